"""The information of every test reading of a scan, and the bound that follows of the trials that take them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactsim.bench.bound.cramer_rao import bound_mm, walked
from tactsim.bench.bound.pose_information import pose_information
from tactsim.bench.bound.response import noise_variance, respond
from tactsim.bench.config import STILL, Slip
from tactsim.bench.placement import properties
from tactsim.bench.trials import Progress, Trials, silent
from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import had_another_shape
from tactsim.core.scan import Scan
from tactsim.core.workers import process_map
from tactsim.models import Letter
from tactsim.press import ScanOptions
from tactsim.press.scanning import letters_of


def scan_bounds(
    scan: Scan, trials: Trials, slip: Slip = STILL, *, jobs: int = 1, progress: Progress = silent
) -> FloatArray:
    """Bound the mean placement error of every trial on a scan after each reading, (n, r) mm.

    slip: how the objects moved, a random walk at most; the bound knows of it, and the error is that of the place at the
    last touch. jobs, progress: see `scan_information`. Raises InputError for another motion, and as that does.
    """
    check_motion(slip)
    information, objects = scan_information(scan, jobs=jobs, progress=progress), properties(scan)
    result = np.empty(trials.reading.shape)
    for letter in np.unique(trials.truth).tolist():
        rows = trials.truth == letter
        # robot_in_object turns the other way than the object.
        turns = -np.diff(trials.true_pose[rows, :, 2], axis=1, prepend=trials.true_pose[rows, :1, 2])
        summed = walked(information[letter][trials.reading[rows]], turns, slip.walk_mm, slip.walk_rad)
        result[rows] = bound_mm(summed, objects[letter])
    # An ended trial knows no more than after its last touch.
    last = np.minimum(trials.taken.cumsum(axis=1), trials.touches[:, None]) - 1
    result = np.take_along_axis(result, last, axis=1)
    if slip.still:  # readings of other poses do not add up
        result[np.ptp(trials.true_pose, axis=1).any(axis=1)] = np.inf
    return result


@lru_cache(maxsize=8)  # the runs of a report share scans
def scan_information(scan: Scan, *, jobs: int = 1, progress: Progress = silent) -> dict[str, FloatArray]:
    """Work out the Fisher information of every test reading on where the object lies.

    Returns {letter: (n, 3, 3)}, of the letter's test readings in the scan's order. jobs: processes; the result does not
    depend on them. progress("bound", done, total) is called as letters are done.
    Raises InputError if the scan does not say how it was pressed, or if its sensor is none that `noise_variance` knows.
    """
    options = stated_options(scan)
    noise_variance(options.sensor)
    letters = pressed_letters(scan, options)
    tasks = [(letter, scan.where("test", name).poses, options) for name, letter in letters.items()]
    found: dict[str, FloatArray] = {}
    with process_map(min(jobs, len(tasks))) as mapped:
        for name, information in zip(letters, mapped(_of_letter, tasks), strict=True):
            found[name] = information
            progress("bound", len(found), len(letters))
    return found


def _of_letter(task: tuple[Letter, FloatArray, ScanOptions]) -> FloatArray:
    letter, poses, options = task
    return pose_information(respond(letter, poses, options), poses, options.sensor)


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
    found = {letter.name: letter for letter in letters_of(options)}
    for name in scan.letters:
        if name not in found or had_another_shape(scan.meta, name, found[name].digest):
            raise InputError(f"the scan pressed another letter {name!r} than the one that is known here")
    return {name: found[name] for name in scan.letters}
