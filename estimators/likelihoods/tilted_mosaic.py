"""What a press feels that tilts: a mosaic of each object, times a pressure that is a plane over the pad.

A pad that leans presses harder on one side. On springs, the pressure under it is a plane, and a taxel feels that
plane as far as the object covers it:

    z = gain * cover(x, y on the object) * (p + q u + r v) + error,   u, v the taxel's place on the pad.

p, q and r differ from press to press, with its load and its tilt, and say nothing of the object. So they are fitted
to each reading, under a Gaussian prior, before reading and object are compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import Scan, compose, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.deviation import non_negative
from tactsim.estimators.likelihoods.folds import LeftOut, as_one, load_levels
from tactsim.estimators.likelihoods.mosaic import Grid, LearnedMosaic, Mosaic, learn_with_spread
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.likelihoods.plane_kernels import Nodes, Planes, PressureModel, expand, fit_planes
from tactsim.estimators.options import LikelihoodOptions

# How often mosaics are learned from pressures, and these from the mosaics.
_TURNS = 6
# Map cells along a cell of the mosaics: cover is smooth over a taxel.
_COARSER = 2
# A training taxel counts with the square of its pressure beside the typical one, at most with this square.
_MOST_PRESSURE = 3.0
# A taxel under less than this share of the typical pressure says nothing of what covers it.
_LEAST_PRESSURE = 1 / 30
# The prior of p, q and r while nothing is known of them, beside the typical pressure.
_LOOSE = 3.0
# kPa; no pressure is 0.
_LEAST = 1e-6
# Errors are learned from about so many taxels of training readings.
_ENOUGH = 100_000
# Steps of a search for the pose, and how much less misfit (nats) a step must bring for another one.
_STEPS, _WORTH = 6, 0.02
# mm, mm, rad that one step may move at most.
_STRIDE = np.array([0.5, 0.5, 0.06])
# Rounds in which variances are learned.
_ROUNDS = 6
# A taxel errs by at least this share of the typical pressure.
_LEAST_ERROR = 1e-3


@dataclass(frozen=True, eq=False)
class Foretold:
    """Cover and squared slope (n, taxels) at a letter's training readings, of mosaics learned without them.

    near: without any taxel that lay just like it, so that the place is known well. far: without all
    readings that were taken around there, so that it is known badly. Each holds cover and slope.
    """

    poses: FloatArray
    readings: FloatArray
    near: tuple[FloatArray, FloatArray]
    far: tuple[FloatArray, FloatArray]


class TiltedMosaics:
    """Mosaics of cover for all letters, and how far readings are from what they predict.

    mosaics: by letter. gain: (taxels,) of mean 1. typical: kPa, the median of the training readings' highest taxel.
    variance: (3,) a taxel's variance is their sum, the first as it is (kPa^2), the second times the squared predicted
    pressure, the third (mm^2) times the squared slope of the prediction. prior: (3,) kPa, deviations of p, q and r.
    """

    def __init__(self, options: LikelihoodOptions) -> None:
        self.options = options

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn mosaics and gains in turns with the planes of the training readings, then the errors."""
        train = scan.where("train")
        self.taxel_xy = np.array(scan.taxel_xy, dtype=float)
        from_middle = self.taxel_xy - self.taxel_xy.mean(axis=0)
        self._plane = np.column_stack(
            [np.ones(len(from_middle)), from_middle / (np.abs(from_middle).max() or 1.0)]
        )
        highest = {label: train.where(label=label).readings.max(axis=1, keepdims=True) for label in maps}
        self.typical = max(float(np.median(np.concatenate(list(highest.values())))), _LEAST)
        self.gain = np.ones(len(self.taxel_xy))
        self.variance = np.array([(self.typical / 10) ** 2, 0.0, 0.0])
        self.prior = np.full(3, _LOOSE * self.typical)
        letters = {label: train.where(label=label) for label in maps}
        xy = {label: transform(mine.poses, self.taxel_xy) for label, mine in letters.items()}
        pressure = {
            label: np.repeat(np.maximum(top, self.typical / 4), len(self.gain), axis=1)
            for label, top in highest.items()
        }
        learned: dict[str, LearnedMosaic] = {}
        for _ in range(_TURNS):
            felt, predicted = np.zeros((2, len(self.gain)))
            for label, mine in letters.items():
                learned[label] = self._learn(
                    maps[label], xy[label], *self._cover(mine.readings, pressure[label])
                )
                cover, slope = learned[label].mosaic(xy[label])
                pressure[label] = self._planes(mine.readings, cover, slope).pressure
                under = cover * pressure[label]
                felt += (under * mine.readings).sum(axis=0)
                predicted += (under * under).sum(axis=0)
            gain = np.maximum(np.divide(felt, predicted, out=np.ones_like(felt), where=predicted > 0), 0)
            self.gain = gain / gain.mean() if gain.any() else np.ones_like(gain)
        self.mosaics: dict[str, Mosaic] = {label: learned[label].mosaic for label in letters}
        self._out = {
            label: self._left_out(learned[label], maps[label], mine, xy[label], pressure[label])
            for label, mine in letters.items()
        }
        self._learn_errors()

    def left_out(self, label: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Give the misfits of a letter's training readings (n,) each: near, far, and looked up elsewhere.

        near and far as in `Foretold`. Elsewhere is where another reading was taken, as far away in the list as can be.
        """
        out = self._out[label]
        elsewhere = np.roll(out.readings, len(out.readings) // 2, axis=0)
        return (
            self._planes(out.readings, *out.near).misfit,
            self._planes(out.readings, *out.far).misfit,
            self._planes(elsewhere, *out.near).misfit,
        )

    def kept(self, label: str) -> FloatArray:
        """Give the misfits of a letter's training readings (n,), none of which is left out."""
        out = self._out[label]
        return self.misfits(label, np.zeros(3), out.readings, out.poses)

    def load_levels(self, label: str) -> NDArray[np.intp]:
        """Tell a letter's training readings by their loads, (n,) from 0; one level if no pose was felt at several."""
        out = self._out[label]
        return load_levels(out.poses, out.readings)

    def misfits(
        self, label: str, robot_in_object: FloatArray, readings: FloatArray, sensor_in_robot: FloatArray
    ) -> FloatArray:
        """Compare readings (n, taxels) kPa, taken at poses (n, 3), with a letter at a pose: (n,) nats from 0.

        A misfit is half of chi^2: squared errors over their variances, and p, q and r over theirs, at the p, q and r
        for which that is least.
        """
        xy = transform(compose(robot_in_object, sensor_in_robot), self.taxel_xy)
        return self._planes(readings, *self.mosaics[label](xy)).misfit

    def fitting_pose(
        self, label: str, start: FloatArray, readings: FloatArray, sensor_in_robot: FloatArray
    ) -> FloatArray:
        """Search around a pose T_R^O (3,) for one that readings (n, taxels) at poses (n, 3) fit better.

        Gauss-Newton steps, damped (Marquardt 1963), in which p, q and r are fitted along (variable projection, Golub
        and Pereyra 1973).
        """
        pose, damping = np.array(start, dtype=float), 1e-3
        total, slope, curvature = self._around(label, pose, readings, sensor_in_robot)
        for _ in range(_STEPS):
            step = np.linalg.solve(curvature + np.diag(damping * np.diag(curvature) + _LEAST), slope)
            other = pose + step / max(1.0, float(np.abs(step / _STRIDE).max()))
            found = self._around(label, other, readings, sensor_in_robot)
            gained = total - found[0]
            if gained > 0:
                pose, (total, slope, curvature), damping = other, found, damping / 10
            else:
                damping *= 100
            if abs(gained) < _WORTH:
                break
        return pose

    def _around(
        self, label: str, pose: FloatArray, readings: FloatArray, sensor_in_robot: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """Give -log p of readings at a pose, less a constant, how fast it falls (3,) and its curvature (3, 3)."""
        slope, curvature, mosaic = np.empty(3), np.empty((3, 3)), self.mosaics[label]
        nodes = Nodes(mosaic.plane, mosaic.origin, mosaic.cell)
        total = expand(
            pose, readings, sensor_in_robot, self.taxel_xy, nodes, self._pressure_model(), slope, curvature
        )
        return total, slope, curvature

    def _planes(self, readings: FloatArray, cover: FloatArray, slope: FloatArray) -> Planes:
        """Fit p, q and r to readings (n, taxels), given cover and its squared slope (n, taxels).

        Where the plane falls below 0 the pad has left the object: nothing is felt.
        """
        n, shape = len(readings), readings.shape
        planes = Planes(np.empty((n, 3)), np.empty(shape), np.empty(shape), np.empty(shape), np.empty(n))
        fit_planes(readings, cover, slope, self._pressure_model(), planes)
        return planes

    def _pressure_model(self) -> PressureModel:
        return PressureModel(self.gain, self._plane, self.variance, self.prior)

    def _cover(self, readings: FloatArray, pressure: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tell what part of each taxel was covered under a pressure, and how much that counts: (n, taxels) all."""
        under, least = self.gain * pressure, _LEAST_PRESSURE * self.typical
        weight = np.where(under > least, np.minimum(under / self.typical, _MOST_PRESSURE) ** 2, 0.0)
        return np.where(under > least, readings / np.maximum(under, least), 0.0), weight

    def _learn(
        self, chart: OccupancyMap, xy: FloatArray, cover: FloatArray, weight: FloatArray
    ) -> LearnedMosaic:
        """Learn a mosaic from cover (n, taxels) at xy (n, taxels, 2) mm, over the same area as a map."""
        rows, columns = (side // _COARSER + 2 for side in chart.log_odds.shape)
        grid = Grid(chart.origin, _COARSER * chart.cell, (rows, columns), self.options.sigma)
        return learn_with_spread(xy.reshape(-1, 2), cover.ravel(), weight.ravel(), grid)

    def _left_out(
        self, learned: LearnedMosaic, chart: OccupancyMap, mine: Scan, xy: FloatArray, pressure: FloatArray
    ) -> Foretold:
        """Look a letter's training readings up in mosaics without themselves, and without those around them."""
        cover, weight = self._cover(mine.readings, pressure)
        near = (
            learned.without(*as_one(mine, cover.ravel(), weight.ravel())).reshape(cover.shape),
            learned.mosaic(xy)[1],
        )
        far_cover, far_slope = LeftOut.of(mine).predicted(
            lambda gone: np.array(self._learn(chart, xy[~gone], cover[~gone], weight[~gone]).mosaic(xy[gone]))
        )
        return Foretold(mine.poses, mine.readings, near, (far_cover, far_slope))

    def _learn_errors(self) -> None:
        """Learn variances and priors from the training readings that were left out, near and far alike.

        The parts of the variance come from a regression of the squared errors, in which none is negative. Each taxel
        is weighted with its own variance (iteratively reweighted least squares).
        """
        seen = [(out.readings, *known) for out in self._out.values() for known in (out.near, out.far)]
        every = max(1, sum(len(readings) for readings, _, _ in seen) * len(self.gain) // _ENOUGH)
        readings, cover, slope = (np.concatenate([one[i][::every] for one in seen]) for i in range(3))
        for _ in range(_ROUNDS):
            fit = self._planes(readings, cover, slope)
            predicted, steep = self.gain * cover * fit.pressure, (self.gain * fit.pressure) ** 2 * slope
            sources = np.stack([np.ones_like(predicted), predicted**2, steep], axis=-1).reshape(-1, 3)
            expected = fit.variance.ravel()
            variance = non_negative(sources / expected[:, None], fit.error.ravel() ** 2 / expected)
            self.variance = np.maximum(variance, [(_LEAST_ERROR * self.typical) ** 2, 0, 0])
        spread = np.sqrt((fit.coefficients**2).mean(axis=0))
        self.prior = np.maximum([spread[0], *[np.sqrt((spread[1:] ** 2).mean())] * 2], _LEAST)
