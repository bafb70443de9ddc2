"""Analysis by synthesis: the estimator `synthesis` presses the known letters itself, and compares."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import Scan, compose
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    PoseSamples,
    check_order,
    check_reading,
)
from tactsim.estimators.filters.modes import Modes
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.pose_bank import PoseBank
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.likelihoods.gaussian_kernels import log_gaussian

_SCOUTS = 1500  # states a letter that wait for the first reading which says where
_CONTACT = 1000.0  # squared pressures over the noise's variance from which a reading says where
_NEGLIGIBLE = 14.0  # nats below the heaviest mode at which one is given up
_APART = 0.7  # standard deviations; modes that are nearer to each other are one
_LOST = 1e-6  # probability that the true mode was given up
_OUTLIER = 1e-3  # probability of a reading that no mode explains
_SAMPLES = 256
_ROUNDS = 4  # of Gauss and Newton after a reading, at most


class SynthesisOptions(Options):
    """Options of analysis by synthesis."""

    modes: int = Field(500, ge=1, le=100_000, description="how many places of the first contact are followed")
    spacing: float = Field(1.0, ge=0.2, le=10, description="mm between the poses pressed beforehand")
    angles: int = Field(18, ge=2, le=360, description="angles to half a turn pressed beforehand")
    reach: float = Field(10.0, gt=0, le=1000, description="T_R^O has x and y in [-reach, reach], mm")


class Synthesis(Estimator):
    """Follow the modes of the belief with predictions of a forward model, by Gauss and Newton's method.

    The first reading with contact is compared with a bank of readings that were pressed beforehand, and the `modes`
    best places begin as Gaussians of a grid cell's size. Every reading is expanded about each mode's mean, what a
    press is off by marginalised, and expanded again where the mean moves.
    """

    options_type: type[Options] = SynthesisOptions
    budget = "modes"
    draws = False
    uses_forward_model = True
    options: SynthesisOptions

    def __init__(self, options: SynthesisOptions) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self._started = False
        self._pressed = self._compared = self._kept = 0

    def fit(self, scan: Scan) -> None:
        """Press the bank of the letters that the training readings name."""
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels = train.letters
        forward = self.forward
        self.noise = forward.noise
        self.banks = [
            PoseBank.pressed(forward, label, self.options.spacing, self.options.angles, self.noise)
            for label in self.labels
        ]
        self._typical = float(
            np.sqrt(np.mean([(bank.mean[bank.mean.any(axis=1)] ** 2).mean() for bank in self.banks]))
        )
        rng = np.random.default_rng(0)
        reach = self.options.reach
        self._scout_states = rng.uniform([-reach, -reach, -math.pi], [reach, reach, math.pi], (_SCOUTS, 3))
        self._normal = rng.standard_normal((_SAMPLES, 3))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        check_order(bool(self.labels), "fit", "reset")
        self._started = True
        self._readings: list[FloatArray] = []
        self._poses: list[FloatArray] = []
        self._floor = np.empty(0)
        self._scouts = np.zeros((len(self.labels), _SCOUTS))
        self._modes: Modes | None = None

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad]."""
        check_order(self._started, "reset" if self.labels else "fit", "update")
        values, pose = check_reading(reading, sensor_in_robot, self.forward.taxels)
        self._readings.append(values)
        self._poses.append(pose)
        broad = max(float((values**2).mean()), self._typical**2) + self.noise**2
        self._floor = np.append(
            self._floor, math.log(_OUTLIER) - len(values) / 2 * (math.log(2 * math.pi * broad) + 1)
        )
        if self._modes is not None:
            self._modes = self._followed(self._modes)
            return
        if (values**2).sum() > _CONTACT * self.noise**2:
            self._modes = self._begun()
            return
        poses = compose(self._scout_states, pose)
        for log_p, bank in zip(self._scouts, self.banks, strict=True):
            log_p += bank.log_p_at(values, poses)

    def _begun(self) -> Modes:
        """Begin with the best places of the last reading, and take in all readings so far."""
        states, scores, letters = [], [], []
        for number, bank in enumerate(self.banks):
            found, score = bank.seeds(self._readings[-1], self._poses[-1], self.options.reach)
            states.append(found)
            scores.append(score)
            letters.append(np.full(len(found), number))
        score = np.concatenate(scores)
        best = _highest(score, self.options.modes)
        spacing = self.banks[0].spacing
        modes = Modes.begun(
            np.concatenate(letters)[best], np.concatenate(states)[best], np.diag((0.6 * spacing) ** 2)
        )
        last = len(self._readings) - 1
        for number in [last, *range(last)]:
            modes = modes.with_reading(modes.mean, *self._expanded(modes.letter, modes.mean, number))
            modes = modes.posterior(self._floor[[last, *range(last)][: modes.log_p.shape[1]]])
            modes = modes.heaviest(self.options.modes, _NEGLIGIBLE)
        order = np.argsort([last, *range(last)])
        modes = Modes(
            **{
                name: value[:, order] if name in ("at", "log_p", "gradient", "information") else value
                for name, value in vars(modes).items()
            }
        )
        return self._settled(modes)

    def _followed(self, modes: Modes) -> Modes:
        """Take in the last reading."""
        modes = modes.with_reading(
            modes.mean, *self._expanded(modes.letter, modes.mean, len(self._readings) - 1)
        )
        return self._settled(modes.posterior(self._floor))

    def _settled(self, modes: Modes) -> Modes:
        """Merge, give up, and expand again what was expanded too far from where its mode now is."""
        for _ in range(_ROUNDS):
            modes = modes.heaviest(self.options.modes, _NEGLIGIBLE)
            if len(modes) <= 200:
                modes = modes.together(_APART)
            spread = np.sqrt(np.einsum("nii->n", modes.cov * np.array([1, 1, 64.0])[:, None]))
            stale = modes.moved() > np.maximum(0.02, 0.25 * np.minimum(spread, 1.0))[:, None]
            if not stale.any():
                break
            mode, number = np.nonzero(stale)
            found = self._expanded(modes.letter[mode], modes.mean[mode], number)
            modes.at[mode, number] = modes.mean[mode]
            for array, new in zip((modes.log_p, modes.gradient, modes.information), found, strict=True):
                array[mode, number] = new
            self._kept += int((~stale).sum())
            modes = modes.posterior(self._floor)
        return modes

    def _expanded(
        self, letter: NDArray[np.int64], states: FloatArray, number: int | NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Expand reading `number` (n,) at states (n, 3): log p, gradient and information in the states' terms."""
        n = len(letter)
        number = np.broadcast_to(np.asarray(number), n)
        sensor_in_robot = np.array(self._poses)[number]
        poses = compose(states, sensor_in_robot)
        log_p, misfit = np.empty(n), np.empty(n)
        gradient, information = np.empty((n, 3)), np.empty((n, 3, 3))
        readings = np.array(self._readings)
        for one in np.unique(letter):
            mine = np.flatnonzero(letter == one)
            found = self.forward.linearised(self.labels[one], poses[mine])
            out = (
                np.empty(len(mine)),
                np.empty(len(mine)),
                np.empty((len(mine), 3)),
                np.empty((len(mine), 3, 3)),
            )
            log_gaussian(
                readings,
                number[mine].astype(np.int64),
                found.mean,
                found.by_pose,
                found.nuisance,
                self.noise,
                *out,
            )
            for array, new in zip((log_p, misfit, gradient, information), out, strict=True):
                array[mine] = new
        self._pressed += n
        # How the sensor moves in its own frame when the state changes.
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        turned = states[:, 2]
        arm_x = -np.sin(turned) * sensor_in_robot[:, 0] - np.cos(turned) * sensor_in_robot[:, 1]
        arm_y = np.cos(turned) * sensor_in_robot[:, 0] - np.sin(turned) * sensor_in_robot[:, 1]
        motion = np.zeros((n, 3, 3))
        motion[:, 0, 0], motion[:, 0, 1], motion[:, 0, 2] = cos, sin, cos * arm_x + sin * arm_y
        motion[:, 1, 0], motion[:, 1, 1], motion[:, 1, 2] = -sin, cos, -sin * arm_x + cos * arm_y
        motion[:, 2, 2] = 1
        gradient = np.einsum("ni,nij->nj", gradient, motion)
        return log_p, gradient, motion.transpose(0, 2, 1) @ information @ motion

    def estimate(self) -> Estimate:
        """Say which letter it is and where, after the readings so far."""
        check_order(self._started, "reset" if self.labels else "fit", "estimate")
        count = len(self.labels)
        if self._modes is None:
            mass = np.exp(self._scouts - self._scouts.max()).sum(axis=1)
            best = int(mass.argmax())
            weights = Weights(self._scouts[best])
            state = self._scout_states[int(self._scouts[best].argmax())]
            samples = PoseSamples(self._scout_states.copy(), weights.normalised)
        else:
            modes = self._modes
            relative = np.exp(modes.log_weight - modes.log_weight.max())
            mass = np.bincount(modes.letter, relative, count)
            best = int(mass.argmax())
            mine = modes.some(np.flatnonzero(modes.letter == best))
            weights = Weights(mine.log_weight)
            state = mean_around(mine.mean.T, weights, int(mine.log_weight.argmax()))
            samples = self._drawn(mine, weights)
        p = (1 - _LOST) * mass / mass.sum() + _LOST / count
        return Estimate(
            self.labels[best], dict(zip(self.labels, (p / p.sum()).tolist(), strict=True)), state, samples
        )

    def _drawn(self, modes: Modes, weights: Weights) -> PoseSamples:
        """Draw poses from the modes, evenly, the same every time."""
        reached = np.cumsum(weights.normalised)
        which = np.searchsorted(reached, (np.arange(_SAMPLES) + 0.5) / _SAMPLES).clip(max=len(modes) - 1)
        factor = np.linalg.cholesky(modes.cov)[which]
        poses = modes.mean[which] + np.einsum("nij,nj->ni", factor, self._normal)
        return PoseSamples(poses, np.full(_SAMPLES, 1 / _SAMPLES))

    @property
    def work(self) -> dict[str, Any]:
        """Count the presses, one for a mode and a reading, and the expansions that were kept."""
        return {"likelihood_evaluations": self._pressed, "skipped": {"expansions": self._kept}}


def _highest(values: FloatArray, count: int) -> NDArray[np.intp]:
    if count >= len(values):
        return np.arange(len(values))
    return np.argpartition(-values, count)[:count]
