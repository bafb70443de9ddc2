"""A bag of tactile features: which kinds of readings an object gives, and how often, whatever their poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.baselines.reading_classifier import ReadingClassifier
from tactsim.estimators.estimator import Options, check_order

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
