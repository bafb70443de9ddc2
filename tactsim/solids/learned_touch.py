"""Learn from training touches how the pad feels: its stiffness, and the widths of what surfaces do not explain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.solids.agreement_kernels import AHEAD, agreements
from tactsim.solids.climbing_kernels import climb
from tactsim.solids.learning import Touches, depths, learn_surface
from tactsim.solids.pad_feel import Touching
from tactsim.solids.rays import Rays
from tactsim.solids.voxels import Voxels

_LEFT_OUT = 5  # one in so many touches is left out to be foreseen
_SHOWN = 3  # objects from which the stiffness is learned
_SOFT = 0.5  # mm
_SURPRISE = 0.01  # share of the touches that nothing explains
_FREEDOM = 4.0
_COUNTS = 0.25  # neighbours share errors of the map and of the pad's place: four count as one
_FINEST = 1e-3  # mm, rad or kPa of a width: readings without noise ask for none
_FEWER_TRIES, _TRIES = 150, 400  # of widths, for a stiffness that is tried, and at last
_GROUP, _STEPS = 12, 7  # touches that are left out together, and steps in which they climb
_STIFFNESSES = np.geomspace(10, 1000, 9)  # kPa/mm that are tried first
_MOST_DEEP = 5.0  # mm

# Of each object distances to its surface, and the touches that these were learned without.
_LeftOut = list[tuple[Voxels, Touches]]


def learn_touching(
    touches: Mapping[str, Touches], points: FloatArray, rays: Rays, dense: Rays, cell: float, stroke: float
) -> tuple[Touching, float]:
    """Learn how a pad with taxels at `points` (taxels, 3) mm feels; also the load of a touch, N.

    rays: on which touches will be compared; dense: on which surfaces are learned.
    """
    shown = list(touches.values())[:: max(1, len(touches) // _SHOWN)][:_SHOWN]

    full = float(np.quantile(np.concatenate([mine.readings.sum(axis=1) for mine in touches.values()]), 0.75))

    def tried(stiffness: float) -> float:
        start = _touching(points, rays, stiffness, _deepest(shown, stiffness), stroke, full)
        return _widths(start, *_foreseen(_left_out(shown, start, dense, cell), start, rays), _FEWER_TRIES)[1]

    first = [tried(stiffness) for stiffness in _STIFFNESSES]
    fine = _STIFFNESSES[int(np.argmax(first))] * np.geomspace(0.75, 1 / 0.75, 5)
    stiffness = float(fine[np.argmax([tried(one) for one in fine])])
    everything = list(touches.values())
    start = _touching(points, rays, stiffness, _deepest(everything, stiffness), stroke, full)
    left_out = _left_out(everything, start, dense, cell)
    depth, readings = _foreseen(left_out, start, rays)
    touching, _ = _widths(start, depth, readings, _TRIES)
    log_p = np.empty(len(depth))
    agreements(touching, depth, readings, log_p)
    touching = touching._replace(worst=float(np.quantile(log_p, _SURPRISE)))
    touching = touching._replace(trust=_trust(left_out, touching))
    area = dense.frame[2] ** 2 * dense.base.size / len(points)
    return touching, full * area / 1000


def corners_of(touching: Touching) -> FloatArray:
    """Give the middle of a pad's rays, then their corners and the middles of their sides: (9, 2) mm."""
    edges = [np.array([v.min(), (v.min() + v.max()) / 2, v.max()]) for v in touching.ray[:, :2].T]
    corners = np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(corners[[4, 0, 1, 2, 3, 5, 6, 7, 8]])


def _deepest(touches: list[Touches], stiffness: float) -> float:
    """Give how deep a surface comes into the layer at most, mm, with some room."""
    highest = max(float(np.quantile(mine.readings.max(axis=1), 0.999)) for mine in touches)
    return min(max(1.5, 1.0 + highest / stiffness), _MOST_DEEP)


def _left_out(touches: list[Touches], start: Touching, dense: Rays, cell: float) -> _LeftOut:
    """Leave some touches of each object out, and learn distances to its surface from the others."""
    divided = [_divided(mine) for mine in touches]
    return [
        (learn_surface(learned, dense, start.stiffness, cell, start.stroke).voxels, out)
        for learned, out in divided
    ]


def _foreseen(left_out: _LeftOut, start: Touching, rays: Rays) -> tuple[FloatArray, FloatArray]:
    """Foresee touches left out: depths (n, rays) mm, and their readings (n, taxels) kPa."""
    depth = [depths(voxels, out, rays, start.deepest, start.soft + AHEAD) for voxels, out in left_out]
    return np.concatenate(depth), np.ascontiguousarray(np.concatenate([out.readings for _, out in left_out]))


def _trust(left_out: _LeftOut, touching: Touching) -> float:
    """Weigh touches so that groups of left-out ones are as sure of their poses as they are right, at most 1.

    The best pose near the true one exceeds it in log p, on average by half a nat for each of the pose's six numbers if
    the touches are weighed right (Wilks 1938): by 3.
    """
    excess = []
    for voxels, out in left_out:
        sensors = np.concatenate([out.places, rigid.quaternion(out.turns)], axis=1)
        for first in range(0, len(sensors) - _GROUP + 1, _GROUP):
            readings, at = out.readings[first : first + _GROUP], sensors[first : first + _GROUP]
            reached = []
            for steps in (0, _STEPS):
                pose, information, log_p = rigid.IDENTITY[None].copy(), np.empty((1, 6, 6)), np.empty(1)
                climb(voxels, touching, corners_of(touching), pose, readings, at, steps, information, log_p)
                reached.append(float(log_p[0]))
            excess.append(reached[1] - reached[0])
    return min(1.0, 3 / max(float(np.mean(excess)), 3.0)) if excess else 1.0


def _divided(touches: Touches) -> tuple[Touches, Touches]:
    """Divide touches into those that are learned from and those left out."""
    out = np.arange(len(touches.readings)) % _LEFT_OUT == 0
    return (touches[~out], touches[out]) if out.any() and not out.all() else (touches, touches)


def _touching(
    points: FloatArray, rays: Rays, stiffness: float, deepest: float, stroke: float, full: float
) -> Touching:
    """Set up how a pad feels, before its widths are learned. full: kPa, what taxels read of a touch's load together."""
    taxel, ray = np.nonzero(rays.to_taxels)
    per_taxel = 1 / float(rays.to_taxels.sum(axis=0).max())  # rays
    return Touching(
        ray=np.column_stack([rays.xy, rays.base.ravel()]),
        taxel=np.ascontiguousarray(points[:, :2]),
        start=np.searchsorted(taxel, np.arange(len(points) + 1)).astype(np.int64),
        which=ray.astype(np.int64),
        share=np.ascontiguousarray(rays.to_taxels[taxel, ray]),
        stiffness=float(stiffness), soft=_SOFT, deepest=deepest, stroke=stroke, noise=np.full(len(points), 2.0),
        rough=0.1, aside=0.2, columns=len(rays.x), step=float(rays.frame[2]),
        displaced=np.array([0.2, 0.02, 0.02, 0.3, 0.3]), swept=0.5, freedom=_FREEDOM, counts=_COUNTS, trust=1.0,
        worst=-1e3, full=full * per_taxel, stiffer=0.5, softer=0.2, split=0.1,
    )  # fmt: skip


def _widths(start: Touching, depth: FloatArray, readings: FloatArray, tries: int) -> tuple[Touching, float]:
    """Choose the widths under which touches left out are most probable, and give their mean log p."""
    from scipy.optimize import minimize  # imported here: only a fit needs it

    log_p = np.empty(len(depth))

    def with_widths(logs: FloatArray) -> Touching:
        noise, rough, aside, shift, tilt, slip, stiffer, softer, split = np.maximum(np.exp(logs), _FINEST)
        return start._replace(
            noise=np.full(len(start.taxel), noise),
            rough=float(rough),
            aside=float(aside),
            displaced=np.array([shift, tilt, tilt, slip, slip]),
            stiffer=float(stiffer),
            softer=float(softer),
            split=float(split),
        )

    def cost(logs: FloatArray) -> float:
        agreements(with_widths(logs)._replace(counts=1.0), depth, readings, log_p)
        return -float(log_p.mean())

    noise = 0.02 * float(np.quantile(readings, 0.99))
    found = minimize(
        cost,
        np.log([noise, 0.1, 0.2, 0.2, 0.02, 0.3, 0.3, 0.1, 0.05]),
        method="Nelder-Mead",
        options={"maxfev": tries, "xatol": 0.05},
    )
    return with_widths(found.x), -float(found.fun)
