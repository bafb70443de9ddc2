"""Which wrappers a built-in filter comes in."""

from __future__ import annotations

from tactsim.estimators.filters.active_touch import ActiveTouch
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.options import OpenSetOptions


def wrapped(filter: MapFilter) -> ActiveTouch:
    """Let a filter propose readings, and say "none of these" if its options give that a probability."""
    options = filter.options
    if isinstance(options, OpenSetOptions) and options.unknown:
        from tactsim.estimators.filters.open_set import OpenSet  # needs SciPy, as no other filter does

        return ActiveTouch(OpenSet(filter, options.unknown))
    return ActiveTouch(filter)
