"""The scan of objects in space: `SpaceOptions`, what it depends on, and `SpaceScan`, the file that holds it.

"assumed" in a description means that the paper does not give the value.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tactsim.core.checking import Settings
from tactsim.core.errors import InputError
from tactsim.core.pad import Pad, PadOrFile
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import POSE, checked_poses
from tactsim.core.scan import Scan, as_names, as_numbers
from tactsim.models import solid_names
from tactsim.press.sensor import SensorOptions

_MOST_POINTS = 1_000_000  # of the lattice, so that it stays in memory


class SpaceOptions(Settings):
    """Everything that readings of objects in space depend on, besides the objects' shapes themselves."""

    objects: tuple[str, ...] = Field(solid_names(), description="names of the objects")
    meshes: tuple[str, ...] = Field((), description="mesh files of one's own, touched after the objects")
    seed: int = Field(0, ge=0, lt=2**63, description="of every random number in the scan")
    points: int = Field(
        192, ge=1, le=100_000, description="points of an object's surface that training touches aim at"
    )
    turns: int = Field(
        2, ge=1, le=360, description="training touches at each point, turned evenly about its normal"
    )
    lean: float = Field(
        1.0,
        ge=0,
        le=1.5,
        description="rad, up to which all but the first training touch at a point lean to any side",
    )
    tests: int = Field(64, ge=0, le=100_000, description="test touches of each object, from anywhere")
    stroke: float = Field(
        200.0, ge=1, le=1000, description="mm that the pad goes along its normal at most (assumed)"
    )
    force: float = Field(2.0, ge=1e-6, le=1e4, description="N at which the pad stops (assumed)")
    stiffness: float = Field(50.0, ge=1, le=1e6, description="kPa per mm of the pad's layer (assumed)")
    thickness: float = Field(
        3.0, ge=1e-3, le=100, description="mm of the pad's layer, past which it gives no more way (assumed)"
    )
    spacing: float = Field(
        0.05,
        ge=0.01,
        le=1,
        description="mm at most between points at which the layer meets the object; three times that over a large area",
    )
    body: Literal["flat", "cylinder", "sphere"] = Field(
        "flat", description="what the pad is laid on; a cylinder's axis is the pad's y"
    )
    radius: float | None = Field(None, gt=0, le=1e6, description="mm of the cylinder or sphere")
    placement_mm: float = Field(
        0.2,
        ge=0,
        le=20,
        description="mm, standard deviation along each axis of a stated pose's error (assumed)",
    )
    placement_rad: float = Field(
        0.01,
        ge=0,
        le=1,
        description="rad, standard deviation about each axis of a stated pose's error (assumed)",
    )
    pad: PadOrFile = Field(
        default_factory=Pad, description="its measures, or the path of a file that holds them"
    )
    sensor: SensorOptions = Field(default_factory=SensorOptions)

    @model_validator(mode="after")
    def _radius_where_curved(self) -> SpaceOptions:
        if (self.body == "flat") != (self.radius is None):
            raise ValueError(
                "a flat pad has no radius: give body = cylinder or sphere"
                if self.body == "flat"
                else f"a pad on a {self.body} needs its radius, mm"
            )
        return self

    @model_validator(mode="after")
    def _pad_is_workable(self) -> SpaceOptions:
        x_low, x_high, y_low, y_high = self.pad.load_bounds
        points = (x_high - x_low) * (y_high - y_low) / self.spacing**2
        if points > _MOST_POINTS:
            raise ValueError(
                f"the pad has {points:,.0f} points {self.spacing:g} mm apart, more than {_MOST_POINTS:,}; choose a "
                "larger spacing or fewer taxels"
            )
        self.sensor.check_dead_taxels(self.pad.taxels)
        return self


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
