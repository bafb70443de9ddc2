"""Parquet in the layout of Hugging Face: one file for each split, a data card, and what else a scan holds as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet
from numpy.typing import NDArray

from tactsim.bench.formats.data_card import card_of_run, card_of_scan
from tactsim.bench.formats.scan_document import document_of, is_of_a_run, loads_of, parts_of, presses_of
from tactsim.bench.results import Run, to_json
from tactsim.core import InputError, Scan
from tactsim.core.documents import read_json
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST
from tactsim.core.scan import SPLITS, is_label

_DOCUMENT = "scan.json"
_OF_A_RUN = "run.json"
_ROW_GROUP = 64 << 20  # bytes: what a reader of one row has to read
_LONGEST_LABEL = 400  # bytes of 100 characters


def write_scan(scan: Scan, folder: Path) -> None:
    """Write data/SPLIT-00000-of-00001.parquet for each split that has readings, scan.json and README.md."""
    (folder / "data").mkdir()
    for split in SPLITS:
        rows = np.flatnonzero(scan.split == split)
        if len(rows):  # the library `datasets` loads no file without rows
            _write(_table(scan, rows), _file(folder, split))
    (folder / _DOCUMENT).write_text(to_json(document_of(scan)), encoding="utf-8")
    (folder / "README.md").write_text(card_of_scan(scan), encoding="utf-8")


def write_run(run: Run, folder: Path) -> None:
    """Write the trials, one row a trial and reading, as data/test-00000-of-00001.parquet, run.json and README.md."""
    (folder / "data").mkdir()
    columns = {name: pa.array(values.tolist()) for name, values in run.columns().items()}
    _write(pa.table(columns), _file(folder, "test"))
    (folder / _OF_A_RUN).write_text(to_json({"config": run.config, **run.about}), encoding="utf-8")
    (folder / "README.md").write_text(card_of_run(run), encoding="utf-8")


def read_scan(folder: Path) -> Scan:
    """Read a scan written by `write_scan`, its readings in their first order. Raises InputError if it is not whole."""
    if (folder / _OF_A_RUN).exists() and not (folder / _DOCUMENT).exists():
        raise is_of_a_run()
    document = read_json(folder / _DOCUMENT, "the scan's")
    taxel_xy, times, meta = parts_of(document)
    frames = None if times is None else len(times)
    parts, left = [], LARGEST
    for split in SPLITS:
        if _file(folder, split).exists():
            part, size = _read(_file(folder, split), len(taxel_xy), frames, left)
            left -= size
            parts.append(part | {"split": np.full(len(part["row"]), split)})
    if not parts:
        raise InputError("it has no data/train-00000-of-00001.parquet and none of the test split")
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(whole["row"], kind="stable")
    if not np.array_equal(whole.pop("row")[order], np.arange(len(order))):
        raise InputError("its rows are not numbered from 0 without gaps; one of its files is another scan's")
    return Scan(
        taxel_xy=taxel_xy,
        meta=meta,
        sequence_times=times,
        loads=loads_of(document),
        presses=presses_of(document),
        **{name: array[order] for name, array in whole.items()},
    )


def _file(folder: Path, split: str) -> Path:
    return folder / "data" / f"{split}-00000-of-00001.parquet"


def _write(table: pa.Table, path: Path) -> None:
    size = max(1, table.nbytes // max(1, len(table)))
    with path.open("wb") as stream:  # of a path Arrow wants UTF-8
        pa.parquet.write_table(table, stream, compression="zstd", row_group_size=max(1, _ROW_GROUP // size))


def _table(scan: Scan, rows: NDArray[np.intp]) -> pa.Table:
    columns = {
        "row": pa.array(rows.astype(np.int64)),
        "label": pa.array(scan.labels[rows].tolist(), pa.string()),
        "pose": _lists(scan.poses[rows]),
        "readings": _lists(scan.readings[rows]),
    }
    if scan.sequence is not None and scan.sequence_force is not None:
        columns |= {
            "sequence": _lists(scan.sequence[rows]),
            "sequence_force": _lists(scan.sequence_force[rows]),
        }
    return pa.table(columns)


def _lists(array: NDArray[Any]) -> pa.Array:
    """Make lists of fixed size, nested for each axis after the first."""
    made = pa.array(np.ascontiguousarray(array).reshape(-1))
    for size in reversed(array.shape[1:]):
        made = pa.FixedSizeListArray.from_arrays(made, size)
    return made


def _read(path: Path, taxels: int, frames: int | None, left: int) -> tuple[dict[str, NDArray[Any]], int]:
    """Read the columns of one file, which may take `left` bytes; also says how many they take."""
    shapes: dict[str, tuple[tuple[int, ...], pa.DataType]] = {
        "row": ((), pa.int64()),
        "pose": ((3,), pa.float64()),
        "readings": ((taxels,), pa.float64()),
    }
    if frames is not None:
        shapes |= {"sequence": ((frames, taxels), pa.float32()), "sequence_force": ((frames,), pa.float32())}
    try:
        # Labels stay a dictionary, so that one long label is not repeated for each row.
        with open_regular(path) as stream, pa.parquet.ParquetFile(stream, read_dictionary=["label"]) as file:
            rows = file.metadata.num_rows
            size = rows * sum(kind.bit_width // 8 * int(np.prod(shape)) for shape, kind in shapes.values())
            if size > left:
                raise InputError(f"{path.name} claims {size:,} bytes; {left:,} are left of {LARGEST:,}")
            _check_kinds(file.schema_arrow, shapes, path.name)
            table = file.read(columns=["label", *shapes])
            if len(table) != rows:
                raise InputError(f"{path.name} has {len(table):,} rows of {rows:,}")
            read: dict[str, NDArray[Any]] = {
                name: _flat(table[name], path.name).reshape(rows, *shape)
                for name, (shape, _) in shapes.items()
            }
            read["labels"] = _labels(table["label"], path.name)
    except (pa.ArrowException, OSError, KeyError, UnicodeDecodeError) as error:
        raise InputError(f"{path.name} is no whole Parquet file: {' '.join(str(error).split())}") from error
    read["poses"] = read.pop("pose")
    return read, size


def _check_kinds(
    schema: pa.Schema, shapes: dict[str, tuple[tuple[int, ...], pa.DataType]], name: str
) -> None:
    """Raise InputError unless each column is there once, and is of the type that was written."""
    for column, (shape, kind) in shapes.items():
        wanted = kind
        for size in reversed(shape):
            wanted = pa.list_(wanted, size)
        places = schema.get_all_field_indices(column)
        # A list's type names its items, and the libraries use different names.
        if len(places) != 1 or not schema.field(places[0]).type.equals(wanted):
            raise InputError(f"{name}: the column {column} should be once there, as {wanted}")
    if len(schema.get_all_field_indices("label")) != 1:
        raise InputError(f"{name}: the column label should be once there, as text")


def _flat(column: pa.ChunkedArray, name: str) -> NDArray[Any]:
    pieces = []
    for chunk in column.chunks:
        while pa.types.is_fixed_size_list(chunk.type):
            if chunk.null_count:
                raise InputError(f"{name}: an entry is missing")
            chunk = chunk.flatten()
        if chunk.null_count:
            raise InputError(f"{name}: a number is missing")
        pieces.append(chunk.to_numpy(zero_copy_only=False))
    return np.concatenate(pieces) if pieces else np.zeros(0)


def _labels(column: pa.ChunkedArray, name: str) -> NDArray[np.str_]:
    found: list[str] = []
    for chunk in column.chunks:
        if not pa.types.is_dictionary(chunk.type) or not pa.types.is_string(chunk.type.value_type):
            raise InputError(f"{name}: the labels are no text but {chunk.type}")
        longest = pa.compute.max(pa.compute.binary_length(chunk.dictionary)).as_py() or 0
        if chunk.null_count or longest > _LONGEST_LABEL:
            raise InputError(f"{name}: a label is missing or longer than {_LONGEST_LABEL} bytes")
        found += chunk.to_pylist()
    if not all(is_label(label) for label in dict.fromkeys(found)):
        raise InputError(f"{name}: a label is empty, too long or not printable")
    return np.array(found, dtype=np.str_)
