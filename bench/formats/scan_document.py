"""What a format without room for it keeps beside the readings, as a JSON object: taxels, times, presses, `meta`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.core.poses import FloatArray

_VERSION = 1


def document_of(scan: Scan) -> dict[str, Any]:
    """Put all but the presses of a scan into a JSON object; `about` is for readers only."""
    return {
        "tactsim_scan": _VERSION,
        "taxel_xy": scan.taxel_xy.tolist(),
        "sequence_times": None if scan.sequence_times is None else scan.sequence_times.tolist(),
        **({} if scan.loads is None else {"loads": _said(scan.loads)}),
        **({} if scan.presses is None else {"presses": scan.presses.tolist()}),
        "meta": dict(scan.meta),
        "about": scan.about,
    }


def parts_of(document: dict[str, Any]) -> tuple[FloatArray, FloatArray | None, dict[str, Any]]:
    """Read the object back: (taxels, 2) mm, (frames,) s or None, `meta`. Raises InputError if it makes no sense."""
    version = document.get("tactsim_scan")
    if version != _VERSION:
        raise InputError(f"it is of version {short(version)} of tactsim's scans; this reads {_VERSION}")
    meta, times = document.get("meta"), document.get("sequence_times")
    if not isinstance(meta, dict):
        raise InputError("its meta is no JSON object")
    taxel_xy = _numbers(document.get("taxel_xy"), "taxel_xy", 2)
    return taxel_xy, None if times is None else _numbers(times, "sequence_times", 1), meta


def is_of_a_run() -> InputError:
    """Build the error for an export of a run where one of a scan is wanted."""
    return InputError(
        "it holds the trials of a run, which keeps its estimates, not its readings; give an export of a scan"
    )


def loads_of(document: dict[str, Any]) -> FloatArray | None:
    """Read the loads of the presses, N, NaN where null stands; None if it has none. Raises InputError as above."""
    loads = document.get("loads")
    if loads is None:
        return None
    if not isinstance(loads, list):
        raise InputError("its loads are no list")
    known = [np.nan if load is None else load for load in loads]
    return _numbers(known, "loads", 1) if known else np.zeros(0)


def presses_of(document: dict[str, Any]) -> NDArray[Any] | None:
    """Read the numbers of the presses that readings were taken of; None if it has none. Raises InputError as above."""
    presses = document.get("presses")
    if presses is None:
        return None
    if not isinstance(presses, list) or not all(type(one) is int and abs(one) < 2**62 for one in presses):
        raise InputError("its presses are no list of whole numbers")
    return np.array(presses, dtype=np.int64)


def _said(loads: FloatArray) -> list[float | None]:
    """List loads with null for one that is not known: JSON has no NaN."""
    return [None if np.isnan(load) else load for load in loads.tolist()]


def _numbers(values: Any, name: str, axes: int) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(())
    if array.ndim != axes or (axes == 2 and array.shape[1] != 2) or not array.size:
        raise InputError(f"its {name} are no numbers along {axes} axes")
    return array
