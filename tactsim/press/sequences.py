"""Press letters through time for a scan: how each press settles, and its images at times common to all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.engine import Moving, ideal_sequence
from tactsim.press.rise import check_size
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import UnsettledError
from tactsim.press.sensor import hysteretic
from tactsim.press.touches import Touches


@dataclass(frozen=True, eq=False)
class Course:
    """How presses went that were stepped through time.

    settle_time: (touching,) s from touch until the force stays within 2 % of the set force. overshoot:
    (touching,) share of the set force. moving: of every press, None where nothing touched; empty if not kept.
    """

    settle_time: FloatArray
    overshoot: FloatArray
    moving: list[Moving | None]


def press_each(
    touches: Touches, options: ScanOptions, *, keep: bool
) -> tuple[FloatArray, dict[int, str], Counter[str], Course]:
    """Press a letter through time: its readings at rest, the blanks with their reasons, the work and the course.

    The readings are (n, taxels) kPa without imperfections but hysteresis, which the way to rest decides.
    keep: whether the images are kept.
    """
    readings = np.zeros((len(touches), options.pad.taxels))
    blanks: dict[int, str] = {}
    settle_time, overshoot = [], []
    kept: list[Moving | None] = []
    untouched = 0
    for index in range(len(touches)):
        moving = None
        try:
            moving = ideal_sequence(touches.some(slice(index, index + 1)), options)
        except UnsettledError as error:
            blanks[index] = str(error.__cause__)
        else:
            untouched += moving is None
        if moving is not None:
            readings[index] = hysteretic(moving.images, options.sensor.hysteresis)[-1]
            settle_time.append(moving.trace.settle_time)
            overshoot.append(moving.trace.overshoot)
        if keep:
            kept.append(moving)
    presses = len(touches) - untouched
    work = Counter(presses=presses, no_contact=untouched, engine_full=presses)
    return readings, blanks, work, Course(np.array(settle_time), np.array(overshoot), kept)


def aligned(presses: Sequence[Moving | None], frame_rate: float, taxels: int) -> tuple[FloatArray, ...]:
    """Bring presses to common times: images (n, frames, taxels) kPa, times (frames,) s, force (n, frames) N.

    Times are k / frame_rate until the last press rests; a press at rest keeps its last image. Where nothing
    touched, all is 0. Raises InputError if the images would take more than a scan's file may hold.
    """
    frames = max([1, *(len(moving.times) for moving in presses if moving is not None)])
    check_size(len(presses), frames, taxels)
    times = np.arange(1, frames + 1) / frame_rate
    images, force = np.zeros((len(presses), frames, taxels)), np.zeros((len(presses), frames))
    for image, total, moving in zip(images, force, presses, strict=True):
        if moving is not None:
            before = len(moving.times) - 1
            image[:before], image[before:] = moving.images[:-1], moving.images[-1]
            total[:] = np.interp(times, moving.trace.times, moving.trace.force)
    return images, times, force
