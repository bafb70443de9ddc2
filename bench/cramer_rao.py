"""The Cramer-Rao bound of a trial: how near the truth any unbiased estimate of the object's place can be.

`respond` presses around the test poses; `pose_information` turns that into Fisher information on a small move of the
object in its own frame, (x mm, y mm, turn rad) about its origin: in these terms it depends on the press alone, and the
mean square displacement of the object's points is x^2 + y^2 + (I/m) turn^2. The information of a trial is the sum of
that of its readings, and its inverse bounds the covariance of the move. What is scored is a mean distance, so the bound
is the mean length of a Gaussian of that covariance, the turn weighted by the root of I/m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.config import STILL, Slip
from tactsim.bench.placement import Properties, properties
from tactsim.bench.score import Scored, mean_where, nones
from tactsim.bench.trials import Progress, Trials, silent
from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray, invert
from tactsim.core.provenance import had_another_shape
from tactsim.core.scan import Scan
from tactsim.core.workers import process_map
from tactsim.models import Letter
from tactsim.press.press_model import PressModel, check_flat
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import letters_of
from tactsim.press.sensor import EFFECTS, Frames, SensorOptions, gains, take
from tactsim.press.touches import Touches, log_spread

# Steps of the differences where nothing is misplaced: mm and rad, far below the point spread and far above rounding.
SMALL = (0.02, 0.02, 0.002)


@dataclass(frozen=True, eq=False)
class Response:
    """Ideal readings of n presses and their first derivatives.

    mean: (n, taxels) kPa, pressed as stated. by_pose: (n, taxels, 3) kPa per mm, mm and rad of sensor_in_object.
    unknown: (n, taxels, k) kPa, what one standard deviation of each unknown of a press changes: its placement in
    x, y and angle, its tilt about either axis, and its load.
    """

    mean: FloatArray
    by_pose: FloatArray
    unknown: FloatArray


def respond(letter: Letter, poses: FloatArray, options: ScanOptions) -> Response:
    """Press a letter at poses (n, 3) and around them: central differences over one standard deviation.

    A step as long as the placement error takes the mean slope over what the press may really be (statistical
    linearisation), where a slope at a point would see an edge of the contact or miss it.
    Raises UnsettledError if a press does not come to rest.
    """
    placement = np.array([options.placement_mm, options.placement_mm, options.placement_rad])
    steps = np.where(placement > 0, placement, SMALL)
    tilt, load = options.placement_tilt, log_spread(options.load_spread)
    shifts = [(row, np.zeros(2), 0.0) for row in np.diag(steps)]
    if tilt:
        shifts += [(np.zeros(3), row, 0.0) for row in tilt * np.eye(2)]
    if load:
        shifts.append((np.zeros(3), np.zeros(2), load))
    stated = np.tile((options.press.tilt_x, options.press.tilt_y), (len(poses), 1))
    pressed = [(poses, stated, np.ones(len(poses)))]
    for of_pose, of_tilt, of_load in shifts:
        for sign in (1, -1):
            force = np.full(len(poses), math.exp(sign * of_load))
            pressed.append((poses + sign * of_pose, stated + sign * of_tilt, force))
    where, tilts, force = (np.concatenate(parts) for parts in zip(*pressed, strict=True))
    ideal = _ideal(Touches(letter, where, tilts, load=options.test_load * force), options)
    at = Frames(gains(options), options.pad.rows, np.ones((1, len(ideal)), dtype=int))
    readings = take(
        ideal[None], options.sensor, at, [], [effect for effect in EFFECTS if effect.facts.learned]
    )
    mean, *around = readings.reshape(len(pressed), len(poses), -1)
    half = np.stack([(up - down) / 2 for up, down in zip(around[::2], around[1::2], strict=True)], axis=-1)
    by_pose = half[..., :3] / steps
    return Response(mean, by_pose, np.concatenate([by_pose * placement, half[..., 3:]], axis=-1))


def is_quick(letter: Letter, options: ScanOptions) -> bool:
    """Tell whether the forward model presses this letter, in some 10 us a press; if not, an engine does, in 0.5 ms."""
    try:
        check_flat(letter, options)
    except InputError:
        return False
    return True


def _ideal(touches: Touches, options: ScanOptions) -> FloatArray:
    """Press without imperfections (n, taxels): by the forward model where it can, else by the scan's engine."""
    if not is_quick(touches.letter, options):
        from tactsim.press.engine import ideal_readings  # brings MuJoCo

        return ideal_readings(touches, options)[0]
    loads = touches.forces(options.press.force)
    readings = np.empty((len(touches), options.pad.taxels))
    for load in np.unique(loads).tolist():
        rows = loads == load
        press = options.press.model_copy(update={"force": load})
        model = PressModel([touches.letter], options.model_copy(update={"press": press}))
        tilts = touches.tilts[rows] - (options.press.tilt_x, options.press.tilt_y)
        readings[rows] = model.readings(touches.letter.name, touches.poses[rows], tilts)
    return readings


def noise_variance(sensor: SensorOptions) -> float:
    """Give the variance of a taxel that knows the press, kPa^2: noise, and rounding to steps (step^2 / 12).

    A share q of taxels that tell nothing counts as variance / (1 - q). That is the information of one who knows which
    they are, or more (information is concave in the taxels' precisions), so that a bound stays one. What else an effect
    does takes nothing away.

    Raises InputError for a sensor that is not a reading plus noise: with lag, ghosting, all taxels random, or no noise.
    """
    kept = 1.0
    for effect in EFFECTS:
        if effect.facts.mixes and effect.acts(sensor):
            raise InputError(
                f"the bound does not know sensor.{effect.facts.name}, which mixes {effect.facts.mixes}; leave it out"
            )
        kept *= effect.kept(sensor)
        if not kept:
            raise InputError(f"with sensor.{effect.facts.name} = 1 a reading says nothing; give less")
    variance = sum(effect.variance(sensor) for effect in EFFECTS)
    if not variance:
        raise InputError("without noise and resolution nothing bounds the error; give sensor.noise")
    return variance / kept


def object_slopes(by_pose: FloatArray, poses: FloatArray) -> FloatArray:
    """Turn slopes by sensor_in_object (n, taxels, 3) into slopes by a small move of the object's frame.

    A move m of the frame makes sensor_in_object exp(m) sensor_in_object: x + m_x - m_t y, y + m_y + m_t x, theta + m_t.
    """
    move = np.tile(np.eye(3), (len(poses), 1, 1))
    move[:, 0, 2], move[:, 1, 2] = -poses[:, 1], poses[:, 0]
    return by_pose @ move


def pose_information(response: Response, poses: FloatArray, sensor: SensorOptions) -> FloatArray:
    """Compute the information of n readings, (n, 3, 3).

    Noise is Gaussian, and what is unknown of a press counts linearly. So this is H' S^-1 H (Kay 1993, section 3.9), S
    being the noise on the diagonal plus an outer product for each unknown. Its own change with the pose is left out.
    """
    slopes = np.concatenate([object_slopes(response.by_pose, poses), response.unknown], axis=2)
    every = slopes.swapaxes(1, 2) @ slopes / noise_variance(sensor)
    # Of pose and unknowns together, each of the k unknowns being normal with variance 1, what is left on the pose.
    pose, shared, unknown = every[:, :3, :3], every[:, 3:, :3], every[:, 3:, 3:]
    return pose - shared.swapaxes(1, 2) @ np.linalg.solve(unknown + np.eye(unknown.shape[1]), shared)


# A trial of an object at rest counts as determined by its readings if its bound is at most this. Beyond, what is known
# beforehand and what was not touched say more than the slopes of the readings: the bound is then the prior's.
MOST_MM = 0.5
FARTHEST_MM = 1000.0  # the bound where readings determine nothing: no object is lost by more
_LOGS = np.arange(-80.0, 80.5, 0.5)  # nodes of the integral in `mean_length`


def bound_mm(information: FloatArray, of: Properties) -> FloatArray:
    """Bound the mean placement error (...,) mm by the inverse of information (..., 3, 3) on an object's small move.

    A disc has no turn. Where the information is singular the bound is FARTHEST_MM, as it is beyond.
    """
    weights = np.array([1.0, 1.0, np.sqrt(of.inertia_over_mass)])[: 2 if of.symmetry == 0 else 3]
    size = len(weights)
    eigen = np.linalg.eigvalsh(information[..., :size, :size] / weights[:, None] / weights)
    # Rounding leaves some 1e-16 of the largest where there is nothing.
    whole = eigen[..., 0] > 1e-12 * np.maximum(eigen[..., -1], 1e-300)
    result = np.full(eigen.shape[:-1], FARTHEST_MM)
    result[whole] = np.minimum(mean_length(1 / eigen[whole]), FARTHEST_MM)
    return result


def walked(information: FloatArray, turns: FloatArray, walk_mm: float, walk_rad: float) -> FloatArray:
    """Sum information (n, r, 3, 3) of readings of an object that takes a random step before each but the first.

    Between two touches what is known of the last place becomes J' = (J^-1 + Q)^-1 = (1 + J Q)^-1 J, Q being the
    covariance of a step, and each reading adds its own: the recursion of Tichavsky, Muravchik and Nehorai (IEEE Trans.
    Signal Processing 46(5), 1998, eq. 21). Without a step this is the sum.

    turns: (n, r) rad, by which the object's frame turned before each touch; J is in that frame.
    """
    step = np.diag([walk_mm**2, walk_mm**2, walk_rad**2])
    result = np.array(information)
    for touch in range(1, information.shape[1]):
        cos, sin = np.cos(turns[:, touch]), np.sin(turns[:, touch])
        back = np.tile(np.eye(3), (len(turns), 1, 1))
        back[:, 0, 0], back[:, 0, 1], back[:, 1, 0], back[:, 1, 1] = cos, -sin, sin, cos
        before = back.swapaxes(1, 2) @ result[:, touch - 1] @ back
        left = np.linalg.solve(np.eye(3) + before @ step, before)
        result[:, touch] += (left + left.swapaxes(1, 2)) / 2
    return result


def mean_length(variances: FloatArray) -> FloatArray:
    """Compute the mean length (...,) of a Gaussian vector with these variances (..., k) along its principal axes.

    E sqrt(Q) = 1 / (2 sqrt(pi)) int_0^inf (1 - E exp(-t Q)) t^(-3/2) dt, and for a Gaussian E exp(-t Q) is the product
    of (1 + 2 t v)^(-1/2) over the variances v. With t = exp(u) / sum(v) the trapezoid rule is exact to 1e-9.
    """
    total = variances.sum(axis=-1)
    t = np.exp(_LOGS)
    share = variances / total[..., None]
    decay = -0.5 * np.log1p(2 * share[..., None] * t).sum(axis=-2)
    integral = (-np.expm1(decay) / np.sqrt(t)).sum(axis=-1) * (_LOGS[1] - _LOGS[0])
    return np.sqrt(total) * integral / (2 * np.sqrt(np.pi))


def scan_bounds(
    scan: Scan, trials: Trials, slip: Slip = STILL, *, jobs: int = 1, progress: Progress = silent
) -> FloatArray:
    """Bound the mean placement error of every trial on a scan after each reading, (n, r) mm.

    slip: how the objects moved, a random walk at most; the bound knows of it, and the error is that of the place at the
    last touch. jobs, progress: see `scan_information`. Raises InputError for another motion, and as that does.
    """
    check_motion(slip)
    information, objects = scan_information(scan, jobs=jobs, progress=progress), properties(scan)
    result = np.empty(trials.touch_index.shape)
    for letter in np.unique(trials.truth).tolist():
        rows = trials.truth == letter
        # robot_in_object turns the other way than the object.
        turns = -np.diff(trials.true_pose[rows, :, 2], axis=1, prepend=trials.true_pose[rows, :1, 2])
        summed = walked(information[letter][trials.touch_index[rows]], turns, slip.walk_mm, slip.walk_rad)
        result[rows] = bound_mm(summed, objects[letter])
    # An ended trial knows no more than after its last touch.
    last = np.minimum(trials.taken.cumsum(axis=1), trials.touches[:, None]) - 1
    result = np.take_along_axis(result, last, axis=1)
    if slip.still:  # readings of other poses do not add up
        result[np.ptp(trials.true_pose, axis=1).any(axis=1)] = np.inf
    return result


@lru_cache(maxsize=8)  # the runs of a report share scans
def scan_information(scan: Scan, *, jobs: int = 1, progress: Progress = silent) -> dict[str, FloatArray]:
    """Work out the Fisher information of every test reading on where the object lies.

    Returns {letter: (n, 3, 3)}, of the letter's test readings in the scan's order. jobs: processes; the result does not
    depend on them. progress("bound", done, total) is called as letters are done.
    Raises InputError if the scan does not say how it was pressed, or if its sensor is none that `noise_variance` knows.
    """
    options = stated_options(scan)
    noise_variance(options.sensor)
    letters = pressed_letters(scan, options)
    tasks = [(letter, scan.where("test", name).poses, options) for name, letter in letters.items()]
    found: dict[str, FloatArray] = {}
    with process_map(min(jobs, len(tasks))) as mapped:
        for name, information in zip(letters, mapped(_of_letter, tasks), strict=True):
            found[name] = information
            progress("bound", len(found), len(letters))
    return found


def _of_letter(task: tuple[Letter, FloatArray, ScanOptions]) -> FloatArray:
    letter, poses, options = task
    return pose_information(respond(letter, poses, options), poses, options.sensor)


def check_motion(slip: Slip) -> None:
    """Raise InputError if the bound does not know how the objects moved."""
    if slip.jump_mm or slip.jump_rad or slip.drift_mm or slip.drift_rad:
        raise InputError("the bound knows objects that lie still or walk at random, without jump or drift")


def stated_options(scan: Scan) -> ScanOptions:
    """Take from a scan how it was pressed. Raises InputError if it does not say, as a real pad's does not."""
    stated = scan.meta.get("options")
    if not isinstance(stated, dict):
        raise InputError(
            "the readings do not say how they were pressed, so nothing bounds their error; "
            "give readings of `bench scan`, or the options of the press"
        )
    return checked(ScanOptions, stated, "scan: meta.options")


def pressed_letters(scan: Scan, options: ScanOptions) -> dict[str, Letter]:
    """Build the letters that a scan says it pressed. Raises InputError if one is not there or has another shape."""
    found = {letter.name: letter for letter in letters_of(options)}
    for name in scan.letters:
        if name not in found or had_another_shape(scan.meta, name, found[name].digest):
            raise InputError(f"the scan pressed another letter {name!r} than the one that is known here")
    return {name: found[name] for name in scan.letters}


ENOUGH = 0.9  # share of the trials that readings must determine for a mean bound to be stated
_STEPS = 3.0  # rms steps of an object, which a few readings that touch nothing leave unknown


def bounds_of_trials(scan: Scan, trials: Trials, explore: str, slip: Slip) -> tuple[FloatArray | None, str]:
    """Bound the mean placement error of trials after each reading, (n, r) mm, by what their readings tell.

    Returns None and why, if nobody knows: the readings do not say how they were pressed, only a slow engine presses
    them (`bench bound` does), they were chosen or pressed on demand, or the object moved otherwise than by a random
    walk.
    """
    if explore != "random":
        return None, "touches pressed on demand" if explore == "blind" else "the estimator chose the readings"
    if slip.still and (trials.true_pose != trials.true_pose[:, :1]).any():
        return None, "the object moved"
    try:
        options = stated_options(scan)
        if not all(is_quick(letter, options) for letter in pressed_letters(scan, options).values()):
            return None, "these letters take long to press; `bench bound` works it out"
        return scan_bounds(scan, trials, slip), ""
    except InputError as error:
        return None, str(error)


def bound_curves(bounds: FloatArray, scored: Scored) -> dict[str, list[float | None]]:
    """Average bounds (n, r) over the trials that are determined by their readings, by reading.

    bound_mm: the mean. determined: the share of such trials. efficiency: the mean error of those whose letter is known
    and right, over the mean bound of the same trials. Before ENOUGH of the trials are determined the bound is the
    prior's, and bound_mm and efficiency are None.
    """
    trials = scored.trials
    counted = stated(bounds, trials)
    named = counted & trials.named & ~np.isnan(scored.error)
    errors, their_bounds = (np.where(named, values, 0).sum(axis=0) for values in (scored.error, bounds))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = errors / their_bounds
    return {
        "bound_mm": list(mean_where(bounds, counted)),
        "determined": determined(bounds, trials).mean(axis=0).tolist(),
        "efficiency": list(nones(ratio)),
    }


def stated(bounds: FloatArray, trials: Trials) -> NDArray[np.bool_]:
    """Tell which trials a mean bound is of: those that are determined, at readings that determine ENOUGH of them.

    bounds: (n, r) mm, or (n,) at one reading.
    """
    counted = determined(bounds, trials)
    return counted & (counted.mean(axis=0) >= ENOUGH)


def determined(bounds: FloatArray, trials: Trials) -> NDArray[np.bool_]:
    """Tell which trials are determined by their readings, so that the bound is not the prior's."""
    return bounds <= determined_below_mm(trials)


def determined_below_mm(trials: Trials) -> float:
    """Give the bound, mm, from which on a trial counts as determined: larger where objects move in steps."""
    steps = np.diff(invert(trials.true_pose)[..., :2], axis=1)
    return max(MOST_MM, _STEPS * float(np.sqrt((steps**2).sum(axis=-1).mean()))) if steps.size else MOST_MM
