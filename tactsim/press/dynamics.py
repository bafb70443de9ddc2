"""Press letters through time under force control: approach, touch, settle.

The carriage is velocity-driven, and its velocity follows the error of the measured contact force. This is
"damping control" (Whitney, Force feedback control of manipulator fine motions, J. Dyn. Sys. Meas. Control
99(2), 1977), the oldest form of admittance control:

    wanted velocity  w = G (F_set - f)           G: admittance, f: measured contact force
    motor force      u = f + D (w - v)           D: gain of the velocity servo, v: measured velocity

On a layer of stiffness K the carriage of mass m then obeys m z'' + D z' + (1 + a) K z = (1 + a) F_set with
1 + a = D G. D and G are chosen so that both poles lie at -rate:

    rate = sqrt((1 + a) K / m),    D = 2 m rate,    G = (1 + a) / D

So neither touch nor a step of the set point overshoots, as long as the carriage touches at a speed of at
most G F_set. With a = 1 measured force halves the mass that the layer feels; a < 0 would be positive
feedback of force, which a step longer than sqrt(m / K) makes unstable.

The controller knows the mass, and as K the layer's stiffness under the whole contact, which is the most that
it can meet: where only a part touches, the loop is slower and better damped. It is ideal otherwise: force and
velocity are measured without noise and delay.

The scene is that of the equilibrium, but time steps are short, the letter has its real mass, and the layer
is that of Hunt and Crossley (Coefficient of restitution interpreted as damping in vibroimpact, J. Appl. Mech.
42(2), 1975) with exponent 1, as a bed of springs asks for: f = k A d (1 + c v), never below 0. Its damping is
in proportion to the depth d, so force begins at 0 at touch, and the layer does not stick. The first part of this
file says how the carriage is driven.

Each step is implicit (see `scene`): the spring is taken at the end of the step, and so is the velocity of the
damper, while the damper's depth is that which the step's first velocity leads to. How long steps are follows
from the rate of the controlled contact.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, islice, pairwise
from typing import Any

import mujoco
import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.npz import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream
from tactsim.press.bed import MM, Bed, Springs, lay_bed, levels
from tactsim.press.scan_options import CLEARANCE, PressOptions, ScanOptions
from tactsim.press.scene import Scene, Setup, scene
from tactsim.press.sensor import gains, sense
from tactsim.press.spread import Patches
from tactsim.press.touches import Pressed, Touches, UnsettledError, unsettled

_FEEDBACK = 1.0  # a above
_TOUCH = 0.25  # share of the force that is the set point at touch, and so sets the speed of touch
# Most that the layer's damping may add to its force, as a share, by the carriage's speed in contact.
_DAMPED = 1.0
_BRAKING = 100.0  # 1/s: most by which the speed of approach falls with the distance that is left
_BRAKING_SHARE = 1 / 8  # and as a share of the servo's rate, which must follow


@dataclass(frozen=True)
class ForceControl:
    """A controller designed for a mass (kg), a stiffness (N/m) and a force (N); see the module's docstring.

    rate: 1/s. servo: N s/m, the gain D. admittance: m/s per N, the gain G. approach_speed, contact_speed: m/s, the most
    before and after touch. touch_speed: m/s. braking: 1/s. force: N. ramp: s, from touch to the full set point.
    """

    mass: float
    rate: float
    servo: float
    admittance: float
    approach_speed: float
    contact_speed: float
    touch_speed: float
    braking: float
    force: float
    ramp: float

    @classmethod
    def designed(
        cls,
        mass: float,
        stiffness: float,
        *,
        force: float,
        approach_speed: float,
        ramp: float,
        dissipation: float,
    ) -> ForceControl:
        """Choose the gains.

        approach_speed: m/s, the most at which the carriage is driven. dissipation: s/m, of the layer; in
        contact the carriage is driven so slowly that damping at most doubles the layer's force.
        """
        rate = math.sqrt((1 + _FEEDBACK) * stiffness / mass)
        servo = 2 * mass * rate
        admittance = (1 + _FEEDBACK) / servo
        contact_speed = min(approach_speed, _DAMPED / dissipation) if dissipation else approach_speed
        return cls(
            mass=mass,
            rate=rate,
            servo=servo,
            admittance=admittance,
            approach_speed=approach_speed,
            contact_speed=contact_speed,
            touch_speed=min(contact_speed, _TOUCH * admittance * force),
            braking=min(_BRAKING, _BRAKING_SHARE * servo / mass),
            force=force,
            ramp=ramp,
        )

    def approach(self, distance: float, step: float) -> float:
        """Give the wanted velocity, m/s, for the next `step` s, `distance` m before the touch.

        It falls with the distance to the touch speed; over the step it is that of the step's middle.
        """
        middle = (self.touch_speed + self.braking * max(distance, 0.0)) / (1 + self.braking * step / 2)
        return min(self.approach_speed, max(middle, self.touch_speed))

    def set_point(self, elapsed: float, touch_velocity: float) -> float:
        """Give the wanted force, N, `elapsed` s after the letter touched at `touch_velocity` m/s.

        It begins where the wanted velocity is that of the touch, and rises smoothly to the whole force.
        """
        first = min(max(touch_velocity, 0.0) / self.admittance, self.force)
        share = min(elapsed / self.ramp, 1.0) if self.ramp else 1.0
        return first + (self.force - first) * share * share * (3 - 2 * share)

    def contact(self, set_point: float, measured: float) -> float:
        """Give the wanted velocity, m/s, from the wanted and the measured force, N."""
        return max(-self.contact_speed, min(self.contact_speed, self.admittance * (set_point - measured)))

    def motor_force(self, wanted: float, velocity: float, measured: float, step: float) -> float:
        """Give the motor's force, N, for the next `step` s.

        wanted, velocity: m/s. measured: contact force, N. The servo's gain is that of a sampled controller:
        without contact the velocity error falls by exp(-D step / m) exactly, at any step.
        """
        gain = self.mass * -math.expm1(-self.servo / self.mass * step) / step
        return measured + gain * (wanted - velocity)


# share of the force that contacts may miss, and by which they may change while they are at rest
_SETTLED = 2e-4
_REST = 0.02  # s for which they do; or so many time constants of the controlled contact, if that is longer
_REST_CONSTANTS = 2.0
_BAND = 0.02  # share of the force: a press has settled once it stays within
# Steps, in time constants (1 / rate) of the controlled contact: at touch, and later. They grow from one to the other.
_TOUCH_STEP = 0.1
_LATER_STEP = 0.4
_LAG = 0.02  # share of the ramp by which the set point may be followed late: a long step h lags by h^2 rate
_TOUCH_CONSTANTS = 3.0  # time constants after a touch before they grow
_GROWTH = 1.1
_APPROACH_STEP = 0.15  # in time constants of braking
_RAMP_STEPS = 25  # at least
_DISSIPATION = 0.1  # s/mm, Hunt and Crossley's c of the layer (assumed)
_WRIST_RELAXATION = 0.005  # s, damping over stiffness of the hinges (assumed)


@dataclass(frozen=True, eq=False)
class ForceTrace:
    """The force over a press, at the end of every time step.

    times: (steps,) s since the letter began to move. force, set_point: (steps,) N, of all contacts and as
    wanted. touch_time: s, when it first touched. settle_time: s from the touch until the force stays within
    2 % of the set force.
    """

    times: FloatArray
    force: FloatArray
    set_point: FloatArray
    touch_time: float
    settle_time: float

    @property
    def overshoot(self) -> float:
        """Give the most by which the force was above the set force, as a share of it; 0 if it never was."""
        return max(0.0, float(self.force.max() / self.set_point[-1]) - 1)


@dataclass(frozen=True, eq=False)
class History:
    """Contact forces over a press; the last frame is at rest.

    times: (frames,) s since the letter began to move. forces: (frames, contacts) N.
    """

    times: FloatArray
    forces: FloatArray
    trace: ForceTrace


@dataclass(frozen=True, eq=False)
class Moving:
    """The images of one press through time, (frames, taxels) kPa at times (frames,) s, and its force."""

    times: FloatArray
    images: FloatArray
    trace: ForceTrace


@dataclass(frozen=True, eq=False)
class Moved:
    """How n presses went; None where nothing touches and in a blank."""

    presses: list[Moving | None]

    def readings(self, options: ScanOptions) -> FloatArray:
        """Give the last images, (n, taxels) kPa without imperfections but hysteresis, which the way to rest decides."""
        readings = np.zeros((len(self.presses), options.pad.taxels))
        for reading, moving in zip(readings, self.presses, strict=True):
            if moving is not None:
                reading[:] = hysteretic(moving.images, options.sensor.hysteresis)[-1]
        return readings


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Step every press through time. Raises InputError for what cannot be stepped."""
    presses: list[Moving | None] = [None] * len(touches)
    blanks = {}
    for index in range(len(touches)):
        try:
            presses[index] = ideal_sequence(touches.some(slice(index, index + 1)), options)
        except UnsettledError as error:
            blanks[index] = str(error.__cause__)
    untouched = presses.count(None) - len(blanks)
    work = Counter(presses=len(touches) - untouched, no_contact=untouched)
    return Pressed(touches, Moved(presses), work, blanks)


def _bed(touches: Touches, options: ScanOptions) -> Bed:
    """Lay the bed of presses that are stepped through time. Raises InputError for what cannot be."""
    if options.press.engine != "auto":
        raise InputError(
            f"press.engine: {options.press.engine} works out presses at rest; with dynamics = full give auto"
        )
    return lay_bed(levels(touches.letter, options.press), touches.poses, *options.cell_lines)


def contact_history(
    bed: Bed, touches: Touches, index: int, options: ScanOptions, *, step_share: float = 1.0
) -> History:
    """Step press `index` through time until it rests; `bed` is of all presses.

    step_share: of the steps that follow from stiffness, mass and force control, to show that these are short enough.
    Raises UnsettledError if it does not rest.
    """
    press, springs = options.press, bed.springs[index]
    stage = scene(Setup(press.moving_mass, press.wrist_stiffness), len(springs.share), touches.tilts[index])
    force = float(touches.forces(press.force)[index])
    return _press_through_time(stage, springs, press.model_copy(update={"force": force}), step_share)


def _even(bed: Bed, forces: FloatArray) -> Patches:
    """Spread each contact's force evenly over its part."""
    return Patches(bed, forces / bed.area)


def ideal_sequence(touches: Touches, options: ScanOptions) -> Moving | None:
    """Press a letter once, through time: its images, or None where nothing touches.

    The last image is at rest and is the ideal reading.
    Raises UnsettledError, naming letter and pose, if the press does not come to rest.
    """
    bed = _bed(touches, options)
    if not bed.area.any():
        return None
    try:
        history = contact_history(bed, touches, 0, options)
    except UnsettledError as error:
        raise unsettled(touches.letter.name, touches.poses[0], str(error)) from error
    images = _even(bed.repeat(len(history.times)), history.forces.ravel()).readings(options)
    return Moving(history.times, images, history.trace)


def _press_through_time(stage: Scene, springs: Springs, options: PressOptions, step_share: float) -> History:
    """Press against `springs` until force and contacts have settled.

    Raises UnsettledError if they have not at the time limit.
    """
    count, force = len(springs.share), options.force
    stiffness = options.stiffness_over(springs.area)
    dissipation = _DISSIPATION / MM
    control = ForceControl.designed(
        stage.setup.mass,
        stiffness * springs.area,
        force=force,
        approach_speed=options.approach_speed * MM,
        ramp=options.ramp,
        dissipation=dissipation,
    )
    shortest, longest, in_approach = (step_share * step for step in _steps(control, options.ramp))
    touch_depth = stage.depth_of_touch(springs).min()
    stage.set_springs(springs, stiffness, step=shortest)
    stage.reset(touch_depth - CLEARANCE * MM)
    stage.model.opt.tolerance = 1e-10
    data = stage.data
    now, measured, step, settled_at = 0.0, 0.0, shortest, 0.0
    touched: float | None = None
    touch_velocity = 0.0
    rest_from, rest_forces = math.inf, np.zeros(count)
    rest = max(_REST, _REST_CONSTANTS / control.rate)
    times: list[float] = []
    frames: list[FloatArray] = []
    trace: list[tuple[float, float, float]] = []
    while now < options.time_limit:
        velocity = float(data.qvel[0])
        if touched is None:
            distance = touch_depth - float(data.qpos[0])
            set_point = wanted = 0.0
            # Half of what is left at most, so that a long step does not carry it far into the layer.
            left = distance / max(velocity, control.touch_speed)
            step = min(in_approach, max(shortest, step_share * left / 2))
        else:
            set_point = control.set_point(now - touched, touch_velocity)
            wanted = control.contact(set_point, measured)
            if now - touched > _TOUCH_CONSTANTS / control.rate:
                # Over a long step the force that the motor makes up for is an old one. At full speed nothing else
                # corrects that.
                limited = abs(wanted) == control.contact_speed
                step = min(step * _GROWTH, shortest * _LATER_STEP / _TOUCH_STEP if limited else longest)
        frame_at = (len(times) + 1) / options.frame_rate
        steps = math.ceil((frame_at - now) / step)
        taken = (frame_at - now) / steps
        if touched is None:
            wanted = control.approach(distance, taken)
        data.qfrc_applied[0] = control.motor_force(wanted, velocity, measured, taken)
        depth = np.maximum(stage.depths(springs) + taken * velocity, 0.0)
        stage.set_step(
            springs,
            stiffness,
            step=taken,
            bed_relaxation=dissipation * depth,
            hinge_relaxation=_WRIST_RELAXATION,
        )
        stage.check_position()
        mujoco.mj_step(stage.model, data)
        now = frame_at if steps == 1 else now + taken
        forces = stage.forces(count)
        measured = float(forces.sum())
        if touched is None and measured > 0:
            touched, touch_velocity, step = now, velocity, shortest
        trace.append((now, measured, set_point))
        if abs(measured - force) > _BAND * force:
            settled_at = now
        if abs(measured - force) > _SETTLED * force or np.abs(forces - rest_forces).sum() > _SETTLED * force:
            rest_from, rest_forces = now, forces
        at_rest = now - rest_from >= rest
        if at_rest or steps == 1:
            times.append(now)
            frames.append(forces)
        if at_rest and touched is not None:
            ends, total, aim = np.array(trace).T
            return History(
                np.array(times),
                np.array(frames),
                ForceTrace(ends, total, aim, touched, max(settled_at - touched, 0.0)),
            )
    state = "has not touched" if touched is None else f"carries {measured:g} N of {force:g} N"
    raise UnsettledError(f"after {options.time_limit:g} s it {state}; a longer time_limit may help")


def _steps(control: ForceControl, ramp: float) -> tuple[float, float, float]:
    """Choose the steps, s: the shortest, the longest in contact and the longest in approach."""
    longest = max(_LATER_STEP / control.rate, math.sqrt(_LAG * ramp / control.rate))
    if ramp:
        longest = min(longest, ramp / _RAMP_STEPS)
    shortest = min(_TOUCH_STEP / control.rate, longest)
    approach = max(shortest, _APPROACH_STEP / control.braking)
    return shortest, longest, approach


def hysteretic(images: FloatArray, share: float) -> FloatArray:
    """Let the images of one touch depend on how they came about: (images, taxels) kPa.

    images: (images, taxels) kPa, from before the touch on. share: `SensorOptions.hysteresis`.

    Preisach's model (I. D. Mayergoyz, Mathematical Models of Hysteresis, 1991) with Everett's function
    E(a, b) = (b - a) (1 - 4 share a / b): a load that has only risen is read as it is; one that falls from
    b to a is read as b - E(a, b), at most share * b too high (at half the load) and right again at 0. A small
    loop within closes, and is forgotten when the load leaves it.
    """
    if not share:
        return images
    result = images.copy()
    for taxel in np.flatnonzero((np.diff(images, axis=0) < 0).any(axis=0)):
        # Loads where the course turned and what has not been wiped out: low, high, low, ..., now
        turns = [0.0]
        for index, load in enumerate(images[:, taxel].tolist()):
            _follow(turns, max(load, 0.0))
            result[index, taxel] = sum(
                (high - low) * (1 - 4 * share * low / high) * (1 if after > before else -1)
                for before, after in pairwise(turns)
                for low, high in [sorted((before, after))]
            )
    return result


def _follow(turns: list[float], load: float) -> None:
    """Go on to `load`, and forget the turns of the loops that close on the way."""
    rising = len(turns) % 2 == 0
    if (load >= turns[-1]) == rising or load == turns[-1]:
        turns[-1] = load
    else:
        turns.append(load)
    while len(turns) > 2:
        rising = len(turns) % 2 == 0
        if not (load >= turns[-3] if rising else load <= turns[-3]):
            break
        del turns[-3:-1]


def sequences(
    batches: Sequence[tuple[str, str]], pressed: Sequence[Sequence[Moving | None]], options: ScanOptions
) -> dict[str, Any]:
    """Sense the images of presses; each batch, of a letter and a split, has a random stream for them of its own.

    The zero drifts from press to press, so images on the way to one reading have no drift of their own. Returns what
    `Scan` calls sequence, sequence_times and sequence_force.
    """
    images, times, force = _aligned(list(chain(*pressed)), options.press.frame_rate, options.pad.taxels)
    gain, sensor = gains(options), options.sensor.model_copy(update={"drift": 0.0})
    left = iter(images)
    for (name, split), presses in zip(batches, pressed, strict=True):
        rng = stream(options.seed, name, split, "sequence")
        for image in islice(left, len(presses)):
            image[:] = sense(image, sensor, gain, rng, rows=options.pad.rows, one_touch=True)
    return {"sequence": images, "sequence_times": times, "sequence_force": force}


def _aligned(
    presses: Sequence[Moving | None], frame_rate: float, taxels: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bring presses to common times: images (n, frames, taxels) kPa, times (frames,) s, force (n, frames) N.

    Times are k / frame_rate until the last press rests; a press at rest keeps its last image. Where nothing
    touched, all is 0. Raises InputError if the images would take more than a scan's file may hold.
    """
    frames = max([1, *(len(moving.times) for moving in presses if moving is not None)])
    size = 4 * len(presses) * frames * taxels
    if size > LARGEST // 2:
        raise InputError(
            f"{len(presses):,} presses of {frames:,} images are {size:,} bytes, more than a scan's "
            f"{LARGEST // 2:,}; choose a lower press.frame_rate or fewer letters"
        )
    times = np.arange(1, frames + 1) / frame_rate
    images, force = np.zeros((len(presses), frames, taxels)), np.zeros((len(presses), frames))
    for image, total, moving in zip(images, force, presses, strict=True):
        if moving is not None:
            before = len(moving.times) - 1
            image[:before], image[before:] = moving.images[:-1], moving.images[-1]
            total[:] = np.interp(times, moving.trace.times, moving.trace.force)
    return images, times, force
