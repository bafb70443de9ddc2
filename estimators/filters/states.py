"""A belief as weighted states (letter, T_R^O), their weights, kept as logs, and what is made of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PlaneBelief, PoseSamples
from tactsim.estimators.filters.placement import samples_of_cells

_BISECTIONS = 14  # of a power
# Cells along a side of a picture of the belief, whatever `reach` is.
_MOST_CELLS = 200
# A cell with more than this share of the belief stands for eight poses, in its corners' directions, one with less for
# its middle: so a belief in few cells is not a belief in few points. `samples_of_cells` says when it does not.
SPREAD = 1e-3
# The eight poses of a cell (8, 3), in units of its size: as far from the middle as the cell's points are, rms.
CORNERS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / np.sqrt(12)


@dataclass(frozen=True, eq=False)
class Weights:
    """The weights of n states, from 1. log: (n,), of any common factor; -inf is weight 0, at least one is finite."""

    log: FloatArray

    def __len__(self) -> int:
        return len(self.log)

    @cached_property
    def relative(self) -> FloatArray:
        """Give the weights (n,) in the unit of the heaviest, which is 1: they cannot all be 0."""
        below = self.log - self.log.max()
        return np.exp(below, out=below)

    @property
    def normalised(self) -> FloatArray:
        """Give the weights (n,), summing to 1."""
        return self.relative / self.relative.sum()

    @property
    def log_mean(self) -> float:
        """Give the log of the mean weight."""
        return float(self.log.max() + np.log(self.relative.mean()))

    @property
    def ess(self) -> float:
        """Give the effective sample size, from 1 to n (Kong 1992)."""
        weight = self.relative
        return float(weight.sum() ** 2 / (weight @ weight))

    def systematic(self, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
        """Draw `count` indices, ascending, each as often as is due, rounded up or down.

        Systematic resampling (Kitagawa 1996): one random number, the least variance for its cost.
        """
        return self.spaced(count, rng.random())

    def spaced(self, count: int, first: float) -> NDArray[np.intp]:
        """List the indices at which the sum of the weights reaches (k + first) / count of all, `count` ascending ones.

        first: from 0 to 1.
        """
        reached = np.cumsum(self.relative)
        ladder = (np.arange(count) + first) / count * reached[-1]
        return np.minimum(np.searchsorted(reached, ladder, side="right"), len(self) - 1)


def highest_power(log_weight: FloatArray, log_p: FloatArray, least: float, low: float = 0.0) -> float:
    """Find the largest power b from `low` to 1 with which weights times p^b leave so many states effective.

    log_weight, log_p: (n,). least: effective sample size. By bisection; `low` if no power does.
    """
    if Weights(log_weight + log_p).ess >= least:
        return 1.0
    high = 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        enough = Weights(log_weight + middle * log_p).ess >= least
        low, high = (middle, high) if enough else (low, middle)
    return low


@dataclass(frozen=True, eq=False)
class WeightedStates:
    """The belief of a filter: states and how much each weighs.

    letter: (n,) index into the filter's `labels`. state: (3, n) T_R^O mm, mm, rad. weights: n of them.
    size: (3, n) mm, mm, rad, of the cells whose middles the states are; None if they are points.
    """

    letter: NDArray[np.int64]
    state: FloatArray
    weights: Weights
    size: FloatArray | None = None

    def draw(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw equally probable states: letter (count,), state (3, count), at a random place in their cells."""
        chosen = self.weights.systematic(count, rng)
        letter, state = self.letter[chosen], self.state.take(chosen, axis=1)
        if self.size is not None:
            state = state + rng.uniform(-0.5, 0.5, (3, count)) * self.size[:, chosen]
        return letter, state


def pose_samples(state: FloatArray, weights: Weights, size: FloatArray | None = None) -> PoseSamples:
    """Make the belief about the pose of one letter from its states (3, n) and n weights.

    size: (3, n) mm, mm, rad, of the cells whose middles the states are; None if they are points.
    """
    weight = weights.normalised
    if size is None:
        return PoseSamples(np.ascontiguousarray(state.T), weight)
    return PoseSamples(*samples_of_cells(state, weight, size, CORNERS, SPREAD))


def letter_mass(letter: NDArray[np.int64], weights: Weights, letters: int) -> FloatArray:
    """Sum the weights of states of each letter (letters,), in the unit of the heaviest (eq. 9)."""
    return np.asarray(np.bincount(letter, weights.relative, minlength=letters), dtype=float)


def likeliest_view(
    mass: FloatArray, same_object: NDArray[np.bool_], stated: NDArray[np.bool_] | None = None
) -> int:
    """Find the likeliest label of the likeliest object, whose views count together.

    mass: (labels,) what each holds. same_object: (labels, labels) which labels are views of one object. stated:
    (labels,) those that may be named; all without it.
    """
    of_object = same_object @ mass
    if stated is not None:
        of_object = np.where(stated, of_object, -1.0)
    return int(np.where(of_object == of_object.max(), mass, -1.0).argmax())


def shared(mass: FloatArray, alike: NDArray[np.int64]) -> FloatArray:
    """Let letters that are one hypothesis have equal parts of what it holds: (letters, ...) like `mass`.

    alike: (letters,) the number of each letter's hypothesis, see `LikelihoodField.alike`.
    """
    total = np.zeros_like(mass)
    np.add.at(total, alike, mass)
    letters = np.bincount(alike, minlength=len(mass))[alike]
    return total[alike] / letters.reshape(-1, *(1,) * (mass.ndim - 1))


def uniform_states(count: int, reach: float, rng: np.random.Generator) -> FloatArray:
    """Draw T_R^O (3, count) uniformly: x and y in [-reach, reach] mm, any angle."""
    return rng.uniform(-1, 1, (3, count)) * [[reach], [reach], [np.pi]]


def plane_histogram(
    labels: tuple[str, ...], belief: WeightedStates, x: FloatArray, y: FloatArray
) -> PlaneBelief:
    """Sum the weights of a belief in the cells whose centres are x (columns,) and y (rows,) mm, in ascending order."""
    edges = [np.concatenate([[-np.inf], (of[1:] + of[:-1]) / 2, [np.inf]]) for of in (y, x)]
    total = np.zeros((len(labels), len(y), len(x)))
    for k in range(len(labels)):
        of_letter = belief.letter == k
        along_x, along_y = belief.state[:2, of_letter]
        weights = belief.weights.relative[of_letter]
        total[k] = np.histogram2d(along_y, along_x, bins=edges, weights=weights)[0]
    return PlaneBelief(labels, x, y, total / total.sum())


def plane_cells(reach: float) -> FloatArray:
    """Give the centres, mm, of cells of about 1 mm from -reach to reach, larger if they would be many."""
    count = min(max(1, round(2 * reach)), _MOST_CELLS)
    return reach * (np.arange(1, 2 * count, 2) / count - 1)
