"""HDF5: every array of a scan, or every column of a run, is a dataset that says its unit and what it is."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from math import prod
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tactsim.bench.columns import column
from tactsim.bench.formats import is_of_a_run
from tactsim.bench.results import Run, to_json
from tactsim.core import InputError, Scan
from tactsim.core.documents import parse_json
from tactsim.core.errors import short
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST, MissingArrayError

_OF_A_RUN = "run"  # the dataset that only a run has
_READINGS = "unit of the readings"
_STATED = ("scale_factor", "add_offset", "_FillValue", "missing_value")  # attributes of netCDF
# {dataset: (axes, unit, description)}; the first six are in every scan.
_DATASETS = {
    "readings": (("press", "taxel"), _READINGS, "what each taxel says of each press"),
    "poses": (("press", "x y theta"), "mm, mm, rad", "sensor_in_object of each press: x, y, theta"),
    "labels": (("press",), "", "the object of each press"),
    "split": (("press",), "", "what each press is for: train or test"),
    "taxel_xy": (("taxel", "x y"), "mm", "the taxels' centres in the frame of the sensor: x, y"),
    "meta": ((), "", "how the scan was made, JSON"),
    "sequence": (("press", "frame", "taxel"), _READINGS, "the images of each press on its way to rest"),
    "sequence_times": (("frame",), "s", "when the images were taken, since the object began to move"),
    "sequence_force": (("press", "frame"), "N", "the contact force at these times"),
    "loads": (("press",), "N", "the force of each press; NaN where it is not known"),
    "presses": (("press",), "", "the number of the press that each reading was taken of"),
    "moments": (("press",), "", "the share of its press's load at which each reading was taken"),
    "views": (("press",), "", "which of its object's pictures each reading belongs to"),
}


def write_scan(scan: Scan, stream: IO[bytes]) -> None:
    """Write a scan's arrays, gzipped, each with `unit` and `description`, and `meta` as a text of JSON."""
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs.update({"kind": "tactsim scan", "version": 1})
        file.attrs.update({name: scan.about[name] or "not stated" for name in ("source", "licence")})
        for name, (axes, unit, description) in _DATASETS.items():
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
            of = column(name)
            _add(file, name, values, of.unit, of.what)
        about = np.array(to_json({"config": run.config, **run.about}))
        _add(file, _OF_A_RUN, about, "", "what was asked and what it was done with, JSON")
    stream.write(content.getbuffer())


def is_foreign(path: Path) -> bool:
    """Tell whether a file is a whole one of HDF5, and of somebody else."""
    try:
        with _opened(path) as file:
            return not str(file.attrs.get("kind", "")).startswith("tactsim")
    except InputError:
        return False


def says_matlab(path: Path) -> bool:
    """Tell whether a dataset of a file says that MATLAB wrote it (-v7.3): then `read_named` turns its dimensions."""
    with _opened(path) as file:
        return file.visititems(lambda _, item: "MATLAB_class" in item.attrs or None) is not None


def read_named(path: Path, names: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
    """Read datasets of somebody else's file: numbers or texts, whatever group they are in, as `group/name`.

    names: None for all arrays of numbers that lie in no group. Those that MATLAB wrote (-v7.3) have their dimensions
    turned round there, and come as it has them; a cell of texts comes as an array of them.
    Raises InputError if the file is not whole, too large, or lacks one, which is a MissingArrayError.
    """
    with _opened(path) as file:
        if names is None:
            names = [
                name for name, item in file.items() if getattr(item, "dtype", np.dtype("O")).kind in "biuf"
            ]
        of_cells = [
            name for name in names if getattr(file.get(name), "attrs", {}).get("MATLAB_class") == b"cell"
        ]
        arrays = _read(file, [name for name in names if name not in of_cells])
        for name in of_cells:
            texts = [file[reference] for reference in file[name][()].ravel()]
            if not all(text.attrs.get("MATLAB_class") == b"char" and text.size < 1000 for text in texts):
                raise InputError(f"array {name!r} is a cell of more than texts")
            arrays[name] = np.array(["".join(map(chr, text[()].ravel())) for text in texts])
        for name, array in arrays.items():
            kind = None if name in of_cells else file[name].attrs.get("MATLAB_class")
            if kind is not None:
                of_text = kind == b"char" and array.ndim == 2
                arrays[name] = np.array(["".join(map(chr, row)) for row in array.T]) if of_text else array.T
        return arrays


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open a file; what h5py says of its faults becomes an InputError."""
    try:
        with open_regular(path) as stream, h5py.File(stream, "r") as file:
            yield file
    except InputError:
        raise
    except UnicodeDecodeError as error:
        raise InputError(f"its names are not text in UTF-8: {error}") from error
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:  # as h5py words HDF5's faults
        raise InputError(f"it is no whole HDF5 file: {' '.join(str(error).split())}") from error


def read_scan(path: Path) -> Scan:
    """Read a scan written by `write_scan`. Raises InputError for a file that is not whole or too large."""
    with _opened(path) as file:
        if _OF_A_RUN in file and "readings" not in file:
            raise is_of_a_run()
        always, there = list(_DATASETS)[:6], lambda name: file.get(name, getlink=True) is not None
        names = [name for name in _DATASETS if name in always or there(name)]
        try:
            arrays = _read(file, names)
        except MissingArrayError as error:
            raise InputError(f"it has no dataset {error.name} of its own") from error
    return Scan(meta=parse_json(str(arrays.pop("meta")), "its meta"), **arrays)


def _read(file: h5py.File, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Read datasets that lie in an open file, as `read_named` does."""
    arrays, left, there = dict[str, NDArray[Any]](), LARGEST, dict[str, h5py.Dataset]()
    file.visititems(lambda name, item: there.update({name: item} if isinstance(item, h5py.Dataset) else {}))
    for name in names:
        if name.strip("/") not in there:
            raise MissingArrayError(name, {one: dataset.shape for one, dataset in there.items()})
        dataset = there[name.strip("/")]
        # HDF5 unpacks whole chunks; text takes four bytes a character in memory.
        numbers = max(prod(dataset.shape or ()), prod(dataset.chunks or (0,)))
        size = numbers * dataset.dtype.itemsize * (4 if dataset.dtype.kind == "S" else 1)
        left -= size
        if left < 0:
            raise InputError(f"its {name} claims {size:,} bytes; {left + size:,} are left of {LARGEST:,}")
        if dataset.is_virtual or dataset.external:
            raise InputError(f"its {name} lies in another file")
        said = str(dataset.attrs.get("units", dataset.attrs.get("unit", "")))
        if {"m", "cm", "deg", "degree", "degrees"} & {*said.lower().replace(",", " ").split()}:
            raise InputError(f"its {name} says that its unit is {short(said)}; give poses in mm, mm, rad")
        text = h5py.check_string_dtype(dataset.dtype) is not None
        if not text and dataset.dtype.kind not in "biufS":
            raise InputError(f"its {name} holds {dataset.dtype}, no numbers or names")
        of_bytes = dataset.dtype.kind == "S"
        content = dataset.asstr("utf-8")[()] if text and not of_bytes else dataset[()]
        arrays[name] = (
            np.char.decode(content, "utf-8") if of_bytes else _as_stated(np.array(content), dataset)
        )
    return arrays


def _as_stated(array: NDArray[Any], dataset: h5py.Dataset) -> NDArray[Any]:
    """Read numbers as HDF5 and netCDF state them: names for numbers, a scale and an offset, a number for none."""
    names = h5py.check_enum_dtype(dataset.dtype)
    if names and array.dtype.kind != "b":
        named = {number: name for name, number in names.items()}
        return np.array([named[number] for number in array.ravel().tolist()]).reshape(array.shape)
    stated = {name: np.ravel(dataset.attrs[name])[0] for name in _STATED if name in dataset.attrs}
    if not stated or array.dtype.kind not in "iuf":
        return array
    none = np.isin(array, [stated[name] for name in _STATED[2:] if name in stated])
    numbers = array * stated.get("scale_factor", 1) + stated.get("add_offset", 0)
    return np.where(none, np.nan, numbers) if none.any() else np.asarray(numbers)


def _add(file: h5py.File, name: str, array: NDArray[Any], unit: str, description: str) -> h5py.Dataset:
    """Store an array; text becomes UTF-8 of a fixed length, which needs no objects when it is read."""
    options: dict[str, Any] = {"compression": "gzip", "shuffle": True} if array.ndim else {}
    if array.dtype.kind == "U":
        array = np.char.encode(array, "utf-8")
        array = array.astype(h5py.string_dtype("utf-8", max(1, array.dtype.itemsize)))
    dataset = file.create_dataset(name, data=array, dtype=array.dtype, **options)
    dataset.attrs.update({"description": description, **({"unit": unit} if unit else {})})
    return dataset
