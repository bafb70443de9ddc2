"""The information of every test reading of a scan, worked out once and kept beside the pressed readings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactsim.bench.bound.cramer_rao import bound_mm, walked
from tactsim.bench.bound.pose_information import of_classes, of_pressures
from tactsim.bench.bound.response import noise_variance, respond
from tactsim.bench.config import STILL, Slip
from tactsim.bench.placement import Properties, properties
from tactsim.bench.trials import Trials
from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan
from tactsim.core.seeds import stream
from tactsim.core.source_digest import source_digest
from tactsim.core.workers import process_map
from tactsim.models import Letter
from tactsim.press import ScanOptions
from tactsim.press import cache as cached
from tactsim.press.scanning import letters_of
from tactsim.press.touches import Touches

Progress = Callable[[str, int, int], None]

_CHUNK = 24  # poses that are worked out at a time


@dataclass(frozen=True, eq=False)
class ScanInformation:
    """Fisher information of a scan's test readings on where the object lies.

    pressures, classes: {letter: (n, 3, 3)}, of the letter's test readings in the scan's order. objects: each letter's
    properties for the error metric.
    """

    pressures: Mapping[str, FloatArray]
    classes: Mapping[str, FloatArray]
    objects: Mapping[str, Properties]

    def bounds(self, trials: Trials, of: str = "pressures", slip: Slip = STILL) -> FloatArray:
        """Bound the mean placement error of every trial after each reading, (n, r) mm.

        of: "pressures", or "classes" for an estimator that sees the three classes of eq. 3 only. slip: how the objects
        moved, a random walk at most; the bound knows of it, and the error is that of the place at the last touch.
        Raises InputError for another motion.
        """
        check_motion(slip)
        information = getattr(self, of)
        result = np.empty(trials.reading.shape)
        for letter in np.unique(trials.truth).tolist():
            rows = trials.truth == letter
            # robot_in_object turns the other way than the object.
            turns = -np.diff(trials.true_pose[rows, :, 2], axis=1, prepend=trials.true_pose[rows, :1, 2])
            summed = walked(information[letter][trials.reading[rows]], turns, slip.walk_mm, slip.walk_rad)
            result[rows] = bound_mm(summed, self.objects[letter])
        if slip.still:  # readings of other poses do not add up
            result[np.ptp(trials.true_pose, axis=1).any(axis=1)] = np.inf
        return result


def check_motion(slip: Slip) -> None:
    """Raise InputError if the bound does not know how the objects moved."""
    if slip.jump_mm or slip.jump_rad or slip.drift_mm or slip.drift_rad:
        raise InputError("the bound knows objects that lie still or walk at random, without jump or drift")


def stated_options(scan: Scan) -> ScanOptions:
    """Take from a scan how it was pressed. Raises InputError if it does not say, as a real pad's does not."""
    stated = scan.meta.get("options")
    if not isinstance(stated, dict):
        raise InputError(
            "the readings do not say how they were pressed, so nothing bounds their error; "
            "give readings of `bench scan`, or the options of the press"
        )
    return checked(ScanOptions, stated, "scan: meta.options")


def pressed_letters(scan: Scan, options: ScanOptions) -> dict[str, Letter]:
    """Build the letters that a scan says it pressed. Raises InputError if one is not there or has another shape."""
    objects: Mapping[str, Any] = scan.meta.get("objects", {})
    found = {letter.name: letter for letter in letters_of(options)}
    for name in scan.letters:
        if name not in found or objects.get(name, {}).get("digest", found[name].digest) != found[name].digest:
            raise InputError(f"the scan pressed another letter {name!r} than the one that is known here")
    return {name: found[name] for name in scan.letters}


def scan_information(
    scan: Scan, *, jobs: int = 1, cache: bool = True, progress: Progress | None = None
) -> ScanInformation:
    """Work out the information of every test reading, or read it from the cache.

    jobs: processes; the result does not depend on them. progress("bound", done, total) is called as presses are done.
    Raises InputError if the scan does not say how it was pressed, or if its sensor is none that `noise_variance` knows.
    """
    options = stated_options(scan)
    noise_variance(options.sensor)
    letters = pressed_letters(scan, options)
    poses = {name: scan.where("test", name).poses for name in letters}
    keys = {name: _key(letter, poses[name], options) for name, letter in letters.items()}
    found: dict[str, FloatArray] = {}
    for name, key in keys.items():
        stored = cached.load(key, (2 * len(poses[name]), 9)) if cache else None
        if stored is not None:
            found[name] = stored.reshape(2, -1, 3, 3)
    tasks = [
        (name, letters[name], poses[name][first : first + _CHUNK], options)
        for name in letters
        if name not in found
        for first in range(0, len(poses[name]), _CHUNK)
    ]
    parts: dict[str, list[FloatArray]] = {name: [] for name in letters if name not in found}
    with process_map(min(jobs, len(tasks))) as mapped:
        results = mapped(_of_poses, tasks)
        for number, (task, result) in enumerate(zip(tasks, results, strict=True), start=1):
            parts[task[0]].append(result)
            if progress is not None:
                progress("bound", number, len(tasks))
    for name, pieces in parts.items():
        found[name] = np.concatenate(pieces, axis=1)
        if cache:
            cached.store(keys[name], found[name].reshape(-1, 9))
    return ScanInformation(
        {name: found[name][0] for name in letters},
        {name: found[name][1] for name in letters},
        properties(scan),
    )


def _of_poses(task: tuple[str, Letter, FloatArray, ScanOptions]) -> FloatArray:
    name, letter, poses, options = task
    response = respond(letter, poses, options)
    rng = stream(options.seed, name, "bound")
    return np.stack(
        [
            of_pressures(response, poses, options.sensor),
            of_classes(response, poses, options.sensor, rng),
        ]
    )


def _key(letter: Letter, poses: FloatArray, options: ScanOptions) -> str:
    """Hash all that the information depends on, 64 hex digits."""
    content = json.dumps(
        {
            "presses": cached.key(Touches.of(letter, poses), options),
            "options": options.model_dump(mode="json", exclude={"letters", "shapes", "test_poses"}),
            "source": source_digest(__name__),
        },
        sort_keys=True,
    )
    return hashlib.sha256(content.encode()).hexdigest()
