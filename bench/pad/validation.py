"""Validate the simulation against a recording: readings, sensor parameters, recognition."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.config import RunConfig
from tactsim.bench.experiment import perform
from tactsim.bench.intervals import wilson
from tactsim.bench.pad.fitted_world import clipped, fitted_world
from tactsim.bench.pad.recorded_presses import PressesAsRecorded, check_presses
from tactsim.bench.runs.figures import BLUE, SOFT, Picture
from tactsim.bench.trials import Progress
from tactsim.core import Scan
from tactsim.core.checking import checked
from tactsim.core.poses import FloatArray
from tactsim.core.scan import train_on
from tactsim.estimators import create
from tactsim.hardware.cutting import taxel_grid
from tactsim.hardware.sensor_fit import SensorFit, fit_sensor, noise_of
from tactsim.hardware.taxel_fit import TaxelError, best_gain, taxel_error
from tactsim.hardware.terminal_pictures import SEEN
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import scan_letters

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
