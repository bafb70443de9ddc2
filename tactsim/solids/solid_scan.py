"""`SpaceScan`: readings of objects in space, each touched from a side of its own, and the file that holds them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import POSE, checked_poses
from tactsim.core.scan import Scan, as_names, as_numbers


@dataclass(frozen=True, eq=False, repr=False)
class SpaceScan(Scan):
    """Readings of objects that a pad touched from known poses in space.

    readings: (n, taxels) kPa at rest. poses: (n, 7) sensor_in_object at rest, where the robot says that it is. The
    sensor's z axis looks out of the pad, into the object; the pad came along it, over the last `meta["stroke"]` mm.
    A touch that met nothing reads 0 at the end of its stroke. labels: (n,). split: (n,) "train" or "test".
    taxel_points, taxel_normals: (taxels, 3) mm in the sensor frame and unit vectors: the taxels' centres on the pad's
    unloaded surface and where they look; z = 0 and +z on a flat pad. touch: (n,) whole numbers: readings of one number
    were taken together, by several pads.

    meta: how it was made, a JSON object. `meta["objects"][label]` holds, where known, `rotations` (k, 4) the finite
    group of turns about the origin that leave the object as it is, `axis` (3,) where every turn about it does, or null,
    and `radius` mm about the origin that holds all of it.

    Raises InputError when shapes disagree, a number is not finite, a rotation is none, or a name is wrong.
    """

    taxel_xy: FloatArray = field(init=False)  # the first two numbers of `taxel_points`
    taxel_points: FloatArray = field(kw_only=True)
    taxel_normals: FloatArray = field(kw_only=True)
    touch: NDArray[np.intp] = field(kw_only=True)

    kind: ClassVar[str] = "solids"
    POSE: ClassVar[tuple[str, ...]] = POSE
    _ARRAYS: ClassVar[tuple[str, ...]] = (
        "readings", "poses", "labels", "split", "taxel_points", "taxel_normals", "touch",
    )  # fmt: skip
    _OPTIONAL: ClassVar[tuple[str, ...]] = ()
    PER_READING: ClassVar[tuple[str, ...]] = ("readings", "poses", "labels", "split", "touch")
    _MADE_BY: ClassVar[str] = "`bench scan --task solids --out FILE`"

    def _check_arrays(self) -> None:
        for name in ("readings", "taxel_points", "taxel_normals"):
            # Not read only: kernels that are compiled for arrays that can be written take them.
            object.__setattr__(self, name, np.array(as_numbers(name, getattr(self, name), 2)))
        object.__setattr__(self, "poses", checked_poses(self.poses, "scan: poses"))
        for name in ("labels", "split"):
            object.__setattr__(self, name, as_names(name, getattr(self, name)))
        object.__setattr__(self, "touch", np.asarray(self.touch).astype(np.intp))
        count, taxels = self.readings.shape
        self._check_shapes(
            poses=(count, len(POSE)), labels=(count,), split=(count,), touch=(count,),
            taxel_points=(taxels, 3), taxel_normals=(taxels, 3),
        )  # fmt: skip
        if np.abs(np.linalg.norm(self.taxel_normals, axis=1) - 1).max() > 1e-6:
            raise InputError("scan: taxel_normals are not of length 1")
        object.__setattr__(self, "taxel_xy", self.taxel_points[:, :2])

    @property
    def objects(self) -> tuple[str, ...]:
        """List the labels in the order of their first appearance."""
        return self.letters
