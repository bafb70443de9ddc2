"""Validate the simulation against a recording: readings, sensor parameters, classes, recognition."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from tactsim.bench.config import RunConfig
from tactsim.bench.runner import perform
from tactsim.bench.trials import Progress
from tactsim.core import InputError, Scan
from tactsim.core.checking import checked
from tactsim.core.poses import FloatArray, compose
from tactsim.core.scan import train_on
from tactsim.estimators.likelihoods.classifier import classify
from tactsim.hardware.sensor_fit import Guess, SensorFit, fit_sensor
from tactsim.hardware.taxel_error import TaxelError, class_agreement, taxel_error
from tactsim.press.bed import lay_bed
from tactsim.press.engine import press_at
from tactsim.press.levels import levels
from tactsim.press.pressed import Pressed
from tactsim.press.scan_options import PressOptions, ScanOptions, SensorOptions
from tactsim.press.scanning import letters_of
from tactsim.press.sensor import gains, sense
from tactsim.press.touches import Touches

CLASSES = ("no contact", "in contact", "unknown")


@dataclass(frozen=True, eq=False)
class Validation:
    """The result of comparing a simulated and a recorded scan.

    before, after: errors with the simulation's own parameters and with the fitted ones. class_agreement: the
    share of taxels that eq. 3 puts in the same class for recorded and simulated readings. class_ceiling: the
    same for two simulations with different noise, which is as good as it can get. class_counts: (3, 3) taxels,
    rows by recorded class, columns by simulated class. recognition: final accuracy and error by "trained ->
    tested". parameters: options of a scan that reads as the recorded pad does.
    """

    readings: int
    letters: tuple[str, ...]
    taxels: int
    before: TaxelError
    after: TaxelError
    fit: SensorFit
    class_agreement: float
    class_ceiling: float
    class_counts: NDArray[np.int64]
    recognition: dict[str, dict[str, Any]]
    parameters: dict[str, Any]


class _Simulator:
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
        self._pressed: tuple[tuple[bytes, float, float, bool], dict[str, Pressed]] | None = None

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
                first, second = (
                    np.bincount(bed.press, bed.area * along**power, len(poses)) for power in (1, 2)
                )
                moments.append((second - first**2 / np.maximum(area, 1e-9))[area > 0])
        every = np.concatenate(moments)
        if not len(every):
            raise InputError("nothing touches the pad at the recorded poses: are the poses right?")
        return max(float(every.mean()), 1e-3)

    def __call__(self, guess: Guess, errors: FloatArray) -> FloatArray:
        """Predict readings without imperfections; see `tactsim.hardware.sensor_fit.Predict`."""
        wrist = None if np.isinf(guess.wrist) else guess.wrist
        options = self.options.model_copy(
            update={
                "sensor": self.options.sensor.model_copy(update={"psf_sigma": guess.psf_sigma}),
                "press": self.options.press.model_copy(
                    update={
                        "stiffness": guess.stiffness,
                        "wrist_stiffness": wrist,
                        "engine": "auto",
                        "dynamics": "equilibrium",  # a recorded press is one at rest
                    }
                ),
            }
        )
        ideal = np.empty((len(errors), options.pad.taxels))
        for name, pressed in self._press(errors, options).items():
            readings = pressed.readings(options)
            readings[list(pressed.blanks)] = np.nan
            ideal[self._recorded.labels == name] = readings
        return ideal[:, self.taxels]

    def _press(self, errors: FloatArray, options: ScanOptions) -> dict[str, Pressed]:
        """Press every letter; once for all point spreads, which change only what taxels feel of the forces."""
        press = options.press
        wrist = np.inf if press.wrist_stiffness is None else press.wrist_stiffness
        wanted = errors.tobytes(), press.stiffness, wrist, options.sensor.psf_sigma == 0
        if self._pressed is None or self._pressed[0] != wanted:
            poses = compose(self._recorded.poses, errors[:, :3])
            labels = self._recorded.labels
            self._pressed = (
                wanted,
                {
                    name: press_at(
                        Touches(self._letters[name], poses[labels == name], errors[labels == name, 3:]),
                        options,
                    )
                    for name in self._recorded.letters
                },
            )
        return self._pressed[1]

    def noisy(self, seed: int) -> FloatArray:
        """Simulate readings at the recorded poses, with the imperfections that the simulation's options state.

        A press that does not come to rest reads NaN.
        """
        rng = np.random.default_rng(seed)
        options = self.options
        off = (options.placement_mm, options.placement_mm, options.placement_rad)
        spread = np.array((*off, options.placement_tilt, options.placement_tilt))
        errors = self.level + rng.standard_normal((len(self._recorded), 5)) * spread
        ideal = np.zeros((len(errors), options.pad.taxels))
        ideal[:, self.taxels] = self(self.stated, errors)
        rested = np.isfinite(ideal).all(axis=1, keepdims=True)
        read = sense(np.nan_to_num(ideal), options.sensor, gains(options), rng)[:, self.taxels]
        return np.where(rested, read, np.nan)


def validate(
    simulated: Scan,
    recorded: Scan,
    *,
    estimator: str = "histogram",
    options: dict[str, Any] | None = None,
    trials: int = 10,
    seed: int = 0,
    progress: Progress,
) -> Validation:
    """Compare a recorded scan with a simulated one that says how it was made.

    The readings are compared at the recorded poses, which the simulated scan need not have. Raises
    InputError if the recorded letters or taxels are not in the simulation.
    """
    simulator = _Simulator(simulated, recorded)
    as_it_is = simulator(simulator.stated, simulator.level)
    fit = fit_sensor(recorded.readings, simulator, simulator.stated, simulator.bending())
    fitted = fit.gain * fit.gain_per_taxel * simulator(fit.guess, fit.errors)
    one, other = (simulator.noisy(seed + k) for k in range(2))
    rested = np.isfinite(one + other).all(axis=1)
    first, second = classify(one[rested]), classify(other[rested])
    agreement, counts = class_agreement(classify(recorded.readings[rested]), first, len(CLASSES))
    ceiling, _ = class_agreement(first, second, len(CLASSES))
    return Validation(
        readings=len(recorded),
        letters=recorded.letters,
        taxels=len(recorded.taxel_xy),
        before=_error(recorded, as_it_is),
        after=_error(recorded, fitted),
        fit=fit,
        class_agreement=agreement,
        class_ceiling=ceiling,
        class_counts=counts,
        recognition=_recognition(simulated, recorded, estimator, options or {}, trials, seed, progress),
        parameters=_parameters(simulator.options, fit),
    )


def _recognition(
    simulated: Scan,
    recorded: Scan,
    estimator: str,
    options: dict[str, Any],
    trials: int,
    seed: int,
    progress: Progress,
) -> dict[str, dict[str, Any]]:
    """Train on either and test on either, on the recorded letters and taxels."""
    sides = {"simulated": simulated.of_letters(recorded.letters), "recorded": recorded}
    results = {}
    for trained, train in sides.items():
        for tested, test in sides.items():
            if trained == tested and not (len(train.where("train")) and len(train.where("test"))):
                continue  # training and testing on the same readings would say nothing
            scan = train_on(train, test)
            fewest = min(len(scan.where("test", letter)) for letter in scan.letters)
            config = RunConfig(
                estimator=estimator, set=options, trials=trials, readings=min(20, fewest), seed=seed,
                given=scan.digest,
            )  # fmt: skip
            run = perform(config, scan=scan, progress=progress)
            results[f"{trained} -> {tested}"] = {
                "readings": config.readings,
                "trials": len(run.trials.truth),
                "accuracy_at_5": run.summary["accuracy"][min(5, config.readings) - 1],
                "accuracy": run.summary["accuracy"][-1],
                "error_mm": run.summary["error_mm"][-1],
            }
    return results


def _error(recorded: Scan, predicted: FloatArray) -> TaxelError:
    """Compare readings with predicted ones, where a press came to rest."""
    rested = np.isfinite(predicted).all(axis=1)
    return taxel_error(recorded.readings[rested], predicted[rested])


def _parameters(options: ScanOptions, fit: SensorFit) -> dict[str, Any]:
    """Say what to change in a scan's options so that it reads as the recorded pad does.

    Gain and force cannot be told apart by readings alone, so the force takes both. Tilts grow with it: a pressure
    that is larger by one factor everywhere has a larger slope, too. A recorded press is a mean of frames; what
    the mean leaves of the sensor's resolution is part of the fitted noise. What is beyond the bounds of a scan's
    options is put on the nearest bound.
    """
    tilt_x, tilt_y = (fit.gain * fit.tilt_offset).tolist()
    rigid = np.isinf(fit.wrist)
    return {
        "placement_mm": _within(ScanOptions, "placement_mm", fit.placement_mm, 4),
        "placement_rad": _within(ScanOptions, "placement_rad", fit.placement_rad, 5),
        "placement_tilt": _within(ScanOptions, "placement_tilt", fit.gain * fit.placement_tilt, 6),
        "press": {
            "force": _within(PressOptions, "force", options.press.force * fit.gain, 5),
            "stiffness": _within(PressOptions, "stiffness", fit.stiffness, 2),
            "wrist_stiffness": "rigid" if rigid else _within(PressOptions, "wrist_stiffness", fit.wrist, 2),
            "tilt_x": _within(PressOptions, "tilt_x", tilt_x, 5),
            "tilt_y": _within(PressOptions, "tilt_y", tilt_y, 5),
        },
        "sensor": {
            "psf_sigma": _within(SensorOptions, "psf_sigma", fit.psf_sigma, 4),
            "noise": _within(SensorOptions, "noise", fit.noise, 4),
            "gain_spread": _within(SensorOptions, "gain_spread", fit.gain_spread, 5),
            "resolution": 0.0,
        },
    }


def _within(model: type[BaseModel], name: str, value: float, digits: int) -> float:
    """Round a value, and put it on the nearest bound of an option that does not take it."""
    schema = model.model_json_schema()["properties"][name]
    bounds = next(kind for kind in (schema, *schema.get("anyOf", ())) if kind.get("type") == "number")
    return float(np.clip(round(value, digits), bounds.get("minimum", -np.inf), bounds.get("maximum", np.inf)))


def as_json(result: Validation) -> dict[str, Any]:
    """Put a validation into JSON's types."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, np.ndarray | tuple | list):
            return [plain(inner) for inner in value]
        if isinstance(value, float | np.floating):
            return float(value) if np.isfinite(value) else None
        return int(value) if isinstance(value, np.integer) else value

    return {key: plain(value) for key, value in asdict(result).items()}
