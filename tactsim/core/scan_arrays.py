"""The arrays of scans: what they must be, how those of two scans become one, their digest and their file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError, short
from tactsim.core.files import replacing
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.core.scan import Scan


def as_numbers(name: str, values: Any, axes: int, kind: Any = float) -> NDArray[Any]:
    """Return finite numbers along so many axes, read only. Raises InputError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.ndim != axes:
        what = "a table of numbers" if axes == 2 else f"numbers along {axes} axes"
        raise InputError(f"scan: {name} must be {what}, got {array.dtype} {array.shape}")
    array = finite(array, f"scan: {name}").astype(kind)
    array.setflags(write=False)
    return array


def as_names(name: str, values: Any) -> NDArray[np.str_]:
    """Return texts, read only. Raises InputError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind != "U" and array.size:
        raise InputError(f"scan: {name} must be names, got {array.dtype}")
    array = array.astype(np.str_)
    try:
        longest = max(map(len, array.ravel().tolist()), default=0)
    except (ValueError, SystemError) as error:  # a code beyond Unicode
        raise InputError(f"scan: {name} are no text: {error}") from None
    array = array.astype(f"U{max(longest, 1)}")  # so that equal scans are alike, bit for bit
    array.setflags(write=False)
    return array


def as_loads(values: Any, count: int) -> FloatArray:
    """Return the loads of `count` presses, N, read only; NaN stands for one that is not known.

    Raises InputError for a load below 0, and for what are no `count` numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.shape != (count,):
        raise InputError(
            f"scan: loads must be {count:,} numbers, one a press, got {array.dtype} {array.shape}"
        )
    array = array.astype(float)
    known = ~np.isnan(array)
    if (finite(array[known], "scan: loads") < 0).any():
        raise InputError(
            f"scan: a load is {short(float(array[known].min()))} N; a press is made with 0 or more"
        )
    array.setflags(write=False)
    return array


def as_presses(values: Any, count: int) -> NDArray[np.int64]:
    """Return the presses of `count` readings, whole numbers from 0 on, read only. Raises InputError for others."""
    array = np.asarray(values)
    if array.dtype.kind not in "iu" or array.shape != (count,) or (array.astype(np.int64) < 0).any():
        raise InputError(
            f"scan: presses must be {count:,} whole numbers from 0 on, one a reading, got {array.dtype} {array.shape}"
        )
    array = array.astype(np.int64)
    array.setflags(write=False)
    return array


def joined_sequences(first: Scan, second: Scan) -> dict[str, Any]:
    """Append the sequences of two scans, the shorter ones held at their last image; nothing if times differ."""
    times, more = first.sequence_times, second.sequence_times
    if times is None or more is None:
        return {}
    if len(more) > len(times):
        times, more = more, times
    if not np.array_equal(times[: len(more)], more):
        return {}
    joined: dict[str, Any] = {"sequence_times": times}
    for name in ("sequence", "sequence_force"):
        longer = []
        for array in (getattr(first, name), getattr(second, name)):
            rest = [(0, 0)] * array.ndim
            rest[1] = (0, len(times) - array.shape[1])
            longer.append(np.pad(array, rest, mode="edge"))
        joined[name] = np.concatenate(longer)
    return joined


def joined_loads(first: Scan, second: Scan) -> FloatArray | None:
    """Append the loads of two scans; those of a scan that says none are not known. None if neither says any."""
    if first.loads is None and second.loads is None:
        return None
    return np.concatenate(
        [np.full(len(scan), np.nan) if scan.loads is None else scan.loads for scan in (first, second)]
    )


def joined_presses(first: Scan, second: Scan) -> NDArray[np.int64] | None:
    """Append the presses of two scans, counted on; None if each reading of both is of a press of its own."""
    if first.presses is None and second.presses is None:
        return None
    before, after = (
        np.arange(len(scan)) if scan.presses is None else scan.presses for scan in (first, second)
    )
    return np.concatenate([before, after + before.max(initial=-1) + 1])


def digest_of(meta: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> str:
    """Name arrays and what is said of them by their content: equal ones have equal digests (SHA-256, hex)."""
    content = sha256(json.dumps(meta, sort_keys=True).encode())
    for name, given in arrays.items():
        array = np.ascontiguousarray(given)
        content.update(f"{name} {array.dtype.str} {array.shape}".encode())
        content.update(array.tobytes())
    return content.hexdigest()


def write_arrays(path: str | Path, meta: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays and `meta`, a JSON string, as .npz: whole or not at all, and equal ones as equal bytes.

    Raises InputError if `path` cannot be written.
    """
    content = BytesIO()
    stated = np.array(json.dumps(meta, sort_keys=True))
    # np.savez writes no dates and keeps the members' order, so the bytes depend on the content alone.
    np.savez_compressed(content, allow_pickle=False, **arrays, meta=stated)
    with replacing(path) as stream:
        stream.write(content.getbuffer())
