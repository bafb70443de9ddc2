"""The options that estimators share. Descriptions carry the paper's symbols and the units."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from estimators.base import Options


class MapOptions(Options):
    """How occupancy maps are learned (paper, eq. 3 to 6)."""

    sigma: float = Field(1.0, ge=0.1, le=10, description="sigma of eq. 4: the sensor's point spread, mm")
    peak: float = Field(0.9, gt=0, lt=1, description="G' of eq. 4 at an element's own centre")
    prior: float = Field(0.2, gt=0, lt=1, description="p(m): the share of a map that is occupied")
    threshold: float = Field(2.0, description="T of eq. 3, kPa")
    ratio: float = Field(0.3, ge=0, le=1, description="the 0.3 of eq. 3: share of the largest element")
    cell: float = Field(0.4, ge=0.05, le=5, description="side of a map cell, mm")


class LikelihoodOptions(MapOptions):
    """Which measurement model, and its parameters (paper, eq. 7)."""

    likelihood: str = Field("paper", description="the measurement model: paper")
    gamma: float = Field(0.1, gt=0, lt=1, description="gamma of eq. 7: how often the classifier fails")
    failure: Literal["printed", "complement"] = Field(
        "printed", description="No Contact after a failure in eq. 7: p(m) as printed, or 1 - p(m)"
    )


class FilterOptions(LikelihoodOptions):
    """What every filter over (letter, T_R^O) takes."""

    reach: float = Field(10.0, gt=0, le=1000, description="T_R^O has x and y in [-reach, reach], mm")
