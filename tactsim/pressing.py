"""Press one letter: from its outline and a pose to what the pad would read."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import models
from models.errors import InputError
from tactsim.bed import lay_bed
from tactsim.clip import edges_of
from tactsim.equilibrium import contact_forces
from tactsim.options import ScanOptions
from tactsim.poses import FloatArray
from tactsim.sensor import contact_map, gains, sense


@dataclass(frozen=True, eq=False)
class Press:
    """What one press gives: `ideal` (taxels,) kPa without imperfections, `reading` (taxels,) kPa sensed."""

    ideal: FloatArray
    reading: FloatArray


def press_letter(
    letter: models.Letter,
    sensor_in_object: ArrayLike,
    options: ScanOptions | None = None,
    rng: np.random.Generator | None = None,
) -> Press:
    """Press `letter` at one pose [x, y, theta] (mm, rad), exactly there.

    Of `options` only pad, press and sensor count. `rng` draws gains and noise; without it neither is added.
    Raises InputError if the pose is not three finite numbers.
    """
    options = options or ScanOptions()
    pose = np.asarray(sensor_in_object, dtype=float)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InputError(f"a pose is three finite numbers [x mm, y mm, theta rad], got {sensor_in_object!r}")
    sensor = options.sensor
    if rng is None:
        sensor = sensor.model_copy(update={"noise": 0.0, "gain_spread": 0.0, "random_taxels": 0.0})
        rng = np.random.default_rng(0)
    ideal, _ = ideal_readings(letter, pose[None], options)
    gain = gains(options.pad.taxels, sensor, rng)
    return Press(ideal[0], sense(ideal, sensor, gain, rng)[0])


def ideal_readings(
    letter: models.Letter, poses: FloatArray, options: ScanOptions
) -> tuple[FloatArray, Counter[str]]:
    """Press `letter` at `poses` (n, 3) sensor_in_object and average the spread pressure per element.

    Returns (n, taxels) kPa without imperfections, and what was skipped.
    """
    pad, press, sensor = options.pad, options.press, options.sensor
    lines = pad.grid_lines(press.cells_per_element, gap_cells=sensor.psf_sigma == 0)
    bed = lay_bed(edges_of(letter.contours), poses, *lines)
    forces = contact_forces(bed, press.force)
    skipped = Counter(no_contact=int((np.diff(bed.start) == 0).sum()))
    return contact_map(bed, forces, pad, press.cells_per_element, sensor.psf_sigma), skipped
