"""The options of a scan of objects in space: which objects, which touches, the pad and how it presses.

"assumed" in a description means that the paper does not give the value.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from tactsim.core.checking import Settings
from tactsim.core.pad import Pad
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
    pad: Pad = Field(default_factory=Pad, description="its measures, or the path of a file that holds them")
    sensor: SensorOptions = Field(default_factory=SensorOptions)

    @field_validator("pad", mode="before")
    @classmethod
    def _pad_from_file(cls, pad: object) -> object:
        return Pad.load(pad) if isinstance(pad, str | Path) else pad

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
        beyond = [taxel for taxel in self.sensor.dead_taxels if taxel >= self.pad.taxels]
        if beyond:
            raise ValueError(
                f"dead taxel {beyond[0]} does not exist: the pad's taxels are 0 to {self.pad.taxels - 1}"
            )
        return self
