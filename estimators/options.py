"""The options that estimators share. Descriptions carry the paper's symbols and the units."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal, cast

from pydantic import Field, create_model, model_validator

from tactsim.core import Scan
from tactsim.core.pad import OFFSET, offsets
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Options

Reach = Annotated[float, Field(gt=0, le=10_000)] | Literal["auto"]
MODELS = "the measurement model; `bench list likelihoods` names them, and a model's own options"
MOTION = (
    "how the object moves between touches: off, auto (learned), seen (auto from the touch on at which readings "
    "disagree with an object at rest) or MM,RAD of a random walk"
)
REACH = "T_R^O has x and y in [-reach, reach], mm; auto: 10 for the paper's pad, as much more as another is larger"


class MapOptions(Options):
    """How occupancy maps are learned (paper, eq. 3 to 6)."""

    sigma: float = Field(1.0, ge=0.1, le=10, description="sigma of eq. 4: the sensor's point spread, mm")
    peak: float = Field(0.9, gt=0, lt=1, description="G' of eq. 4 at a taxel's own centre")
    # Nearer to 0 or 1, a prior would give weight to the last 1e-14 of a point spread, which maps cut off.
    prior: float = Field(0.2, ge=1e-6, le=1 - 1e-6, description="p(m): the share of a map that is occupied")
    threshold: Annotated[float, Field(ge=-1e9, le=1e9)] | Literal["auto"] = Field(
        2.0, description="T of eq. 3, kPa; auto: 1/18 of the training readings' median scale"
    )
    ratio: float = Field(0.3, ge=0, le=1, description="the 0.3 of eq. 3: share of the largest taxel")
    cell: float = Field(0.4, ge=0.05, le=5, description="side of a map cell, mm; at least sigma / 25")

    @model_validator(mode="after")
    def _cells_are_not_needlessly_fine(self) -> MapOptions:
        if self.sigma > 25 * self.cell:  # 40,000 cells and more for every taxel of every reading
            raise ValueError(
                f"cell {self.cell} mm is below sigma / 25 = {self.sigma / 25:g} mm; choose larger cells"
            )
        return self


class LikelihoodOptions(MapOptions):
    """How maps are learned, and which measurement model looks them up."""

    likelihood: str = Field("paper", description=MODELS)


class FilterOptions(LikelihoodOptions):
    """What every filter over (letter, T_R^O) takes."""

    motion: str = Field("off", description=MOTION)
    reach: Reach = Field("auto", description=REACH)
    fit: Literal["auto", "off"] | None = Field(
        None,
        description="auto: unit, lengths, response and what is not given follow from the training readings; not given: "
        "auto for recorded and imported scans, else off",
    )


class OpenSetOptions(FilterOptions):
    """What a filter takes that can say "none of these"."""

    unknown: float = Field(
        0.0, ge=0, lt=1, description="prior probability that the object is none of the known letters"
    )


def reach_of(reach: float | Literal["auto"], taxel_xy: FloatArray | None = None) -> float:
    """Resolve an option `reach`, mm, for a pad with taxels at (taxels, 2) mm, or before a pad is known."""
    if reach != "auto":
        return reach
    return OFFSET if taxel_xy is None else offsets(taxel_xy)


def wants_pad_fit(options: FilterOptions, scan: Scan) -> bool:
    """Tell whether options ask to be fitted to a scan's pad: if they do not say, those of a real pad are."""
    if options.fit is not None:
        return options.fit == "auto"
    stated = (scan.meta, scan.meta.get("train"))
    return any(
        isinstance(meta, Mapping) and meta.get("source") in ("recorded", "imported") for meta in stated
    )


@cache
def joined(own: type[LikelihoodOptions], model: type[MapOptions]) -> type[LikelihoodOptions]:
    """Make the options of a filter with a measurement model: its own, and the model's."""
    bases = cast("tuple[type[LikelihoodOptions], ...]", (own, model))
    made = cast("type[LikelihoodOptions]", create_model(own.__name__, __base__=bases, __doc__=own.__doc__))

    def reduced(
        options: LikelihoodOptions,
    ) -> tuple[Any, ...]:  # a class that is made is not found by its name
        return _rejoined, (own, model, options.model_fields_set, dict(options))

    made.__reduce__ = reduced  # type: ignore[method-assign, assignment]
    return made


def _rejoined(
    own: type[LikelihoodOptions], model: type[MapOptions], given: set[str], values: dict[str, Any]
) -> LikelihoodOptions:
    return joined(own, model).model_construct(given, **values)
