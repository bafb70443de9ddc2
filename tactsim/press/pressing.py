"""Press one letter: from its outline and a pose to what the pad would read."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed, Level, lay_bed
from tactsim.press.contact_forces import contact_forces, contact_history
from tactsim.press.face import levels
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import UNREAD_STAGES
from tactsim.press.sensor import gains, sense
from tactsim.press.spread import contact_map


@dataclass(frozen=True, eq=False)
class Press:
    """What one press gives.

    ideal: (taxels,) kPa without imperfections. reading: (taxels,) kPa, what the pad reports. With full
    dynamics `sequence` (frames, taxels) kPa holds the images of the press, without imperfections, taken
    at `times` (frames,) s; the last is `ideal`.
    """

    ideal: FloatArray
    reading: FloatArray
    times: FloatArray | None = None
    sequence: FloatArray | None = None


def press_letter(
    letter: models.Letter,
    sensor_in_object: ArrayLike,
    options: ScanOptions | None = None,
    rng: np.random.Generator | None = None,
) -> Press:
    """Press `letter` at one pose [x, y, theta] (mm, rad), exactly there.

    Of `options` only pad, press, sensor and, for the pad's gains, seed count. `rng` draws noise and random
    taxels; without it there are none.
    Raises InputError if the pose is not three finite numbers.
    """
    options = options or ScanOptions()
    pose = finite(sensor_in_object, "sensor_in_object")
    if pose.shape != (3,):
        raise InputError(f"a pose is three numbers [x mm, y mm, theta rad], got {sensor_in_object!r}")
    sensor = options.sensor
    if rng is None:
        sensor = sensor.model_copy(update={"noise": 0.0, "random_taxels": 0.0})
        rng = np.random.default_rng(0)
    bed = _bed(levels(letter, options.press), pose[None], options)
    times = sequence = None
    if options.press.dynamics == "full" and bed.area.any():
        history = contact_history(bed.springs[0], pose, letter, options.press)
        times, sequence = history.times, _map(bed.repeat(len(history.times)), history.forces.ravel(), options)
        ideal = sequence[-1]
    else:
        ideal = _map(bed, contact_forces(bed, pose[None], letter, options.press), options)[0]
    return Press(ideal, sense(ideal[None], sensor, gains(options), rng)[0], times, sequence)


def ideal_readings(
    letter: models.Letter, poses: FloatArray, options: ScanOptions
) -> tuple[FloatArray, Counter[str]]:
    """Press `letter` at `poses` (n, 3) sensor_in_object and average the spread pressure per taxel.

    Returns (n, taxels) kPa without imperfections, and the work: presses, and what was skipped by reason.
    """
    face = levels(letter, options.press)
    bed = _bed(face, poses, options)
    forces = contact_forces(bed, poses, letter, options.press)
    return _map(bed, forces, options), _work(bed, face, letter, options)


def _work(bed: Bed, face: list[Level], letter: models.Letter, options: ScanOptions) -> Counter[str]:
    """Count presses and what each skip left out of them."""
    skip = options.press.skip
    touching = sum(springs.area > 0 for springs in bed.springs)
    untouched = len(bed.springs) - touching
    pressed = touching + (0 if skip.no_contact else untouched)
    x_lines, y_lines = _lines(options)
    cells = (len(x_lines) - 1) * (len(y_lines) - 1) * len(face)
    return Counter(
        presses=pressed,
        no_contact=untouched if skip.no_contact else 0,
        cells=touching * cells - len(bed.area) if skip.cells else 0,
        parts=pressed * len(letter.parts) if skip.parts else 0,
        stages=pressed * len(UNREAD_STAGES) if skip.stages else 0,
    )


def _bed(face: list[Level], poses: FloatArray, options: ScanOptions) -> Bed:
    return lay_bed(face, poses, *_lines(options), skip_empty=options.press.skip.cells)


def _lines(options: ScanOptions) -> tuple[FloatArray, FloatArray]:
    return options.pad.grid_lines(options.press.cells_per_taxel, gap_cells=options.sensor.psf_sigma == 0)


def _map(bed: Bed, forces: FloatArray, options: ScanOptions) -> FloatArray:
    return contact_map(bed, forces, options.pad, options.press.cells_per_taxel, options.sensor.psf_sigma)
