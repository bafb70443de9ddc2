"""A person and a real pad: guided recording, sheets to press by, and how far the simulation agrees with a recording.

Lives here: leading a person through the presses of a session or of a run's trials, the template that is printed for
it, and `bench validate`. Does not live here: the pad's bytes and its calibration, which are `tactsim.hardware`'s.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from tactsim.core import InputError, Pad, Scan
from tactsim.core.errors import some
from tactsim.core.poses import FloatArray, invert, transform
from tactsim.core.seeds import stream
from tactsim.hardware.recording import SUFFIX
from tactsim.hardware.scans import scan_of_sessions
from tactsim.models import Letter, letter, names, shape
from tactsim.press.clip import covers
from tactsim.press.scan_poses import grid_poses, random_poses, stage_for
from tactsim.press.scanning import object_facts

_STEP_MM, _STEP_DEGREES = 1.0, 5.0  # the marks of the sheets of `bench template`
_SPARE = 3  # poses of a trial for each one that is wanted: some are skipped


def recording_of(folder: Path, letter: str, trial: int) -> Path:
    """Name the recording of a letter's trial, which counts from 0, in a folder of measured trials."""
    return folder / f"{quote(letter, safe='')}-{trial + 1}{SUFFIX}"


def poses_to_press(
    label: str, trial: int, readings: int, seed: int, pad: Pad, own: Letter | None = None
) -> FloatArray:
    """Draw the poses (n, 3) sensor_in_object of a trial, off the grid; more than `readings`, for some are skipped.

    They reach as far as those of a scan with this pad, and lie on whole mm and every 5 degrees, where the sheets of
    `bench template` have marks. own: the user's object that is called so, which all of them touch.
    """
    rng = stream(seed, label, "measured", f"trial {trial}")
    poses = touching(rng, _SPARE * readings, pad, own or known_letter(label))
    steps = (_STEP_MM, _STEP_MM, np.deg2rad(_STEP_DEGREES))
    poses = np.round(poses / steps) * steps
    poses[:, 2] %= 2 * np.pi  # rounding may have made a whole turn
    return poses


def measured_scan(folder: Path, letters: Sequence[str], trials: int, readings: int) -> Scan:
    """Read the measured trials of the letters: for each letter `readings` readings of its first trial, then the next.

    Raises InputError if a trial is missing, or has fewer presses.
    """
    chosen: list[NDArray[np.bool_]] = []
    paths = [recording_of(folder, letter, trial) for letter in letters for trial in range(trials)]
    for path in paths:
        if not path.exists():
            raise InputError(
                f"{path} was not measured yet; measure it by the same command with --port, or say fewer --trials"
            )
    scan = scan_of_sessions(paths)
    for path, about in zip(paths, scan.meta["recordings"], strict=True):
        count = about["presses"]
        if count < readings:
            raise InputError(
                f"{path} has {count} presses of {readings}; the same command with --port measures the others"
            )
        chosen.append(np.arange(count) < readings)
    kept = scan.chosen(np.concatenate(chosen))
    return with_letters(replace(kept, meta={**scan.meta, "readings_a_trial": readings}))


def on_object(poses: FloatArray, pad: Pad, pressed: Letter | None) -> NDArray[np.bool_]:
    """Tell at which poses (n, 3) sensor_in_object a taxel lies on the object, by its corners and its middle.

    A letter of the catalogue is pressed at all of them, as in the paper. Of what nobody drew (None) its origin is known
    alone, and has to lie on the pad.
    """
    if pressed is None:
        return (np.abs(invert(poses)[:, :2]) <= np.abs(pad.taxel_xy).max(axis=0)).all(axis=1)
    if pressed is known_letter(pressed.name):
        return np.ones(len(poses), dtype=bool)
    half = np.array([pad.taxel_width, pad.taxel_height]) / 2
    corners = half * np.array([(0, 0), (-1, -1), (-1, 1), (1, -1), (1, 1)])
    points = (pad.taxel_xy[:, None] + corners).reshape(-1, 2)
    return np.array([covers(pressed.contours, transform(pose, points)).any() for pose in poses])


def touching(rng: np.random.Generator, count: int, pad: Pad, pressed: Letter | None) -> FloatArray:
    """Draw poses (count, 3) sensor_in_object off the grid, within the reach of a scan; see `on_object`."""
    stage = stage_for(pad, pressed)
    share = max(float(on_object(grid_poses(stage), pad, pressed).mean()), 1 / stage.poses)
    poses = random_poses(rng, int(np.ceil(4 * count / share)), stage.reach)  # since some touch nothing
    return poses[on_object(poses, pad, pressed)][:count]


def known_letter(label: str) -> Letter | None:
    """Build the letter of the catalogue that a label names; None if there is none."""
    return letter(label) if label in names() else None


def with_letters(scan: Scan, letters: Collection[str] | None = None) -> Scan:
    """Add to the scan's `meta` what scores need to know of the labels that are letters of the catalogue.

    letters: which labels are; by default all that are called like one, as in guided sessions, which show its outline.
    Raises InputError for one that no label names.
    """
    for one in letters or ():
        if one not in scan.letters:
            raise InputError(f"no reading is of the letter {one!r}; the labels are {some(scan.letters)}")
    called = set(names()) if letters is None else set(letters)
    objects = {label: object_facts(letter(label)) for label in scan.letters if label in called}
    return replace(scan, meta={**scan.meta, "objects": objects})


def with_shapes(scan: Scan, paths: Sequence[Path]) -> Scan:
    """Add to the scan's `meta` what scores need to know of these files of shapes; see `with_objects`."""
    return with_objects(scan, list(map(shape, paths))) if paths else scan


def with_objects(scan: Scan, pressed: Sequence[Letter]) -> Scan:
    """Add to the scan's `meta` what scores need to know of the objects that are called like these.

    Raises InputError for one that no label names, and for a label that is a letter of the catalogue already.
    """
    shapes = {of.name: of for of in pressed}
    known = scan.meta.get("objects", {})
    for name in shapes:
        if name not in scan.letters:
            raise InputError(f"no reading is of the shape {name!r}; the labels are {some(scan.letters)}")
        if name in known:
            raise InputError(f"{name!r} is a shape and, by --letters, one of the catalogue; leave one out")
    objects = {**known, **{name: object_facts(of) for name, of in shapes.items()}}
    return replace(scan, meta={**scan.meta, "objects": objects})


def taken_as_letters(scan: Scan) -> list[str]:
    """Say, in a line if there are any, which labels of a scan count as letters of the catalogue."""
    taken = [label for label in scan.letters if label in scan.meta.get("objects", {})]
    facts = "placements count as those of the catalogue's letters (centre, inertia, symmetry)"
    return [f"{' '.join(taken)}: {facts}"] if taken else []
