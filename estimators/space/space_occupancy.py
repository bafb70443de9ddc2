"""Occupancy maps of objects in space, learned from classified touches by the paper's equations (section II)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators.likelihoods.classifier import CONTACT, classify
from tactsim.estimators.likelihoods.occupancy import log_odds, point_spread, taxel_log_odds
from tactsim.estimators.space.learning import Touches
from tactsim.estimators.space.occupancy_kernels import TaxelWays, add_evidence

_BLOCK = 8  # voxels along the side of what is kept or left out together
_REACH = 2.0  # sigma; a taxel farther away than that changes a voxel by less than 0.0015
_STEPS = 400  # squared distances that are told apart
_MARGIN = 6.0  # mm of the maps around what was touched


@dataclass(frozen=True, eq=False)
class SpaceOccupancy:
    """Log-odds of occupancy on a sparse cubic grid in the object frame (paper, eq. 1).

    corner: (3,) mm, the centre of voxel [0, 0, 0]. cell: mm. block: (a, b, c) which of `blocks` holds 8 x 8 x 8 voxels,
    or -1. blocks: (blocks held, 8, 8, 8). prior: p(m), which holds elsewhere.
    """

    corner: FloatArray
    cell: float
    block: NDArray[np.int32]
    blocks: NDArray[np.float32]
    prior: float

    def log_odds_at(self, points: ArrayLike) -> FloatArray:
        """Interpolate the log-odds linearly between the voxels around points (..., 3) mm; outside is the prior."""
        place = (np.asarray(points, dtype=float) - self.corner) / self.cell
        below = np.floor(place).astype(np.intp)
        rest = place - below
        value = np.zeros(place.shape[:-1])
        for side in np.ndindex(2, 2, 2):
            share = np.where(side, rest, 1 - rest).prod(axis=-1)
            value += share * self._voxel(below + side)
        return value

    def _voxel(self, index: NDArray[np.intp]) -> FloatArray:
        shape = np.array(self.block.shape) * _BLOCK
        inside = np.all((index >= 0) & (index < shape), axis=-1, keepdims=True)
        index = np.where(inside, index, 0)
        which = self.block[tuple(np.moveaxis(index // _BLOCK, -1, 0))]
        held = self.blocks[which, *np.moveaxis(index % _BLOCK, -1, 0)]
        return np.where(inside[..., 0] & (which >= 0), held, log_odds(self.prior))

    def occupied(self, least: float = 0.0) -> FloatArray:
        """Give the centres (n, 3) mm of voxels whose log-odds are above `least`."""
        block = np.argwhere(self.block >= 0)
        which, *inside = np.nonzero(self.blocks > least)
        return self.corner + self.cell * (_BLOCK * block[which] + np.column_stack(inside))


def learn_occupancy(
    scan: SpaceScan,
    *,
    stiffness: float,
    sigma: float = 1.0,
    peak: float = 0.9,
    prior: float = 0.2,
    threshold: float = 2.0,
    ratio: float = 0.3,
    cell: float = 1.0,
) -> Mapping[str, SpaceOccupancy]:
    """Learn one occupancy map for every object of a scan's training touches (paper, eq. 2 to 6).

    stiffness: kPa/mm of the pad's layer: a taxel In Contact felt the surface reading / stiffness above the pad's plane.
    sigma: mm, the sensor's point spread. peak: G' at a taxel's centre. prior: p(m). threshold kPa, ratio: eq. 3. cell:
    mm. What the pad has passed is free. Raises InputError if the scan has no training touches.
    """
    train = scan.where("train")
    if not len(train):
        raise InputError("the scan has no touches with split 'train' to learn maps from")
    stroke = float(scan.meta.get("stroke", 0.0))
    squared = (np.arange(_STEPS) + 0.5) / _STEPS * (_REACH * sigma) ** 2
    spread = point_spread(squared, sigma, peak)
    added = np.stack([taxel_log_odds(kind, spread, prior) for kind in range(2)])
    maps = {}
    for label in train.objects:
        mine = train.labels == label
        touches = Touches.at(train.readings[mine], train.poses[mine])
        kinds = classify(touches.readings, threshold, ratio).astype(np.int64)
        ends = train.taxel_points[:, 2] - np.where(kinds == CONTACT, touches.readings / stiffness, 0.0)
        seen = np.concatenate(
            [np.broadcast_to(train.taxel_points[:, :2], (*ends.shape, 2)), ends[..., None]], axis=-1
        )
        points = np.einsum("nij,ntj->nti", touches.turns, seen) + touches.places[:, None]
        met = points[kinds == CONTACT] if (kinds == CONTACT).any() else points.reshape(-1, 3)
        corner = met.min(axis=0) - _MARGIN
        blocks = np.ceil((met.max(axis=0) + _MARGIN - corner) / cell / _BLOCK).astype(int)
        odds = np.full(blocks * _BLOCK, log_odds(prior), dtype=np.float32)
        taxel = np.ascontiguousarray(train.taxel_points[:, :2])
        ways = TaxelWays(touches.places, touches.turns, taxel, ends, kinds)
        add_evidence(odds, corner, cell, ways, added, _REACH * sigma, stroke)
        maps[label] = _sparse(odds, corner, cell, prior)
    return maps


def _sparse(odds: NDArray[np.float32], corner: FloatArray, cell: float, prior: float) -> SpaceOccupancy:
    """Keep the blocks in which something was learned."""
    count = np.array(odds.shape) // _BLOCK
    blocks = odds.reshape(count[0], _BLOCK, count[1], _BLOCK, count[2], _BLOCK).transpose(0, 2, 4, 1, 3, 5)
    learned = (np.abs(blocks - log_odds(prior)) > 1e-6).any(axis=(3, 4, 5))
    block = np.full(learned.shape, -1, dtype=np.int32)
    block[learned] = np.arange(np.count_nonzero(learned))
    return SpaceOccupancy(corner, cell, block, np.ascontiguousarray(blocks[learned]), prior)
