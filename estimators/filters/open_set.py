"""None of the known letters: how well the best letter explains what was felt, and how well it should.

Open-set recognition: a filter over the known letters always names one of them. Whether the object is that
letter at all is told by the misfit of the readings, half of chi^2 beside what the letter's mosaic predicts at the
best pose (`likelihoods.tilted_mosaic`), compared with the misfit of the letter's own training readings, each looked
up in mosaics without itself, or with it, as those of an object are that lies as it did in training.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactsim.core import InputError, Scan, compose, invert
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import NONE, Estimate
from tactsim.estimators.filters.states import WeightedStates
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.likelihoods.tilted_mosaic import TiltedMosaics
from tactsim.estimators.options import OpenSetOptions

_HALF_LOG_2PI = math.log(2 * math.pi) / 2
_LEAST_DEVIATION = 1e-3  # nats
# Letters that are less probable than this beside the most probable one, and all but so many, are not asked.
_NEGLIGIBLE, _ASKED = 1e-3, 3


@dataclass(frozen=True)
class Misfit:
    """How the misfit of one reading is spread for a letter's own readings, and where chance begins.

    mean, deviation: nats, of the letter's readings. drift: nats, standard deviation of what the mean itself may be off
    by, for all readings of a sequence together. chance: nats, the mean of readings that are looked up where they were
    not taken.
    """

    mean: float
    deviation: float
    drift: float
    chance: float

    def log_odds(self, total: float, readings: int) -> float:
        """Weigh "none" against the letter by the summed misfit (nats) of its readings: log p(m | none) / p(m | letter).

        The letter's own sum is taken as normal. For another object the mean misfit of a reading is anything
        between the letter's own and chance, all alike, and the sum is spread about it as widely as the letter's own.
        """
        if not readings:
            return 0.0
        spread = math.hypot(self.deviation * math.sqrt(readings), self.drift * readings)
        z = (self.mean * readings - total) / spread
        width = (self.chance - self.mean) * readings / spread
        return _log_smeared(z, width) + z**2 / 2


class OpenSet:
    """How probable it is that the object is none of the known letters, beside a filter over these; the filter has it.

    The filter's pose must be exact enough for a search to begin there: in the middle of a large bin, it may end
    in the wrong place.

    mosaics: of all letters that were learned. misfit: by letter, how its own readings fit, at each load: at new places,
    and where the letter was pressed in training.
    """

    def __init__(self, options: OpenSetOptions, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn how well each letter's own training readings fit its mosaic.

        Raises InputError if a letter is called "none".
        """
        if NONE in maps:
            raise InputError(f"a letter is called {NONE!r}: with unknown above 0 that means no known letter")
        self._unknown = options.unknown
        self._taxel_xy = scan.taxel_xy
        self.mosaics = TiltedMosaics(options)
        self.mosaics.fit(scan, maps)
        self.misfit = {
            label: [learn_misfit(self.mosaics, label, again) for again in (False, True)] for label in maps
        }
        self.reset()

    def reset(self) -> None:
        """Forget the sequence."""
        self._felt: list[tuple[FloatArray, FloatArray]] = []

    def keep(self, reading: FloatArray, sensor_in_robot: FloatArray) -> None:
        """Keep a reading (taxels,) for the comparison with what mosaics predict."""
        self._felt.append((reading, sensor_in_robot))

    def estimate(self, known: Estimate, log_odds: float) -> Estimate:
        """Give "none" its share beside the known letters: the prior odds, times what the misfits say (`log_odds`)."""
        odds = log_odds + math.log(self._unknown) - math.log1p(-self._unknown)
        none = 1 / (1 + math.exp(-odds)) if odds > 0 else math.exp(odds) / (1 + math.exp(odds))
        probabilities = {label: (1 - none) * p for label, p in known.probabilities.items()} | {NONE: none}
        best = max(probabilities, key=probabilities.__getitem__)
        return replace(known, label=best, probabilities=probabilities)

    def log_odds(self, known: Estimate, path: FloatArray, states: Callable[[], WeightedStates]) -> float:
        """Weigh "none" against the letters that may still be: p(m | none) / p(m | letter), its inverse averaged.

        known: the estimate over the known letters. path: robot_in_object at each touch (n, 3) that goes with it.
        states: gives the belief over the known letters.
        """
        if not self._felt:
            return 0.0
        readings, poses = self._history(known, path)
        least = _NEGLIGIBLE * known.probabilities[known.label]
        ranked = sorted(known.probabilities.items(), key=lambda item: (item[0] != known.label, -item[1]))
        against, asked = [], 0.0
        for label, p in [item for item in ranked[:_ASKED] if item[1] > least]:
            start: FloatArray | None = known.robot_in_object
            if label != known.label:
                start = _likeliest(list(known.probabilities).index(label), states())
            if start is None:
                continue
            pose = self.mosaics.fitting_pose(label, start, readings, poses)
            total = float(self.mosaics.misfits(label, pose, readings, poses).sum())
            # Nobody says whether the object lies as it did in training: the letter has the better of both.
            odds = min(log_odds(misfits, total, len(readings)) for misfits in self.misfit[label])
            against.append(math.log(p) - odds)
            asked += p
        # Letters that are not asked are taken to fit as those that are.
        return math.log(asked) - float(np.logaddexp.reduce(against))

    def _history(self, known: Estimate, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Give the readings so far (n, taxels) and their poses (n, 3), as they would be had the object lain still.

        Where it has moved, along the path that goes with the estimate, the sensor is moved back with it.
        """
        readings = np.array([reading for reading, _ in self._felt]).reshape(-1, len(self._taxel_xy))
        poses = np.array([pose for _, pose in self._felt]).reshape(-1, 3)
        last = known.robot_in_object
        moved = (path != last).any(axis=1)
        poses[moved] = compose(invert(last), compose(path[moved], poses[moved]))
        return readings, poses


def _likeliest(letter: int, belief: WeightedStates) -> FloatArray | None:
    """Find the most probable state of a letter, T_R^O; None if none holds a part of the belief."""
    chosen = np.flatnonzero(belief.letter == letter)
    if not len(chosen):
        return None
    return belief.state[:, chosen[belief.weights.log[chosen].argmax()]]


def log_odds(misfits: Sequence[Misfit], total: float, readings: int) -> float:
    """Weigh "none" against a letter whose presses may be of any of these loads, all alike: `Misfit.log_odds`, averaged.

    The readings of a sequence are taken to be of one load, for it is one hand or machine that presses.
    """
    against = [-misfit.log_odds(total, readings) for misfit in misfits]
    return math.log(len(against)) - float(np.logaddexp.reduce(against))


def learn_misfit(mosaics: TiltedMosaics, label: str, again: bool = False) -> tuple[Misfit, ...]:
    """Learn how the misfit of a letter's readings is spread, at each load at which its poses were felt.

    A place of the object may be known as well as where training readings were taken, or as badly as between them.
    A reading comes from either, and so does the mean: all that lies between the two is as likely.

    again: whether the places are those of training itself. One if no pose was felt at several loads.
    """
    near, far, elsewhere = mosaics.left_out(label)
    if again:
        near = far = mosaics.kept(label)
    level = mosaics.load_levels(label)
    at_levels = [(near[level == load], far[level == load]) for load in np.unique(level)]
    return tuple(
        Misfit(
            mean=float(close.mean() + away.mean()) / 2,
            deviation=math.sqrt(float(close.var() + away.var()) / 2 + _LEAST_DEVIATION**2),
            drift=abs(float(away.mean() - close.mean())) / math.sqrt(12),
            chance=float(elsewhere.mean()),
        )
        for close, away in at_levels
    )


def _log_smeared(z: float, width: float) -> float:
    """Compute log of the mean of the normal density over [z, z + width], relative to that at z, less z^2 / 2."""
    from scipy.special import log_ndtr

    if width < 1e-6:
        return -(z**2) / 2
    # The tail that is not rounded to 1.
    more, less = (z + width, z) if z < 0 else (-z, -z - width)
    top = float(log_ndtr(more))
    return top + math.log(-math.expm1(float(log_ndtr(less)) - top)) - math.log(width) + _HALF_LOG_2PI
