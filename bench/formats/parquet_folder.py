"""Parquet in the layout of Hugging Face: one file for each split, a data card, and what else a scan holds as JSON."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from tactsim.bench.formats.data_card import card_of_run, card_of_scan
from tactsim.bench.formats.scan_document import document_of, is_of_a_run, parts_of
from tactsim.bench.results import Run, to_json
from tactsim.core import InputError, Scan
from tactsim.core.documents import read_json
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST
from tactsim.core.scan import SPLITS, is_label

_DOCUMENT, _OF_A_RUN = "scan.json", "run.json"
_ROW_GROUP = 64 << 20  # bytes: what a reader of one row has to read
Shapes = dict[str, tuple[tuple[int, ...], str]]  # of a row of each column, and its type


def write_scan(scan: Scan, folder: Path) -> None:
    """Write data/SPLIT-00000-of-00001.parquet for each split that has readings, scan.json and README.md."""
    arrays: dict[str, NDArray[Any]] = {"pose": scan.poses, "readings": scan.readings}
    if scan.sequence is not None and scan.sequence_force is not None:
        arrays |= {"sequence": scan.sequence, "sequence_force": scan.sequence_force}
    for split in SPLITS:
        rows = np.flatnonzero(scan.split == split)
        labels = pa.array(scan.labels[rows].tolist(), pa.string())
        columns = {"row": _lists(rows.astype(np.int64)), "label": labels}
        columns |= {name: _lists(array[rows]) for name, array in arrays.items()}
        if len(rows):  # the library `datasets` loads no file without rows
            _write(pa.table(columns), _file(folder, split))
    (folder / _DOCUMENT).write_text(to_json(document_of(scan)), encoding="utf-8")
    (folder / "README.md").write_text(card_of_scan(scan), encoding="utf-8")


def write_run(run: Run, folder: Path) -> None:
    """Write the trials, one row a trial and reading, as data/test-00000-of-00001.parquet, run.json and README.md."""
    columns = {name: pa.array(values.tolist()) for name, values in run.columns().items()}
    _write(pa.table(columns), _file(folder, "test"))
    (folder / _OF_A_RUN).write_text(to_json({"config": run.config, **run.about}), encoding="utf-8")
    (folder / "README.md").write_text(card_of_run(run), encoding="utf-8")


def read_scan(folder: Path) -> Scan:
    """Read a scan written by `write_scan`, its readings in their first order. Raises InputError if it is not whole."""
    if (folder / _OF_A_RUN).exists() and not (folder / _DOCUMENT).exists():
        raise is_of_a_run()
    told = parts_of(read_json(folder / _DOCUMENT, "the scan's"))
    taxels, times = len(told["taxel_xy"]), told["sequence_times"]
    shapes: Shapes = {"row": ((), "int64"), "pose": ((3,), "float64"), "readings": ((taxels,), "float64")}
    if times is not None:
        frames = len(times)
        shapes |= {"sequence": ((frames, taxels), "float32"), "sequence_force": ((frames,), "float32")}
    parts = {split: _read(_file(folder, split), shapes) for split in SPLITS if _file(folder, split).exists()}
    if not parts:
        raise InputError("it has no data/train-00000-of-00001.parquet and none of the test split")
    whole = {name: np.concatenate([part[name] for part in parts.values()]) for name in (*shapes, "label")}
    whole["split"] = np.repeat(list(parts), [len(part["row"]) for part in parts.values()])
    order = np.argsort(whole["row"], kind="stable")
    if not np.array_equal(whole.pop("row")[order], np.arange(len(order))):
        raise InputError("its rows are not numbered from 0 without gaps; one of its files is another scan's")
    whole |= {"poses": whole.pop("pose"), "labels": whole.pop("label")}
    return Scan(**told | {name: array[order] for name, array in whole.items()})


def _file(folder: Path, split: str) -> Path:
    return folder / "data" / f"{split}-00000-of-00001.parquet"


def _write(table: pa.Table, path: Path) -> None:
    rows = max(1, _ROW_GROUP * len(table) // max(1, table.nbytes))
    path.parent.mkdir(exist_ok=True)
    with path.open("wb") as stream:  # of a path Arrow wants UTF-8
        pa.parquet.write_table(table, stream, compression="zstd", row_group_size=rows)


def _lists(array: NDArray[Any]) -> pa.Array:
    """Make lists of fixed size, nested for each axis after the first."""
    made = pa.array(np.ascontiguousarray(array).reshape(-1))
    for size in reversed(array.shape[1:]):
        made = pa.FixedSizeListArray.from_arrays(made, size)
    return made


def _read(path: Path, shapes: Shapes) -> dict[str, NDArray[Any]]:
    """Read the columns of one file. Raises InputError if they are too large or others than were written."""
    try:
        # Labels stay a dictionary, so that one long label is not repeated for each row.
        with open_regular(path) as stream, pa.parquet.ParquetFile(stream, read_dictionary=["label"]) as file:
            rows, schema = file.metadata.num_rows, file.schema_arrow
            if rows * sum(np.dtype(kind).itemsize * prod(shape) for shape, kind in shapes.values()) > LARGEST:
                raise InputError(f"{path.name} claims more than the {LARGEST:,} bytes that a scan may hold")
            kinds = {name: _lists(np.zeros((0, *shape), kind)).type for name, (shape, kind) in shapes.items()}
            kinds["label"] = pa.dictionary(pa.int32(), pa.string())
            for name, kind in kinds.items():
                # A list's type names its items, and the libraries use different names.
                if schema.names.count(name) != 1 or not schema.field(name).type.equals(kind):
                    raise InputError(f"{path.name}: the column {name} should be once there, as {kind}")
            table = file.read(columns=list(kinds)).combine_chunks()
        words = table["label"].chunk(0)
        labels = words.dictionary.to_pylist()
        if words.null_count or not all(map(is_label, labels)):
            raise InputError(f"{path.name}: a label is missing, empty, too long or not printable")
        read = {"label": np.array(labels, np.str_)[words.indices.to_numpy()]}
        for name, (shape, _) in shapes.items():
            numbers = table[name].chunk(0).flatten(recursive=True) if shape else table[name].chunk(0)
            if numbers.null_count or len(numbers) != rows * prod(shape):
                raise InputError(f"{path.name}: a number of the column {name} is missing")
            read[name] = numbers.to_numpy().reshape(rows, *shape)
    except (pa.ArrowException, OSError, KeyError, IndexError, UnicodeDecodeError) as error:
        raise InputError(f"{path.name} is no whole Parquet file: {' '.join(str(error).split())}") from error
    return read
