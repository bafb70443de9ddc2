"""LeRobotDataset v3, experimental for touch: a press is an episode, its images or its one reading are the frames.

    meta/info.json, meta/stats.json           features, frames a second, statistics for normalisation
    meta/tasks.parquet                        a task for each object
    meta/episodes/chunk-000/file-000.parquet  where each episode lies, and its statistics
    data/chunk-000/file-000.parquet, ...      the frames

`observation.tactile` is what the taxels say in float32, `observation.state` and `action` the pose of the press. LeRobot
has no convention for touch yet. Written after huggingface/lerobot, `src/lerobot/datasets`, with codebase_version v3.0.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from tactsim.bench.formats.data_card import card, licence_of, made
from tactsim.bench.formats.scan_document import document_of
from tactsim.bench.results import to_json
from tactsim.core import InputError, Scan
from tactsim.core.scan import SPLITS

_PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA, _EPISODES = f"data/{_PLACE}", f"meta/episodes/{_PLACE}"
_CHUNK = 1000  # files in a folder
_FILE_MB = 100
_STATE = ["x_mm", "y_mm", "theta_rad"]
_QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
_WHOLE = {"shape": [1], "names": None}
_INDICES = ("frame_index", "episode_index", "index", "task_index")

Columns = dict[str, NDArray[Any]]  # of n episodes: (n, frames) or (n, frames, numbers)


def write_scan(scan: Scan, folder: Path) -> None:
    """Write a scan, the training presses first, those of each split in their order.

    Raises InputError if its sequences have no whole number of images a second, which LeRobot asks for.
    """
    order = np.concatenate([np.flatnonzero(scan.split == split) for split in SPLITS])
    rate = _rate(scan)
    columns = _columns(scan, order, rate)
    (count, frames), taxels = columns["index"].shape, scan.readings.shape[1]
    tasks = [f"touch {label}" for label in scan.letters]
    size = sum(array.nbytes for array in columns.values()) // count
    a_file = max(1, (_FILE_MB << 20) // size)  # episodes
    for number, first in enumerate(range(0, count, a_file)):
        part = {name: array[first : first + a_file] for name, array in columns.items()}
        place = {"chunk_index": number // _CHUNK, "file_index": number % _CHUNK}
        _write({name: _flat(array) for name, array in part.items()}, folder / _DATA.format(**place))
    episodes = np.arange(count)
    files = episodes // a_file
    told: dict[str, Any] = {
        "episode_index": episodes,
        "tasks": [[tasks[task]] for task in columns["task_index"][:, 0]],
        "length": np.full(count, frames),
        "dataset_from_index": episodes * frames,
        "dataset_to_index": (episodes + 1) * frames,
        "data/chunk_index": files // _CHUNK,
        "data/file_index": files % _CHUNK,
        **{f"meta/episodes/{name}": np.zeros(count, dtype=int) for name in ("chunk_index", "file_index")},
        "split": scan.split[order].tolist(),
        **dict(_episode_stats(columns)),
    }
    _write(told, folder / _EPISODES.format(chunk_index=0, file_index=0))
    _write_tasks(tasks, folder / "meta" / "tasks.parquet")
    (folder / "meta" / "stats.json").write_text(json.dumps(_stats(columns), indent=1), encoding="utf-8")
    training = int(np.count_nonzero(scan.split == "train"))
    ranges = {"train": (0, training), "test": (training, count)}
    info = {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": count,
        "total_frames": count * frames,
        "total_tasks": len(tasks),
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": _FILE_MB,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {split: f"{first}:{last}" for split, (first, last) in ranges.items() if last > first},
        "data_path": _DATA,
        "video_path": None,
        "features": _features(taxels),
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    (folder / "meta" / "scan.json").write_text(to_json(document_of(scan)), encoding="utf-8")
    (folder / "README.md").write_text(_card(scan, count * frames), encoding="utf-8")


def _rate(scan: Scan) -> int:
    """Give the frames a second; a press without a sequence is one frame, and takes a second."""
    times = scan.sequence_times
    if times is None or len(times) == 1:
        return 1
    rate = (len(times) - 1) / (times[-1] - times[0])
    whole = round(rate) if 0.5 < rate < 1e6 else 0
    if whole < 1 or np.abs(times - times[0] - np.arange(len(times)) / whole).max() > 1e-4:
        raise InputError(
            f"lerobot asks for frames at a whole rate, and the scan's sequences have {rate:.4g} a second on average; "
            "press with such a press.frame_rate, or export to mcap, hdf5 or parquet"
        )
    return whole


def _columns(scan: Scan, order: NDArray[np.intp], rate: int) -> Columns:
    tactile = scan.readings[:, None] if scan.sequence is None else scan.sequence
    tactile = tactile[order].astype(np.float32)
    count, frames, _ = tactile.shape
    pose = np.repeat(scan.poses[order, None].astype(np.float32), frames, axis=1)
    shape, frame = (count, frames), np.arange(frames)
    number = {label: index for index, label in enumerate(scan.letters)}
    task = np.array([number[label] for label in scan.labels[order].tolist()])
    return {
        "observation.tactile": tactile,
        "observation.state": pose,
        "action": pose,
        "timestamp": np.broadcast_to((frame / rate).astype(np.float32), shape),
        "frame_index": np.broadcast_to(frame, shape),
        "episode_index": np.broadcast_to(np.arange(count)[:, None], shape),
        "index": np.arange(count * frames).reshape(shape),
        "task_index": np.broadcast_to(task[:, None], shape),
    }


def _features(taxels: int) -> dict[str, Any]:
    pose = {"dtype": "float32", "shape": [3], "names": _STATE}
    names = [f"taxel_{taxel}" for taxel in range(taxels)]
    return {
        "observation.tactile": {"dtype": "float32", "shape": [taxels], "names": names},
        "observation.state": pose,
        "action": pose,
        "timestamp": {"dtype": "float32", **_WHOLE},
        **{name: {"dtype": "int64", **_WHOLE} for name in _INDICES},
    }


def _flat(array: NDArray[Any]) -> pa.Array:
    """Put the frames of all episodes below each other; LeRobot keeps one number as a number, more as a list."""
    size = 1 if array.ndim == 2 else array.shape[2]
    values = pa.array(np.ascontiguousarray(array).reshape(-1))
    return values if size == 1 else pa.FixedSizeListArray.from_arrays(values, size)


def _episode_stats(columns: Columns) -> Iterator[tuple[str, pa.Array]]:
    """Give the statistics of each episode, as `stats/FEATURE/NAME` columns."""
    for feature, array in columns.items():
        frames = (array if array.ndim == 3 else array[..., None]).astype(np.float64)
        for name in ("min", "max", "mean", "std"):
            values = getattr(np, name)(frames, axis=1)
            lists = pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), frames.shape[2])
            yield f"stats/{feature}/{name}", lists
        counts = pa.array(np.full(len(array), array.shape[1]))
        yield f"stats/{feature}/count", pa.FixedSizeListArray.from_arrays(counts, 1)


def _stats(columns: Columns) -> dict[str, dict[str, list[float]]]:
    """Give the statistics of all frames, by which a policy normalises what it is given."""
    found = {}
    for feature, array in columns.items():
        frames = array.reshape(array.shape[0] * array.shape[1], -1).astype(np.float64)
        found[feature] = {
            name: getattr(np, name)(frames, axis=0).tolist() for name in ("min", "max", "mean", "std")
        }
        found[feature]["count"] = [len(frames)]
        quantiles = np.quantile(frames, _QUANTILES, axis=0)
        found[feature] |= {
            f"q{round(100 * share):02d}": values.tolist()
            for share, values in zip(_QUANTILES, quantiles, strict=True)
        }
    return found


def _write_tasks(tasks: list[str], path: Path) -> None:
    """Write the tasks with their numbers; LeRobot reads them with pandas, and the text has to be the index."""
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored, "metadata": None}
        for name, kind, stored in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    table = pa.table(
        {"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())}
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:  # of a path Arrow wants UTF-8
        pa.parquet.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), stream)


def _write(columns: dict[str, Any], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        pa.parquet.write_table(pa.table(columns), stream, compression="snappy")


def _card(scan: Scan, frames: int) -> str:
    unit = scan.about["units"]["readings"]
    text = [
        "This dataset follows the format LeRobotDataset v3.0. LeRobot has no convention for touch yet: take the names "
        "of the features as experimental.",
        "An episode is one press at a known pose against the object that its task names. `observation.tactile` is what "
        f"each of {scan.readings.shape[1]} taxels says, {unit}, in float32. `observation.state` and `action` are the "
        "pose sensor_in_object: x mm, y mm, theta rad. `timestamp` counts from the first image of the press. "
        "`meta/scan.json` holds the taxels' centres, the pad and all options.",
        *made(scan),
    ]
    title = "Tactile presses at known poses, as episodes"
    every = {
        "train": frames
    }  # what is to train on and what to test with stands in meta/info.json, by episode
    return card(title, licence_of(scan), frames, every, text, tags=["LeRobot"], files="data/*/*.parquet")
