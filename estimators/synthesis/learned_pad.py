"""What a forward model is not told of a pad, learned from training presses: gains, failing taxels, the scatter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tactsim.core import Scan, compose
from tactsim.core.forward import ForwardModel, Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.synthesis.modes import FARTHEST, expand, likeliest_press, pressed

# By so much, a standard deviation of its logarithm, the force of a touch may differ from that of the training presses.
_FORCE = 0.5
_PRESSES, _ROUNDS = 400, 4  # training presses that are looked at, at most, and how often
_FAINT = 0.2  # of a press's largest pressure: what is predicted below that tells little of a gain
_MAD = 1.4826  # standard deviations in a median absolute deviation, of a normal distribution
_FEW, _NEAR = 5, 3.0  # presses of a taxel that tell of its gain; standard deviations within which they count
_SIGNIFICANT = 4.0  # standard deviations by which gains must differ more than by chance
_DEAD = 0.05  # a gain below that
_SEARCHES = 8  # for the most probable press
_FAILING = 0.1  # of taxels, to begin with
# Readings of a taxel that fails lie anywhere in the range of the press's readings. Below this share none does: so often
# a reading at rest is as far off as that.
_FEWEST = 0.003
# Standard deviations of the pose, by one press, by which it is shifted for the slope of its score; and its least slope.
_SHIFT, _FLATTEST = 0.5, 0.25
_LEAST = 1e-6  # of the information on the pose: a way that presses tell less of, as a turn of a disc, does not count


@dataclass(eq=False)
class LearnedPad:
    """A forward model, and how the pad differs from it: a `ForwardModel` too.

    A reading is the predicted one, times the taxel's gain and a factor of the touch, log-normal with `force`; to that
    comes noise. A taxel fails at a touch with probability `failing`, and reads anything then.

    gain: (taxels,). noise: kPa. force: standard deviation of the factor's logarithm, the last nuisance; 0 for none.
    too_sure: by how many times squared errors of poses are larger than what expansions of readings say, at least 1.
    usual: mean and standard deviation of log p of a training press at its known pose, the latter at least noise's own.
    """

    forward: ForwardModel
    gain: FloatArray
    noise: float
    failing: float = 0.0
    force: float = _FORCE
    too_sure: float = 1.0
    usual: tuple[float, float] = (-math.inf, 1.0)
    letters: tuple[str, ...] = field(init=False)
    reach: Mapping[str, float] = field(init=False)
    turns: int = field(init=False)
    symmetry: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        even = bool((self.gain == self.gain[::-1]).all())
        self.letters, self.reach, self.symmetry = (
            self.forward.letters,
            self.forward.reach,
            self.forward.symmetry,
        )
        self.turns = self.forward.turns if even else 1

    @classmethod
    def as_told(cls, forward: ForwardModel) -> LearnedPad:
        """Take a pad that differs in nothing from the forward model."""
        return cls(forward, np.ones(forward.taxels), forward.noise, force=0.0)

    @classmethod
    def learned(cls, forward: ForwardModel, train: Scan) -> LearnedPad:
        """Learn from training readings, at known poses of known letters, by iterated reweighting.

        Each press is predicted as it most probably was; from what is left follow the noise, a robust standard deviation
        that is never below the one that was told, the share of taxels that fail, and the gains. Gains are shrunk
        towards 1 by as much as chance explains them (empirical Bayes), so that of an even pad all are 1.
        """
        pad = replace(cls.as_told(forward), force=_FORCE, failing=_FAILING)
        chosen = np.unique(np.linspace(0, len(train) - 1, min(len(train), _PRESSES)).round().astype(int))
        some = train.chosen(chosen)
        for _ in range(_ROUNDS):
            pad = pad.refitted(some.readings, pad.explained(some))
        return pad.compared(some)

    @property
    def taxels(self) -> int:
        """Count the taxels of a reading."""
        return len(self.gain)

    def compared(self, presses: Scan) -> LearnedPad:
        """Learn from presses at known poses how probable they are, and by how much expansions are too sure.

        Of a pad that is as the model says, the score of the pose has the information as its variance and as its slope.
        Else the errors' covariance is the variance over the squared slope (Huber 1967), here one number for all ways.
        """
        labels, number = presses.letters, np.arange(len(presses))
        letter = np.array([labels.index(label) for label in presses.labels])
        readings, poses = np.array(presses.readings), np.array(presses.poses)

        def expanded(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            predict = pressed(self, labels, compose(state, poses), readings, number)
            return expand(letter, state, poses, readings, number, predict, self.noise, self.failing)

        log_p, _, every = expanded(np.zeros_like(poses))
        usual = float(log_p.mean()), max(float(log_p.std()), math.sqrt(self.taxels / 2))
        information, ways = np.linalg.eigh(every.mean(axis=0))
        told = information > _LEAST * information[-1]
        if not told.any():
            return replace(self, usual=usual)
        whiten = (ways[:, told] / np.sqrt(information[told])).T
        off = _SHIFT * np.random.default_rng(0).standard_normal((len(poses), len(whiten)))
        up, down = (expanded(sign * off @ whiten)[1] @ whiten.T for sign in (1, -1))
        slope = max(float(((down - up) * off).sum() / (2 * (off**2).sum())), _FLATTEST)
        too_sure = max(1.0, float((((up + down) / 2) ** 2).mean()) / slope**2)
        return replace(self, too_sure=too_sure, usual=usual)

    def readings(self, letter: str, sensor_in_object: FloatArray) -> FloatArray:
        """Predict the readings (n, taxels) kPa of presses at poses (n, 3), of factor 1, without noise."""
        return self.gain * self.forward.readings(letter, sensor_in_object)

    def linearised(
        self, letter: str, sensor_in_object: FloatArray, off: FloatArray | None = None
    ) -> Linearised:
        """Predict readings of presses and how they change, as `ForwardModel.linearised`; `off` ends with the factor."""
        inner = off if off is None or not self.force else off[:, :-1]
        found = self.forward.linearised(letter, sensor_in_object, inner)
        mean, by_pose, nuisance = (
            values * self.gain for values in (found.mean, found.by_pose, found.nuisance)
        )
        if not self.force:
            return Linearised(mean, by_pose, nuisance)
        factor = np.ones(len(mean)) if off is None else np.exp(self.force * off[:, -1])
        by = factor[:, None, None]
        own = self.force * by * mean[:, None]
        return Linearised(mean * factor[:, None], by_pose * by, np.concatenate([nuisance * by, own], axis=1))

    def explained(self, presses: Scan) -> FloatArray:
        """Predict each press as it most probably was, of a pad whose gains are 1: (n, taxels) kPa."""
        even = replace(self, gain=np.ones(self.taxels))
        predicted = np.empty(presses.readings.shape)
        for label in presses.letters:
            which = np.flatnonzero(presses.labels == label)
            poses, felt = presses.poses[which], presses.readings[which]
            off = None
            for _ in range(_SEARCHES):
                found = self.linearised(label, poses, off)
                mean = found.mean if off is None else found.mean - (off[:, None] @ found.nuisance)[:, 0]
                off = likeliest_press(felt, mean, found.nuisance, self.noise, self.failing)
                off = off.clip(-FARTHEST, FARTHEST)
            predicted[which] = even.linearised(label, poses, off).mean
        return predicted

    def refitted(self, readings: FloatArray, predicted: FloatArray) -> LearnedPad:
        """Fit gains, noise and how often taxels fail to readings (n, taxels) kPa and what `explained` predicts."""
        told = predicted > _FAINT * predicted.max(axis=1, keepdims=True).clip(min=1e-9)
        gain, precision = np.ones(self.taxels), np.zeros(self.taxels)
        for taxel in np.flatnonzero(told.sum(axis=0) >= _FEW):
            z, m = readings[told[:, taxel], taxel], predicted[told[:, taxel], taxel]
            rough = float(np.median(z / m))
            near = np.abs(z - rough * m) <= _NEAR * max(
                self.noise, _MAD * float(np.median(np.abs(z - rough * m)))
            )
            gain[taxel] = (z @ (m * near)) / (m @ (m * near))
            precision[taxel] = m @ (m * near) / self.noise**2
        known = precision > 0
        chance = np.divide(1, precision, out=np.zeros_like(precision), where=known)
        count, away = int(known.sum()), (gain - 1) ** 2 * precision
        if away.sum() > count + _SIGNIFICANT * math.sqrt(2 * count):
            spread = max(float(((gain - 1) ** 2 - chance)[known].mean()), 0.0)
            gain = np.where(known, 1 + (gain - 1) * spread / (spread + chance), 1.0)
        else:
            gain = np.ones(self.taxels)
        left = readings - gain * predicted
        clear = told & (gain > _DEAD)
        noise, failing = self.noise, self.failing
        span = np.ptp(readings, axis=1, keepdims=True) + 4 * noise
        for _ in range(_ROUNDS):  # expectation and maximisation, of a normal distribution and an even one
            anything = max(failing, _FEWEST) / span
            right = (1 - failing) * np.exp(-0.5 * (left / noise) ** 2) / (noise * math.sqrt(2 * math.pi))
            share = right / (right + anything)
            failing = 1 - float(share.mean())
            squares = float((share[clear] * left[clear] ** 2).sum() / max(share[clear].sum(), 1e-9))
            noise = max(self.forward.noise, math.sqrt(squares))
        return replace(self, gain=gain, noise=noise, failing=failing if failing > _FEWEST else 0.0)
