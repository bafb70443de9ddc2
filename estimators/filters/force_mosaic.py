"""The coarse-to-fine filter on the tactile mosaic in the force domain."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from tactsim.estimators.estimator import Options
from tactsim.estimators.filters.refined import RefinedFilter, RefinedOptions


class ForceMosaicOptions(RefinedOptions):
    """Options of the coarse-to-fine filter, with pressures instead of classes unless said otherwise."""

    likelihood: str = Field("force", description="the measurement model: paper, calibrated, force")


class ForceMosaicFilter(RefinedFilter):
    """Coarse-to-fine histogram filter whose measurement model predicts pressures instead of classes."""

    options_type: ClassVar[type[Options]] = ForceMosaicOptions
    options: ForceMosaicOptions
