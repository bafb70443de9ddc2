"""The measurement model of a touch that is a sequence: its images at shares of the load, each with maps of its own.

While force rises, relief is touched at its highest places first, a tilted face at one side, and more taxels pass the
threshold of eq. 3. So each moment, an image at 1/m, 2/m ... of the load, has its own maps and its own measurement
model, learned from the training presses at that moment. With moments k of a touch that show, a state has

    log p(z | x) = c sum over k of log p_k(z_k | x).

The images of one touch share where it was pressed, its tilt and the maps' errors. They count as c m images, and not as
m: `filters.trust_learning.images_count` learns c from left-out training touches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import InputError, Scan
from tactsim.core.moments import felt_moments, shares_of
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood, create
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps
from tactsim.estimators.options import LikelihoodOptions


class SequenceLikelihood(Likelihood):
    """log p of the moments of a touch, summed, with the weight c that makes their number an effective one.

    of_moment: the measurement model of each moment, the lightest first; the last is that of the whole load. counts: c.
    """

    def __init__(self, options: LikelihoodOptions) -> None:
        super().__init__(options)
        alone = options.model_copy(update={"moments": 1})
        self.shares = shares_of(options.moments)
        self.of_moment = [create(alone) for _ in self.shares]
        self.counts = 1 / len(self.shares)

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn maps and measurement model of each moment from the training sequences; `maps` are the whole load's.

        Raises InputError if the scan has no sequences, or no training press of an object shows a moment.
        """
        self._moments = _moments_apart(scan.where("train"), self.shares)
        options, lower = self.options, self._moments.scans[:-1]
        of_loads = [
            learn_maps(
                one, sigma=options.sigma, peak=options.peak, prior=options.prior,
                threshold=options.threshold, ratio=options.ratio, cell=options.cell,
            )
            for one in lower
        ]  # fmt: skip
        for model, one, of_load in zip(self.of_moment, self._moments.scans, [*of_loads, maps], strict=True):
            model.fit(one, of_load)

    @property
    def last_images(self) -> Scan:
        """Give the training touches with their images at the whole load alone."""
        return self._moments.scans[-1]

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> SequenceLikelihood | None:
        """Make a copy whose maps, at each moment, were learned without some training touches."""
        rest = copy(self)
        rest.of_moment = []
        for kept, model, one in zip(self._moments.kept, self.of_moment, self._moments.scans, strict=True):
            left = model.without(one, gone[kept], labels, whole_positions)
            if left is None:
                return None
            rest.of_moment.append(left)
        return rest

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Give the corners of the maps of all moments."""
        low, high = zip(*(model.extent for model in self.of_moment), strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate the tables of all moments, the lightest's first: (tables, ...)."""
        found = [model.log_tables(label, xy) for model in self.of_moment]
        self._first = np.cumsum([0, *(len(one) for one in found)])
        return np.concatenate(found)

    def evidence(self, reading: FloatArray) -> Evidence:
        """Turn a touch into terms: a sequence (frames, taxels) kPa, or its last image (taxels,).

        Of one image, and where no rise is seen, the whole load's moment alone counts, as one image.
        """
        found, taken = felt_moments(np.atleast_2d(reading)[None], self.shares)
        return self._terms(found[0], taken[0])

    def evidence_of(self, train: Scan, touch: int) -> Evidence:
        """Turn the sequence of a training touch into terms."""
        return self._terms(self._moments.found[touch], self._moments.images[touch])

    def _terms(self, found: NDArray[np.bool_], images: FloatArray) -> Evidence:
        each = [model.evidence(images[k]) for k, model in enumerate(self.of_moment) if found[k]]
        counts = np.float32(self.counts if len(each) > 1 else 1.0)
        first = self._first[:-1][found]
        return Evidence(
            np.concatenate([one.table + start for one, start in zip(each, first, strict=True)]),
            np.concatenate([one.taxel for one in each]),
            np.concatenate([counts * one.weight for one in each]),
        )


@dataclass(frozen=True, eq=False)
class _Moments:
    """The moments of training touches: which are found (n, m), their images (n, m, taxels), and a scan of each.

    kept: (m, n) which touches the scan of a moment has.
    """

    found: NDArray[np.bool_]
    images: FloatArray
    kept: NDArray[np.bool_]
    scans: tuple[Scan, ...]


def _moments_apart(train: Scan, shares: FloatArray) -> _Moments:
    """Divide training touches by moments. One that never rests, having met nothing, is among all with its reading.

    Raises InputError if the scan has no sequences, or if no touch of an object shows a moment.
    """
    if train.sequence is None:
        raise InputError(
            "the scan holds one image of each press, and moments are of sequences; press with `bench scan --sequence`"
        )
    found, images = felt_moments(train.sequence.astype(float), shares)
    kept = found.T | ~found[:, :-1].any(axis=1)
    alone = replace(train, sequence=None, sequence_times=None, sequence_force=None)
    scans = []
    for number, (share, there) in enumerate(zip(shares, kept, strict=True)):
        readings = np.where(found[:, number, None], images[:, number], train.readings)
        scans.append(replace(alone, readings=readings).chosen(there))
        missing = set(train.letters) - set(train.labels[found[:, number]].tolist())
        if missing:
            raise InputError(
                f"no training press of {min(missing)!r} shows {share:.0%} of its load: its images are too far apart; "
                f"choose fewer moments than {len(shares)}"
            )
    return _Moments(found, images, kept, tuple(scans))
