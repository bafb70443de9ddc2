"""What Parquet has no room for and a scan keeps beside it, as JSON: taxels, times, `meta`, what is known of presses."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactsim.core import InputError, Scan
from tactsim.core.errors import short

_VERSION = 1
_AXES = {"taxel_xy": 2, "sequence_times": 1, "loads": 1, "presses": 1, "moments": 1, "views": 1}


def document_of(scan: Scan) -> dict[str, Any]:
    """Put all but the presses of a scan into a JSON object; `about` is for readers only."""
    document: dict[str, Any] = {"tactsim_scan": _VERSION, "meta": dict(scan.meta), "about": scan.about}
    for name in _AXES:
        array = getattr(scan, name)
        if array is not None:  # JSON has no NaN: null stands for a load that is not known
            document[name] = [None if np.isnan(one).any() else one.tolist() for one in array]
    return document


def parts_of(document: dict[str, Any]) -> dict[str, Any]:
    """Read the object back, as words for `Scan`. Raises InputError if it makes no sense."""
    version = document.get("tactsim_scan")
    if version != _VERSION:
        raise InputError(f"it is of version {short(version)} of tactsim's scans; this reads {_VERSION}")
    if not isinstance(document.get("meta"), dict):
        raise InputError("its meta is no JSON object")
    parts: dict[str, Any] = {"meta": document["meta"]}
    for name, axes in _AXES.items():
        values = document.get(name)
        try:
            array = (
                None
                if values is None
                else np.array(values, dtype=None if name in ("presses", "views") else float)
            )
        except (TypeError, ValueError, OverflowError):
            array = np.zeros(())
        if (array is None and name == "taxel_xy") or (array is not None and array.ndim != axes):
            raise InputError(f"its {name} are no numbers along {axes} axes")
        parts[name] = array
    return parts


def is_of_a_run() -> InputError:
    """Build the error for an export of a run where one of a scan is wanted."""
    return InputError(
        "it holds the trials of a run, which keeps its estimates, not its readings; give an export of a scan"
    )
