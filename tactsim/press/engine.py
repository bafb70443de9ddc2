"""What an ideal pad would read of a letter at a pose: lay the bed, let it press, spread the forces over the taxels.

The way is `levels` (what of the letter can be met), `bed` (the springs that carry it), `contact_forces`
(what each carries, by MuJoCo) and `spread` (what the taxels feel of that). Nothing random happens here and
nothing that belongs to one sensor: its imperfections come afterwards, in `sensor`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from tactsim import models
from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed, Level, lay_bed
from tactsim.press.contact_forces import contact_forces, contact_history
from tactsim.press.dynamics import ForceTrace
from tactsim.press.levels import levels
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import UNREAD_STAGES
from tactsim.press.spread import contact_map


@dataclass(frozen=True, eq=False)
class Pressed:
    """A letter pressed at poses until it rests: the springs that carry it, and what each carries.

    forces: N, one a spring of `bed`. work: `presses`, and what was skipped by reason.
    """

    bed: Bed
    forces: FloatArray
    work: Counter[str]

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the forces over the taxels: (n, taxels) kPa without imperfections.

        `options` may differ from those of the press in the sensor's alone, and not in whether its point
        spread is 0, which the bed's springs depend on.
        """
        return _map(self.bed, self.forces, options)


@dataclass(frozen=True, eq=False)
class Moving:
    """The images of one press through time, (frames, taxels) kPa at times (frames,) s, and its force."""

    times: FloatArray
    images: FloatArray
    trace: ForceTrace


def ideal_readings(
    letter: models.Letter, poses: FloatArray, options: ScanOptions
) -> tuple[FloatArray, Counter[str]]:
    """Press `letter` at `poses` (n, 3) sensor_in_object [mm, mm, rad] until it rests.

    Returns (n, taxels) kPa without imperfections, and the work: `presses`, and what was skipped by reason.
    Raises UnsettledError, naming letter and pose, if a press does not come to rest; InputError if a letter
    with rounded edges is to be pressed by its parts.
    """
    pressed = press_at(letter, poses, options)
    return pressed.readings(options), pressed.work


def press_at(letter: models.Letter, poses: FloatArray, options: ScanOptions) -> Pressed:
    """Press `letter` at `poses` (n, 3) as `ideal_readings` does, and keep what the springs carry.

    Raises what `ideal_readings` does.
    """
    face = levels(letter, options.press)
    bed = _bed(face, poses, options)
    forces = contact_forces(bed, poses, letter, options.press)
    return Pressed(bed, forces, _work(bed, face, letter, options))


def ideal_sequence(letter: models.Letter, pose: FloatArray, options: ScanOptions) -> Moving | None:
    """Press `letter` at one pose (3,) through time: its images, or None where nothing touches.

    The last image is at rest and is the ideal reading.
    Raises what `ideal_readings` does.
    """
    bed = _bed(levels(letter, options.press), pose[None], options)
    if not bed.area.any():
        return None
    history = contact_history(bed.springs[0], pose, letter, options.press)
    images = _map(bed.repeat(len(history.times)), history.forces.ravel(), options)
    return Moving(history.times, images, history.trace)


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
