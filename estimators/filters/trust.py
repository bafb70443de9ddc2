"""The weight of the log-likelihood of a sequence of readings: how much they count (learned in `trust_learning`).

A likelihood multiplies the taxels of a reading as if they erred independently. They do not: neighbours share the error
of the press's place and of the map, so that a posterior is too narrow. Here the log-likelihood of a sequence is given a
weight (a composite likelihood: Pauli, Racugno and Ventura 2011).

How much readings err is learned from those of training. Readings of a trial may err more, under a load that was not
trained, or less, between positions that lie well. They tell so themselves, by how far they disagree about the place:
the infinitesimal jackknife (`jackknife`). With few readings they tell little. So the weight is that of training,
corrected like a variance whose prior is worth a number of readings.

Readings of another load, pad or object than those of training are explained badly, wherever the object is thought to
be. Then no letter is like what is felt, and one that is less unlike than the others is not much more probable. `Misfit`
says how badly left-out training readings are explained, and so what of a sequence nothing in training explains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
        by_chance = _BY_CHANCE * self.deviation * math.sqrt(readings)
        return max(0.0, misfit - readings * self.mean - by_chance)


@dataclass(frozen=True)
class Trust:
    """The weight of the log-likelihood of a sequence of n readings, 1 / (own + growth ln n + shared n).

    own: how much too small the likelihood says the variance of the error of one reading is, as a factor. growth: how
    much more for e times as many readings: a narrow belief rests on finer features of the maps than a wide one.
    shared: the variance of the error that all readings have in common, the map's, in the same unit: that of the mean of
    its training readings. What grows is how maps err in detail, which is unlike from place to place and not shared.
    few, many: what the jackknife finds of the variance of one reading's error in sequences of few and of `longest`
    left-out readings, as shares of what it is, 0 if it was not tried. In a belief of few readings each of them has a
    large part.
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

    def given(self, readings: int, influence: float) -> float:
        """Give the weight of a sequence that tells itself how much its readings err.

        influence: of a reading, as `jackknife.influence` finds it in the belief with the weight of training; nan if it
        finds none. With n readings the error's own variance becomes

            (m + (n - 1) s) / (m + n - 1)

        times that of training, where s is the ratio of what is found to what is expected, and m the readings that
        training is worth.
        """
        if readings < 2 or math.isnan(influence) or not (self.few > 0 and self.many > 0):
            return self(readings)
        apart, others = self._apart(readings), readings - 1
        found = shown_error(self(readings), readings, influence) / self._seen(readings)
        return 1 / ((_TRAINED * apart + others * found) / (_TRAINED + others) + self.shared * readings)

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
