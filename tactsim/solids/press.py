"""Touch objects in space: the pad comes from any side along its normal until it carries the set force."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactsim import models
from tactsim.core.errors import InputError, unknown
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import checked_poses, compose, from_vector, matrix
from tactsim.press.scan_options import ScanOptions
from tactsim.press.sensor import gains, sense
from tactsim.solids.options import SpaceOptions
from tactsim.solids.pad_lattice import pad_lattice
from tactsim.solids.touch_kernels import STATE, Layer, Mesh, Starts, touch_all


@dataclass(frozen=True, eq=False)
class Touched:
    """What n touches of one object came to; poses are sensor_in_object.

    stated, true: (n, 7), where the robot says that the pad rests, and where it does. travel: (n,) mm along the pad's z.
    met: (n,), whether the pad met the object; one that met nothing rests at the end of its stroke and reads 0.
    force: (n,) N that the pad carries: the set force, or less where the stroke ended before.
    readings: (n, taxels) kPa at rest.
    """

    stated: FloatArray
    true: FloatArray
    travel: FloatArray
    met: NDArray[np.bool_]
    force: FloatArray
    readings: FloatArray


class SpacePress:
    """A pad that touches objects at rest, under force control.

    solids: the objects, by their names. Of `options` the objects' names and the numbers of touches do not count.
    A pad is held rigidly and comes along its z axis from outside the object, whatever lies behind `start`. Its layer is
    a bed of independent springs (Winkler): pressure = stiffness * depth, never below 0, both along the pad's normal.
    Only the pad's own surface touches (`Pad.load_bounds`); its sides and what carries it do not.
    Raises InputError if the pad does not fit its body.
    """

    def __init__(self, solids: Iterable[models.Solid], options: SpaceOptions) -> None:
        self.options = options
        self.solids = {solid.name: solid for solid in solids}
        self.lattice = pad_lattice(options)
        self._gain = gains(ScanOptions(pad=options.pad, sensor=options.sensor, seed=options.seed))

    def touch(self, label: str, start: FloatArray, rng: np.random.Generator | None = None) -> Touched:
        """Touch an object from stated starts (n, 7), sensor_in_object; the readings have no imperfections.

        rng: draws how far the stated pose at rest is off the true one (`placement_mm`, `placement_rad`); none if it is
        None. Drawn at the start, an error in angle would grow sideways with the way that the pad goes.
        A layer that the force would press by more than its thickness is just so stiff that it gives way by that.
        Raises InputError if there is no such object or a start is no pose.
        """
        start = checked_poses(start, "start")
        touched = self.touch_from(label, start, start, np.full(start.shape[:-1], self.options.stroke))
        if rng is None:
            return touched
        return replace(touched, stated=misplaced(touched.true, self.options, rng))

    def touch_from(self, label: str, start: FloatArray, true: FloatArray, stroke: FloatArray) -> Touched:
        """Touch an object from starts (n, 7) that are truly at `true` (n, 7), each over its own stroke (n,) mm."""
        if label not in self.solids:
            raise unknown("object", label, list(self.solids))
        if start.ndim != 2:
            raise InputError(f"start has shape {start.shape}; it is a table of poses, (n, 7)")
        solid, options, lattice = self.solids[label], self.options, self.lattice
        states = np.empty((len(start), STATE))
        images = np.empty((len(start), options.pad.taxels))
        touch_all(
            Mesh(solid.vertices.astype(float), solid.faces.astype(np.int64)),
            Starts(np.ascontiguousarray(true[:, :3]), np.ascontiguousarray(matrix(true[:, 3:])), stroke),
            lattice.points,
            Layer(1e-3 * options.stiffness, float(options.thickness)),
            options.force,
            states,
            images,
        )
        images *= lattice.kpa
        travel, force = states[:, 0], states[:, 1]
        return Touched(advanced(start, travel), advanced(true, travel), travel, force > 0, force, images)

    def sensed(self, touched: Touched, rng: np.random.Generator) -> Touched:
        """Give the touches with what the pad reports of them, one after the other: noise, steps and its other faults.

        A touch that met nothing has them too.
        """
        sensor, rows = self.options.sensor, self.options.pad.rows
        return replace(touched, readings=sense(touched.readings, sensor, self._gain, rng, rows=rows))


def advanced(pose: FloatArray, distance: FloatArray) -> FloatArray:
    """Move poses (n, 7) by distances (n,) mm along their own z axes."""
    moved = pose.copy()
    moved[:, :3] += distance[:, None] * matrix(pose[:, 3:])[:, :, 2]
    return moved


def misplaced(pose: FloatArray, options: SpaceOptions, rng: np.random.Generator) -> FloatArray:
    """Draw poses (..., 7) that are off the given ones by a placement error in the pads' own frames."""
    error = rng.standard_normal((*pose.shape[:-1], 6))
    turn = from_vector(options.placement_rad * error[..., 3:])
    return compose(pose, np.concatenate([options.placement_mm * error[..., :3], turn], axis=-1))
