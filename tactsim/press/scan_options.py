"""The options of a scan: letters, pad, press and sensor (`sensor`), each with its unit and its bounds.

"assumed" in a description means that the paper does not give the value.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from tactsim.core.checking import Settings, without_gone
from tactsim.core.pad import Pad, PadOrFile
from tactsim.core.poses import FloatArray
from tactsim.press.sensor import SensorOptions
from tactsim.press.spread import cell_lines

CLEARANCE = 0.2  # mm between letter and pad before a press through time (assumed)
_MOST_CELLS = 200_000  # of the bed: 1 GB of moments for the presses that are laid out together
# Options of earlier versions, with the values that press as now.
_GONE = {
    "foundation": "winkler",
    "poisson": 0.45,
    "dissipation": 0.1,
    "wrist_relaxation": 0.005,
    "clearance": CLEARANCE,
    "time_step": 1.0,
}


class Skips(Settings):
    """Work that is left out because it cannot change a reading. Each switch brings it back, to show just that."""

    no_contact: bool = Field(True, description="no physics for a press that does not touch")
    known: bool = Field(True, description="no press of the same letter at exactly the same pose again")

    @model_validator(mode="before")
    @classmethod
    def _of_earlier_versions(cls, values: object) -> object:
        return without_gone(values, dict.fromkeys(("cells", "parts", "stages", "solver"), True))


class PressOptions(Settings):
    """How a letter is pressed against the pad."""

    engine: Literal["auto", "exact", "bed", "collide", "relief"] = Field(
        "auto", description="what works out a press; auto takes the cheapest that is exact for it"
    )
    force: float = Field(
        2.0, ge=1e-6, le=1e8, description="N, constant force along the pad's normal (assumed)"
    )
    cells_per_taxel: int = Field(
        2, ge=1, le=16, description="cells of the bed along each side of a taxel; more cost time"
    )
    points_per_taxel: int = Field(
        48,
        ge=1,
        le=2000,
        description="points of the pad's lattice on each taxel and its share of gaps; engine collide",
    )
    stiffness: float = Field(
        1000.0,
        ge=1,
        le=1e6,
        description="kPa per mm of the pad's layer, which a flat, level face does not feel (assumed)",
    )
    thickness: float = Field(
        1.0, ge=1e-3, le=100, description="mm of the pad's layer, past which it gives no more way (assumed)"
    )
    tilt_x: float = Field(0.0, ge=-0.2, le=0.2, description="rad about the pad's x between letter and pad")
    tilt_y: float = Field(0.0, ge=-0.2, le=0.2, description="rad about the pad's y between letter and pad")
    wrist_stiffness: float | None = Field(
        300.0,
        ge=1,
        le=1e7,
        description="N mm per rad of hinges in the pad's middle that let a tilt give way; rigid for none (assumed)",
    )
    dynamics: Literal["equilibrium", "full"] = Field(
        "equilibrium", description="solve for rest, or step through approach, touch and settling"
    )
    moving_mass: float = Field(
        0.1, ge=1e-3, le=100, description="kg, of what is moved; full dynamics (assumed)"
    )
    approach_speed: float = Field(
        10.0, gt=0, le=1000, description="mm/s at most before contact; full dynamics (assumed)"
    )
    ramp: float = Field(0.05, ge=0, le=10, description="s, touch to full set point; full dynamics (assumed)")
    time_limit: float = Field(
        5.0, gt=0, le=100, description="s after which a press counts as unsettled; full dynamics"
    )
    frame_rate: float = Field(200.0, gt=0, le=1e4, description="images a second; full dynamics (assumed)")
    skip: Skips = Field(default_factory=Skips)

    @model_validator(mode="before")
    @classmethod
    def _of_earlier_versions(cls, values: object) -> object:
        return without_gone(values, _GONE)

    @field_validator("wrist_stiffness", mode="before")
    @classmethod
    def _rigid_wrist(cls, stiffness: object) -> object:
        return None if stiffness == "rigid" else stiffness  # a word that TOML and the command line can say

    @model_validator(mode="after")
    def _can_be_stepped(self) -> PressOptions:
        least = CLEARANCE / self.approach_speed + self.ramp
        if self.dynamics == "full" and self.time_limit <= least:
            raise ValueError(
                f"time_limit = {self.time_limit:g} s is over before the force is: approach ({CLEARANCE:g} mm / "
                f"approach_speed) and ramp take {least:g} s"
            )
        return self

    def stiffness_over(self, area: float, force: float | None = None) -> float:
        """Give the layer's stiffness, kPa/mm, under a contact of `area` mm^2 that carries `force` N, or the set force.

        A layer that the force would press by more than its thickness is stiffer: just enough to stop there.
        """
        return max(self.stiffness, 1e3 * (self.force if force is None else force) / (area * self.thickness))


class ScanOptions(Settings):
    """Everything that the readings of a scan depend on, besides the letters' shapes themselves."""

    letters: tuple[str, ...] = Field(("A", "E", "I", "O", "U"), description="names of the letters")
    shapes: tuple[str, ...] = Field((), description="files of shapes of one's own, pressed after the letters")
    rounding: float = Field(
        0.0, ge=0, le=10, description="mm, radius of the pressed face's edges (assumed sharp)"
    )
    seed: int = Field(0, ge=0, lt=2**63, description="of every random number in the scan")
    test_poses: Literal["same", "random"] = Field(
        "random",
        description="test readings at random poses within 12 mm, or at the training poses (the paper's)",
    )
    placement_mm: float = Field(
        0.1,
        ge=0,
        le=20,
        description="mm, standard deviation of a press's x and y about the stated pose (assumed)",
    )
    placement_rad: float = Field(
        0.005, ge=0, le=3.2, description="rad, standard deviation of a press's angle (assumed)"
    )
    placement_tilt: float = Field(
        0.0044,
        ge=0,
        le=0.2,
        description="rad, standard deviation of a press's tilt about either axis (assumed)",
    )
    load_spread: float = Field(
        0.0,
        ge=0,
        le=1,
        description="standard deviation of a press's load as a share of press.force, log-normal with that mean "
        "(assumed exact)",
    )
    test_load: float = Field(
        1.0, ge=1e-3, le=1e3, description="load of the test presses as a share of the training presses'"
    )
    unit: Literal["kPa", "N", "V", "count"] = Field(
        "kPa",
        exclude_if=lambda unit: unit == "kPa",
        description="of the readings, and of all that says kPa in `sensor`: what a real pad's recordings have",
    )
    pad: PadOrFile = Field(
        default_factory=Pad, description="its measures, or the path of a file that holds them"
    )
    press: PressOptions = Field(default_factory=PressOptions)
    sensor: SensorOptions = Field(default_factory=SensorOptions)

    @property
    def cell_lines(self) -> tuple[FloatArray, FloatArray]:
        """Give the edges of the bed's cells along the pad's x and y, mm."""
        return cell_lines(self.pad, self.press.cells_per_taxel, self.sensor.psf_sigma)

    @model_validator(mode="after")
    def _fits_the_pad(self) -> ScanOptions:
        x_lines, y_lines = self.cell_lines
        cells = (len(x_lines) - 1) * (len(y_lines) - 1)
        if cells > _MOST_CELLS:
            raise ValueError(
                f"{self.pad.taxels} taxels make {cells:,} cells of the bed, more than {_MOST_CELLS:,}; choose "
                f"fewer taxels, a smaller press.cells_per_taxel or a larger sensor.psf_sigma"
            )
        self.sensor.check_dead_taxels(self.pad.taxels)
        return self


# Ready-made worlds: what differs from the defaults. In "level" letter and pad stay parallel, as in a textbook. In
# "paper-like" a rigid wrist tilts every press by 0.4 degrees about either axis, which alone lets a particle filter
# level out where the paper's does. "rough" adds other faults that real data may have: poses off by 1.5 mm and 0.1 rad
# and 20 % random classes. In "handheld" no robot presses: loads vary by 30 %, presses are tilted by one degree about
# either axis, and the sensor's response is bent. "resistive" is a home-made pad: a sheet between wires without guards,
# whose conductance rises less than the pressure. "ideal" has no noise, no steps and exact, level poses.
_LEVEL: dict[str, Any] = {"placement_tilt": 0.0, "press": {"wrist_stiffness": None}}
WORLDS: dict[str, dict[str, Any]] = {
    "default": {},
    "level": _LEVEL,
    "paper-like": {"placement_tilt": 0.007, "press": {"wrist_stiffness": None}},
    "rough": {"placement_mm": 1.5, "placement_rad": 0.1, "sensor": {"random_taxels": 0.2}},
    "handheld": {"load_spread": 0.3, "placement_tilt": 0.0175, "sensor": {"response": 2.0}},
    "resistive": {"sensor": {"ghosting": "floating", "response": 0.8}},
    "ideal": {
        **_LEVEL,
        "placement_mm": 0.0,
        "placement_rad": 0.0,
        "sensor": {"noise": 0.0, "resolution": 0.0},
    },
}
