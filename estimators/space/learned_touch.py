"""Learn from training touches how the pad feels: its stiffness, and the widths of what surfaces do not explain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import minimize

from tactsim.core.poses import FloatArray
from tactsim.estimators.space.learning import Touches, depths, learn_surface
from tactsim.estimators.space.rays import Rays
from tactsim.estimators.space.touch_kernels import Touching, agreements

_LEFT_OUT = 5  # one in so many touches is left out to be foreseen
_SHOWN = 3  # objects from which the stiffness is learned
_SOFT = 0.3  # mm
_FREEDOM = 4.0
_COUNTS = 0.5  # neighbours share errors of the map
_STIFFNESSES = np.geomspace(10, 1000, 9)  # kPa/mm that are tried first


def learn_touching(
    touches: Mapping[str, Touches], points: FloatArray, rays: Rays, dense: Rays, cell: float, stroke: float
) -> tuple[Touching, float]:
    """Learn how a pad with taxels at `points` (taxels, 3) mm feels; also the load of a touch, N.

    rays: on which touches will be compared; dense: on which surfaces are learned.
    """
    shown = [_divided(mine) for mine in list(touches.values())[:: max(1, len(touches) // _SHOWN)][:_SHOWN]]
    errors = [_misfit(shown, dense, cell, stroke, stiffness) for stiffness in _STIFFNESSES]
    best = int(np.argmin(errors))
    fine = _STIFFNESSES[best] * np.geomspace(0.7, 1 / 0.7, 5)
    stiffness = float(fine[np.argmin([_misfit(shown, dense, cell, stroke, one) for one in fine])])
    deepest = max(
        1.5,
        1.0
        + max(float(np.quantile(mine.readings.max(axis=1), 0.999)) for mine in touches.values()) / stiffness,
    )
    touching = _touching(points, rays, stiffness, deepest, stroke)
    depth, readings = [], []
    for mine in touches.values():
        learned, left_out = _divided(mine)
        chart = learn_surface(learned, dense, stiffness, cell, stroke)
        depth.append(depths(chart, left_out, rays, deepest, _SOFT + 0.5))
        readings.append(left_out.readings)
    widths = _widths(touching, np.concatenate(depth), np.ascontiguousarray(np.concatenate(readings)))
    area = rays.frame[2] ** 2 * rays.base.size / len(points)
    load = (
        float(np.quantile(np.concatenate([mine.readings.sum(axis=1) for mine in touches.values()]), 0.75))
        * area
    )
    return widths, load / 1000


def _divided(touches: Touches) -> tuple[Touches, Touches]:
    """Divide touches into those that are learned from and those left out."""
    out = np.arange(len(touches.readings)) % _LEFT_OUT == 0
    return (touches[~out], touches[out]) if out.any() and not out.all() else (touches, touches)


def _misfit(
    shown: list[tuple[Touches, Touches]], rays: Rays, cell: float, stroke: float, stiffness: float
) -> float:
    """Give the median error mm with which left-out touches are foreseen, each one's own mean taken out."""
    errors = []
    for learned, left_out in shown:
        chart = learn_surface(learned, rays, stiffness, cell, stroke)
        depth = depths(chart, left_out, rays, 5.0, 1.0)
        pressed = np.maximum(depth, 0) @ rays.to_taxels.T
        touched = left_out.readings > 0.3 * left_out.readings.max(axis=1, keepdims=True)
        off = np.where(touched, pressed - left_out.readings / stiffness, np.nan)
        errors.append(np.abs(off - np.nanmedian(off, axis=1, keepdims=True))[touched])
    return float(np.median(np.concatenate(errors)))


def _touching(points: FloatArray, rays: Rays, stiffness: float, deepest: float, stroke: float) -> Touching:
    """Set up how a pad feels, before its widths are learned."""
    taxel, ray = np.nonzero(rays.to_taxels)
    return Touching(
        ray=np.column_stack([rays.xy, rays.base.ravel()]),
        taxel=np.ascontiguousarray(points[:, :2]),
        start=np.searchsorted(taxel, np.arange(len(points) + 1)).astype(np.int64),
        which=ray.astype(np.int64),
        share=np.ascontiguousarray(rays.to_taxels[taxel, ray]),
        stiffness=stiffness, soft=_SOFT, deepest=deepest, stroke=stroke, noise=np.full(len(points), 2.0), rough=0.1,
        displaced=np.array([0.2, 0.02, 0.02]), swept=0.5, freedom=_FREEDOM, counts=_COUNTS,
    )  # fmt: skip


def _widths(start: Touching, depth: FloatArray, readings: FloatArray) -> Touching:
    """Choose the widths under which touches left out are most probable."""
    log_p = np.empty(len(depth))
    quiet = np.abs(readings[(depth.max(axis=1) < 0)[:, None] & np.ones_like(readings, dtype=bool)])
    least = max(float(np.median(quiet)) / 0.6745 if quiet.size > 100 else 0.0, 0.02 * readings.max())

    def with_widths(logs: FloatArray) -> Touching:
        noise, rough, shift, tilt = np.exp(logs)
        return start._replace(
            noise=np.full(len(start.taxel), noise),
            rough=float(rough),
            displaced=np.array([shift, tilt, tilt]),
        )

    def cost(logs: FloatArray) -> float:
        agreements(with_widths(logs)._replace(counts=1.0), depth, readings, log_p)
        return -float(log_p.mean())

    found = minimize(
        cost,
        np.log([2 * least, 0.1, 0.2, 0.02]),
        method="Nelder-Mead",
        options={"maxfev": 120, "xatol": 0.05},
    )
    return with_widths(found.x)
