"""Write the files of a run with objects in space, and read them back unchanged."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.results import read_table, to_json, write_table
from tactsim.bench.space.space_config import TASK
from tactsim.bench.space.space_run import Shape, SpaceRun
from tactsim.bench.space.space_trials import SpaceTrials
from tactsim.bench.space.surface_distance import Surface
from tactsim.core.documents import read_json
from tactsim.core.errors import InputError
from tactsim.core.files import new_folder, write_bytes, write_text
from tactsim.core.finite import finite
from tactsim.core.npz import read_npz
from tactsim.core.rigid import checked_poses

SCHEMA = 1
_PLACE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_POSES = {"pose": "", "true_pose": "true_", "start": "start_"}
_KEYS = ("truth", "trial", "touch_number")
_NUMBERS = ("p_truth", "p_label", "credibility", "radius_90")
_COUNTS = ("met", "evaluations")
_SECONDS = ("update_s", "estimate_s", "propose_s")
_POSE_COLUMNS = {name: tuple(before + place for place in _PLACE) for name, before in _POSES.items()}
# trials.csv: one row per trial and touch, the same on every machine for the same seed; times.csv differs every time.
COLUMNS = (*_KEYS, "label", *(name for of in _POSE_COLUMNS.values() for name in of), *_NUMBERS, *_COUNTS)
TIME_COLUMNS = (*_KEYS, *_SECONDS)


def save(run: SpaceRun, folder: Path) -> Path:
    """Write a run's folder, pictures included, whole or not at all, and return its path.

    Raises InputError if the folder holds something or cannot be written.
    """
    from tactsim.bench.space.map_picture import maps_figure
    from tactsim.bench.space.pictures import touches_figure

    with new_folder(folder) as inside:
        symmetries = {
            label: {
                "rotations": shape.surface.rotations.tolist(),
                "axis": None if shape.surface.axis is None else shape.surface.axis.tolist(),
            }
            for label, shape in run.shapes.items()
        }
        head = {"schema": SCHEMA, "task": TASK, "config": run.config, "symmetries": symmetries, **run.about}
        write_text(inside / "run.json", to_json(head))
        table = columns(run.trials)
        write_text(inside / "trials.csv", write_table(COLUMNS, table))
        write_text(inside / "times.csv", write_table(TIME_COLUMNS, table))
        write_text(inside / "summary.json", to_json(run.summary))
        write_text(inside / "times.json", to_json(run.times | {"work": run.work}))
        content = BytesIO()
        arrays: dict[str, NDArray[Any]] = {}
        for number, label in enumerate(sorted(run.shapes)):  # as JSON sorts them
            shape = run.shapes[label]
            arrays[f"vertices_{number}"] = shape.vertices
            arrays[f"faces_{number}"] = shape.faces
            arrays[f"points_{number}"] = shape.surface.points
        np.savez_compressed(content, allow_pickle=False, **arrays)
        write_bytes(inside / "objects.npz", content.getvalue())
        write_bytes(inside / "touches.png", touches_figure(run).png())
        if run.maps:
            write_bytes(inside / "maps.png", maps_figure(run.maps).png())
    return folder


def is_in_space(folder: Path) -> bool:
    """Tell whether a folder holds a run with objects in space."""
    file = folder / "run.json"
    return file.is_file() and read_json(file, "file of a run").get("task") == TASK


def load(folder: Path) -> SpaceRun:
    """Read a run's folder. Raises InputError if it is no such run, is not whole or has another schema."""
    try:
        about = read_json(folder / "run.json", "file of a run")
        if about.pop("task", None) != TASK or about.pop("schema", None) != SCHEMA:
            raise InputError(f"run.json is no run with objects in space of schema {SCHEMA}")
        times = read_json(folder / "times.json", "file of a run")
        trials = _trials(
            read_table(folder / "trials.csv", COLUMNS), read_table(folder / "times.csv", TIME_COLUMNS)
        )
        shapes = _shapes(folder / "objects.npz", about.pop("symmetries"))
        if not set(trials.truth.tolist()) <= set(shapes):
            raise InputError("objects.npz: an object of trials.csv is missing")
        return SpaceRun(about.pop("config"), about, shapes, times.pop("work"), trials, times)
    except (InputError, KeyError, TypeError, AttributeError) as error:
        said = error if isinstance(error, InputError) else f"run.json or times.json lacks {error}"
        raise InputError(f"{folder} is not a whole run: {said}") from error


def columns(trials: SpaceTrials) -> dict[str, NDArray[Any]]:
    """Give the columns of trials.csv and times.csv, one row a trial and touch."""
    shape = trials.label.shape
    values: dict[str, NDArray[Any]] = {
        "truth": trials.truth[:, None], "trial": trials.trial[:, None], "touch_number": np.arange(1, shape[1] + 1),
        "label": trials.label,
        **{name: getattr(trials, name) for name in (*_NUMBERS, *_COUNTS, *_SECONDS)},
    }  # fmt: skip
    for name, of in _POSE_COLUMNS.items():
        poses = getattr(trials, name)
        poses = poses[:, None] if poses.ndim == 2 else poses
        values |= dict(zip(of, np.moveaxis(poses, -1, 0), strict=True))
    return {name: np.broadcast_to(value, shape).ravel() for name, value in values.items()}


def _trials(table: dict[str, list[str]], times: dict[str, list[str]]) -> SpaceTrials:
    number = _numbers(table, "touch_number", np.int64)
    touches = int(number.max())
    count, left = divmod(len(number), max(touches, 1))
    if left or not np.array_equal(number, np.tile(np.arange(1, touches + 1), count)):
        raise InputError("trials.csv: rows are missing")
    if any(times[name] != table[name] for name in _KEYS):
        raise InputError("times.csv does not have the rows of trials.csv")
    shape = (count, touches)
    poses = {
        name: checked_poses(
            np.stack([_numbers(table, column, float) for column in of], axis=-1), f"trials.csv: {name}"
        ).reshape(*shape, 7)
        for name, of in _POSE_COLUMNS.items()
    }
    return SpaceTrials(
        truth=np.array(table["truth"])[::touches],
        trial=_numbers(table, "trial", np.int64)[::touches],
        label=np.array(table["label"]).reshape(shape),
        true_pose=poses["true_pose"][:, 0],
        start=poses["start"],
        pose=poses["pose"],
        **{name: _numbers(table, name, float).reshape(shape) for name in _NUMBERS},
        **{name: _numbers(table, name, np.int64).reshape(shape) for name in _COUNTS},
        **{name: _numbers(times, name, float).reshape(shape) for name in _SECONDS},
    )


def _numbers(table: dict[str, list[str]], name: str, kind: type) -> NDArray[Any]:
    try:
        return np.array(table[name], dtype=kind)
    except (ValueError, OverflowError) as error:
        raise InputError(f"the column {name} holds what is no number") from error


def _shapes(path: Path, symmetries: dict[str, Any]) -> dict[str, Shape]:
    names = [f"{kind}_{n}" for n in range(len(symmetries)) for kind in ("vertices", "faces", "points")]
    arrays = read_npz(path, tuple(names))
    return {
        label: Shape(
            finite(arrays[f"vertices_{number}"], "vertices"),
            arrays[f"faces_{number}"].astype(np.int64),
            Surface(
                finite(arrays[f"points_{number}"], "points"),
                finite(of["rotations"], "rotations"),
                None if of["axis"] is None else finite(of["axis"], "axis"),
            ),
        )
        for number, (label, of) in enumerate(symmetries.items())
    }
