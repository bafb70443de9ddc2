"""The inner loops of tilted mosaics: planes of pressure fitted to readings, and how that changes with the pose."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactsim.core.compiling import GivenReals1D, GivenReals2D, Reals1D, Reals2D, Reals3D, compiled

# Passes in which the plane of a reading, and where it is below 0, are found.
_PASSES = 3


class PressureModel(NamedTuple):
    """What a press that tilts does to the taxels, as in `TiltedMosaics`.

    gain: (taxels,). plane: (taxels, 3) 1, u and v. parts: (3,) of a taxel's variance. prior: (3,) kPa, deviations of p,
    q and r.
    """

    gain: Reals1D
    plane: Reals2D
    parts: Reals1D
    prior: Reals1D


class Plane(NamedTuple):
    """What was fitted to one reading: coefficients (3,) p, q, r; pressure, variance, error (taxels,) as in `Planes`."""

    coefficients: Reals1D
    pressure: Reals1D
    variance: Reals1D
    error: Reals1D


class Planes(NamedTuple):
    """What was fitted to n readings.

    coefficients: (n, 3) p, q, r, kPa. pressure: (n, taxels) kPa, the plane, from 0. variance: (n, taxels) kPa^2, of the
    last pass, and error: (n, taxels) kPa, in it. misfit: (n,) nats.
    """

    coefficients: Reals2D
    pressure: Reals2D
    variance: Reals2D
    error: Reals2D
    misfit: Reals1D


class Nodes(NamedTuple):
    """The nodes of a `Mosaic`: plane (rows, columns, 3), origin (2,) mm, cell mm."""

    plane: Reals3D
    origin: Reals1D
    cell: float


@compiled(called_from_python=False)
def _factorise(normal: Reals2D, prior: Reals1D) -> None:
    """Add the prior's 1 / deviation^2 to a symmetric matrix (3, 3), and replace its lower part by Cholesky's factor."""
    for a in range(3):
        normal[a, a] += 1.0 / prior[a] ** 2
        for b in range(a + 1):
            total = normal[a, b]
            for k in range(b):
                total -= normal[a, k] * normal[b, k]
            normal[a, b] = math.sqrt(total) if a == b else total / normal[b, b]


@compiled(called_from_python=False)
def _divide(vector: Reals1D, factor: Reals2D) -> None:
    """Divide a vector (3,) by a lower triangular matrix (3, 3), in place."""
    for a in range(3):
        for k in range(a):
            vector[a] -= factor[a, k] * vector[k]
        vector[a] /= factor[a, a]


@compiled(called_from_python=False)
def _fit_plane(
    reading: GivenReals1D,
    cover: Reals1D,
    slope: Reals1D,
    model: PressureModel,
    fit: Plane,
    factor: Reals2D,
    seen: Reals1D,
) -> float:
    """Do for one reading what `fit_planes` does for all; returns its misfit, nats.

    factor: (3, 3) becomes Cholesky's factor of the normal equations of the last pass. seen: (taxels,) what a pressure
    of 1 kPa was taken to give in it.
    """
    gain, plane, parts, prior = model.gain, model.plane, model.parts, model.prior
    found, pressure, variance, error = fit.coefficients, fit.pressure, fit.variance, fit.error
    misfit = 0.0
    for number in range(_PASSES):
        factor[:] = 0
        found[:] = 0
        squares = 0.0
        for t in range(len(reading)):
            seen[t], variance[t] = gain[t] * cover[t], parts[0]
            if number > 0:
                predicted, steep = seen[t] * pressure[t], gain[t] * pressure[t]
                variance[t] += parts[1] * predicted * predicted + parts[2] * steep * steep * slope[t]
                if pressure[t] == 0:
                    seen[t] = 0
            for a in range(3):
                weighed = seen[t] * plane[t, a] / variance[t]
                found[a] += weighed * reading[t]
                for b in range(a + 1):
                    factor[a, b] += weighed * seen[t] * plane[t, b]
            squares += reading[t] * reading[t] / variance[t]
        _factorise(factor, prior)
        _divide(found, factor)
        for a in range(3):
            squares -= found[a] * found[a]
        misfit = squares / 2
        for a in range(2, -1, -1):
            for k in range(a + 1, 3):
                found[a] -= factor[k, a] * found[k]
            found[a] /= factor[a, a]
        for t in range(len(reading)):
            under = found[0] * plane[t, 0] + found[1] * plane[t, 1] + found[2] * plane[t, 2]
            pressure[t], error[t] = max(under, 0.0), reading[t] - seen[t] * under
    return misfit


@compiled()
def fit_planes(
    reading: GivenReals2D, cover: Reals2D, slope: Reals2D, model: PressureModel, planes: Planes
) -> None:
    """Fit p, q and r to readings (n, taxels) kPa, given cover and its squared slope (n, taxels) mm^-2; fills planes.

    Where the plane falls below 0 the pad has left the object: nothing is felt.
    """
    factor, seen = np.empty((3, 3)), np.empty(len(model.gain))
    for n in range(len(reading)):
        fit = Plane(planes.coefficients[n], planes.pressure[n], planes.variance[n], planes.error[n])
        planes.misfit[n] = _fit_plane(reading[n], cover[n], slope[n], model, fit, factor, seen)


@compiled()
def expand(
    pose: Reals1D, reading: GivenReals2D, sensor_in_robot: GivenReals2D, taxel_xy: Reals2D, mosaic: Nodes,
    model: PressureModel, slope: Reals1D, curvature: Reals2D,
) -> float:  # fmt: skip
    """Expand -log p of readings (n, taxels) kPa, less a constant, around a pose T_R^O (3,) of the object.

    sensor_in_robot: (n, 3). taxel_xy: (taxels, 2) mm. p, q and r are fitted along (variable projection, Golub and
    Pereyra 1973), and what changes variances with the pose is left out. Returns the value at the pose; fills slope
    (3,), how fast it falls, and curvature (3, 3), as Gauss and Newton have it.
    """
    nodes, origin, cell, gain, plane = mosaic.plane, mosaic.origin, mosaic.cell, model.gain, model.plane
    taxels, rows, columns = len(gain), nodes.shape[0], nodes.shape[1]
    cover, steep, gradient = np.empty(taxels), np.empty(taxels), np.empty((taxels, 3))
    fit = Plane(np.empty(3), np.empty(taxels), np.empty(taxels), np.empty(taxels))
    pressure, variance, error, seen = fit.pressure, fit.variance, fit.error, np.empty(taxels)
    factor, along, moved = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    slope[:] = 0
    curvature[:] = 0
    total, turned_x, turned_y = 0.0, math.cos(pose[2]), math.sin(pose[2])
    for n in range(len(reading)):
        x, y, angle = sensor_in_robot[n, 0], sensor_in_robot[n, 1], pose[2] + sensor_in_robot[n, 2]
        # From the object's turning point, which is the robot's origin.
        from_x, from_y = turned_x * x - turned_y * y, turned_y * x + turned_x * y
        cos, sin = math.cos(angle), math.sin(angle)
        for t in range(taxels):
            away_x = from_x + cos * taxel_xy[t, 0] - sin * taxel_xy[t, 1]
            away_y = from_y + sin * taxel_xy[t, 0] + cos * taxel_xy[t, 1]
            u, v = (pose[0] + away_x - origin[0]) / cell, (pose[1] + away_y - origin[1]) / cell
            # What is no number is at the rim, too: nothing is read beyond the nodes.
            u = min(u, columns - 1.0) if u > 0 else 0.0
            v = min(v, rows - 1.0) if v > 0 else 0.0
            column, row = min(int(u), columns - 2), min(int(v), rows - 2)
            u, v = u - column, v - row
            for a in range(3):
                gradient[t, a] = (1 - v) * (
                    (1 - u) * nodes[row, column, a] + u * nodes[row, column + 1, a]
                ) + v * ((1 - u) * nodes[row + 1, column, a] + u * nodes[row + 1, column + 1, a])
            cover[t] = gradient[t, 0]
            by_x, by_y = gradient[t, 1] / cell, gradient[t, 2] / cell
            steep[t] = by_x * by_x + by_y * by_y
            gradient[t, 0], gradient[t, 1], gradient[t, 2] = by_x, by_y, by_y * away_x - by_x * away_y
        total += _fit_plane(reading[n], cover, steep, model, fit, factor, seen)
        along[:] = 0
        for t in range(taxels):
            total += math.log(variance[t]) / 2
            for i in range(3):
                moved[i] = gain[t] * pressure[t] * gradient[t, i]
            for i in range(3):
                weighed = moved[i] / variance[t]
                slope[i] += weighed * error[t]
                for j in range(3):
                    curvature[i, j] += weighed * moved[j]
                    along[i, j] += weighed * seen[t] * plane[t, j]
        for i in range(3):
            _divide(along[i], factor)
        for i in range(3):
            for j in range(3):
                for a in range(3):
                    curvature[i, j] -= along[i, a] * along[j, a]
    return total
