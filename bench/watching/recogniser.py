"""An estimator and the touches that it was given: what it believes after each, and how late that was known."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactsim.bench.trials import fit, proposed
from tactsim.core import InputError, Scan, compose
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate, Estimator
from tactsim.estimators.estimator import checked_estimate, no_exit
from tactsim.press import forward_model

_REHEARSED = 3  # touches before the first: what an estimator prepares only when it is needed is then ready


@dataclass(frozen=True, eq=False)
class Touch:
    """One steady touch. pressures: (taxels,) kPa, the mean of its readings. sensor_in_robot: (3,). came: host time, s,
    of its last reading.
    """

    pressures: FloatArray
    sensor_in_robot: FloatArray
    came: float


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed after the touches so far.

    estimate: None before the first touch. delay: s from the last reading of the last touch until this was known;
    None if the last touch was taken back.
    """

    touches: tuple[Touch, ...] = ()
    estimate: Estimate | None = None
    delay: float | None = None

    @property
    def sensor_in_object(self) -> FloatArray | None:
        """Give where the touches lie on the most probable object, (n, 3); None before the first."""
        if self.estimate is None:
            return None
        poses = np.array([touch.sensor_in_robot for touch in self.touches])
        return compose(self.estimate.robot_in_object, poses)


NOTHING = Belief()


class Recogniser:
    """Let a fitted estimator take touches one by one, take the last one back, and choose the next.

    delays: s from the last reading of each touch until it was known, of all objects so far.
    An estimator that would end the program is a RuntimeError: in a thread it would end nothing but the recognising.
    """

    def __init__(self, estimator: Estimator, letters: Sequence[str], seed: int) -> None:
        self.letters = tuple(letters)
        self.belief: Belief = NOTHING
        self.delays: list[float] = []
        self._estimator, self._seed = estimator, seed
        self._round = 0
        self._reset()

    @classmethod
    def fitted(
        cls, estimator: Estimator, train: Scan, seed: int, candidates: FloatArray | None = None
    ) -> Recogniser:
        """Fit the estimator to training readings and let it do everything once: what it prepares is then ready.

        candidates: (n, 3) sensor_in_robot, if it is to choose among them where it can. Raises InputError if it cannot
        be fitted to the readings.
        """
        fit(estimator, train, forward_model)
        made = cls(estimator, train.letters, seed)
        for reading, pose in zip(train.readings[:_REHEARSED], train.poses, strict=False):
            made.take(Touch(reading, pose, time.monotonic()))
        if candidates is not None and estimator.proposes:
            made.choose(candidates)
        made.begin_anew()
        made.delays.clear()
        return made

    def take(self, touch: Touch) -> Belief:
        """Take in a touch. Raises InputError that names the estimator if its answer is no estimate."""
        self._update(touch)
        estimate = self._estimate()
        delay = time.monotonic() - touch.came
        self.delays.append(delay)
        self.belief = Belief((*self.belief.touches, touch), estimate, delay)
        return self.belief

    def take_back(self, index: int) -> Belief:
        """Forget the touch of that index: the others are taken in again."""
        kept = tuple(touch for k, touch in enumerate(self.belief.touches) if k != index)
        self._reset()
        for touch in kept:
            self._update(touch)
        self.belief = Belief(kept, self._estimate() if kept else None)
        return self.belief

    def begin_anew(self) -> Belief:
        """Forget all touches: another object comes."""
        self._round += 1
        self._reset()
        self.belief = NOTHING
        return self.belief

    def choose(self, candidates: FloatArray) -> int:
        """Let the estimator choose the touch to try next among sensor_in_robot poses (n, 3): its index.

        Raises InputError if the estimator proposes no touches, or something that is none of them.
        """
        with no_exit(self._estimator):
            return proposed(self._estimator, candidates)

    def _update(self, touch: Touch) -> None:
        with no_exit(self._estimator):
            self._estimator.update(touch.pressures, touch.sensor_in_robot)

    def _estimate(self) -> Estimate:
        return checked_estimate(self._estimator, self.letters)

    def _reset(self) -> None:
        with no_exit(self._estimator):
            self._estimator.reset(np.random.default_rng([self._seed, self._round]))


def on_taxels(train: Scan, taxel_xy: FloatArray, name: str) -> Scan:
    """Keep the training readings, on the taxels at `taxel_xy` (taxels, 2) mm and in their order, without sequences.

    A scan without training readings gives all its readings. Raises InputError if the scan `name` lacks a taxel.
    """
    half = train.where("train")
    half = half if len(half) else train
    apart = np.abs(taxel_xy[:, None] - half.taxel_xy[None]).max(axis=-1)
    missing = int((apart.min(axis=1) > 1e-3).sum())  # mm
    if missing:
        raise InputError(
            f"{name} was taken on another pad: {missing} of the pad's {len(taxel_xy)} taxels are not in it, which has "
            f"{len(half.taxel_xy)}; give the scan of this pad, or name its --pad"
        )
    order = apart.argmin(axis=1)
    if not len(half):
        raise InputError(f"{name} holds no readings")
    return replace(
        half, readings=half.readings[:, order], split=np.full(len(half), "train"), taxel_xy=half.taxel_xy[order],
        sequence=None, sequence_times=None, sequence_force=None,
    )  # fmt: skip
