"""Validate the simulation against a recording: readings, sensor parameters, recognition."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from tactsim.bench.config import RunConfig, merged
from tactsim.bench.experiment import perform
from tactsim.bench.intervals import wilson
from tactsim.bench.pad.alignment import check_labels_apart, refuse_presses
from tactsim.bench.runs.figures import BLUE, SOFT, Picture
from tactsim.bench.trials import Progress
from tactsim.core import InputError, Scan
from tactsim.core.checking import checked
from tactsim.core.idle import find_idle
from tactsim.core.making import train_on
from tactsim.core.poses import FloatArray, compose
from tactsim.estimators import create
from tactsim.hardware.cutting import taxel_grid
from tactsim.hardware.sensor_fit import Guess, SensorFit, fit_sensor, noise_of
from tactsim.hardware.taxel_fit import TaxelError, best_gain, taxel_error, untouched
from tactsim.hardware.terminal_pictures import SEEN
from tactsim.models.letter import Letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.engine import press_at
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import letters_of, scan_letters
from tactsim.press.touches import Pressed, Touches

ROWS = {
    "as_it_is": "simulation as it is",
    "one_gain": "times one gain",
    "fitted": "fitted, on what it was fitted to",
    "held_out_placed": "held out, placed by its reading",
    "held_out": "held out, placed as stated",
}

_MOST_TAXELS = 9000  # in all presses that a fit uses: more cost time, and change an interval little
_FEWEST_PRESSES = 60
_FOLDS = 10
_ALIKE = 0.99  # correlation of two presses at one pose, from which on they are one press for a fit
TOUCHES = (1, 2, 3, 5, 10)  # after which the share right is shown
_MOST_TOUCHES = 20
_RIGHT = 0.95


_FORCE_ALONE = (0.1, 10.0)  # a gain within is an error of the force; one beyond it is another unit
_CURVED = 0.2  # an exponent so far from 1 tells the pressure that a response reads right
_PRESSURES = (np.log(1e-3), np.log(1e6))  # kPa, its bounds
_DIGITS = 5


_GRAZES = 0.2  # of what most presses feel at most: one that is to feel less is not judged by its picture
# Of what most feel at most; the least cosine with what is pressed in the simulation.
_IDLE, _FITS = 0.05, 0.05
_LEAST_AREA = 0.3  # of a letter's, that is left of it if its outline is moved inwards


@dataclass(frozen=True, eq=False)
class Validation:
    """The result of comparing a simulated and a recorded scan.

    readings: of the recording. steady: sd of a press by its frames alone, where the recording says it. used: those that
    the fit used, and whether they are all training readings; apart: how many are left of them when near copies are
    averaged. unit: of the recording. errors: by the names of ROWS. presses: those that were fitted. outlined: letters
    whose outlines were fitted, in the order of `fit.grown`. recognition: by estimator and what it was trained on, see
    `recognised`. parameters: a world file. clipped: what was
    found beyond its bounds.
    """

    readings: int
    steady: float | None
    used: int
    apart: int
    trained_apart: bool
    unit: str
    letters: tuple[str, ...]
    taxels: int
    errors: dict[str, TaxelError]
    fit: SensorFit
    presses: Scan
    outlined: tuple[str, ...]
    recognition: dict[str, dict[str, dict[str, Any]]]
    parameters: dict[str, Any]
    clipped: dict[str, float]


def validate(
    simulated: Scan,
    recorded: Scan,
    *,
    estimators: Sequence[str] = ("refined", "histogram"),
    options: dict[str, Any] | None = None,
    trials: int = 10,
    seed: int = 0,
    progress: Progress,
) -> Validation:
    """Compare a recorded scan with a simulated one that says how it was made.

    The readings are compared at the recorded poses, which the simulated scan need not have. If the recording has
    training and test presses, the simulation is fitted to the training presses, and recognises the test presses.
    Of a press with several moments the fit takes the last. Near copies of a press are averaged for it
    (`numbers_of_copies`); its noise is that of single presses.
    Raises InputError if the recorded letters or taxels are not in the simulation, for presses that cannot be its own
    (`check_presses`), or for an estimator or option that does not exist.
    """
    for name in estimators:
        create(name, **(options or {}))  # a wrong name or option is reported before the work
    apart = bool(len(recorded.where("train")) and len(recorded.where("test")))
    single = recorded.where("train") if apart else recorded
    if single.moments is not None:  # a lighter moment is no press of its own
        single = single.chosen(single.moments == single.moments.max())
    every = PressesAsRecorded(simulated, single)
    unit = str(recorded.meta.get("unit", "kPa"))
    check_presses(single, every(every.stated, every.level))
    copies = numbers_of_copies(single)
    averaged = means(single, copies)
    chosen = some_presses(averaged)
    few = averaged.chosen(chosen)
    presses = PressesAsRecorded(simulated, few)
    as_it_is = presses(presses.stated, presses.level)
    fit = fit_sensor(
        few.readings, presses, presses.stated, presses.bending(), folds(few), presses.outline,
        lambda done, total: progress("fit", done, total),
    )  # fmt: skip
    fitted = fit.answered(presses(fit.guess, fit.errors))
    used = chosen[copies]
    if used.sum() > len(few):
        expected = fitted[(np.cumsum(chosen) - 1)[copies[used]]]
        fit = replace(fit, noise=noise_of(single.readings[used] - expected, expected))
    predictions = (
        as_it_is, best_gain(few.readings, as_it_is) * as_it_is, fitted, fit.held_out_placed, fit.held_out,
    )  # fmt: skip
    errors = {name: _error(few, predicted) for name, predicted in zip(ROWS, predictions, strict=True)}
    world = fitted_world(presses.options, fit, unit)
    scan_options = checked(ScanOptions, {**world, "seed": seed}, "fitted world")
    fitted_scan, _ = scan_letters(scan_options, progress=lambda done, total: progress("press", done, total))
    # The simulation's numbers stay as they are; without the recording's unit it could not be tested on it.
    trained = {"simulated": replace(simulated, meta={**simulated.meta, "unit": unit}), "fitted": fitted_scan}
    if apart:
        trained["recorded"] = recorded.where("train")
    recognition = {
        name: {
            side: recognised(
                scan, recorded, name, options or {}, trials, seed,
                _part_of(progress, number * len(trained) + part, len(estimators) * len(trained)),
            )
            for part, (side, scan) in enumerate(trained.items())
        }
        for number, name in enumerate(estimators)
    }  # fmt: skip
    return Validation(
        readings=len(recorded),
        steady=steadiness(single),
        used=int(used.sum()),
        apart=len(few),
        trained_apart=apart,
        unit=unit,
        letters=recorded.letters,
        taxels=len(recorded.taxel_xy),
        errors=errors,
        fit=fit,
        presses=few,
        outlined=presses.outlined,
        recognition=recognition,
        parameters=world,
        clipped=clipped(presses.options, fit),
    )


def steadiness(recorded: Scan) -> float | None:
    """Give the sd of a guided session's presses by the noise of their frames alone, kPa; None of other recordings."""
    noise, sessions = recorded.meta.get("frame_noise_kpa"), recorded.meta.get("recordings")
    return float(noise / np.sqrt(sessions[0]["frames_a_press"])) if noise and sessions else None


def recognised(
    train: Scan,
    recorded: Scan,
    estimator: str,
    options: Mapping[str, Any],
    trials: int,
    seed: int,
    progress: Progress,
) -> dict[str, Any]:
    """Train on one scan and recognise the test presses of a recorded one, or all if it has none.

    The same seed gives the same touches whatever was trained on.
    """
    scan = train_on(train.of_letters(recorded.letters), recorded)
    fewest = min(len(scan.where("test", letter)) for letter in scan.letters)
    config = RunConfig(
        estimator=estimator, set=dict(options), trials=trials, readings=min(_MOST_TOUCHES, fewest), seed=seed,
        given=scan.digest,
    )  # fmt: skip
    run = perform(config, scan=scan, progress=progress)
    right = run.trials.right
    accuracy = right.mean(axis=0)
    low, high = wilson(right.sum(axis=0), len(right))
    errors = run.summary["error_mm"]
    return {
        "trials": len(right),
        "touches": config.readings,
        "accuracy": accuracy.tolist(),
        "accuracy_low": low.tolist(),
        "accuracy_high": high.tolist(),
        "touches_to_95": touches_to(accuracy),
        "error_mm": errors[-1],
        "options": run.about["options"],
    }


def touches_to(accuracy: Sequence[float] | NDArray[np.float64]) -> int | None:
    """Count the touches from which on at least 95 % are right, (touches,) accuracy; None if that is never so."""
    below = np.flatnonzero(np.asarray(accuracy) < _RIGHT)
    first = int(below[-1]) + 2 if len(below) else 1
    return first if first <= len(accuracy) else None


def numbers_of_copies(scan: Scan) -> NDArray[np.intp]:
    """Give presses numbers (n,), the same to near copies: of one label and one stated pose, with nearly one picture.

    A robot that presses one place twenty times says once where it is and what it looks like.
    """
    numbers = np.full(len(scan), -1)
    places = np.column_stack([np.unique(scan.labels, return_inverse=True)[1], scan.poses])
    about = scan.readings - scan.readings.mean(axis=1, keepdims=True)
    about /= np.maximum(np.linalg.norm(about, axis=1, keepdims=True), 1e-12)
    for press in range(len(scan)):
        if numbers[press] < 0:
            alike = (places == places[press]).all(axis=1) & (about @ about[press] >= _ALIKE)
            alike[press] = True
            numbers[alike & (numbers < 0)] = numbers.max() + 1
    return numbers


def means(scan: Scan, copies: NDArray[np.intp]) -> Scan:
    """Put the mean of all presses of a number, (n,) `copies`, in the place of the first, and leave out the others."""
    first = np.unique(copies, return_index=True)[1]
    readings = np.array([scan.readings[copies == number].mean(axis=0) for number in range(len(first))])
    return replace(scan.chosen(np.isin(np.arange(len(scan)), first)), readings=readings)


def some_presses(scan: Scan) -> NDArray[np.bool_]:
    """Choose presses (n,) for a fit, evenly from all letters and poses: so many that more would not help."""
    most = max(_FEWEST_PRESSES, _MOST_TAXELS // scan.readings.shape[1])
    if len(scan) <= most:
        return np.ones(len(scan), dtype=bool)
    each = max(1, most // len(scan.letters))
    chosen = []
    for letter in scan.letters:
        rows = np.flatnonzero(scan.labels == letter)
        chosen.append(rows[np.unique(np.linspace(0, len(rows) - 1, min(each, len(rows))).astype(int))])
    return np.isin(np.arange(len(scan)), np.concatenate(chosen))


def folds(scan: Scan) -> NDArray[np.intp]:
    """Put presses (n,) into groups to be held out: letters where there are three or more, else neighbouring positions.

    A press next to one that was fitted says little of the fit.
    """
    if len(scan.letters) >= 3:
        number = {letter: index % _FOLDS for index, letter in enumerate(scan.letters)}
        return np.array([number[letter] for letter in scan.labels.tolist()])
    x, y = (np.argsort(np.argsort(along, kind="stable")) / len(scan) for along in scan.poses[:, :2].T)
    return (np.floor(3 * x) + 3 * np.floor(2 * y)).astype(np.intp)


def _part_of(progress: Progress, number: int, parts: int) -> Progress:
    """Report the trials of one run as its part of those of all, so that the time left is that of all."""

    def report(stage: str, done: int, total: int) -> None:
        if stage == "trials":
            progress("trials", number * total + done, parts * total)

    return report


def _error(recorded: Scan, predicted: FloatArray) -> TaxelError:
    """Compare readings with predicted ones, where a press came to rest."""
    rested = np.isfinite(predicted).all(axis=1)
    return taxel_error(recorded.readings[rested], predicted[rested])


def as_json(result: Validation) -> dict[str, Any]:
    """Put a validation into JSON's types."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, np.ndarray | tuple | list):
            return [plain(inner) for inner in value]
        if isinstance(value, float | np.floating):
            return float(value) if np.isfinite(value) else None
        return int(value) if isinstance(value, np.integer) else value

    whole = asdict(result)
    del whole["presses"]
    for name in ("held_out", "held_out_placed"):
        del whole["fit"][name]  # as large as the recording
    return {key: plain(value) for key, value in whole.items()}


_MOST = 6  # labels of which a press is drawn


def presses_figure(result: Validation) -> Picture:
    """Draw a press of each label, neither the best nor the worst fitted, above what a fit without its group says of it.

    Beside them: all taxels of all presses, recorded against fitted, and how far each taxel is off.
    """
    scan, fitted = result.presses, result.fit.held_out_placed
    off = np.sqrt(np.mean((scan.readings - fitted) ** 2, axis=1))  # NaN where a press tips over
    rested = np.flatnonzero(np.isfinite(off))
    each = [rested[scan.labels[rested] == label] for label in scan.letters]
    shown = [rows[np.argsort(off[rows])[len(rows) // 2]] for rows in each if len(rows)][:_MOST]
    figure = Picture(figsize=(1.5 * len(shown) + 3.6, 3.9), layout="constrained")
    grid = figure.subplots(2, len(shown) + 1, width_ratios=[*(1 for _ in shown), 1.5], squeeze=False)
    most = float(np.nanmax([scan.readings[shown], fitted[shown]]))
    for (above, below), press in zip(grid.T, shown, strict=False):
        title = f"{textwrap.fill(scan.labels[press], 16)}\nrms {off[press]:.3g}"
        above.set_title(title, fontsize=9, parse_math=False)
        for axes, values in ((above, scan.readings), (below, fitted)):
            image = axes.imshow(
                _on_pad(scan.taxel_xy, values[press]), "magma", origin="lower", vmin=0, vmax=most
            )
            axes.set(xticks=[], yticks=[])
    grid[0, 0].set_ylabel("recorded")
    grid[1, 0].set_ylabel("fitted, held out")
    figure.colorbar(image, ax=grid[:, :-1], label=result.unit, location="bottom", aspect=50)
    against, where = grid[:, -1]
    against.plot(fitted, scan.readings, ".", color=BLUE, ms=2, alpha=0.3)
    against.axline((0, 0), slope=1, color=SOFT, lw=0.8)
    against.set_xlabel(f"fitted, held out, {result.unit}", fontsize=8)
    against.set_ylabel(f"recorded, {result.unit}", fontsize=8)
    of_taxel = np.sqrt(np.nanmean((scan.readings - fitted) ** 2, axis=0))
    image = where.imshow(_on_pad(scan.taxel_xy, of_taxel), "viridis", origin="lower", vmin=0)
    where.set(xticks=[], yticks=[])
    where.set_xlabel(SEEN[False], fontsize=8)
    figure.colorbar(image, ax=where).set_label(f"rms of a taxel, {result.unit}", fontsize=8)
    return figure


def _on_pad(taxel_xy: FloatArray, values: FloatArray) -> FloatArray:
    """Lay taxels (n,) out as they lie on the pad, the first row below: (rows, columns), NaN where none is."""
    numbers = taxel_grid(taxel_xy)
    return np.where(numbers < 0, np.nan, values[numbers])


def fitted_world(options: ScanOptions, fit: SensorFit, unit: str) -> dict[str, Any]:
    """Say how a scan reads as the recorded pad does: a world file, with letters, shapes and pad of the simulation.

    Gain and force cannot be told apart by readings alone. Where the response is bent, its pressure takes both, and the
    force is as stated; else the force takes both. A pressure that is larger by one
    factor everywhere has a larger slope, too: tilts grow with it, or, where the gain is that of another unit, layer
    and wrist. A recorded press is a mean of frames; what the mean leaves of the sensor's resolution is part of the
    fitted noise. A response whose interval includes none is left out. What is
    beyond the bounds of a scan's options is put on the nearest bound: `clipped` names it.
    """
    return merged(stated_world(options, unit), _rounded(ScanOptions, _changes(options, fit)))


def stated_world(options: ScanOptions, unit: str) -> dict[str, Any]:
    """Say in TOML's types how a simulation was made, in another unit: what `fitted_world` changes.

    TOML has no null. So a pad without a seam says `no_seam = true`, a wrist that does not give way is "rigid", and
    what else is None has that as its default.
    """
    left_out = {"seed", "test_poses", "test_load"}
    stated = options.model_dump(mode="json", exclude_defaults=True, exclude_none=True, exclude=left_out)
    stated |= {"letters": list(options.letters), "unit": unit}
    if "shapes" in stated:
        stated["shapes"] = [str(Path(path).resolve()) for path in stated["shapes"]]
    if options.pad.seam is None:
        stated["pad"]["no_seam"] = True
    if options.press.wrist_stiffness is None:
        stated["press"]["wrist_stiffness"] = "rigid"
    return stated


def clipped(options: ScanOptions, fit: SensorFit) -> dict[str, float]:
    """Name what was found beyond the bounds of a scan's options, with what was found."""
    changes = _changes(options, fit)
    said = _rounded(ScanOptions, changes)
    pairs = [(changes, said), *((changes[group], said[group]) for group in ("press", "sensor"))]
    return {
        name: value
        for found, put in pairs
        for name, value in found.items()
        if isinstance(value, float) and put[name] != _round(value)
    }


def _changes(options: ScanOptions, fit: SensorFit) -> dict[str, Any]:
    bent = not fit.response_range[0] <= 1 <= fit.response_range[1]
    gain, pressure = fit.gain, fit.gain * fit.typical
    if bent and abs(fit.response - 1) > _CURVED:
        # gain typical (p / typical)^g is p0 (p / p0)^g with this p0.
        logarithm = np.log(fit.typical) + np.log(gain) / (1 - fit.response)
        if _PRESSURES[0] < logarithm < _PRESSURES[1]:
            gain, pressure = 1.0, float(np.exp(logarithm))
    layer = 1.0
    if not _FORCE_ALONE[0] <= gain <= _FORCE_ALONE[1]:
        least = max(1 / fit.stiffness, 1 / fit.wrist if np.isfinite(fit.wrist) else 0.0)
        most = min(1e6 / fit.stiffness, 1e7 / fit.wrist if np.isfinite(fit.wrist) else np.inf)
        layer = float(np.clip(gain, least, most))
    tilt = gain / layer
    tilt_x, tilt_y = (tilt * fit.tilt_offset).tolist()
    # What a response that is left out did to what presses and taxels differ by.
    bend = 1.0 if bent else fit.response
    return {
        "placement_mm": fit.placement_mm,
        "placement_rad": fit.placement_rad,
        "placement_tilt": tilt * fit.placement_tilt,
        "load_spread": bend * fit.load_spread,
        "press": {
            "force": options.press.force * gain,
            "stiffness": layer * fit.stiffness,
            "wrist_stiffness": layer * fit.wrist if np.isfinite(fit.wrist) else "rigid",
            "tilt_x": tilt_x,
            "tilt_y": tilt_y,
        },
        "sensor": {
            "psf_sigma": fit.psf_sigma,
            "response": fit.response if bent else 1.0,
            "response_pressure": pressure,
            "noise": fit.noise,
            "gain_spread": bend * fit.gain_spread,
            "texture": bend * fit.texture,
            "random_taxels": fit.stray,
            "resolution": 0.0,
        },
    }


def _rounded(model: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """Round all values, and put them on the nearest bounds of the model's options."""
    rounded = dict(changes)
    for name, value in changes.items():
        if isinstance(value, dict):
            rounded[name] = _rounded(model.model_fields[name].annotation, value)
        elif isinstance(value, float):
            rounded[name] = _within(model, name, value)
    return rounded


def _within(model: type[BaseModel], name: str, value: float) -> float:
    schema = model.model_json_schema()["properties"][name]
    bounds = next(kind for kind in (schema, *schema.get("anyOf", ())) if kind.get("type") == "number")
    return float(np.clip(_round(value), bounds.get("minimum", -np.inf), bounds.get("maximum", np.inf)))


def _round(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


class PressesAsRecorded:
    """Predict what the simulated pad reads at the poses of a recorded scan."""

    def __init__(self, simulated: Scan, recorded: Scan) -> None:
        stated = simulated.meta.get("options")
        if not isinstance(stated, dict):
            raise InputError("the simulated scan does not say how it was made; make it with `bench scan`")
        self.options = checked(ScanOptions, stated, "simulated scan")
        self._letters = {letter.name: letter for letter in letters_of(self.options)}
        unknown = [name for name in recorded.letters if name not in self._letters]
        if unknown:
            raise InputError(
                f"{unknown[0]!r} was recorded but not simulated; press it with `bench scan --letters` or --shape"
            )
        self._recorded = recorded
        pad = self.options.pad.taxel_xy
        apart = np.abs(recorded.taxel_xy[:, None] - pad[None]).max(axis=-1)
        if apart.min(axis=1).max() > 1e-3:
            raise InputError("the recorded taxels are not where the simulated pad has them: the pads differ")
        self.taxels = apart.argmin(axis=1)
        self._pressed: tuple[tuple[object, ...], dict[str, Pressed]] | None = None

    @property
    def stated(self) -> Guess:
        """Give the simulation's own parameters."""
        press = self.options.press
        wrist = np.inf if press.wrist_stiffness is None else press.wrist_stiffness
        return Guess(self.options.sensor.psf_sigma, press.stiffness, wrist)

    @property
    def level(self) -> FloatArray:
        """Give the errors (n, 5) of presses that are just as stated."""
        errors = np.zeros((len(self._recorded), 5))
        errors[:, 3:] = self.options.press.tilt_x, self.options.press.tilt_y
        return errors

    def bending(self) -> float:
        """Average the second moment of the area that touches over both axes and all presses, mm^4."""
        moments = []
        for name in self._recorded.letters:
            poses = self._recorded.poses[self._recorded.labels == name]
            bed = lay_bed(levels(self._letters[name], self.options.press), poses, *self.options.cell_lines)
            area = bed.area_of_presses
            for along in bed.centroid.T:
                sums = [np.bincount(bed.press, bed.area * along**power, len(poses)) for power in (1, 2)]
                first, second = sums
                moments.append((second - first**2 / np.maximum(area, 1e-9))[area > 0])
        every = np.concatenate(moments)
        if not len(every):
            raise InputError("nothing touches the pad at the recorded poses: are the poses right?")
        return max(float(every.mean()), 1e-3)

    def __call__(self, guess: Guess, errors: FloatArray) -> FloatArray:
        """Predict readings without imperfections; see `tactsim.hardware.sensor_fit.Predict`."""
        wrist = None if np.isinf(guess.wrist) else guess.wrist
        held = {"stiffness": guess.stiffness, "wrist_stiffness": wrist, "engine": "auto"}
        held["dynamics"] = "equilibrium"  # a recorded press is one at rest
        press = self.options.press.model_copy(update=held)
        sensor = self.options.sensor.model_copy(update={"psf_sigma": guess.psf_sigma})
        options = self.options.model_copy(update={"sensor": sensor, "press": press})
        ideal = np.empty((len(errors), options.pad.taxels))
        for name, pressed in self._press(errors, options, guess).items():
            readings = pressed.readings(options)
            readings[list(pressed.blanks)] = np.nan
            ideal[self._recorded.labels == name] = readings
        return ideal[:, self.taxels]

    @property
    def outlined(self) -> tuple[str, ...]:
        """Name the letters that have an outline alone, and no relief."""
        return tuple(name for name in self._recorded.letters if self._letters[name].relief is None)

    @property
    def outline(self) -> NDArray[np.intp]:
        """Number the outline of each press, (n,), as in `outlined`; -1 if it has none alone."""
        number = {name: index for index, name in enumerate(self.outlined)}
        return np.array([number.get(label, -1) for label in self._recorded.labels.tolist()])

    def _press(self, errors: FloatArray, options: ScanOptions, guess: Guess) -> dict[str, Pressed]:
        """Press every letter; once for all point spreads with the same cells: these change only what taxels feel."""
        lines = b" ".join(edges.tobytes() for edges in options.cell_lines)
        wanted = errors.tobytes(), guess.stiffness, guess.wrist, lines, guess.grown
        if self._pressed is None or self._pressed[0] != wanted:
            poses = compose(self._recorded.poses, errors[:, :3])
            labels = self._recorded.labels
            grown = zip(self.outlined, guess.grown, strict=False)
            letters = self._letters | {name: wider(self._letters[name], by) for name, by in grown if by}
            pressed = {}
            for name in self._recorded.letters:
                own = labels == name
                pressed[name] = press_at(Touches(letters[name], poses[own], errors[own, 3:]), options)
            self._pressed = wanted, pressed
        return self._pressed[1]


def check_presses(recorded: Scan, predicted: FloatArray) -> None:
    """Refuse recorded presses that cannot be those of the simulation, with predicted (n, taxels) kPa at their poses.

    Raises InputError for readings that are not 0 at rest, idle frames where the simulation touches, a press that
    resembles nothing of what it presses there, and a press that two labels have in common. Presses that only graze an
    object are not judged.
    """
    felt = np.clip(find_idle(recorded.readings, recorded.presses).rise(recorded.readings), 0, None)
    predicted = np.nan_to_num(predicted)
    touch, most = predicted.max(axis=1), felt.max(axis=1)
    rest = recorded.readings[untouched(predicted) & (touch > 0)[:, None]]
    if len(rest) and abs(level := float(np.median(rest))) > _IDLE * np.ptp(recorded.readings):
        raise InputError(
            f"taxels that nothing touches in the simulation read {level:.4g} in the recording, not 0; import or replay "
            f"it with --zero {level:.4g}, or with --idle"
        )
    judged = touch > _GRAZES * (np.median(touch[touch > 0]) if touch.any() else 0.0)
    idle = judged & (most <= _IDLE * (np.median(most[judged]) if judged.any() else 0.0))
    size = np.linalg.norm(felt, axis=1) * np.linalg.norm(predicted, axis=1)
    lost = judged & ~idle & ((felt * predicted).sum(axis=1) < _FITS * size)
    nothing = "are idle frames, which feel next to nothing where the simulation touches: {}; leave them out"
    refuse_presses(recorded, idle, "presses", nothing)
    nowhere = (
        "fit nowhere on what is pressed at their poses: {}; are poses, labels, first_row, first_column right?"
    )
    refuse_presses(recorded, lost, "presses", nowhere)
    check_labels_apart(recorded, judged)


def wider(letter: Letter, by: float) -> Letter:
    """Move a letter's outline outwards by `by` mm, or inwards; by half of it, and so on, where little would be left."""
    from manifold3d import JoinType

    area = letter.footprint.area()
    while (moved := letter.footprint.offset(by, JoinType.Miter)).area() < _LEAST_AREA * area:
        by /= 2
    return replace(letter, contours=tuple(np.asarray(contour) for contour in moved.to_polygons()))
