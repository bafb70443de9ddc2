"""The images of presses on their way to rest, for a scan: through time, or at rest under one load after another.

A press that is worked out at rest has no course of its own. Its images are those at rest under each load that the
force control asks for on its ramp (`ForceControl.set_point`), as of a carriage that is slow beside the pad: relief,
which no press through time covers, shows what it touches first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.npz import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.press.dynamics import Moving
from tactsim.press.scan_options import PressOptions

# The whole load is held for so large a part of the ramp, and for so many images, as a plateau needs to be known as one.
_HELD, _LEAST_HELD = 0.5, 4


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


def check_size(presses: int, frames: int, taxels: int) -> None:
    """Raise InputError if so many images would take more than a scan's file may hold."""
    size = 4 * presses * frames * taxels
    if size > LARGEST // 2:
        raise InputError(
            f"{presses:,} presses of {frames:,} images are {size:,} bytes, more than a scan's "
            f"{LARGEST // 2:,}; choose a lower press.frame_rate or fewer letters"
        )


def rising(press: PressOptions) -> FloatArray:
    """Give the shares of the whole load at the images of the ramp, (frames,) rising, all above 0 and below 1.

    share = s^2 (3 - 2 s) at times s of the ramp, `frame_rate` images a second.
    """
    s = np.arange(1, int(np.ceil(press.ramp * press.frame_rate))) / (press.ramp * press.frame_rate)
    return s * s * (3 - 2 * s)


def held(
    images: FloatArray, loads: FloatArray, press: PressOptions
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hold the last image of presses at rest: images (n, frames, taxels), times (frames,) s, force (n, frames) N.

    images: (n, rising + 1, taxels) kPa, at the shares of `rising` and at the whole load. loads: (n,) N. Where nothing
    touches there is no force. Raises InputError if the images would take more than a scan's file may hold.
    """
    shares = rising(press)
    more = max(_LEAST_HELD, int(_HELD * press.ramp * press.frame_rate))
    count, _, taxels = images.shape
    frames = len(shares) + 1 + more
    check_size(count, frames, taxels)
    images = np.concatenate([images, np.repeat(images[:, -1:], more, axis=1)], axis=1)
    force = loads[:, None] * np.concatenate([shares, np.ones(1 + more)])
    force[~images[:, -1].any(axis=1)] = 0.0
    return images, np.arange(1, frames + 1) / press.frame_rate, force
