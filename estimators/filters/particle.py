"""Particle filters (paper, section III-B): as printed, and with random particles injected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import transform, wrap_angle
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief
from tactsim.estimators.field.state_kernels import add_cones, draw, sum_cones, weigh
from tactsim.estimators.field.tables import tabulate
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.resampling import systematic
from tactsim.estimators.likelihoods.likelihood import Evidence
from tactsim.estimators.options import FilterOptions

# The grid on which the paper evaluates the density of eq. 11: mm, mm, rad.
PARZEN_STEP = np.array([0.5, 0.5, 0.04 * np.pi])
# Particles lighter than this share of the heaviest are added to the density only if they could
# decide which node is highest.
_LIGHT = 1e-4
# By how much a sum of cones in float32 may be off, relative to itself: thirty times what was seen.
_ROUNDING = 1e-4
# Nodes along a side of the tiles in which the density is worked out, 64 mm: the paper's poses fit into one.
_TILE = 128
# Cells along a side of a picture of the belief, whatever `reach` is.
_MOST_CELLS = 200


class ParticleOptions(FilterOptions):
    """Options of the particle filter."""

    particles: int = Field(
        10_000, ge=1, le=10_000_000, description="n_P, the total over all letters together"
    )
    noise_mm: float = Field(1.0, ge=0, le=100, description="sigma of the command update in x and y, mm")
    noise_rad: float = Field(0.1, ge=0, le=10, description="sigma of the command update in the angle, rad")
    rho: float = Field(1.0, gt=0, le=3, description="rho of eq. 10, mm and rad")


class ParticleFilter(MapFilter):
    """Particle filter over letter, x, y and angle (paper, eq. 8 to 12), resampled at every reading."""

    options_type: ClassVar[type[Options]] = ParticleOptions
    budget = "particles"
    options: ParticleOptions

    def __init__(self, options: ParticleOptions) -> None:
        super().__init__(options)
        self._evaluated = 0

    def prepare(self) -> None:
        """Tabulate the likelihood, once for each map cell."""
        cell = self.options.cell
        tables = tabulate(self.likelihood, self.labels, (cell, cell), cell)
        self._nodes = np.ascontiguousarray(tables.values[:, :, 0, 0])
        self._lattice = np.concatenate([tables.origin, tables.step])
        self._outside = tables.outside

    def restart(self, rng: np.random.Generator) -> None:
        """Spread the particles evenly over letters and uniformly over poses."""
        count = self.options.particles
        self._rng = rng
        self._letter = np.arange(count) % len(self.labels)
        self._state = self._random_states(count)
        self._weight = np.ones(count)
        self._fresh = True

    def take(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Resample, then corrupt with noise (command update), then weigh (measurement update).

        The paper resamples last; resampling first in the next reading instead leaves the weighted
        particles of eq. 9 and 11 for the estimate.
        """
        if not self._fresh:
            self._resample()
        self._fresh = False
        evidence.check(len(self._nodes), len(self.taxel_xy))
        chosen = self.options
        noise = self._rng.standard_normal(self._state.shape)
        noise[:2] *= chosen.noise_mm
        noise[2] *= chosen.noise_rad
        self._state += noise
        np.clip(self._state[:2], -chosen.reach, chosen.reach, out=self._state[:2])
        far = evidence.weight @ self._outside[evidence.table]
        log_weight = far[self._letter]
        xy = transform(sensor_in_robot, self.taxel_xy)[evidence.taxel]
        weigh(
            log_weight, self._state, self._letter, evidence.table, xy, evidence.weight,
            self._nodes, self._lattice,
        )  # fmt: skip
        self._evaluated += len(self._letter)
        # In proportion to w_t. The heaviest is 1: in logs the weights cannot all be zero.
        self._log_highest = log_weight.max()
        self._weight = np.exp(log_weight - self._log_highest)

    def answer(self) -> Estimate:
        """Sum the weights of each letter (eq. 9); find the mode (eq. 12) within the best letter."""
        weight = self._weight
        mass = np.bincount(self._letter, weight, minlength=len(self.labels))
        best = int(mass.argmax())
        mine = self._letter == best
        probabilities = (mass / mass.sum()).tolist()
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, probabilities, strict=True)),
            robot_in_object=parzen_mode(self._state.compress(mine, axis=1), weight[mine], self.options.rho),
        )

    def draw_states(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw particles by their weights."""
        chosen = systematic(self._weight, count, rng)
        return self._letter[chosen], self._state.take(chosen, axis=1)

    def belief_over_plane(self) -> PlaneBelief:
        """Count the weighted particles in cells of about 1 mm."""
        return plane_histogram(self.labels, self._letter, self._state, self._weight, self.options.reach)

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a particle in a reading each, since the estimator was made."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {}}

    def _resample(self) -> None:
        """Draw n_P particles with replacement, with probability proportional to their weights."""
        chosen = np.empty(len(self._letter), dtype=np.int64)
        draw(chosen, self._weight, self._rng.random(len(chosen)))
        self._letter, self._state = self._letter[chosen], self._state.take(chosen, axis=1)

    def _random_states(self, count: int) -> FloatArray:
        reach = self.options.reach
        return self._rng.uniform(-1, 1, (3, count)) * [[reach], [reach], [np.pi]]


class AugmentedOptions(ParticleOptions):
    """Options of augmented Monte Carlo localisation."""

    alpha_slow: float = Field(0.05, gt=0, le=1, description="decay of the long-term mean of w")
    alpha_fast: float = Field(0.5, gt=0, le=1, description="decay of the short-term mean of w")


class AugmentedFilter(ParticleFilter):
    """Augmented MCL (paper, ref. [23]): a particle filter that injects random particles when w falls.

    Each particle is replaced by a random one with probability max(0, 1 - w_fast / w_slow), where w_slow
    and w_fast follow the mean weight slowly and fast.
    """

    options_type: ClassVar[type[Options]] = AugmentedOptions
    options: AugmentedOptions

    def __init__(self, options: AugmentedOptions) -> None:
        if options.alpha_slow > options.alpha_fast:
            raise InputError(
                f"alpha_slow {options.alpha_slow} is above alpha_fast {options.alpha_fast}; "
                "the slow mean must be the slower one"
            )
        super().__init__(options)
        self._injected = 0

    def restart(self, rng: np.random.Generator) -> None:
        """Spread the particles and forget the means of the weights."""
        super().restart(rng)
        self._log_slow = self._log_fast = -math.inf

    def take(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Update as the particle filter does, then follow the mean weight, in logs."""
        super().take(evidence, sensor_in_robot)
        mean = self._log_highest + math.log(self._weight.mean())
        self._log_slow = _mix(self._log_slow, mean, self.options.alpha_slow)
        self._log_fast = _mix(self._log_fast, mean, self.options.alpha_fast)

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, and the random particles injected, since the estimator was made."""
        return {**super().work, "injected": self._injected}

    def _resample(self) -> None:
        super()._resample()
        share = max(0.0, -math.expm1(min(0.0, self._log_fast - self._log_slow)))
        replaced: NDArray[np.bool_] = self._rng.random(len(self._letter)) < share
        count = int(replaced.sum())
        self._letter[replaced] = self._rng.integers(len(self.labels), size=count)
        self._state[:, replaced] = self._random_states(count)
        self._injected += count


def plane_histogram(
    labels: tuple[str, ...], letter: NDArray[np.int64], state: FloatArray, weight: FloatArray, reach: float
) -> PlaneBelief:
    """Sum the weights (n,) of particles, letter (n,), state (3, n), in cells of about 1 mm, larger if they are many."""
    cells = min(max(1, round(2 * reach)), _MOST_CELLS)
    edges = np.linspace(-reach, reach, cells + 1)
    total = np.zeros((len(labels), cells, cells))
    for k in range(len(labels)):
        mine = letter == k
        x, y = state[:2, mine]
        total[k] = np.histogram2d(y, x, bins=(edges, edges), weights=weight[mine])[0]
    middle = (edges[1:] + edges[:-1]) / 2
    return PlaneBelief(labels, middle, middle, total / total.sum())


def parzen_mode(state: FloatArray, weight: FloatArray, rho: float = 1.0) -> FloatArray:
    """Find the pose of highest density (eq. 10 to 12) on the grid of 0.5 mm and 0.04 pi rad.

    state: (3, n) mm, mm, rad. weight: (n,). Light particles are looked at only if all of them together
    could lift another node above the highest.
    """
    weight = weight / weight.max()  # of a size for float32
    heavy = weight > _LIGHT
    mode, lead = _density_mode(state.compress(heavy, axis=1), weight[heavy], rho)
    if lead <= weight[~heavy].sum():
        mode, _ = _density_mode(state, weight, rho)
    return mode


def _density_mode(state: FloatArray, weight: FloatArray, rho: float) -> tuple[FloatArray, float]:
    """Find the highest node of the density, and how much higher it is, at least, than every other."""
    low = np.floor(state[:2].min(axis=1) / PARZEN_STEP[:2]) * PARZEN_STEP[:2]
    high = np.ceil(state[:2].max(axis=1) / PARZEN_STEP[:2]) * PARZEN_STEP[:2]
    columns, rows = (np.rint((high - low) / PARZEN_STEP[:2]).astype(int) + 1).tolist()
    on_circle = np.stack([state[0], state[1], np.mod(state[2], 2 * np.pi)])
    best, second = (-1.0, (0, 0, 0)), 0.0
    for row, column, near in _tiles(on_circle, low, rows, columns, rho):
        states, weights = (
            (on_circle, weight) if near is None else (on_circle.take(near, axis=1), weight[near])
        )
        size = min(rows - row, _TILE), min(columns - column, _TILE)
        density = _density(states, weights, low + PARZEN_STEP[:2] * [column, row], size, rho)
        flat = density.reshape(-1)
        # The grid is summed in float32; the nodes that may be the highest are summed again.
        close = np.flatnonzero(flat >= flat.max() * (1 - _ROUNDING))
        inside = np.stack(np.unravel_index(close, density.shape), axis=-1) + [row, column, 0]
        node = np.ascontiguousarray(inside[:, [1, 0, 2]] * PARZEN_STEP + [*low, 0])
        heights = np.empty(len(close))
        sum_cones(heights, node, states, weights, rho)
        first = int(heights.argmax())
        height, flat[close[first]] = float(heights[first]), 0
        place = tuple(inside[first].tolist())
        second = max(second, float(flat.max()) * (1 + _ROUNDING), min(height, best[0]))
        if height > best[0] or (height == best[0] and place < best[1]):
            best = (height, place)
    height, (row, column, angle) = best
    dx, dy, turn = PARZEN_STEP
    return np.array([low[0] + column * dx, low[1] + row * dy, wrap_angle(angle * turn)]), height - second


def _tiles(
    state: FloatArray, low: FloatArray, rows: int, columns: int, rho: float
) -> Iterator[tuple[int, int, NDArray[np.intp] | None]]:
    """Cut a plane of rows x columns nodes into tiles, and leave out those that no cone reaches.

    state: (3, n). low: [x, y] mm of the first node. Gives each tile's first row and column and the indices,
    ascending, of the states whose cones may reach it; None for all of them, where one tile does.
    """
    if max(rows, columns) <= _TILE:
        yield 0, 0, None
        return
    nodes = (state[:2] - low[:, None]) / PARZEN_STEP[:2, None]
    reach = rho / PARZEN_STEP[0] + 1  # at most 7 nodes, so that a cone reaches two tiles each way
    edges = [np.clip((nodes + side) // _TILE, 0, None).astype(np.int64) for side in (-reach, reach)]
    across = columns // _TILE + 2
    tile = np.concatenate([edges[i][1] * across + edges[j][0] for i in (0, 1) for j in (0, 1)])
    owner = np.tile(np.arange(state.shape[1]), 4)
    order = np.lexsort((owner, tile))
    tile, owner = tile[order], owner[order]
    again = np.zeros(len(tile), dtype=bool)
    again[1:] = (tile[1:] == tile[:-1]) & (owner[1:] == owner[:-1])
    tile, owner = tile[~again], owner[~again]
    for near in np.split(np.arange(len(tile)), np.flatnonzero(np.diff(tile)) + 1):
        row, column = divmod(int(tile[near[0]]), across)
        if row * _TILE < rows and column * _TILE < columns:
            yield row * _TILE, column * _TILE, owner[near]


def _density(
    on_circle: FloatArray, weight: FloatArray, low: FloatArray, size: tuple[int, int], rho: float
) -> FloatArray:
    """Sum the cones of states (3, n) at the nodes of a tile: (rows, columns, angles)."""
    around, angles = int(rho / PARZEN_STEP[2]) + 1, round(2 * math.pi / PARZEN_STEP[2])
    density = np.zeros((*size, angles + 2 * around + 1), dtype=np.float32)
    add_cones(density, around, on_circle, weight, low, PARZEN_STEP, rho)
    # What went round the circle at either end belongs to the other.
    density[:, :, angles : angles + around] += density[:, :, :around]
    density[:, :, around : 2 * around + 1] += density[:, :, around + angles :]
    return np.ascontiguousarray(density[:, :, around : around + angles])


def _mix(log_mean: float, log_value: float, share: float) -> float:
    """Move a mean by a share towards a value, both in logs; a mean of nothing has log -inf."""
    stay = math.log1p(-share) if share < 1 else -math.inf
    return float(np.logaddexp(stay + log_mean, math.log(share) + log_value))
