"""Where an object is placed: what the error of a placement needs of an object, and the error itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, Field

from tactsim.bench.placement_kernels import distances
from tactsim.core import InputError, Scan, transform, wrap_angle
from tactsim.core.checking import checked
from tactsim.core.errors import short
from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray

_Length = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


@dataclass(frozen=True)
class Properties:
    """What the error metric needs of an object.

    symmetry: order of the rotational symmetry, 0 for a disc. centre: [x, y] mm, centre of mass in
    the object frame. inertia_over_mass: mm^2, polar second moment of mass about the centre / mass.
    """

    symmetry: int
    centre: tuple[float, float]
    inertia_over_mass: float

    @classmethod
    def stated(cls, values: Any, where: str) -> Properties:
        """Take the properties from a file's JSON. Raises InputError that begins with `where`."""
        stated = checked(_Stated, values, where)
        return cls(stated.symmetry, stated.centre, stated.inertia_over_mass)


class _Stated(BaseModel):
    symmetry: int = Field(ge=0, le=1000)
    centre: tuple[_Length, _Length] = (0.0, 0.0)
    inertia_over_mass: float = Field(gt=0, le=LARGEST)


def properties(scan: Scan) -> dict[str, Properties]:
    """Take the objects' properties from the scan, or estimate them from its training readings.

    If the scan does not state them, the pressures of the training readings, at the places where they were
    felt, stand for the mass, and no symmetry is assumed. The paper estimates the properties from its maps.
    Raises InputError as `stated_properties` does.
    """
    known = stated_properties(scan)
    return {
        label: known.get(label) or _felt(scan.where("train", label), scan.where(label=label))
        for label in scan.letters
    }


def stated_properties(scan: Scan) -> dict[str, Properties]:
    """Take the properties of those objects of which the scan states them. Raises InputError if they make no sense."""
    known = scan.meta.get("objects", {})
    if not isinstance(known, dict):
        raise InputError(f"scan: meta.objects must be a table, got {short(known)}")
    return {
        label: Properties.stated(known[label], f"scan: meta.objects.{label}")
        for label in scan.letters
        if label in known
    }


def load_scan(path: str | Path) -> Scan:
    """Load a scan for trials: one whose objects can be scored. Raises InputError that names the file."""
    scan = Scan.load(path)
    try:
        stated_properties(scan)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return scan


def _felt(train: Scan, all_readings: Scan) -> Properties:
    felt = train if len(train) else all_readings
    points = transform(felt.poses, felt.taxel_xy).reshape(-1, 2)
    weights = np.clip(felt.readings, 0, None).reshape(-1)
    if weights.sum() <= 0:
        return Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=1.0)
    weights = weights / weights.sum()
    centre = weights @ points
    inertia = float(weights @ ((points - centre) ** 2).sum(axis=1))
    return Properties(1, (float(centre[0]), float(centre[1])), max(inertia, 1e-6))


def placement_error(estimated: ArrayLike, true: ArrayLike, of: Properties) -> FloatArray:
    """Measure the distance between an object's estimated and true placement, in mm.

    estimated, true: (..., 3) robot_in_object. The object's placement is the inverse, T_O^R.
    d^2 = |displacement of the centre of mass|^2 + (I/m) 2 (1 - cos dtheta): the rms displacement of
    the object's points (the paper's ref. [24], Eqn. 4, in mm); dtheta is folded by the object's
    rotational symmetry (eq. 17-20, with the wrap that the printed mod lacks).
    """
    one, other = np.asarray(estimated, dtype=float), np.asarray(true, dtype=float)
    if other.ndim > 1:
        one, other = np.broadcast_arrays(one, other)
    poses, others = (np.ascontiguousarray(rows.reshape(-1, 3)) for rows in (one, other))
    away = distances(poses, others, of.symmetry, *of.centre, of.inertia_over_mass)
    return away.reshape(one.shape[:-1])


def fold_angle(angle: ArrayLike, symmetry: int) -> FloatArray:
    """Return the smallest turn (rad, signed) that looks the same, for a symmetry order (0: a disc)."""
    if symmetry == 0:
        return np.zeros_like(np.asarray(angle, dtype=float))
    return wrap_angle(np.asarray(angle, dtype=float) * symmetry) / symmetry
