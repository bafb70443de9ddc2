"""The baseline: compare a reading with every training reading, and learn no map."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from tactsim.core import Scan, compose, invert
from tactsim.core.poses import FloatArray
from tactsim.estimators.baselines.reading_classifier import ReadingClassifier
from tactsim.estimators.estimator import Options, check_order

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

        The width is the rms difference of a taxel between a training reading and the nearest other one of its
        letter.
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
