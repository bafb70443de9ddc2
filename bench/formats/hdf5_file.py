"""HDF5: every array of a scan, or every column of a run, is a dataset that says its unit and what it is."""

from __future__ import annotations

import json
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
from tactsim.core.documents import parse_json
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST

_OF_A_RUN = "run"  # the dataset that only a run has
_READINGS = "unit of the readings"
# {dataset: (kind, axes, unit, description)}; the first six are in every scan.
_DATASETS = {
    "readings": ("f", ("press", "taxel"), _READINGS, "what each taxel says of each press"),
    "poses": ("f", ("press", "x y theta"), "mm, mm, rad", "sensor_in_object of each press: x, y, theta"),
    "labels": ("S", ("press",), "", "the object of each press"),
    "split": ("S", ("press",), "", "what each press is for: train or test"),
    "taxel_xy": ("f", ("taxel", "x y"), "mm", "the taxels' centres in the frame of the sensor: x, y"),
    "meta": ("S", (), "", "how the scan was made, JSON"),
    "sequence": ("f", ("press", "frame", "taxel"), _READINGS, "the images of each press on its way to rest"),
    "sequence_times": ("f", ("frame",), "s", "when the images were taken, since the object began to move"),
    "sequence_force": ("f", ("press", "frame"), "N", "the contact force at these times"),
    "loads": ("f", ("press",), "N", "the force of each press; NaN where it is not known"),
    "presses": ("i", ("press",), "", "the number of the press that each reading was taken of"),
    "moments": ("f", ("press",), "", "the share of its press's load at which each reading was taken"),
    "views": ("i", ("press",), "", "which of its object's pictures each reading belongs to"),
}
_OF_TRIALS = dict.fromkeys(("x", "y", "true_x", "true_y", "radius_90"), "mm")
_OF_TRIALS |= {"theta": "rad", "true_theta": "rad", "update_s": "s", "estimate_s": "s", "propose_s": "s"}


def write_scan(scan: Scan, stream: IO[bytes]) -> None:
    """Write a scan's arrays, gzipped, each with `unit` and `description`, and `meta` as a text of JSON."""
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs.update({"kind": "tactsim scan", "version": 1})
        file.attrs.update({name: scan.about[name] or "not stated" for name in ("source", "licence")})
        for name, (_, axes, unit, description) in _DATASETS.items():
            array = np.array(json.dumps(scan.meta)) if name == "meta" else getattr(scan, name)
            if array is None:
                continue
            unit = scan.about["units"]["readings"] if unit == _READINGS else unit
            dataset = _add(file, name, array, unit, description)
            for number, axis in enumerate(axes):
                dataset.dims[number].label = axis
        if scan.sequence is not None:
            file["sequence_times"].make_scale("time, s")
            file["sequence"].dims[1].attach_scale(file["sequence_times"])
            file["sequence_force"].dims[1].attach_scale(file["sequence_times"])
    stream.write(content.getbuffer())


def write_run(run: Run, stream: IO[bytes]) -> None:
    """Write a run's trials, one dataset a column and one entry a trial and reading, and `run`, JSON."""
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs.update({"kind": "tactsim run", "version": 1})
        for name, values in run.columns().items():
            _add(file, name, values, _OF_TRIALS.get(name, ""), f"{name} of each trial and reading")
        about = np.array(to_json({"config": run.config, **run.about}))
        _add(file, _OF_A_RUN, about, "", "what was asked and what it was done with, JSON")
    stream.write(content.getbuffer())


def read_scan(path: Path) -> Scan:
    """Read a scan written by `write_scan`. Raises InputError for a file that is not whole or too large."""
    try:
        with open_regular(path) as stream, h5py.File(stream, "r") as file:
            if _OF_A_RUN in file and "readings" not in file:
                raise is_of_a_run()
            arrays, left = {}, LARGEST
            for name in _DATASETS:
                if name in list(_DATASETS)[:6] or file.get(name, getlink=True) is not None:
                    arrays[name], left = _read(file, name, left)
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:  # as h5py words HDF5's faults
        raise InputError(f"it is no whole HDF5 file: {' '.join(str(error).split())}") from error
    return Scan(meta=parse_json(str(arrays.pop("meta")), "its meta"), **arrays)


def _add(file: h5py.File, name: str, array: NDArray[Any], unit: str, description: str) -> h5py.Dataset:
    """Store an array; text becomes UTF-8 of a fixed length, which needs no objects when it is read."""
    options: dict[str, Any] = {"compression": "gzip", "shuffle": True} if array.ndim else {}
    if array.dtype.kind == "U":
        array = np.char.encode(array, "utf-8")
        array = array.astype(h5py.string_dtype("utf-8", max(1, array.dtype.itemsize)))
    dataset = file.create_dataset(name, data=array, dtype=array.dtype, **options)
    dataset.attrs.update({"description": description, **({"unit": unit} if unit else {})})
    return dataset


def _read(file: h5py.File, name: str, left: int) -> tuple[NDArray[Any], int]:
    """Read a dataset that lies in this file and takes at most `left` bytes; also says how many are left then."""
    # A link is asked for first: file[name] would open what it points to.
    if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(
        file[name], h5py.Dataset
    ):
        raise InputError(f"it has no dataset {name} of its own; save arrays of yours as .npz or .mat")
    dataset, (kind, axes, *_) = file[name], _DATASETS[name]
    if dataset.dtype.kind != kind or dataset.shape is None or len(dataset.shape) != len(axes):
        raise InputError(f"its {name} holds {dataset.dtype} along {len(dataset.shape or ())} axes")
    # HDF5 unpacks whole chunks; text takes four bytes a character in memory.
    numbers = max(prod(dataset.shape), prod(dataset.chunks or (0,)))
    size = numbers * dataset.dtype.itemsize * (4 if kind == "S" else 1)
    if size > left:
        raise InputError(f"its {name} claims {size:,} bytes; {left:,} are left of {LARGEST:,}")
    if dataset.is_virtual or dataset.external:
        raise InputError(f"its {name} lies in another file")
    return np.char.decode(dataset[()], "utf-8") if kind == "S" else dataset[()], left - size
