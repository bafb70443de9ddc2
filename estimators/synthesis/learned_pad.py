"""What a forward model is not told, learned from training presses: response, gains, failing taxels, uneven objects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize_scalar

from tactsim.core import InputError, Scan, compose, transform
from tactsim.core.forward import ForwardModel, Linearised
from tactsim.core.pad import pitch
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
_BENT = 4.0  # a response rises with at most this power of the pressure, and at least with one over it
# Objects are uneven where presses at other poses, in this many folds, foretell so much of the squares that a press
# leaves; and how wide a place is, in pitches: a standard deviation.
_FOLDS, _UNEVEN, _PLACE = 4, 0.3, 0.5


@dataclass(frozen=True)
class Response:
    """How a pad that reads no kPa, and 0 at rest, responds: by `scale` times a power of the pressure in kPa."""

    scale: float = 1.0
    power: float = 1.0

    @classmethod
    def learned(cls, readings: FloatArray, predicted: FloatArray) -> Response:
        """Find what makes readings (n, taxels) most like the pressures that are predicted, press by press.

        Raises InputError for readings that do not rise under load.
        """
        told = predicted.any(axis=1) & readings.any(axis=1)
        m, z = predicted[told], readings[told]

        def alike(power: float) -> float:
            p = Response(power=power).pressures(z)
            return float(((p * m).sum(axis=1) / np.sqrt((p**2).sum(axis=1) * (m**2).sum(axis=1))).mean())

        if not len(z) or alike(1.0) <= 0:
            raise InputError("the training readings do not rise where their objects press the pad")
        most = math.log(_BENT)
        best = minimize_scalar(lambda log: -alike(math.exp(log)), bounds=(-most, most), method="bounded")
        power = math.exp(best.x)
        p = Response(power=power).pressures(z)
        return cls(float((p * m).sum() / (m**2).sum()) ** power, power)

    def pressures(self, readings: FloatArray) -> FloatArray:
        """Give the pressures in kPa that readings are of."""
        if self == Response():
            return readings
        return np.sign(readings) * (np.abs(readings) / self.scale) ** (1 / self.power)


@dataclass(frozen=True, eq=False)
class Unevenness:
    """What the places of an object press more than they are said to, kPa (rows along x, columns along y)."""

    origin: FloatArray
    cell: float
    more: FloatArray

    @classmethod
    def learned(cls, xy: FloatArray, left: FloatArray, width: float) -> Unevenness:
        """Average what was left, kPa, around each of the places (n, taxels, 2) mm, and with a 0 (Nadaraya 1964)."""
        cell, margin = width / 2, 4 * width
        origin = xy.min(axis=(0, 1)) - margin
        shape = np.ceil((xy.max(axis=(0, 1)) + margin - origin) / cell).astype(int) + 1
        at = tuple(np.moveaxis(np.round((xy - origin) / cell).astype(int), -1, 0))
        sums = np.zeros((2, *shape))
        np.add.at(sums[0], at, 1.0)
        np.add.at(sums[1], at, left)
        count, total = (gaussian_filter(one, width / cell, mode="constant") for one in sums)
        return cls(origin, cell, total / (count + 1 / (2 * math.pi * (width / cell) ** 2)))

    def at(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Interpolate at places (..., 2) mm: what is pressed more, kPa, and its slope (..., 2), kPa/mm."""
        place = ((xy - self.origin) / self.cell).clip(0, np.array(self.more.shape) - 1.001)
        i, j = np.moveaxis(place.astype(int), -1, 0)
        u, v = np.moveaxis(place % 1, -1, 0)
        a, b, c, d = self.more[i, j], self.more[i + 1, j], self.more[i, j + 1], self.more[i + 1, j + 1]
        by_x, by_y = (1 - v) * (b - a) + v * (d - c), (1 - u) * (c - a) + u * (d - b)
        return (1 - v) * (a + u * (b - a)) + v * (c + u * (d - c)), np.stack(
            [by_x, by_y], axis=-1
        ) / self.cell


@dataclass(eq=False)
class LearnedPad:
    """A forward model, and how the pad differs from it: like a `ForwardModel`, but loads are nuisances.

    A reading is the predicted one and what is uneven, at a load that is the press's times a factor of the touch,
    log-normal with `force`, times the taxel's gain; to that comes noise. A taxel fails at a touch with probability
    `failing`, and reads anything then.

    gain: (taxels,). noise: kPa. force: standard deviation of the factor's logarithm, the last nuisance; 0 for none.
    too_sure: by how many times squared errors of poses are larger than what expansions of readings say, at least 1.
    usual: mean and standard deviation of log p of a training press at its known pose, the latter at least noise's own.
    taxel_xy: (taxels, 2) mm. uneven: of the objects that are. response: of a pad that reads no kPa.
    """

    forward: ForwardModel
    gain: FloatArray
    noise: float
    failing: float = 0.0
    force: float = _FORCE
    too_sure: float = 1.0
    usual: tuple[float, float] = (-math.inf, 1.0)
    taxel_xy: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    uneven: Mapping[str, Unevenness] = field(default_factory=dict)
    response: Response = Response()
    letters: tuple[str, ...] = field(init=False)
    reach: Mapping[str, float] = field(init=False)
    turns: int = field(init=False)
    symmetry: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        even = bool((self.gain == self.gain[::-1]).all()) and not self.uneven
        self.letters, self.reach = self.forward.letters, self.forward.reach
        self.symmetry = {**self.forward.symmetry, **dict.fromkeys(self.uneven, 1)}
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

        Readings that are no pressures give the response first. Objects are uneven where that makes presses that were
        left out more probable.
        """
        pad = replace(cls.as_told(forward), force=_FORCE, failing=_FAILING, taxel_xy=train.taxel_xy)
        chosen = np.unique(np.linspace(0, len(train) - 1, min(len(train), _PRESSES)).round().astype(int))
        some = train.chosen(chosen)
        if train.meta.get("unit", "kPa") != "kPa":
            response = Response.learned(some.readings, pad.exactly(some))
            pad = replace(pad, response=response)
            train = replace(train, readings=response.pressures(train.readings))
            some = train.chosen(chosen)
        for _ in range(_ROUNDS):
            pad = pad.refitted([(pad, some)])
        told = pad.compared([(pad, some)])
        *others, uneven = (pad.unevenness(train) if len(train.taxel_xy) > 1 else []) or [{}]
        if not uneven:
            return told
        fold, parts = _folds(some), list[tuple[LearnedPad, Scan]]()
        for _ in range(_ROUNDS):  # each press is judged by what presses at other poses left
            pads = [replace(pad, uneven=of_others) for of_others in others]
            parts = [
                (one, some.chosen(fold == number))
                for number, one in enumerate(pads)
                if (fold == number).any()
            ]
            pad = pad.refitted(parts)
        return max(told, replace(pad, uneven=uneven).compared(parts), key=lambda one: one.usual[0])

    @property
    def taxels(self) -> int:
        """Count the taxels of a reading."""
        return len(self.gain)

    def unevenness(self, presses: Scan) -> list[Mapping[str, Unevenness]]:
        """Learn how uneven each object is, from presses but those of each fold of poses in turn, and last from all.

        None are listed if that foretells too little of what is left of the presses that were left out.
        """
        left, xy = presses.readings - self.exactly(presses), transform(presses.poses, self.taxel_xy)
        fold = _folds(presses)
        squares, found = 0.0, list[Mapping[str, Unevenness]]()
        for number in range(_FOLDS + 1):
            found.append({})
            for label in presses.letters:
                mine, out = presses.labels == label, fold == number
                if (mine & ~out).any():
                    of = Unevenness.learned(xy[mine & ~out], left[mine & ~out], _PLACE * pitch(self.taxel_xy))
                    found[-1] = {**found[-1], label: of}
                    squares += float(((left[mine & out] - of.at(xy[mine & out])[0]) ** 2).sum())
        return found if squares < (1 - _UNEVEN) * float((left**2).sum()) else []

    def compared(self, parts: Sequence[tuple[LearnedPad, Scan]]) -> LearnedPad:
        """Learn from presses at known poses how probable they are, and by how much expansions are too sure.

        parts: pads that each predict some of the presses. Of a pad that is as the model says, the score of the pose
        has the information as its variance and as its slope. Else the errors' covariance is the variance over the
        squared slope (Huber 1967), here one number for all ways.
        """

        def expanded(off: FloatArray | None) -> list[FloatArray]:
            found, first = [], 0
            for pad, presses in parts:
                labels, number = presses.letters, np.arange(len(presses))
                letter = np.array([labels.index(label) for label in presses.labels])
                readings, poses = np.array(presses.readings), np.array(presses.poses)
                state = np.zeros_like(poses) if off is None else off[first : first + len(poses)]
                first += len(poses)
                predict = pressed(pad, labels, compose(state, poses), readings, number)
                found.append(expand(letter, state, poses, readings, number, predict, pad.noise, pad.failing))
            return [np.concatenate(one) for one in zip(*found, strict=True)]

        log_p, _, every = expanded(None)
        usual = float(log_p.mean()), max(float(log_p.std()), math.sqrt(self.taxels / 2))
        information, ways = np.linalg.eigh(every.mean(axis=0))
        told = information > _LEAST * information[-1]
        if not told.any():
            return replace(self, usual=usual)
        whiten = (ways[:, told] / np.sqrt(information[told])).T
        off = _SHIFT * np.random.default_rng(0).standard_normal((len(log_p), len(whiten)))
        up, down = (expanded(sign * off @ whiten)[1] @ whiten.T for sign in (1, -1))
        slope = max(float(((down - up) * off).sum() / (2 * (off**2).sum())), _FLATTEST)
        too_sure = max(1.0, float((((up + down) / 2) ** 2).mean()) / slope**2)
        return replace(self, too_sure=too_sure, usual=usual)

    def readings(self, letter: str, sensor_in_object: FloatArray) -> FloatArray:
        """Predict the readings (n, taxels) kPa of presses at poses (n, 3), of factor 1, without noise."""
        found, uneven = self.forward.readings(letter, sensor_in_object), self.uneven.get(letter)
        if uneven is not None:
            found = found + uneven.at(transform(sensor_in_object, self.taxel_xy))[0]
        return self.gain * found

    def linearised(
        self, letter: str, sensor_in_object: FloatArray, off: FloatArray | None = None
    ) -> Linearised:
        """Predict readings of presses and how they change, as `ForwardModel.linearised`; `off` ends with the factor."""
        inner, load = off, None
        if self.force:
            inner, load = None, np.ones(len(sensor_in_object))
            if off is not None:
                inner, load = off[:, :-1], np.exp(self.force * off[:, -1])
        found = self.forward.linearised(letter, sensor_in_object, inner, load)
        if letter in self.uneven:  # where a press errs that is foretold as if it did not
            more, slope = self.uneven[letter].at(transform(sensor_in_object, self.taxel_xy))
            cos, sin = np.cos(sensor_in_object[:, 2, None]), np.sin(sensor_in_object[:, 2, None])
            x, y = cos * slope[..., 0] + sin * slope[..., 1], cos * slope[..., 1] - sin * slope[..., 0]
            turn = self.taxel_xy[:, 0] * y - self.taxel_xy[:, 1] * x
            by_pose, nuisance = np.stack([x, y, turn], axis=1), found.nuisance.copy()
            if load is not None:
                more, by_pose = load[:, None] * more, load[:, None, None] * by_pose
                nuisance[:, -1] += more
            found = Linearised(found.mean + more, found.by_pose + by_pose, nuisance)
        mean, by_pose, nuisance = (
            values * self.gain for values in (found.mean, found.by_pose, found.nuisance)
        )
        if load is not None:
            nuisance[:, -1] *= self.force
        return Linearised(mean, by_pose, nuisance)

    def exactly(self, presses: Scan) -> FloatArray:
        """Predict presses exactly at their poses, of factor 1, without noise: (n, taxels) kPa."""
        predicted = np.empty(presses.readings.shape)
        for label in presses.letters:
            mine = presses.labels == label
            predicted[mine] = self.readings(label, presses.poses[mine])
        return predicted

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

    def refitted(self, parts: Sequence[tuple[LearnedPad, Scan]]) -> LearnedPad:
        """Fit gains, noise and how often taxels fail to presses and what the pad of each part says of them."""
        readings = np.concatenate([presses.readings for _, presses in parts])
        predicted = np.concatenate([pad.explained(presses) for pad, presses in parts])
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


def _folds(presses: Scan) -> NDArray[np.intp]:
    """Give each press (n,) the number of its fold; those at one pose are in one."""
    return np.unique(presses.poses.round(6), axis=0, return_inverse=True)[1].ravel() % _FOLDS
