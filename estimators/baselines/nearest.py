"""The baselines that name the letter of each reading by itself: nearest training reading, and a bag of features."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import Scan, compose, invert
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    check_order,
    check_reading,
    probabilities,
)


class ReadingClassifier(Estimator):
    """Multiply what each reading says of the letter (naive Bayes). A subclass implements `fit` and `_log_p_of`.

    Readings are not fitted together in space. Unless a subclass says where the object lies, the pose is always the
    middle of the prior, 0, 0, 0, which has the least expected squared error while nothing is known.

    labels: the letters. taxels: of a reading. Both are set by `fit`. _robot_in_object: (letters, 3) what is said of the
    pose. _evaluated: what `work` counts.
    """

    draws = False

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self.taxels = 0
        self._started = False
        self._evaluated = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every letter is equally probable again."""
        check_order(bool(self.labels), "fit", "reset")
        self._sum = np.zeros(len(self.labels))
        self._robot_in_object = np.zeros((len(self.labels), 3))
        self._started = True

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) in the scan's unit at the pose sensor_in_robot [mm, mm, rad]."""
        check_order(self._started, "reset" if self.labels else "fit", "update")
        self._sum += self._log_p_of(*check_reading(reading, sensor_in_robot, self.taxels))

    def estimate(self) -> Estimate:
        """Say which letter it is, and what is known of the place."""
        check_order(self._started, "reset" if self.labels else "fit", "estimate")
        said = self._log_belief()
        p = np.exp(said - said.max())
        best = int(p.argmax())
        return Estimate(self.labels[best], probabilities(self.labels, p), self._robot_in_object[best].copy())

    def _log_belief(self) -> FloatArray:
        """Give what the readings so far say of the letters, (letters,), up to a constant: each as much as alone."""
        return self._sum

    @property
    def work(self) -> dict[str, Any]:
        """Count what readings were compared with, or how often a classifier was asked."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {}}

    @abstractmethod
    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        """Say what a reading (taxels,) adds to the log-probability of each letter, (letters,), up to a constant."""


# The least kernel width, as a share of the training readings' root mean square.
_LEAST_WIDTH = 1e-4


class NearestOptions(Options):
    """What the baseline takes."""

    width: float | None = Field(
        None, gt=0, le=1e6, description="kernel width of a taxel, kPa; learned if not given"
    )


class Nearest(ReadingClassifier):
    """Estimate p(reading | letter) by a Gaussian kernel on each training reading of the letter (Parzen 1962).

    It asks only whether a reading looks like one that was trained, not whether the readings of a sequence fit
    together in space. So it shows how much of a task is done by remembering readings.

    The place is that of the reading of the sequence that was most like one of its training readings.
    """

    options_type = NearestOptions
    options: NearestOptions

    def fit(self, scan: Scan) -> None:
        """Keep the training readings, in the order of their letters, and learn the kernel's width.

        The width is the rms difference of a taxel between a training reading and the nearest other one of its letter.
        """
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels, self.taxels = train.letters, train.readings.shape[1]
        of_letters = [train.where(label=label) for label in self.labels]
        self._readings = np.concatenate([known.readings for known in of_letters])
        self._poses = np.concatenate([known.poses for known in of_letters])
        counts = [len(known) for known in of_letters]
        self._first = np.cumsum([0, *counts[:-1]])
        self._log_count = np.log(counts)
        nearest = np.concatenate([_nearest_squares(known.readings) for known in of_letters])
        learned = np.sqrt(nearest.mean() / self.taxels) if len(nearest) else 0.0
        # Alike to the bit, readings have no width: then a small share of what they are, in whatever unit.
        least = _LEAST_WIDTH * float(np.sqrt((self._readings**2).mean()))
        self.width = self.options.width or max(float(learned), least) or 1.0

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every letter is equally probable again."""
        super().reset(rng)
        self._unlike = np.full(len(self.labels), np.inf)

    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        squares = ((self._readings - reading) ** 2).sum(axis=1)
        self._evaluated += len(squares)
        # Of the sequence, the match with the least difference per pressure says where: that of a reading beside the
        # letter, where there is next to no pressure, says nothing.
        best = [
            first + of_letter.argmin()
            for first, of_letter in zip(self._first, np.split(squares, self._first[1:]), strict=True)
        ]
        unlike = squares[best] / max((reading**2).sum(), 1e-12)
        closer = unlike < self._unlike
        self._unlike[closer] = unlike[closer]
        self._robot_in_object[closer] = compose(self._poses[best][closer], invert(sensor_in_robot))
        # Relative to the nearest of all, so that letters stay apart however far away all readings are.
        log_kernel = (squares - squares.min()) / (-2 * self.width**2)
        return np.asarray(np.logaddexp.reduceat(log_kernel, self._first) - self._log_count)


def _nearest_squares(readings: FloatArray) -> FloatArray:
    """Give the squared distance of each of (n, taxels) readings to the nearest other; none for a single one."""
    if len(readings) < 2:
        return np.empty(0)
    squares = (readings**2).sum(axis=1)
    apart = squares[:, None] + squares - 2 * readings @ readings.T
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1).clip(min=0)


# What is added to each count, so that a word that a letter never gave is improbable and not impossible (Jeffreys).
_UNSEEN = 0.5


class BagOptions(Options):
    """What the bag of features takes."""

    words: int = Field(
        200, ge=1, le=100_000, description="the most words of the vocabulary: kinds of readings"
    )


class BagOfFeatures(ReadingClassifier):
    """Recognise an object by how often it gives each kind of reading (Schneider et al. 2009).

    A tactile image is a feature. The training readings of all letters are clustered by k-means: the centres are the
    words of a vocabulary. A letter is the histogram of its words. A reading counts as its nearest word, and the words
    of a sequence as independent. Poses of the training readings are not looked at either.

    words: (words, taxels) kPa.
    """

    options_type = BagOptions
    options: BagOptions

    def fit(self, scan: Scan) -> None:
        """Cluster the training readings into words, and count those of each letter."""
        from scipy.cluster.vq import kmeans  # imported here: only a fit needs it

        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels, self.taxels = train.letters, train.readings.shape[1]
        different = np.unique(train.readings, axis=0)
        # It begins with as many of the readings, evenly spread over their order, so that no numbers are drawn.
        count = min(self.options.words, len(different))
        begin = different[np.arange(count) * len(different) // count]
        self.words: FloatArray = kmeans(different, begin)[0]
        words = self._nearest(train.readings)
        counts = np.array(
            [np.bincount(words[train.labels == label], minlength=len(self.words)) for label in self.labels]
        )
        smoothed = counts + _UNSEEN
        self._log_share = np.log(smoothed / smoothed.sum(axis=1, keepdims=True))

    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        self._evaluated += len(self.words)
        return np.asarray(self._log_share[:, self._nearest(reading[None])[0]])

    def _nearest(self, readings: FloatArray) -> NDArray[np.intp]:
        """Find the number of the nearest word of each of (n, taxels) readings."""
        squares = (self.words**2).sum(axis=1) - 2 * readings @ self.words.T
        return squares.argmin(axis=1)
