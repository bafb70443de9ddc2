"""HDF5: every array of a scan, or every column of a run, is a dataset that says its unit and what it is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from io import BytesIO
from math import prod
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tactsim.bench.formats.scan_document import is_of_a_run
from tactsim.bench.results import Run, to_json
from tactsim.core import InputError, Scan
from tactsim.core.documents import LARGE, parse_json
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST

_KIND, _VERSION = "tactsim scan", 1
_OF_A_RUN = "run"  # the dataset that only a run has
_NEEDED = {
    "readings": 2,
    "poses": 2,
    "labels": 1,
    "split": 1,
    "taxel_xy": 2,
    "meta": 0,
}  # axes of each dataset
_SEQUENCE = {"sequence": 3, "sequence_times": 1, "sequence_force": 2}
_OF_PRESSES = {"loads": 1, "presses": 1}
_KINDS = {"labels": "S", "split": "S", "meta": "S", "presses": "i"}  # of what is no float
# HDF5 inflates a whole chunk before it looks how much comes out, at most 1,032 times what went in.
_LARGEST_CHUNK = 2 << 20  # bytes; h5py's own are at most 1 MiB
_FILTERS = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)
_FAULTS = (OSError, RuntimeError, ValueError, KeyError, TypeError)  # h5py words those of HDF5 by these
_MM_MM_RAD = "mm, mm, rad"
_OF_TRIALS = {
    "x": "mm", "y": "mm", "theta": "rad", "true_x": "mm", "true_y": "mm", "true_theta": "rad", "radius_90": "mm",
    "update_s": "s", "estimate_s": "s", "propose_s": "s",
}  # fmt: skip


def write_scan(scan: Scan, stream: IO[bytes]) -> None:
    """Write a scan's arrays, gzipped, each with `unit` and `description`, and `meta` as a text of JSON."""
    unit = scan.about["units"]["readings"]
    arrays: dict[str, tuple[Any, str, str]] = {
        "readings": (scan.readings, unit, "what each taxel says of each press"),
        "poses": (scan.poses, _MM_MM_RAD, "sensor_in_object of each press: x, y, theta"),
        "labels": (scan.labels, "", "the object of each press"),
        "split": (scan.split, "", "what each press is for: train or test"),
        "taxel_xy": (scan.taxel_xy, "mm", "the taxels' centres in the frame of the sensor: x, y"),
        "meta": (np.array(json.dumps(scan.meta)), "", "how the scan was made, JSON"),
    }
    if scan.sequence is not None:
        arrays |= {
            "sequence": (scan.sequence, unit, "the images of each press on its way to rest"),
            "sequence_times": (
                scan.sequence_times,
                "s",
                "when the images were taken, since the object began to move",
            ),
            "sequence_force": (scan.sequence_force, "N", "the contact force at these times"),
        }
    if scan.loads is not None:
        arrays["loads"] = (scan.loads, "N", "the force of each press; NaN where it is not known")
    if scan.presses is not None:
        arrays["presses"] = (scan.presses, "", "the number of the press that each reading was taken of")
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs["kind"], file.attrs["version"] = _KIND, _VERSION
        for name in ("source", "licence"):
            file.attrs[name] = scan.about[name] or "not stated"
        for name, (array, of, description) in arrays.items():
            _add(file, name, array, of, description)
        _label_axes(file)
    stream.write(content.getbuffer())


def write_run(run: Run, stream: IO[bytes]) -> None:
    """Write a run's trials, one dataset a column and one entry a trial and reading, and `run`, JSON."""
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs["kind"], file.attrs["version"] = "tactsim run", _VERSION
        for name, values in run.columns().items():
            _add(file, name, values, _OF_TRIALS.get(name, ""), f"{name} of each trial and reading")
        about = np.array(to_json({"config": run.config, **run.about}))
        _add(file, _OF_A_RUN, about, "", "what was asked and what it was done with, JSON")
    stream.write(content.getbuffer())


def read_scan(path: Path) -> Scan:
    """Read a scan written by `write_scan`. Raises InputError for a file that is not whole, hostile or too large."""
    try:
        with open_regular(path) as stream, h5py.File(stream, "r") as file:
            if _OF_A_RUN in file and "readings" not in file:
                raise is_of_a_run()
            names = dict(_NEEDED)
            names |= _SEQUENCE if any(name in file for name in _SEQUENCE) else {}
            names |= {name: axes for name, axes in _OF_PRESSES.items() if name in file}
            arrays = _arrays(file, names)
    except InputError:
        raise
    except _FAULTS as error:
        raise InputError(f"it is no whole HDF5 file: {' '.join(str(error).split())}") from error
    meta = parse_json(str(arrays.pop("meta")), "its meta")
    return Scan(meta=meta, **arrays)


def _add(file: h5py.File, name: str, array: NDArray[Any], unit: str, description: str) -> None:
    """Store an array; text becomes UTF-8 of a fixed length, which needs no objects when it is read."""
    options: Mapping[str, Any] = {"compression": "gzip", "shuffle": True} if array.ndim else {}
    if array.dtype.kind == "U":
        array = np.char.encode(array, "utf-8")
        kind = h5py.string_dtype("utf-8", max(1, array.dtype.itemsize))
        dataset = file.create_dataset(name, data=array.astype(kind), dtype=kind, **options)
    else:
        dataset = file.create_dataset(name, data=array, **options)
    dataset.attrs["description"] = description
    if unit:
        dataset.attrs["unit"] = unit


def _label_axes(file: h5py.File) -> None:
    """Name the axes; the times of a sequence are the scale of its frames."""
    axes: dict[str, tuple[str, ...]] = {
        "readings": ("press", "taxel"),
        "poses": ("press", "x y theta"),
        "taxel_xy": ("taxel", "x y"),
    }
    if "sequence" in file:
        axes |= {"sequence": ("press", "frame", "taxel"), "sequence_force": ("press", "frame")}
        file["sequence_times"].make_scale("time, s")
        for name in ("sequence", "sequence_force"):
            file[name].dims[1].attach_scale(file["sequence_times"])
    for name, labels in axes.items():
        for axis, label in enumerate(labels):
            file[name].dims[axis].label = label


def _arrays(file: h5py.File, names: Mapping[str, int]) -> dict[str, Any]:
    left, arrays = LARGEST, {}
    for name, axes in names.items():
        link = file.get(name, getlink=True)  # unlike file[name], this opens nothing
        if not isinstance(link, h5py.HardLink):
            raise InputError(
                f"it has no dataset {name}" if link is None else f"its {name} is a link elsewhere"
            )
        dataset = file[name]
        if not isinstance(dataset, h5py.Dataset):
            raise InputError(f"its {name} is no dataset")
        left -= _check(dataset, name, axes, left)
        array = dataset[()]
        arrays[name] = _texts(array, name) if dataset.dtype.kind == "S" else array
    return arrays


def _check(dataset: h5py.Dataset, name: str, axes: int, left: int) -> int:
    """Say how many bytes a dataset takes. Raises InputError for what could hold or ask for more than it says."""
    kind = _KINDS.get(name, "f")
    if dataset.dtype.kind != kind or len(dataset.shape or ()) != axes or dataset.shape is None:
        raise InputError(f"its {name} holds {dataset.dtype} along {len(dataset.shape or ())} axes")
    size = prod(dataset.shape) * dataset.dtype.itemsize
    # Text takes four bytes a character in memory.
    size *= 4 if kind == "S" else 1
    if size > (left if name != "meta" else min(left, 4 * LARGE)):
        raise InputError(f"its {name} claims {size:,} bytes; {left:,} are left of {LARGEST:,}")
    if dataset.is_virtual or dataset.external:
        raise InputError(f"its {name} lies in another file")
    if dataset.chunks is not None:
        if prod(dataset.chunks) * dataset.dtype.itemsize > _LARGEST_CHUNK:
            raise InputError(
                f"its {name} has chunks of more than {_LARGEST_CHUNK:,} bytes; repack it in smaller ones"
            )
        _check_chunks(dataset, name)
    return int(size)


def _check_chunks(dataset: h5py.Dataset, name: str) -> None:
    """Raise InputError for a filter that HDF5 would load from elsewhere, and a chunk longer than what it is made of."""
    made = dataset.id.get_create_plist()
    filters = [made.get_filter(number)[0] for number in range(made.get_nfilters())]
    if not set(filters) <= set(_FILTERS) or len(set(filters)) < len(filters):
        raise InputError(f"its {name} is compressed otherwise than by gzip, once")
    most = 2 * prod(dataset.chunks) * dataset.dtype.itemsize + 1024
    sizes: list[int] = []
    dataset.id.chunk_iter(lambda chunk: sizes.append(chunk.size))
    if max(sizes, default=0) > most:
        raise InputError(
            f"its {name} has a chunk of {max(sizes):,} bytes that is said to hold {most:,} at most"
        )


def _texts(array: Any, name: str) -> NDArray[np.str_]:
    try:
        return np.char.decode(np.asarray(array), "utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"its {name} is no UTF-8: {error}") from error
