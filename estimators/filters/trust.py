"""The weight of the log-likelihood of a sequence of readings: how much they count.

A likelihood multiplies the taxels of a reading as if they erred independently. They do not: neighbours share the error
of the press's place and of the map, so that a posterior is too narrow. Here the log-likelihood of a sequence is given a
weight (a composite likelihood: Pauli, Racugno and Ventura 2011).

How much readings err is learned from those of training. Readings of a trial may err more, under a load that was not
trained, or less, between positions that lie well. They tell so themselves, by how far they disagree about the place:
the infinitesimal jackknife (`trust_kernels`). With few readings they tell little. So the weight is that of training,
corrected like a variance whose prior is worth a number of readings.

Readings of another load, pad or object than those of training are explained badly, wherever the object is thought to
be. Then no letter is like what is felt, and one that is less unlike than the others is not much more probable. `Misfit`
says how badly left-out training readings are explained, and so what of a sequence nothing in training explains.

The weight that is learned is the one with which regions that hold 90 % of the belief hold the truth in 90 % of
sequences of left-out training readings.

Readings at new places err independently, but left-out training readings do not: those at one position miss the same
press, and all of them together agree with the maps, which are their mean. So each reading of a sequence is mirrored, or
not, at random: moves of the object change their sign. That keeps the size of its error and what its likelihood makes
of it, and takes the correlation away (the wild bootstrap: Wu 1986, Liu 1988). What new readings do share is the error
of a map that was learned from N readings: the mean of n errs with the variance v / n + v / N.

A left-out reading errs too little if the map has other presses at its position, and too much if it has none: with the
share h of the map that a position has, its variance is (1 - h) and 1 / (1 - h) times what it is by itself. So readings
are left out in both ways. h is found from the two, and their geometric mean is the variance itself (compare HC2 of
MacKinnon and White 1985). At a new place the map's own error is added, h of that variance: (1 + h) in all, as for every
prediction of least squares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import IMPOSSIBLE, field_of
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.trust_kernels import influence_in_sequences, mostly_held, sums_of_readings
from tactsim.estimators.likelihoods.folds import LeftOut, folds, presses, some_labels
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood, TaxelSum

# Sequences of few and of many readings are tried.
FEW, MANY = 3, 20
# What was learned of how much readings err counts as so many readings of a trial that tell it.
_TRAINED = 20.0
# So many standard deviations above its mean a sum of misfits is in one sequence of training in twenty.
_BY_CHANCE = 1.645


@dataclass(frozen=True)
class Misfit:
    """How badly a left-out training reading is explained where its object truly lies.

    The misfit of a reading is what its log-likelihood lacks of the most that any prediction could give, nats. mean,
    deviation: over training readings; nothing counts as badly explained if they are not known.
    """

    mean: float = math.inf
    deviation: float = 0.0

    def unexplained(self, readings: int, misfit: float) -> float:
        """Give what of the misfit of a sequence, nats, left-out training readings would not have, chance included."""
        if math.isinf(self.mean):
            return 0.0
        return max(0.0, misfit - self._most(readings))

    def dispersion(self, readings: int, unexplained: float) -> float:
        """Give by what factor readings vary more than in training, if so much is unexplained (Wedderburn 1974).

        Training readings that are explained exactly are taken to lack one nat.
        """
        return 1 + unexplained / max(self._most(readings), 1.0)

    def _most(self, readings: int) -> float:
        """Give the misfit, nats, that chance leaves of all but one training sequence in twenty."""
        return readings * self.mean + _BY_CHANCE * self.deviation * math.sqrt(readings)


@dataclass(frozen=True)
class Trust:
    """The weight of the log-likelihood of a sequence of n readings, 1 / (own + growth ln n + shared n).

    own: how much too small the likelihood says the variance of the error of one reading is, as a factor. growth: how
    much more for e times as many readings: a narrow belief rests on finer features of the maps than a wide one. shared:
    the variance of the error that all readings have in common, the map's, in the same unit: that of the mean of its
    training readings. What grows is how maps err in detail, which is unlike from place to place and not shared. few,
    many: what the jackknife finds of the variance of one reading's error in sequences of few and of `longest` left-out
    readings, as shares of what it is, 0 if it was not tried. In a belief of few readings each of them has a large part.
    """

    own: float = 1.0
    growth: float = 0.0
    shared: float = 0.0
    few: float = 0.0
    many: float = 0.0
    longest: float = MANY
    misfit: Misfit = field(default_factory=Misfit)

    def __call__(self, readings: int) -> float:
        """Give the weight of a sequence of so many readings, of one at least."""
        count = max(readings, 1)
        return 1 / (self._apart(count) + self.shared * count)

    @property
    def corrected(self) -> bool:
        """Tell whether readings may correct the weight: the jackknife was tried on left-out ones, and found some."""
        return self.few > 0 and self.many > 0

    def given(self, readings: int, influence: float) -> float:
        """Give the weight of a sequence that tells itself how much its readings err.

        influence: of a reading, as `jackknife.influence` finds it in the belief with the weight of training; nan if it
        finds none. With n readings the error's own variance becomes

            (m + (n - 1) s) / (m + n - 1)

        times that of training, where s is the ratio of what is found to what is expected, and m the readings that
        training is worth.
        """
        if readings < 2 or math.isnan(influence) or not self.corrected:
            return self(readings)
        apart, others = self._apart(readings), readings - 1
        found = shown_error(self(readings), readings, influence) / self._seen(readings)
        return 1 / ((_TRAINED * apart + others * found) / (_TRAINED + others) + self.shared * readings)

    def shown(self, readings: int) -> float:
        """Give the variance in a belief by which one reading pulls its mean, in units of the jackknife's."""
        return self(readings) / (self._seen(readings) * self._apart(readings))

    def _apart(self, readings: int) -> float:
        """Give how much too small the likelihood says the variance is of the error that each reading has by itself."""
        return self.own + self.growth * math.log(readings)

    def _seen(self, readings: int) -> float:
        """Give what share of it the jackknife finds: the more readings there are, the less it falls short."""
        if self.longest <= FEW:
            return self.few
        short = (self.many - self.few) / (1 / FEW - 1 / self.longest)
        return self.few + short * (1 / FEW - 1 / max(readings, FEW))


def shown_error(weight: float, readings: int, influence: float) -> float:
    """Find the variance of one reading's error that the jackknife shows, in units of what the likelihood says.

    influence: of a reading in a belief with that weight. The squared moves of the mean, weight^2 times the influence,
    sum to the mean's variance beside the belief's, readings / (readings - 1) of it because each reading is in the mean.
    """
    return weight * readings**2 / (readings - 1) * influence


_SEQUENCES = 120  # of a number of readings of a letter are tried, at poses off by moves
# mm, the least and the largest move; a turn is counted at a letter's radius of gyration, mm.
_LEAST, _MOST, _GYRATION = 0.01, 4.0, 9.0
_ROOT = 1.1673039782614187  # of x^5 = x + 1
_SHARE = 0.9
_LOWEST, _HIGHEST, _BISECTIONS = 0.02, 2.0, 8


def learn_trust(likelihood: Likelihood, scan: Scan) -> Trust:
    """Learn the weight from the training readings of a scan; 1 if the likelihood cannot leave any of them out."""
    train, rng = scan.where("train"), np.random.default_rng(0)
    labels = some_labels(train)
    shift, size, states = _moves(train.poses[:, :2].mean(axis=0), likelihood.moves)
    errors, seen, longest, misfits = [], [], float(FEW), np.empty(0)
    for left_out in _left_out(likelihood, train, labels, states):
        log_p = [one.log_p for one in left_out]
        misfits = np.concatenate([one.most - one.log_p[:, size.argmin()] for one in left_out])
        found = [_typical(log_p, count, shift, size, rng) for count in (FEW, MANY)]
        errors.append([error for error, _, _ in found])
        seen.append([share for _, share, _ in found])
        longest = found[1][2]
    if not errors:
        return Trust()
    few, many = (_at_a_new_place(*both) for both in zip(*errors, strict=True))
    growth = max(0.0, (many - few) / math.log(longest / FEW)) if longest > FEW else 0.0
    own = few - growth * math.log(FEW) if growth else (few + many) / 2  # one number from both without growth
    own = max(own, growth, 1 / _HIGHEST)  # with less, two readings would say less than one
    trained = len(train) / len(train.letters)
    few_seen, many_seen = np.mean(seen, axis=0).tolist()
    misfit = Misfit()
    if np.isfinite(misfits).all():  # what the likelihood says at most is known
        misfit = Misfit(float(misfits.mean()), float(misfits.std()))  # as at new places
    return Trust(own, growth, own / trained, few_seen, many_seen, longest, misfit)


@dataclass(frozen=True)
class _LeftOut:
    """What maps without some training readings of a letter say of them, in nats.

    log_p: (readings, moves) at moved poses. most: (readings,) an upper bound of what any pose could give.
    """

    log_p: FloatArray
    most: FloatArray


def _typical(
    log_p: Sequence[FloatArray], count: int, shift: FloatArray, size: FloatArray, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Learn from sequences of so many readings: the means of the letters but the least and the greatest.

    The turn of a round letter is free, and only small turns are tried. Returns the error, 1 / weight; the share of it
    that the jackknife finds; and how many readings a sequence has, the mean of the letters.
    """
    found = []
    # As many moves are in each shell as in any other, though its volume grows with the cube of its size.
    log_volume, along = 3 * np.log(size), np.ascontiguousarray(shift.T)
    for one in log_p:
        drawn, mirrored = _sequences(len(one), count, rng)
        sums = sums_of_readings(one, drawn, mirrored)
        weight = _weight(sums, log_volume, along)
        moved = influence_in_sequences(one, drawn, mirrored, sums, weight, log_volume, along)
        readings = drawn.shape[1]
        found.append((1 / weight, weight * shown_error(weight, readings, moved) if readings > 1 else 0.0))
    error, seen = np.sort(found, axis=0)[1:-1].mean(axis=0) if len(found) > 2 else np.mean(found, axis=0)
    return float(error), float(seen), float(np.mean([min(len(one), count) for one in log_p]))


def _at_a_new_place(kept: float, gone: float) -> float:
    """Find 1 / weight at a new place from those with and without the position in the map: kept, gone.

    By the equations at the top of this module. Of few sequences kept may seem larger than gone: then h is 0.
    """
    kept = min(kept, gone)
    share = 1 - math.sqrt(kept / gone)
    return math.sqrt(kept * gone) * (1 + share)


def _weight(sums: FloatArray, log_volume: FloatArray, along: FloatArray) -> float:
    """Find the weight with which regions of 90 % hold no move at all in 90 % of sequences, log p (sequences, moves).

    log_volume: (moves,) of what a move stands for. along: (2, moves) mm; only shifts count, because a round letter's
    turn is unknown.
    """
    low, high, order = _LOWEST, _HIGHEST, np.arange(len(sums))
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        held = mostly_held(sums, order, middle, log_volume, along, _SHARE)
        low, high = (middle, high) if held else (low, middle)
    return math.sqrt(low * high)


def _moves(centre: FloatArray, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw n = count moves of an object: shifts (n, 2) of its centre [x, y], sizes (n,), mm, and T_R^O (3, n).

    They have all sizes, as many of one order of magnitude as of another, and all directions, spread evenly by an
    additive recurrence (Richtmyer 1951) with the powers of the root of x^5 = x + 1 (Roberts 2018). Few of them lie in a
    narrow region, and drawn independently they would make it seem narrower than it is. The second half are those of
    the first half the other way.
    """
    spread = (np.arange(1, count // 2 + 1)[:, None] * _ROOT ** -np.arange(1.0, 5.0) + 0.5) % 1
    size = _LEAST * (_MOST / _LEAST) ** spread[:, 0]
    direction = np.vectorize(NormalDist().inv_cdf)(spread[:, 1:])
    move = direction / np.linalg.norm(direction, axis=1, keepdims=True) * size[:, None]
    move, size = np.concatenate([move, -move]), np.tile(size, 2)
    turn = move[:, 2] / _GYRATION
    cos, sin, (x, y) = np.cos(turn), np.sin(turn), centre
    about = centre - np.column_stack([cos * x - sin * y, sin * x + cos * y])
    shift = move[:, :2].copy()
    return shift, size, np.column_stack([shift + about, turn]).T


def _left_out(
    likelihood: Likelihood, train: Scan, labels: Sequence[str], states: FloatArray
) -> Iterator[list[_LeftOut]]:
    """Compute log p of training readings at moved poses, without themselves, then without all at their positions.

    Yields what is found for each letter, twice; nothing of a likelihood that cannot leave readings out. Of each
    reading the taxels count that lie where others were felt, or all if the likelihood is no sum over them.
    """
    said: dict[int, Evidence] = {}  # both times the same
    for whole_positions in (False, True):
        found: dict[str, list[FloatArray]] = {label: [] for label in labels}
        most: dict[str, list[float]] = {label: [] for label in labels}
        out = LeftOut.of(train, folds if whole_positions else presses)
        for gone in out:
            rest = likelihood.without(train, gone, labels, whole_positions)
            if rest is None:
                return
            cell = rest.options.cell
            field = field_of(rest, labels, train.taxel_xy, (cell, cell), cell)
            those = np.flatnonzero(gone & np.isin(train.labels, labels))
            for k in those.tolist():
                if isinstance(field, TableField) and isinstance(rest, TaxelSum):
                    if k not in said:
                        said[k] = rest.evidence(train.readings[k])
                    field.add(said[k].of_taxels(out.known[k]), np.array(train.poses[k]))
                else:
                    field.append(train.readings[k], np.array(train.poses[k]))
                most[train.labels[k].item()].append(field.bound(len(field) - 1))
            first = 0
            for label, run in groupby(train.labels[those].tolist()):
                last = first + len(list(run))
                log_p = field.each(labels.index(label), states, first, last)
                found[label].extend(np.maximum(log_p, IMPOSSIBLE))
                first = last
        if not any(found.values()):
            return
        yield [_LeftOut(np.array(found[label]), np.array(most[label])) for label in labels]


def _sequences(
    readings: int, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Draw sequences of `count` of a letter's readings, or of all, and half of the readings to be mirrored.

    Returns the readings' numbers, and 1 for those that are mirrored, (sequences, count) both.
    """
    drawn = np.array([rng.permutation(readings)[:count] for _ in range(_SEQUENCES)])
    return drawn, rng.integers(2, size=drawn.shape)
