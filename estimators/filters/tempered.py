"""Tempered particles: one population a letter, kept spread out by a temperature, moved by its own spread."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import transform, wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief
from tactsim.estimators.field.state_kernels import weigh
from tactsim.estimators.field.tables import tabulate
from tactsim.estimators.filters.open_set import OpenSetFilter, OpenSetOptions
from tactsim.estimators.filters.particle import plane_histogram
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.resampling import systematic
from tactsim.estimators.likelihoods.likelihood import Evidence

# A move reaches this far, in differences between two other particles of the letter; drawn for each
# particle from the row, so that some move within a mode and some between modes.
_STRIDES = np.array([0.1, 0.5, 1.0])
# And a little noise on top, so that a population of copies can spread again: mm, mm, rad.
_JITTER = np.array([[0.02], [0.02], [0.002]])
_BISECTIONS = 20
# A letter this many nats behind the best is weighed, not moved: it would have to be misjudged by as much.
_HOPELESS = 60.0


class TemperedOptions(OpenSetOptions):
    """Options of the tempered particle filter."""

    likelihood: str = Field("calibrated", description="the measurement model: paper, calibrated, force")
    particles: int = Field(
        10_000, ge=1, le=10_000_000, description="n_P over all letters together; each has an equal part"
    )
    rounds: int = Field(8, ge=1, le=100, description="the most rounds of resampling and moving at a reading")
    survivors: float = Field(
        0.5, gt=0, lt=1, description="share of a population that must stay effective: sets the temperature"
    )
    skip: bool = Field(True, description="do not move the particles of letters that cannot matter")


@dataclass(eq=False)
class _Population:
    """The particles of one letter, which stand for p(pose)^(1-b) p(pose | readings)^b.

    state: (3, n) T_R^O mm, mm, rad. log_p: (n,) log-likelihood of the whole history. log_weight: (n,),
    of mean weight 1. power: b. log_evidence: log p(readings | letter) as far as b.
    """

    rng: np.random.Generator
    state: FloatArray
    log_p: FloatArray
    log_weight: FloatArray
    power: float = 0.0
    log_evidence: float = 0.0

    @property
    def rest(self) -> FloatArray:
        """Log-weights (n,) of the rest of the way to b = 1."""
        return self.log_weight + (1 - self.power) * self.log_p

    @property
    def log_total(self) -> float:
        """Log p(readings | letter), the rest of the way to b = 1 by importance."""
        return self.log_evidence + _log_mean_exp(self.rest)


class TemperedFilter(OpenSetFilter):
    """Sequential Monte Carlo on a static state, adaptively tempered (Chopin 2002; Del Moral et al. 2006).

    After every reading b is set as near 1 as leaves `survivors` of the letter's population effective. A
    population that b = 1 would thin out is resampled, moved by a Metropolis step whose length is the
    difference of two other particles, the whole history replayed, and b is raised again, for at most
    `rounds` rounds. No letter can be lost to resampling; its evidence is the product of the mean
    weights on the way.
    """

    options_type: ClassVar[type[Options]] = TemperedOptions
    budget = "particles"
    options: TemperedOptions

    def __init__(self, options: TemperedOptions) -> None:
        super().__init__(options)
        self._evaluated = self._unmoved = 0

    def prepare(self) -> None:
        """Tabulate the likelihood, once for each map cell."""
        cell = self.options.cell
        tables = tabulate(self.likelihood, self.labels, (cell, cell), cell)
        self._nodes = np.ascontiguousarray(tables.values[:, :, 0, 0])
        self._lattice = np.concatenate([tables.origin, tables.step])
        self._outside = tables.outside
        self._each = max(1, self.options.particles // len(self.labels))

    def restart(self, rng: np.random.Generator) -> None:
        """Spread every letter's population uniformly over the poses; each draws from its own stream."""
        reach = self.options.reach
        self._history: list[tuple[Evidence, FloatArray]] = []
        self._populations = [
            _Population(
                own,
                own.uniform(-1, 1, (3, self._each)) * [[reach], [reach], [np.pi]],
                np.zeros(self._each),
                np.zeros(self._each),
            )
            for own in rng.spawn(len(self.labels))
        ]

    def take(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Weigh every particle and choose each letter's b; resample and move the letters that need it."""
        self._history.append((evidence, transform(sensor_in_robot, self.taxel_xy)[evidence.taxel]))
        tired = [self._weigh_in(letter) for letter in range(len(self.labels))]
        log_total = np.array([population.log_total for population in self._populations])
        hopeless = log_total < log_total.max() - _HOPELESS
        for letter in np.flatnonzero(tired).tolist():
            if hopeless[letter] and self.options.skip:
                self._unmoved += self._each * len(self._history)
                continue
            self._renew(letter)

    def answer(self) -> Estimate:
        """Compare the letters' evidence; give the mean pose near the best particle of the best letter."""
        log_p = np.array([population.log_total for population in self._populations])
        probability = np.exp(log_p - log_p.max())
        probability /= probability.sum()
        best = int(probability.argmax())
        one = self._populations[best]
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, probability.tolist(), strict=True)),
            robot_in_object=mean_around(one.state, one.rest, int(one.log_p.argmax())),
        )

    def draw_states(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw particles by their weights and their letters' evidence."""
        letter, state, weight = self._everything()
        chosen = systematic(weight, count, rng)
        return letter[chosen], state.take(chosen, axis=1)

    def belief_over_plane(self) -> PlaneBelief:
        """Count the weighted particles in cells of about 1 mm."""
        return plane_histogram(self.labels, *self._everything(), self.options.reach)

    def _everything(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Put all populations together: letter (n,), state (3, n), weight (n,), the heaviest 1."""
        log_weight = np.concatenate([one.log_evidence + one.rest for one in self._populations])
        return (
            np.repeat(np.arange(len(self.labels)), self._each),
            np.concatenate([population.state for population in self._populations], axis=1),
            np.exp(log_weight - log_weight.max()),
        )

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a particle in a reading each, made and skipped since the estimator was made."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {"moves": self._unmoved}}

    def _weigh(self, letter: int, state: FloatArray, evidence: Evidence, xy: FloatArray) -> FloatArray:
        """Compute log p(z | x) of one reading for (3, n) states of a letter: (n,)."""
        log_p = np.full(state.shape[1], evidence.weight @ self._outside[evidence.table, letter])
        letters = np.full(state.shape[1], letter)
        weigh(log_p, state, letters, evidence.table, xy, evidence.weight, self._nodes, self._lattice)
        self._evaluated += len(log_p)
        return log_p

    def _weigh_in(self, letter: int) -> bool:
        """Take the newest reading into a letter's weights; tells whether b = 1 would thin it out."""
        one = self._populations[letter]
        start = one.log_weight - one.power * one.log_p  # what the weights would be at b = 0
        one.log_p = one.log_p + self._weigh(letter, one.state, *self._history[-1])
        return self._temper(one, start)

    def _temper(self, one: _Population, start: FloatArray) -> bool:
        """Set b and the weights that belong to it; tells whether b = 1 would thin the population out."""
        tired = _effective(start + one.log_p) < self.options.survivors
        one.power = self._next_power(start, one.log_p) if tired else 1.0
        log_weight = start + one.power * one.log_p
        gain = _log_mean_exp(log_weight)
        one.log_evidence += gain
        one.log_weight = log_weight - gain
        return tired

    def _renew(self, letter: int) -> None:
        """Resample, move and raise b again, until b = 1 thins out no more or the rounds are used up."""
        one = self._populations[letter]
        for _ in range(self.options.rounds):
            self._resample(one)
            self._move(letter)
            if not self._temper(one, one.log_weight - one.power * one.log_p):
                break

    def _next_power(self, start: FloatArray, log_p: FloatArray) -> float:
        """Find the largest b, by bisection, that leaves enough particles effective."""
        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            if _effective(start + middle * log_p) >= self.options.survivors:
                low = middle
            else:
                high = middle
        return low

    def _resample(self, one: _Population) -> None:
        """Draw a population anew from itself, systematically: equal weights afterwards."""
        chosen = systematic(np.exp(one.log_weight), self._each, one.rng)
        one.state, one.log_p = one.state.take(chosen, axis=1), one.log_p[chosen]
        one.log_weight = np.zeros(self._each)

    def _move(self, letter: int) -> None:
        """Move a letter's particles by a Metropolis step that leaves what they stand for as it is."""
        one, count = self._populations[letter], self._each
        first, second = one.rng.integers(count, size=(2, count))
        step = one.state[:, first] - one.state[:, second]
        step[2] = wrap_angle(step[2])
        step *= one.rng.choice(_STRIDES, size=count)
        proposed = one.state + step + one.rng.standard_normal(step.shape) * _JITTER
        log_p = np.zeros(count)
        for evidence, xy in self._history:
            log_p += self._weigh(letter, proposed, evidence, xy)
        within = np.abs(proposed[:2]).max(axis=0) <= self.options.reach
        likelier: NDArray[np.bool_] = np.log(one.rng.random(count)) < one.power * (log_p - one.log_p)
        accepted = within & likelier
        one.state = np.where(accepted, proposed, one.state)
        one.log_p = np.where(accepted, log_p, one.log_p)


def _effective(log_weight: FloatArray) -> float:
    """Give the effective share of particles, 1 for equal weights (Kong 1992)."""
    weight = np.exp(log_weight - log_weight.max())
    return float(weight.sum() ** 2 / (weight @ weight) / len(weight))


def _log_mean_exp(values: FloatArray) -> float:
    """Compute log(mean(exp(values)))."""
    top = values.max()
    return float(top + np.log(np.exp(values - top).mean()))
