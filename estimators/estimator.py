"""The face of every estimator: fit on training readings, then update and estimate, reading by reading."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import InputError, Scan
from tactsim.core.checking import Settings
from tactsim.core.errors import short, was_interrupt
from tactsim.core.finite import LARGEST, finite
from tactsim.core.poses import POSE, FloatArray, algebra

if TYPE_CHECKING:
    from tactsim.core.forward import ForwardModel

NONE = "none"  # the label of an object that is none of the known letters
# Steps to the mean of poses, of which each leaves about the square of the error before, in units of a turn; and the
# step, mm and rad, that need not be taken.
_MEAN_STEPS, _NO_STEP = 4, 1e-9


class Options(Settings):
    """Options of an estimator: named, typed, bounded, with the paper's symbol in the description."""


@dataclass(frozen=True, eq=False)
class PoseSamples:
    """Weighted poses T_R^O that stand for the belief about where an object of one letter is.

    poses: (n, 3) robot_in_object, mm, mm, rad; in space (n, 7), see `core.rigid`. weights: (n,), summing to 1.
    """

    poses: FloatArray
    weights: FloatArray

    def moments(self, near: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the mean (3,) or (7,), found from a pose `near` it on, and the covariance (3, 3) or (6, 6).

        Deviations are in the Lie algebra: pose = exp(deviation) mean, [x, y, theta] or [x, y, z, about x, about y,
        about z], mm and rad, along the object's own axes. The mean is the pose about which they sum to 0.
        """
        group = algebra(self.poses.shape[1])
        weights, mean = self.weights / self.weights.sum(), np.asarray(near, dtype=float)
        for steps in range(_MEAN_STEPS + 1):
            away = group.log(group.compose(self.poses, group.invert(mean)))
            step = weights @ away
            if steps == _MEAN_STEPS or np.abs(step).max() < _NO_STEP:
                break
            mean = group.compose(group.exp(step), mean)
        away -= step
        return mean, away.T @ (away * weights[:, None])


@dataclass(frozen=True)
class Estimate:
    """What an estimator holds to be true after the readings so far.

    label: the most probable letter (eq. 9, 14), any of them if several are, or NONE. probabilities: p(letter), summing
    to 1, with NONE among them if the estimator considers that. robot_in_object: [x, y, theta] mm, rad: the most
    probable T_R^O within the most probable letter; in space (7,), see `core.rigid`. samples: the belief about the pose
    of that letter, from which mean, covariance and regions are computed; None if it does not say how sure it is.
    unexplained: nats by which the readings are explained worse than those of training would be; 0 if they are not, or
    the estimator does not say.
    """

    label: str
    probabilities: Mapping[str, float]
    robot_in_object: FloatArray
    samples: PoseSamples | None = None
    unexplained: float = 0.0

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray] | tuple[None, None]:
        return (None, None) if self.samples is None else self.samples.moments(self.robot_in_object)

    @property
    def mean(self) -> FloatArray | None:
        """Give the belief's mean robot_in_object, see `PoseSamples.moments`; of several modes it lies between them."""
        return self._moments[0]

    @property
    def covariance(self) -> FloatArray | None:
        """Give the covariance of the pose, (3, 3) or (6, 6), mm and rad: see `PoseSamples.moments`."""
        return self._moments[1]

    def moved(self, move: Callable[[FloatArray], FloatArray]) -> Estimate:
        """Give the estimate with all its poses (..., 3) as a function moves them."""
        samples = self.samples
        return replace(
            self,
            robot_in_object=move(self.robot_in_object),
            samples=None if samples is None else PoseSamples(move(samples.poses), samples.weights),
        )


def probabilities(labels: Sequence[str], mass: FloatArray) -> dict[str, float]:
    """Name what each letter holds (letters,), so that it sums to 1."""
    return dict(zip(labels, (mass / mass.sum()).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class PlaneBelief:
    """p(letter, x, y) of T_R^O after the readings so far, the angle summed out, in equal cells.

    labels: the letters. x: (columns,), y: (rows,) mm, the cells' centres. probability: (letters, rows,
    columns), summing to 1.
    """

    labels: tuple[str, ...]
    x: FloatArray
    y: FloatArray
    probability: FloatArray


def proposes_none(name: str) -> InputError:
    """Say that the estimator `name` proposes no readings."""
    return InputError(f"estimator {name} proposes no readings; explore at random")


class Estimator(ABC):
    """Recognise and localise one object from a sequence of readings.

    A subclass names its `options_type`, its `budget` and whether it `draws`, and implements `fit`, `reset`, `update`
    and `estimate`. The calls come in that order; `reset` starts a new sequence and keeps what was fitted.
    """

    options_type: type[Options] = Options
    # The option that says how much may be computed, such as "bins"; None if there is no such option.
    budget: str | None = None
    # Whether the rng of `reset` changes what is estimated.
    draws: bool = True
    # The kind of run that it is for (`bench.kinds`), which is that of the scans that it fits, and a pose's numbers.
    KIND: ClassVar[str] = "plane"
    POSE: ClassVar[tuple[str, ...]] = POSE
    # Whether it wants to press: `bring` is then called before `fit`.
    uses_forward_model: bool = False
    # The registered name that `create` made it by, if it did.
    created_as: str | None = None
    _forward: ForwardModel | None = None

    def __init__(self, options: Options) -> None:
        self.options = options

    def bring(self, forward: ForwardModel) -> None:
        """Take the forward model that predicts readings of the scan's objects, from `fit` on."""
        self._forward = forward

    @property
    def forward(self) -> ForwardModel:
        """Give the forward model. Raises InputError if none was brought."""
        if self._forward is None:
            raise InputError(
                f"estimator {name_of(self)} presses the letters itself; give it what presses: "
                "estimator.bring(tactsim.press.forward_model(scan)) before fit"
            )
        return self._forward

    @abstractmethod
    def fit(self, scan: Scan) -> None:
        """Learn from the scan's training readings; its test readings are not looked at."""

    @abstractmethod
    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence, keep the maps; all randomness until the next reset comes from `rng`."""

    @abstractmethod
    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad].

        Raises InputError, and leaves the belief as it was, for a wrong length or a NaN.
        """

    @abstractmethod
    def estimate(self) -> Estimate:
        """Say which letter it is and where, after the readings so far."""

    def without(self, letter: str, scan: Scan) -> Estimator:
        """Give an estimator like this one that was fitted to a scan, as this one was, but for one letter.

        This one stays as it is. An estimator that learns letters one by one need not learn the others anew.
        """
        other = copy.deepcopy(self)
        other.fit(scan.untrained([letter]))
        return other

    def describe(self) -> str:
        """Say in one line how the estimator is set up, beyond its name."""
        return ", ".join(f"{name} {value}" for name, value in self.options if value is not None)

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the sensor_in_robot pose (n, 3) to try next, if the estimator can."""
        raise proposes_none(type(self).__name__)

    @property
    def proposes(self) -> bool:
        """Tell whether the estimator proposes readings."""
        return type(self).propose is not Estimator.propose

    def estimates(self, readings: FloatArray, sensor_in_robot: FloatArray) -> Sequence[Sequence[Estimate]]:
        """Say after each of k readings of n trials what `reset`, `update` and `estimate` would, all at once.

        readings: (n, k, taxels) kPa. sensor_in_robot: (n, k, 3). A learned method that is faster so, and draws
        nothing, may implement it; runs in which it does not choose the touches then call it for all trials of a letter.
        """
        raise InputError(f"estimator {name_of(self)} answers one reading at a time: update, then estimate")

    @property
    def answers_together(self) -> bool:
        """Tell whether the estimator answers many trials at once."""
        return type(self).estimates is not Estimator.estimates

    def belief_over_plane(self) -> PlaneBelief | None:
        """Show how the belief lies over the plane, for a person to look at; None if it cannot be shown.

        The cells are the same throughout a sequence. It changes nothing: the estimates that follow are
        the same with and without the call.
        """
        return None

    @property
    def work(self) -> dict[str, Any]:
        """Count what was done since the estimator was made: `likelihood_evaluations` and `skipped` {reason: count}.

        Counts of other names may stand beside them.
        """
        return {"likelihood_evaluations": 0, "skipped": {}}


def name_of(estimator: Estimator) -> str:
    """Name an estimator for a message: as it was created, or by its class if it is not registered."""
    return estimator.created_as or type(estimator).__name__


def check_options(estimator: Estimator, name: str) -> None:
    """Raise InputError unless an estimator of somebody's own has kept its options."""
    if not isinstance(getattr(estimator, "options", None), Options):
        raise InputError(f"estimator {name} has no options; its __init__ must call super().__init__(options)")


@contextmanager
def no_exit(estimator: Estimator | str) -> Iterator[None]:
    """Run the code of an estimator, or of one called so; if it would end the program, that is a failure of it.

    Raises RuntimeError where SystemExit was raised, whatever its status: 0 would pass for success; KeyboardInterrupt
    for an interrupt that a compiled function made another error of.
    """
    try:
        yield
    except SystemError as error:
        if was_interrupt(error):
            raise KeyboardInterrupt from error
        raise
    except SystemExit as error:
        name = estimator if isinstance(estimator, str) else name_of(estimator)
        raise RuntimeError(
            f"the estimator {name} ended the program (SystemExit: {error.code}); it must answer or raise an error"
        ) from error


def checked_estimate(estimator: Estimator, letters: Sequence[str]) -> Estimate:
    """Ask an estimator for its estimate over some of `letters` or NONE.

    Raises InputError that names its class if the answer is none, RuntimeError if it would end the program.
    """
    with no_exit(estimator):
        estimate = estimator.estimate()
    check_estimate(estimate, estimator, (*letters, NONE))
    return estimate


def check_estimate(estimate: Any, estimator: Estimator, letters: Sequence[str]) -> None:
    """Raise InputError that names the estimator's class unless it made an estimate over some of `letters`.

    Probabilities are finite, not negative and sum to 1 within 1e-6; no letter is more probable, by 1e-6, than the one
    that is named, unless that is NONE; the pose is finite.
    """
    fault = _fault_of_estimate(estimate, letters, getattr(estimator, "POSE", POSE))
    if fault is not None:
        kind = type(estimator)
        raise InputError(
            f"the estimator {kind.__module__}.{kind.__qualname__} is broken: its estimate {fault}"
        )


def _fault_of_estimate(estimate: Any, letters: Sequence[str], numbers: tuple[str, ...]) -> str | None:
    if not (isinstance(estimate, Estimate) and isinstance(estimate.probabilities, Mapping)):
        return f"is {short(estimate)}, no Estimate with a table of probabilities"
    strange = [label for label in (estimate.label, *estimate.probabilities) if label not in letters]
    if strange:
        return f"names {short(strange[0])}, which is no letter that it was fitted to"
    if estimate.label not in estimate.probabilities:
        return f"gives its own letter {estimate.label} no probability"
    length, kind = len(numbers), f"[{', '.join(numbers)}]"
    if estimate.robot_in_object is None:
        return f"has no pose: robot_in_object is None, and no finite {kind}"
    try:
        p = np.array(list(estimate.probabilities.values()), dtype=float)
        own = float(estimate.probabilities[estimate.label])
        pose = np.asarray(estimate.robot_in_object, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return "holds what is no number"
    if not (p.ndim == 1 and (p >= 0).all() and abs(p.sum() - 1) <= 1e-6):  # false for NaN too
        return f"has probabilities {short(p.tolist())}, which are negative or do not sum to 1"
    if estimate.label != NONE and own < p.max() - 1e-6:
        best = list(estimate.probabilities)[int(p.argmax())]
        return f"names {estimate.label} (p = {own:.4g}), and {best} is more probable (p = {p.max():.4g})"
    if pose.shape != (length,) or not (np.abs(pose) <= LARGEST).all():
        return f"has the pose {short(pose.tolist())}, which is no finite {kind} up to {LARGEST:g}"
    if "qw" in numbers and abs(np.linalg.norm(pose[3:]) - 1) > 1e-6:
        return f"has the quaternion {short(pose[3:].tolist())}, which is not of length 1"
    samples = estimate.samples
    if samples is None:
        return None
    try:
        poses, weights = np.asarray(samples.poses, dtype=float), np.asarray(samples.weights, dtype=float)
    except (AttributeError, TypeError, ValueError, OverflowError):
        return f"has samples {short(samples)}, which are no poses with weights"
    if poses.ndim != 2 or poses.shape[1] != length or weights.shape != poses.shape[:1] or not len(weights):
        return f"has samples of shapes {poses.shape} and {weights.shape}; they are (n, {length}) and (n,), n from 1"
    if not ((weights >= 0).all() and abs(weights.sum() - 1) <= 1e-6 and (np.abs(poses) <= LARGEST).all()):
        return "has samples that are not finite, or weights that are negative or do not sum to 1"
    return None


def check_order(done: bool, first: str, call: str) -> None:
    """Raise InputError if `call` came before `first` was done."""
    if not done:
        raise InputError(f"an estimator was asked to {call} before {first} was called")


def check_reading(
    reading: ArrayLike, sensor_in_robot: ArrayLike, taxels: int
) -> tuple[FloatArray, FloatArray]:
    """Return a reading (taxels,) kPa and a pose (3,) as finite arrays.

    Raises InputError if a length is wrong or a number is not finite.
    """
    values, pose = np.array(reading, dtype=float), np.array(sensor_in_robot, dtype=float)
    if values.shape != (taxels,):
        raise InputError(f"a reading has shape {values.shape}; the maps were learned from {taxels} taxels")
    if pose.shape != (3,):
        raise InputError(f"sensor_in_robot has shape {pose.shape}; it is [x, y, theta]")
    return finite(values, "reading"), finite(pose, "sensor_in_robot")


def check_candidates(candidates: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """Return sensor_in_robot poses to choose from as a finite array (n, 3), n from 1.

    Raises InputError if there are none, a pose has another length or a number is not finite.
    """
    poses = np.array(candidates, dtype=float)
    if poses.ndim != 2 or poses.shape[1] != 3 or not len(poses):
        raise InputError(f"candidates have shape {poses.shape}; they are one or more [x, y, theta]")
    return finite(poses, "candidates")


def about_estimator(estimator: Estimator) -> dict[str, Any]:
    """Describe how an estimator is set up, so that a report can do without the estimator's plug-in.

    options: all of them. settings: those that are not the defaults. budget: see `budget_of`.
    """
    with no_exit(estimator):
        description = estimator.describe()
    return {
        "description": description,
        "options": estimator.options.model_dump(mode="json"),
        "settings": estimator.options.model_dump(mode="json", exclude_defaults=True),
        "budget": budget_of(estimator),
    }


def budget_of(estimator: Estimator) -> dict[str, Any] | None:
    """Name the option that says how much an estimator may compute, and its value; None if it has none."""
    if estimator.budget is None:
        return None
    return {"option": estimator.budget, "value": getattr(estimator.options, estimator.budget)}


def flatten_work(work: Mapping[str, Any]) -> dict[str, int]:
    """Turn {"presses": 3, "skipped": {"cached": 1}} into {"presses": 3, "skipped.cached": 1}."""
    try:
        flat = {name: int(count) for name, count in work.items() if name != "skipped"}
        if not all(isinstance(name, str) for name in flat):
            raise TypeError("counts have names")
        return flat | {f"skipped.{name}": int(count) for name, count in work.get("skipped", {}).items()}
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"an estimator's work is {short(work)}; it must be counts and `skipped`, a table of counts"
        ) from error


def unflatten_work(flat: Mapping[str, int]) -> dict[str, Any]:
    """Undo `flatten_work`."""
    work: dict[str, Any] = {name: count for name, count in flat.items() if not name.startswith("skipped.")}
    skipped = {name.partition(".")[2]: count for name, count in flat.items() if name.startswith("skipped.")}
    return work | {"skipped": skipped}
