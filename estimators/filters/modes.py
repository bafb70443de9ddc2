"""A belief over letter and pose as a sum of Gaussians, one for each mode, and the readings that shape them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

GYRATION = 8.0  # mm: how far a rad counts where turns are compared with shifts


@dataclass(frozen=True, eq=False)
class Modes:
    """n Gaussian parts of the belief over (letter, T_R^O), after k readings.

    letter: (n,). prior_mean (n, 3), prior_cov (n, 3, 3), log_prior (n,), merged (n,): the part of the prior that each
    stands for, of that many grid cells. at: (n, k, 3) the states at which each reading was expanded; log_p (n, k),
    gradient (n, k, 3), information (n, k, 3, 3): its log-likelihood there, in x, y and theta of the state. mean:
    (n, 3), cov: (n, 3, 3), log_weight: (n,) the posterior, of any common factor.
    """

    letter: NDArray[np.int64]
    prior_mean: FloatArray
    prior_cov: FloatArray
    log_prior: FloatArray
    merged: NDArray[np.int64]
    at: FloatArray
    log_p: FloatArray
    gradient: FloatArray
    information: FloatArray
    mean: FloatArray
    cov: FloatArray
    log_weight: FloatArray

    def __len__(self) -> int:
        return len(self.letter)

    @classmethod
    def begun(cls, letter: NDArray[np.int64], states: FloatArray, cov: FloatArray) -> Modes:
        """Begin with the cells of a grid, without readings: states (n, 3), the cells' middles; cov (3, 3) of each."""
        n = len(letter)
        every = np.broadcast_to(cov, (n, 3, 3)).copy()
        return cls(
            letter, states, every, np.zeros(n), np.ones(n, dtype=np.int64), np.empty((n, 0, 3)),
            np.empty((n, 0)), np.empty((n, 0, 3)), np.empty((n, 0, 3, 3)), states, every, np.zeros(n),
        )  # fmt: skip

    def some(self, which: NDArray[np.intp]) -> Modes:
        """Take some of the modes."""
        return Modes(**{one.name: getattr(self, one.name)[which] for one in fields(self)})

    def joined(self, other: Modes) -> Modes:
        """Put the modes of two beliefs with the same readings together."""
        return Modes(
            **{
                one.name: np.concatenate([getattr(self, one.name), getattr(other, one.name)])
                for one in fields(self)
            }
        )

    def with_reading(
        self, at: FloatArray, log_p: FloatArray, gradient: FloatArray, information: FloatArray
    ) -> Modes:
        """Append a reading, expanded at the states `at` (n, 3)."""
        return replace(
            self,
            at=np.concatenate([self.at, at[:, None]], axis=1),
            log_p=np.concatenate([self.log_p, log_p[:, None]], axis=1),
            gradient=np.concatenate([self.gradient, gradient[:, None]], axis=1),
            information=np.concatenate([self.information, information[:, None]], axis=1),
        )

    def posterior(self, floor: FloatArray) -> Modes:
        """Find mean, covariance and weight of each mode: prior times readings, a Gaussian.

        floor: (k,) the log-density of each reading as an outlier. A reading that is less likely than that at the
        mean counts as one.
        """
        kept = np.ones(self.log_p.shape, dtype=bool)
        solved = self._solved(floor, kept)
        now = solved.log_p_of_readings() >= floor
        if (now != kept).any():
            solved = self._solved(floor, now)
        return solved

    def log_p_of_readings(self) -> FloatArray:
        """Give the log-likelihood (n, k) of the readings at the modes' means."""
        away = self.mean[:, None] - self.at
        bent = np.einsum("nkij,nkj->nki", self.information, away)
        return self.log_p + np.einsum("nki,nki->nk", self.gradient - bent / 2, away)

    def _solved(self, floor: FloatArray, kept: NDArray[np.bool_]) -> Modes:
        # About the last mean, so that sums do not cancel.
        offset = self.mean[:, None] - self.at
        bent = np.einsum("nkij,nkj->nki", self.information, offset)
        slope = np.einsum("nki,nk->ni", self.gradient - bent, kept)
        prior_information = np.linalg.inv(self.prior_cov)
        from_prior = self.mean - self.prior_mean
        slope -= np.einsum("nij,nj->ni", prior_information, from_prior)
        precision = prior_information + np.einsum("nkij,nk->nij", self.information, kept)
        cov = np.linalg.inv(precision)
        step = np.einsum("nij,nj->ni", cov, slope)
        value = self.log_p + np.einsum("nki,nki->nk", self.gradient - bent / 2, offset)
        value = np.where(kept, value, floor).sum(axis=1)
        value -= np.einsum("ni,nij,nj->n", from_prior, prior_information, from_prior) / 2
        value += np.einsum("ni,ni->n", slope, step) / 2
        value += (np.linalg.slogdet(prior_information)[1] - np.linalg.slogdet(precision)[1]) / 2
        return replace(self, mean=self.mean + step, cov=cov, log_weight=self.log_prior + value)

    def heaviest(self, count: int, within: float) -> Modes:
        """Keep the `count` heaviest modes, and of those what is at most `within` nats below the heaviest."""
        order = np.argsort(-self.log_weight, kind="stable")[:count]
        order = order[self.log_weight[order] >= self.log_weight[order[0]] - within]
        return self.some(np.sort(order))

    def together(self, apart: float) -> Modes:
        """Merge modes of one letter whose means are less than `apart` of their standard deviations apart.

        What is merged keeps the heavier one's readings, and the mean and covariance of both parts of the prior.
        """
        order = np.argsort(-self.log_weight, kind="stable")
        taken = np.zeros(len(self), dtype=bool)
        precision = np.linalg.inv(self.cov)
        heads, prior_mean, prior_cov, log_prior, merged = [], [], [], [], []
        for head in order.tolist():
            if taken[head]:
                continue
            away = self.mean - self.mean[head]
            turns = np.round(away[:, 2] / (2 * math.pi)) * 2 * math.pi
            away[:, 2] -= turns
            near = (self.letter == self.letter[head]) & ~taken
            near &= np.einsum("ni,ij,nj->n", away, precision[head], away) < apart**2
            near &= np.einsum("ni,nij,nj->n", away, precision, away) < apart**2
            near[head] = True
            group = np.flatnonzero(near)
            taken[group] = True
            count = self.merged[group]
            share = count / count.sum()
            means = self.prior_mean[group].copy()
            means[:, 2] -= turns[group]
            middle = share @ means
            apart_from = means - middle
            heads.append(head)
            merged.append(count.sum())
            prior_mean.append(middle)
            prior_cov.append(
                np.einsum("n,nij->ij", share, self.prior_cov[group])
                + np.einsum("n,ni,nj->ij", share, apart_from, apart_from)
            )
            log_prior.append(np.logaddexp.reduce(self.log_prior[group]))
        if len(heads) == len(self):
            return self
        return replace(
            self.some(np.array(heads)),
            prior_mean=np.array(prior_mean),
            prior_cov=np.array(prior_cov),
            log_prior=np.array(log_prior),
            merged=np.array(merged),
        )

    def moved(self) -> FloatArray:
        """Tell how far each mode's mean is from where each reading was expanded, (n, k) mm."""
        away = self.mean[:, None] - self.at
        away[..., 2] *= GYRATION
        return np.sqrt((away**2).sum(axis=-1))
