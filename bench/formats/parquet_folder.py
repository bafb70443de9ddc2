"""Parquet in the layout of Hugging Face: a file for each split, a data card, and what else a scan holds as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from tactsim.bench.formats import is_of_a_run
from tactsim.bench.results import Run, to_json
from tactsim.bench.runs.tables import markdown_table
from tactsim.core import InputError, Scan
from tactsim.core.documents import read_json
from tactsim.core.errors import counted, short
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST
from tactsim.core.provenance import poses_unknown
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
        columns = {"row": _lists(rows.astype(np.int64)), "press": _lists(scan.press_numbers[rows])}
        columns["label"] = pa.array(scan.labels[rows].tolist(), pa.string())
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


# Licences that Hugging Face knows by their SPDX names in small letters; there are more, which become "other".
_CC = ("CC-BY-4.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC0-1.0")
_KNOWN_LICENCES = (*_CC, "MIT", "Apache-2.0", "BSD-3-Clause")


def card_of_scan(scan: Scan) -> str:
    """Write the card of a scan in Parquet: splits, columns with their units, licence; `scan.json` says all else."""
    about, taxels, presses = scan.about, scan.readings.shape[1], len(np.unique(scan.press_numbers))
    unit = about["units"]["readings"]
    where = "in poses that nobody noted" if poses_unknown(scan.meta) else "at known poses"
    columns = [
        ("column", "what it holds"),
        ("row", "the number of the reading in the scan, from 0"),
        ("press", "the number of the press that the reading is of: rows of one number share its errors"),
        ("label", "the object that was pressed"),
        ("pose", f"mm, mm, rad: {about['frames']['poses']}"),
        ("readings", f"one value for each of {taxels} taxels, {unit}"),
    ]
    if scan.sequence_times is not None:
        frames = len(scan.sequence_times)
        columns += [
            ("sequence", f"{frames} images of the press on its way to rest, {unit}"),
            ("sequence_force", "the contact force at these times, N"),
        ]
    # Of readings under several licences no one licence can be named.
    licences = {about["licence"], *([about["train"]["licence"]] if about["train"] else [])}
    licence = licences.pop() if len(licences) == 1 else None
    text = [
        f"{counted(len(scan), 'reading')} of {counted(presses, 'press')} of a pad of {taxels} taxels against "
        f"{len(scan.letters)} objects {where}:",
        "    " + " ".join(scan.letters),
        markdown_table(columns).rstrip(),
        "`scan.json` says where the taxels' centres lie (mm, in the frame of the sensor), which frames and units all "
        "numbers have, and how the scan was made. `bench import FOLDER --out scan.npz` makes it of this folder again, "
        "bit for bit.",
        f"Licence: {licence or 'none is stated; ask the owner before you use the data'}.",
    ]
    splits = [split for split in SPLITS if np.any(scan.split == split)]
    return _card(f"Tactile presses {where}", licence, splits, text)


def card_of_run(run: Run) -> str:
    """Write the card of a run's trials in Parquet."""
    text = [
        f"What the estimator {run.described} said after each reading of "
        f"{len(run.trials.truth):,} trials of {run.readings} readings: one row a trial and reading.",
        "`truth`, `label`: the true and the estimated object. `x`, `y`, `theta`: the estimated robot_in_object, mm, "
        "mm, rad; `true_x` and so on: the true one. `p_truth`, `p_label`: the probabilities given to the right and to "
        "the estimated label. `update_s`, `estimate_s`, `propose_s`: seconds of processor time. "
        f"`run.json` holds the configuration, the versions and the machine; the protocol is {run.protocol}.",
    ]
    return _card("Trials of recognition by touch", None, ["test"], text)


def _card(title: str, licence: str | None, splits: Iterable[str], text: Iterable[str]) -> str:
    """Put a card together: YAML (JSON is YAML) and paragraphs."""
    known = licence in _KNOWN_LICENCES
    files = [{"split": split, "path": f"data/{split}-*"} for split in splits]
    head = {
        "pretty_name": title,
        "license": "unknown" if licence is None else licence.lower() if known else "other",
        **({} if licence is None or known else {"license_name": licence}),
        "task_categories": ["robotics"],
        "tags": ["tactile", "touch", "tactsim"],
        "configs": [{"config_name": "default", "data_files": files}],
    }
    lines = [f"{name}: {json.dumps(value, ensure_ascii=False)}" for name, value in head.items()]
    return "\n".join(["---", *lines, "---", "", f"# {title}", "", "\n\n".join(text)]) + "\n"


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
        parts[name] = values = document.get(name)
        if values is None and name != "taxel_xy":
            continue
        try:
            parts[name] = np.array(values, dtype=None if name in ("presses", "views") else float)
        except (TypeError, ValueError, OverflowError):
            parts[name] = np.zeros(())
        if parts[name].ndim != axes:
            raise InputError(f"its {name} are no numbers along {axes} axes")
    return parts
