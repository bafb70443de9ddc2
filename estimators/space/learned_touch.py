"""Learn from training touches how the pad feels: its stiffness, and the widths of what surfaces do not explain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import minimize

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.estimators.space.feeling_kernels import Touching, agreements
from tactsim.estimators.space.learning import Touches, depths, learn_surface
from tactsim.estimators.space.rays import Rays

_LEFT_OUT = 5  # one in so many touches is left out to be foreseen
_SHOWN = 3  # objects from which the stiffness is learned
_SOFT = 0.5  # mm
_FREEDOM = 4.0
_COUNTS = 0.25  # neighbours share errors of the map and of the pad's place: four count as one
_STIFFNESSES = np.geomspace(10, 1000, 9)  # kPa/mm that are tried first
_MOST_DEEP = 5.0  # mm


def learn_touching(
    touches: Mapping[str, Touches], points: FloatArray, rays: Rays, dense: Rays, cell: float, stroke: float
) -> tuple[Touching, float]:
    """Learn how a pad with taxels at `points` (taxels, 3) mm feels; also the load of a touch, N.

    rays: on which touches will be compared; dense: on which surfaces are learned.
    """
    shown = list(touches.values())[:: max(1, len(touches) // _SHOWN)][:_SHOWN]

    def tried(stiffness: float) -> float:
        start = _touching(points, rays, stiffness, _deepest(shown, stiffness), stroke)
        return _widths(start, *_left_out(shown, start, rays, dense, cell))[1]

    first = [tried(stiffness) for stiffness in _STIFFNESSES]
    fine = _STIFFNESSES[int(np.argmax(first))] * np.geomspace(0.75, 1 / 0.75, 5)
    stiffness = float(fine[np.argmax([tried(one) for one in fine])])
    start = _touching(points, rays, stiffness, _deepest(list(touches.values()), stiffness), stroke)
    touching, _ = _widths(start, *_left_out(list(touches.values()), start, rays, dense, cell))
    touching = touching._replace(trust=_trust(list(touches.values()), touching, rays, dense, cell))
    area = dense.frame[2] ** 2 * dense.base.size / len(points)
    loads = np.concatenate([mine.readings.sum(axis=1) for mine in touches.values()])
    return touching, float(np.quantile(loads, 0.75)) * area / 1000


def _deepest(touches: list[Touches], stiffness: float) -> float:
    """Give how deep a surface comes into the layer at most, mm, with some room."""
    highest = max(float(np.quantile(mine.readings.max(axis=1), 0.999)) for mine in touches)
    return min(max(1.5, 1.0 + highest / stiffness), _MOST_DEEP)


def _left_out(
    touches: list[Touches], start: Touching, rays: Rays, dense: Rays, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Foresee touches left out: depths (n, rays) mm, and their readings (n, taxels) kPa."""
    depth, readings = [], []
    for mine in touches:
        learned, out = _divided(mine)
        chart = learn_surface(learned, dense, start.stiffness, cell, start.stroke)
        depth.append(depths(chart.voxels, out, rays, start.deepest, start.soft + 0.5))
        readings.append(out.readings)
    return np.concatenate(depth), np.ascontiguousarray(np.concatenate(readings))


def _trust(touches: list[Touches], touching: Touching, rays: Rays, dense: Rays, cell: float) -> float:
    """Weigh touches so that log p of left-out ones at their true poses is as steep as it is curved, at most 1.

    The log p of several touches then exceeds that at the true pose by as much as it should, half a nat for each number
    of the pose (Pauli, Racugno and Ventura 2011): the weight is 6 / trace(H^-1 J), H the sum of minus the second
    derivatives by the pose and J that of the first's squares, both by central differences.
    """
    steps = np.array([0.2, 0.2, 0.2, 0.02, 0.02, 0.02])  # mm and rad
    ways = [(a, b) for a in range(6) for b in range(a)]
    moves = [*np.eye(6), *-np.eye(6)]
    moves += [one * np.eye(6)[a] + two * np.eye(6)[b] for a, b in ways for one in (1, -1) for two in (1, -1)]
    curved, steep = np.zeros((6, 6)), np.zeros((6, 6))
    for mine in touches:
        learned, out = _divided(mine)
        voxels = learn_surface(learned, dense, touching.stiffness, cell, touching.stroke).voxels
        log_p = np.empty((len(moves) + 1, len(out.places)))
        for number, move in enumerate([np.zeros(6), *moves]):
            turn = rigid.matrix(rigid.from_vector(move[3:] * steps[3:]))
            turns = np.ascontiguousarray(np.einsum("ij,njk->nik", turn, out.turns))
            moved = Touches(out.readings, out.places @ turn.T + move[:3] * steps[:3], turns)
            depth = depths(voxels, moved, rays, touching.deepest, touching.soft + 0.5)
            agreements(touching, depth, out.readings, log_p[number])
        slope = (log_p[1:7] - log_p[7:13]) / 2
        steep += slope @ slope.T
        total = log_p.sum(axis=1)
        curved += np.diag(2 * total[0] - total[1:7] - total[7:13])
        for (a, b), four in zip(ways, total[13:].reshape(-1, 4), strict=True):
            curved[a, b] -= (four[0] - four[1] - four[2] + four[3]) / 4
            curved[b, a] = curved[a, b]
    excess = float(np.trace(np.linalg.solve(curved, steep)))
    return 6 / max(excess, 6.0) if np.linalg.eigvalsh(curved)[0] > 0 else 1.0


def _divided(touches: Touches) -> tuple[Touches, Touches]:
    """Divide touches into those that are learned from and those left out."""
    out = np.arange(len(touches.readings)) % _LEFT_OUT == 0
    return (touches[~out], touches[out]) if out.any() and not out.all() else (touches, touches)


def _touching(points: FloatArray, rays: Rays, stiffness: float, deepest: float, stroke: float) -> Touching:
    """Set up how a pad feels, before its widths are learned."""
    taxel, ray = np.nonzero(rays.to_taxels)
    return Touching(
        ray=np.column_stack([rays.xy, rays.base.ravel()]),
        taxel=np.ascontiguousarray(points[:, :2]),
        start=np.searchsorted(taxel, np.arange(len(points) + 1)).astype(np.int64),
        which=ray.astype(np.int64),
        share=np.ascontiguousarray(rays.to_taxels[taxel, ray]),
        stiffness=float(stiffness), soft=_SOFT, deepest=deepest, stroke=stroke, noise=np.full(len(points), 2.0),
        rough=0.1, aside=0.2, columns=len(rays.x), step=float(rays.frame[2]),
        displaced=np.array([0.2, 0.02, 0.02, 0.3, 0.3]), swept=0.5, freedom=_FREEDOM, counts=_COUNTS, trust=1.0,
    )  # fmt: skip


def _widths(start: Touching, depth: FloatArray, readings: FloatArray) -> tuple[Touching, float]:
    """Choose the widths under which touches left out are most probable, and give their mean log p."""
    log_p = np.empty(len(depth))

    def with_widths(logs: FloatArray) -> Touching:
        noise, rough, aside, shift, tilt, slip = np.exp(logs)
        return start._replace(
            noise=np.full(len(start.taxel), noise),
            rough=float(rough),
            aside=float(aside),
            displaced=np.array([shift, tilt, tilt, slip, slip]),
        )

    def cost(logs: FloatArray) -> float:
        agreements(with_widths(logs)._replace(counts=1.0), depth, readings, log_p)
        return -float(log_p.mean())

    noise = 0.02 * float(np.quantile(readings, 0.99))
    found = minimize(
        cost,
        np.log([noise, 0.1, 0.2, 0.2, 0.02, 0.3]),
        method="Nelder-Mead",
        options={"maxfev": 200, "xatol": 0.05},
    )
    return with_widths(found.x), -float(found.fun)
