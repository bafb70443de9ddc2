"""A baseline for whole presses: what an image looks like, with and without its turn, and a kernel machine on it."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import inv, solve
from scipy.special import log_softmax

from tactsim.core import Scan
from tactsim.core.idle import find_idle
from tactsim.core.pad import pitch
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import poses_unknown
from tactsim.estimators.baselines.nearest import ReadingClassifier
from tactsim.estimators.estimator import check_order
from tactsim.estimators.likelihoods.folds import can_leave_out, parts_of_presses

_RADII, _ANGLES, _HARMONICS = 24, 36, 6
_FLOOR = 1e-3  # of the mean sum of a reading: amplitudes below count as that
_BLUR = 1.0  # standard deviation of the blur of images, in pitches
# What is chosen among, by left-out presses: how much the two views count, squared width of the kernel in medians of the
# squared distance, ridge, and the power of the probabilities.
_VIEWS = {"as it lies": (1.0, 0.0), "whatever its turn": (0.0, 1.0), "both": (0.5, 0.5)}
_WIDTHS = (0.25, 1.0, 4.0)
_RIDGES = tuple(10.0**power for power in range(-4, 2))
_SHARPNESS = 2.0 ** np.arange(0, 7.5, 0.5)
# The first of so many readings, evenly spread over their order; more are fitted, and more than that are left out.
_CHOSEN_ON, _FITTED = 800, 4000
# Readings with less than this share of the pressure of nearly all of training feel nothing.
_NOTHING = 0.05
# A spread, and a squared distance, that rounding makes.
_SAME = 1e-6
# The probability that a reading says nothing of the letter, whatever the classifier makes of it.
_OUTLIER = 0.01
# How much of what the readings of a press say is said by each of them, the first where several foretell as well.
_SHARED = tuple(step / 20 for step in range(21))


class WholeImage(ReadingClassifier):
    """Name the letter of each reading by its image, and multiply the probabilities (naive Bayes).

    Two views are taken of an image, both of its Fourier transform at radii from one to a period of two taxels, all the
    way around; it is evaluated at the taxels' places, so a pad may have any shape. *As it lies*: the transform about
    the centroid of pressure, blurred by one pitch, of unit length; by Parseval's theorem two such views are as far
    apart as the images, shifted onto each other. *Whatever its turn*: of each radius the amplitudes of the harmonics,
    over the angle, of the amplitudes, which change neither where the object is shifted nor turned (cf. Reddy and
    Chatterji 1996) nor mirrored; their logarithms have zero mean and unit variance.

    A ridge regression on Gaussian kernels of the first view, of the second, or of the mean of both gives a score for
    each letter (least-squares support vector machine, Suykens and Vandewalle 1999). Left-out presses choose which, the
    width, the ridge, and the power of the probabilities (temperature, Guo et al. 2017). So whether the orientation of
    an object says anything is learned from the training readings alone.

    A press must hold all of an object: windows of it have images of their own.

    Where a sequence is the readings of one press, as of a grasp, they say much the same. Then n of them count as
    n / (1 + (n - 1) shared) independent ones (the design effect, Kish 1965); left-out presses choose `shared`.

    A reading that hardly feels anything, as few of training do, says nothing.

    view: which one was chosen. sharpness: the power. shared: 0 where each reading is of a press of its own.
    """

    def fit(self, scan: Scan) -> None:
        """Learn the views' weights, the kernel and the scores from the training readings."""
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels, self.taxels = train.letters, train.readings.shape[1]
        train = train.chosen(np.argsort(train.labels, kind="stable"))  # in whatever order objects are listed
        self._idle = find_idle(train.readings, train.presses)
        self._see(train)
        if len(train) > _FITTED:
            train = train.chosen(_whole_presses(train.press_numbers, _FITTED))
        letter = np.array([self.labels.index(label) for label in train.labels.tolist()])
        wanted = np.eye(len(self.labels))[letter]
        self._known = self._views(train.readings)
        some = _evenly(len(train), _CHOSEN_ON)
        squares = _squares(*[(view[some], view[some]) for view in self._known])
        between = np.triu_indices(len(some), 1)
        self._scale = [
            max(float(np.median(one[between])), _SAME) if len(some) > 1 else 1.0 for one in squares
        ]
        parts = parts_of_presses(train) if can_leave_out(train) else None
        self._choose(squares, wanted[some], None if parts is None else parts[some])
        # Where nobody knows the poses, a sequence is one press; else its readings are of presses here and there.
        self.shared = 0.0
        several = len(np.unique(train.press_numbers)) < len(train)
        if parts is not None and several and poses_unknown(scan.meta):
            self.shared = self._learn_shared(train, wanted, parts)
        kernel = self._kernel(_squares(*[(view, view) for view in self._known]), self.view, self._width)
        kernel.flat[:: len(kernel) + 1] += self._ridge
        self._weights = solve(kernel, wanted, assume_a="pos")
        alike: dict[bytes, list[int]] = {}
        for number in range(len(self.labels)):
            alike.setdefault(train.readings[letter == number].tobytes(), []).append(number)
        for same in alike.values():  # to rounding their scores are equal already
            self._weights[:, same] = self._weights[:, same].mean(axis=1, keepdims=True)

    def _see(self, train: Scan) -> None:
        """Learn at which waves the pad is seen, and what is the mean and spread of the second view."""
        self._xy = train.taxel_xy - (train.taxel_xy.min(axis=0) + train.taxel_xy.max(axis=0)) / 2
        apart = pitch(train.taxel_xy) or 1.0  # mm; a single taxel feels all waves alike
        widest = float(np.hypot(*np.ptp(train.taxel_xy, axis=0))) + apart
        radius = 2 * np.pi * np.geomspace(1 / widest, 0.5 / apart, _RADII)
        angle = np.arange(_ANGLES) * np.pi / _ANGLES  # the other half is its complex conjugate
        wave = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        self._wave = wave.reshape(-1, 2)
        self._phase = np.exp(-1j * (self._xy @ self._wave.T))
        # A wave stands for an area that grows as the square of its radius.
        self._blur = np.repeat(radius * np.exp(-((radius * _BLUR * apart) ** 2) / 2), _ANGLES)
        rise = self._idle.rise(train.readings)
        self._floor = _FLOOR * float(np.abs(rise).sum(axis=1).mean()) or 1.0
        self._least = _NOTHING * float(np.quantile(rise.clip(min=0).sum(axis=1), _NOTHING))
        self._mean, self._spread = np.zeros(1), np.ones(1)
        turned = self._views(train.readings)[1]
        self._mean, spread = turned.mean(axis=0), turned.std(axis=0)
        self._spread = np.where(spread > _SAME, spread, 1.0)

    def _views(self, readings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See readings (n, taxels) as they lie, (n, 2 * waves), and whatever their turn, (n, 1 + radii * harmonics)."""
        rise = self._idle.rise(readings)
        seen = rise @ self._phase
        pressed = rise.clip(min=0)
        centroid = pressed @ self._xy / np.maximum(pressed.sum(axis=1, keepdims=True), self._floor)
        lying = seen * np.exp(1j * (centroid @ self._wave.T)) * self._blur
        lying /= np.maximum(np.linalg.norm(lying, axis=1, keepdims=True), 1e-12)
        amplitude = np.abs(seen).reshape(len(rise), _RADII, _ANGLES)
        harmonics = np.abs(np.fft.rfft(amplitude, axis=2))[:, :, :_HARMONICS].reshape(len(rise), -1) / _ANGLES
        total = np.abs(rise.sum(axis=1, keepdims=True))
        turned = np.log(np.concatenate([total, harmonics], axis=1) + self._floor)
        return np.concatenate([lying.real, lying.imag], axis=1), (turned - self._mean) / self._spread

    def _kernel(self, squares: list[FloatArray], view: str, width: float) -> FloatArray:
        """Give the kernel of readings at squared distances (n, m) in each view; its constant stands for intercepts."""
        total = np.ones_like(squares[0])
        for weight, one, scale in zip(_VIEWS[view], squares, self._scale, strict=True):
            if weight:
                total += weight * np.exp(one / (-width * scale))
        return total

    def _choose(self, squares: list[FloatArray], wanted: FloatArray, part: NDArray[np.intp] | None) -> None:
        """Choose what foretells left-out presses best: view, width, ridge and sharpness; part: of each reading."""
        self.view, self._width, self._ridge, self.sharpness = "both", 1.0, 0.01, 4.0
        if part is None:  # no object was pressed twice, so no press is foretold by others
            return
        best = -np.inf
        for view, width in product(_VIEWS, _WIDTHS):
            kernel = self._kernel(squares, view, width)
            for ridge in _RIDGES:
                scores = _left_out(kernel, ridge, wanted, part)
                for sharpness in _SHARPNESS:
                    says = float((_log_p(sharpness * scores) * wanted).sum())
                    if says > best:
                        best = says
                        self.view, self._width, self._ridge = view, width, ridge
                        self.sharpness = float(sharpness)

    def _learn_shared(self, train: Scan, wanted: FloatArray, part: NDArray[np.intp]) -> float:
        """Learn how much of what the readings of a press say is said by each of them, 0 to 1.

        That is chosen which gives the letters of presses that are left out most log-probability, all readings together.
        """
        whole = _whole_presses(train.press_numbers, _CHOSEN_ON)
        squares = _squares(*[(view[whole], view[whole]) for view in self._known])
        kernel = self._kernel(squares, self.view, self._width)
        log_p = _log_p(self.sharpness * _left_out(kernel, self._ridge, wanted[whole], part[whole]))
        _, first, which, count = np.unique(
            train.press_numbers[whole], return_index=True, return_inverse=True, return_counts=True
        )
        total = np.zeros((len(count), wanted.shape[1]))
        np.add.at(total, which.reshape(-1), log_p)
        right = wanted[whole][first] > 0
        return max(
            _SHARED,
            key=lambda shared: float(
                log_softmax(_together(total, count[:, None], shared), axis=1)[right].sum()
            ),
        )

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every letter is equally probable again."""
        super().reset(rng)
        self._felt = 0

    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        if self._idle.rise(reading).clip(min=0).sum() < self._least:
            return np.zeros(len(self.labels))
        self._felt += 1
        views = self._views(reading[None])
        squares = _squares(*[(view, known) for view, known in zip(views, self._known, strict=True)])
        self._evaluated += 1
        return _log_p(self.sharpness * self._kernel(squares, self.view, self._width) @ self._weights)[0]

    def _log_belief(self) -> FloatArray:
        return _together(self._sum, max(self._felt, 1), self.shared)


def _left_out(kernel: FloatArray, ridge: float, wanted: FloatArray, part: NDArray[np.intp]) -> FloatArray:
    """Give the scores (n, letters) of readings when their part is left out, from the inverse of all of the kernel."""
    inverse = inv(kernel + ridge * np.eye(len(kernel)), overwrite_a=True, check_finite=False)
    weights, scores = inverse @ wanted, wanted.copy()
    for number in np.unique(part):
        own = np.flatnonzero(part == number)
        scores[own] -= solve(inverse[np.ix_(own, own)], weights[own], assume_a="pos")
    return scores


def _together(total: FloatArray, count: NDArray[np.intp] | int, shared: float) -> FloatArray:
    """Give what readings say together whose log p, as if independent, sum to `total`: the design effect (Kish 1965)."""
    return total / (1 + (count - 1) * shared)


def _evenly(count: int, most: int) -> NDArray[np.intp]:
    """Choose at most `most` of `count` readings, evenly spread over their order."""
    return np.arange(min(count, most)) * count // min(count, most)


def _whole_presses(press: NDArray[np.int64], most: int) -> NDArray[np.intp]:
    """Choose about `most` readings (n,), of presses evenly spread over their numbers, each with all that it has."""
    _, which = np.unique(press, return_inverse=True)
    count = int(which.max()) + 1
    chosen = _evenly(count, max(1, count * most // len(press)))
    return np.flatnonzero(np.isin(which.reshape(-1), chosen))


def _squares(*views: tuple[FloatArray, FloatArray]) -> list[FloatArray]:
    """Give the squared distances (n, m) of the rows of each pair (n, features), (m, features)."""
    return [
        ((one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * one @ other.T).clip(min=0)
        for one, other in views
    ]


def _log_p(scores: FloatArray) -> FloatArray:
    """Give log-probabilities of scores (n, letters), mixed with those of a reading that says nothing."""
    log_p = scores - np.logaddexp.reduce(scores, axis=-1, keepdims=True)
    return np.log((1 - _OUTLIER) * np.exp(log_p) + _OUTLIER / scores.shape[-1])
