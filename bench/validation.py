"""Validate the simulation against a recording: readings, sensor parameters, classes, recognition."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.config import RunConfig
from tactsim.bench.runner import perform
from tactsim.bench.trials import Progress
from tactsim.core import InputError, Scan
from tactsim.core.checking import checked
from tactsim.core.poses import FloatArray, compose
from tactsim.core.scan import train_on
from tactsim.estimators.likelihoods.classifier import classify
from tactsim.hardware.sensor_fit import SensorFit, TaxelError, class_agreement, fit_sensor, taxel_error
from tactsim.press import ScanOptions
from tactsim.press.engine import press_at
from tactsim.press.pressed import Pressed
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
        self._pressed: tuple[tuple[bytes, bool], dict[str, Pressed]] | None = None

    def __call__(self, sigma: float, errors: FloatArray) -> FloatArray:
        """Predict readings without imperfections; see `tactsim.hardware.sensor_fit.Predict`."""
        sensor = self.options.sensor.model_copy(update={"psf_sigma": sigma})
        options = self.options.model_copy(update={"sensor": sensor})
        ideal = np.empty((len(errors), options.pad.taxels))
        for name, pressed in self._press(errors, options).items():
            ideal[self._recorded.labels == name] = pressed.readings(options)
        return ideal[:, self.taxels]

    def _press(self, errors: FloatArray, options: ScanOptions) -> dict[str, Pressed]:
        """Press every letter; once for all point spreads, which change only what taxels feel of the forces."""
        wanted = errors.tobytes(), options.sensor.psf_sigma == 0
        if self._pressed is None or self._pressed[0] != wanted:
            poses = compose(self._recorded.poses, errors)
            labels = self._recorded.labels
            tilt = options.press.tilt_x, options.press.tilt_y
            letters = ((name, self._letters[name]) for name in self._recorded.letters)
            self._pressed = (
                wanted,
                {
                    name: press_at(Touches.of(letter, poses[labels == name], tilt), options).settled()
                    for name, letter in letters
                },
            )
        return self._pressed[1]

    def noisy(self, seed: int) -> FloatArray:
        """Simulate readings at the recorded poses, with the imperfections that the simulation's options state."""
        rng = np.random.default_rng(seed)
        options = self.options
        spread = (options.placement_mm, options.placement_mm, options.placement_rad)
        errors = rng.standard_normal((len(self._recorded), 3)) * spread
        ideal = np.zeros((len(errors), options.pad.taxels))
        ideal[:, self.taxels] = self(options.sensor.psf_sigma, errors)
        return sense(ideal, options.sensor, gains(options), rng)[:, self.taxels]


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
    nothing = np.zeros((len(recorded), 3))
    own = simulator.options.sensor.psf_sigma
    before = taxel_error(recorded.readings, simulator(own, nothing))
    fit = fit_sensor(recorded.readings, simulator)
    fitted = fit.gain * fit.gain_per_taxel * simulator(fit.psf_sigma, fit.placement)
    one, other = (classify(simulator.noisy(seed + k)) for k in range(2))
    agreement, counts = class_agreement(classify(recorded.readings), one, len(CLASSES))
    ceiling, _ = class_agreement(one, other, len(CLASSES))
    return Validation(
        readings=len(recorded),
        letters=recorded.letters,
        taxels=len(recorded.taxel_xy),
        before=before,
        after=taxel_error(recorded.readings, fitted),
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
    with TemporaryDirectory() as folder:
        for trained, train in sides.items():
            for tested, test in sides.items():
                if trained == tested and not (len(train.where("train")) and len(train.where("test"))):
                    continue  # training and testing on the same readings would say nothing
                scan = train_on(train, test)
                fewest = min(len(scan.where("test", letter)) for letter in scan.letters)
                path = Path(folder) / f"{trained}-{tested}.npz"
                scan.save(path)
                config = RunConfig(
                    estimator=estimator, set=options, trials=trials, readings=min(20, fewest), seed=seed,
                    scan=path,
                )  # fmt: skip
                run = perform(config, progress=progress)
                results[f"{trained} -> {tested}"] = {
                    "readings": config.readings,
                    "trials": len(run.trials.truth),
                    "accuracy_at_5": run.summary["accuracy"][min(5, config.readings) - 1],
                    "accuracy": run.summary["accuracy"][-1],
                    "error_mm": run.summary["error_mm"][-1],
                }
    return results


def _parameters(options: ScanOptions, fit: SensorFit) -> dict[str, Any]:
    """Say what to change in a scan's options so that it reads as the recorded pad does.

    Gain and force cannot be told apart by readings alone, so the force takes both. A recorded press is a mean
    of frames; what the mean leaves of the sensor's resolution is part of the fitted noise.
    """
    return {
        "placement_mm": round(fit.placement_mm, 4),
        "placement_rad": round(fit.placement_rad, 5),
        "press": {"force": round(options.press.force * fit.gain, 5)},
        "sensor": {
            "psf_sigma": round(fit.psf_sigma, 4),
            "noise": round(fit.noise, 4),
            "gain_spread": round(fit.gain_spread, 5),
            "resolution": 0.0,
        },
    }


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
