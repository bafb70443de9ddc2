"""The measurement model of a touch that is a sequence: its images at shares of the load, each with maps of its own.

While force rises, relief is touched at its highest places first, a tilted face at one side, and more taxels pass the
threshold of eq. 3. So each moment, an image at 1/m, 2/m ... of the load, has its own maps and its own measurement
model, learned from the training presses at that moment. With moments k of a touch that show, a state has

    log p(z | x) = c sum over k of log p_k(z_k | x).

The images of one touch share where it was pressed, its tilt and the maps' errors. They count as c m images, and not as
m: `filters.trust_learning.images_count` learns c from left-out training touches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core import InputError, Scan
from tactsim.core.moments import felt_moments, shares_of
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.likelihood import Evidence, create
from tactsim.estimators.likelihoods.models_of_loads import ModelsOfLoads
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps_by
from tactsim.estimators.options import LikelihoodOptions


class SequenceLikelihood(ModelsOfLoads):
    """log p of the moments of a touch, summed, with the weight c that makes their number an effective one.

    Its loads are the moments; the last is the whole load. counts: c.
    """

    def __init__(self, options: LikelihoodOptions) -> None:
        self.shares = shares_of(options.moments)
        alone = options.model_copy(update={"moments": 1})
        super().__init__(options, [create(alone) for _ in self.shares])
        self.counts = 1 / len(self.shares)

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn maps and measurement model of each moment from the training sequences; `maps` are the whole load's.

        Raises InputError if the scan has no sequences, or no training press of an object shows a moment.
        """
        self._moments = _moments_apart(scan.where("train"), self.shares)
        lower = [learn_maps_by(self.options, images) for images in self._moments.scans[:-1]]
        self.fit_each(self._moments.kept, self._moments.scans, [*lower, maps])

    @property
    def last_images(self) -> Scan:
        """Give the training touches with their images at the whole load alone."""
        return self._moments.scans[-1]

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
        each = [model.evidence(images[k]) for k, model in enumerate(self.of_load) if found[k]]
        counts = np.float32(self.counts if len(each) > 1 else 1.0)
        first = self.first_table[:-1][found]
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
