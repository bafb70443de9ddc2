"""Which wrappers a built-in filter comes in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactsim.estimators.estimator import Estimator
from tactsim.estimators.filters.active_touch import ActiveTouch
from tactsim.estimators.filters.fitted_to_pad import FittedToPad
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.motion import parse_motion
from tactsim.estimators.filters.moving import Moving
from tactsim.estimators.options import FilterOptions, OpenSetOptions

if TYPE_CHECKING:
    from tactsim.estimators.filters.synthesis import Synthesis


def wrapped(kind: type[MapFilter], options: FilterOptions) -> FittedToPad:
    """Make a filter of a kind that is fitted to the pad, proposes readings, and can say "none of these"."""
    return FittedToPad(kind, options, surrounded)


def surrounded(filter: MapFilter) -> ActiveTouch:
    """Let a filter propose readings, and say "none of these" if its options give that a probability."""
    options = filter.options
    inner: MapFilter | Moving = filter
    motion = parse_motion(options.motion)
    if motion is not None and not filter.moves:
        inner = Moving(filter, motion)
    if isinstance(options, OpenSetOptions) and options.unknown:
        from tactsim.estimators.filters.open_set import OpenSet  # needs SciPy, as no other filter does

        return ActiveTouch(OpenSet(inner, options.unknown))
    return ActiveTouch(inner)


def wrapped_synthesis(filter: Synthesis) -> Estimator:
    """Let `synthesis` follow an object that moves, if its options say so."""
    from tactsim.estimators.filters.moving_synthesis import (
        MovingSynthesis,
    )  # only it needs the presses' kernels

    motion = parse_motion(filter.options.motion)
    return filter if motion is None else MovingSynthesis(filter, motion)  # type: ignore[arg-type]
