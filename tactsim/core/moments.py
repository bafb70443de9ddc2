"""Several moments of each press: images at shares of its load, found in what was felt while it was made."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError, short
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan

MOST = 20  # moments of a press
_AUTO = 4
# A press holds still while what is felt stays so near to its plateau, as a share of that.
_BAND = 0.1
# It must do so for so many images, and for so large a share of the images in which the pad is touched at all.
_LEAST_IMAGES, _LEAST_SHARE = 3, 0.3
# The pad is touched while more than this share of the plateau is felt.
_TOUCHED = 0.2
# A moment lies between two images whose loads differ by this share of the plateau's at most.
_STEP = 0.35
# A press whose plateau is not so many times the noise of an image says nothing of its load.
_CLEAR = 5.0


def shares_of(moments: int | Literal["auto"]) -> FloatArray:
    """Give the shares of the plateau's load at which so many moments of a press are taken: 1/m, 2/m ... 1.

    "auto" is 4. Raises InputError for a number that is not from 1 to 20.
    """
    count = _AUTO if moments == "auto" else moments
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise InputError(f"moments is {short(moments)}; give a whole number from 1 to {MOST}, or auto")
    return np.arange(1, count + 1) / count


def plateau(felt: FloatArray) -> slice | None:
    """Find the images between which a press holds still, in what the pad felt of it.

    felt: (frames,) the sum over the taxels in any unit, of one press: idle, a rise, a plateau, perhaps a fall.
    Returns None where it never holds still: for three images at least, and three tenths of the time of touch.
    """
    if len(felt) < _LEAST_IMAGES:
        return None
    smooth = np.median(np.stack([np.roll(np.pad(felt, 1, mode="edge"), k)[1:-1] for k in (-1, 0, 1)]), axis=0)
    top = float(smooth.max())
    if not top > 0:
        return None
    level = float(np.median(smooth[_longest(smooth > (1 - 2 * _BAND) * top)]))
    held = _longest(np.abs(smooth - level) <= _BAND * level)
    count = held.stop - held.start
    touched = np.count_nonzero(smooth > _TOUCHED * level)
    return held if count >= _LEAST_IMAGES and count >= _LEAST_SHARE * touched else None


def moments_of(
    images: FloatArray, shares: FloatArray, load: FloatArray
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Take the images of one press at shares of its plateau's load, on the rise.

    images: (frames, taxels) in any unit. shares: (m,) rising, above 0, at most 1; 1 is the median of the plateau. load:
    (frames,) the contact force, N, or what all taxels feel together. An image between two frames is interpolated.
    Returns which of the moments there are, (m,), and their images, (m, taxels). There are none without a plateau or
    below the noise, and none between two frames that are further apart than a third of the load.
    """
    found = np.zeros(len(shares), dtype=bool)
    taken = np.zeros((len(shares), images.shape[1]))
    held = plateau(load)
    if held is None:
        return found, taken
    level = float(np.median(load[held]))
    if level < _CLEAR * float(np.std(np.diff(load[held]))) / np.sqrt(2):
        return found, taken
    for number, share in enumerate(shares):
        if share >= 1:
            taken[number], found[number] = np.median(images[held], axis=0), True
            continue
        below = np.flatnonzero(load[: held.start + 1] <= share * level)
        if not len(below):
            continue
        before = int(below[-1])
        low, high = float(load[before]), float(load[before + 1])
        if high - low <= _STEP * level:
            part = (share * level - low) / (high - low)
            taken[number] = (1 - part) * images[before] + part * images[before + 1]
            found[number] = True
    return found, taken


def _images(scan: Scan, press: int) -> FloatArray:
    """Give the images of a press (frames, taxels). Raises InputError if the scan has none."""
    if scan.sequence is None:
        raise InputError(
            "the scan holds one image of each press, so it has no other moments; press with `bench scan --sequence`, "
            "or read recordings with `bench replay --moments`"
        )
    return scan.sequence[press].astype(float)


def _load(scan: Scan, press: int) -> FloatArray:
    """Give the load of a press at each image, (frames,): the contact force if it is known, else what is felt."""
    force = scan.sequence_force
    return (
        force[press].astype(float) if force is not None and force.any() else _images(scan, press).sum(axis=1)
    )


def with_moments(scan: Scan, moments: int | Literal["auto"] = "auto", split: str = "train") -> Scan:
    """Add to each press of a split its images at lower loads, as further readings at the same pose.

    moments: m; the images are those at 1/m, 2/m ... of the plateau's load; the last is the press's own reading.
    "auto" is 4 without the shares that fewer than half of the presses show. The load is the contact force where
    `sequence_force` has any, else what the taxels feel together. Each press's readings follow each other, the lightest
    first; `presses` says that they are of one, `moments` at which share of its load each was taken, and `loads` its
    load where the press's is known. The result has no
    sequences, and `meta["moments"]` says the shares, of which the load was taken, and how many presses have lower
    moments.

    Raises InputError if the scan has no sequences, the split no press, or none of its presses a plateau.
    """
    chosen = np.flatnonzero(scan.split == split)
    if not len(chosen):
        raise InputError(f"the scan has no press of the split {split!r} to take moments of")
    wanted = shares_of(moments)
    gauged = scan.sequence_force is not None and bool(scan.sequence_force.any())
    found = np.zeros((len(chosen), len(wanted)), dtype=bool)
    images = np.zeros((len(chosen), len(wanted), scan.readings.shape[1]))
    for row, press in enumerate(chosen.tolist()):
        load = _load(scan, press)
        found[row], images[row] = moments_of(_images(scan, press), wanted, load)
    if not found.any():
        raise InputError(
            f"no press of the split {split!r} comes to rest: none holds still for {_LEAST_IMAGES} images and three "
            "tenths of its time, so there is no plateau to take shares of"
        )
    if moments == "auto":
        found &= found.sum(axis=0) >= found[:, -1].sum() / 2
    found[:, -1] = False  # the reading itself is the moment at full load
    count = np.ones(len(scan), dtype=int)
    count[chosen] += found.sum(axis=1)
    rows = np.repeat(np.arange(len(scan)), count)
    last = np.cumsum(count) - 1
    share = np.ones(len(rows))
    readings = scan.readings[rows]
    lower = np.setdiff1d(np.arange(len(rows)), last)
    readings[lower] = images[found]
    share[lower] = np.broadcast_to(wanted, found.shape)[found]
    loads = scan.loads
    if loads is None and gauged:
        assert scan.sequence_force is not None
        loads = scan.sequence_force[:, -1].astype(float)
    said = {
        "shares": wanted[found.any(axis=0)].tolist() + [1.0],
        "of": "force" if gauged else "felt",
        "split": split,
        "presses": int(found.any(axis=1).sum()),
    }
    return Scan(
        readings, scan.poses[rows], scan.labels[rows], scan.split[rows], scan.taxel_xy,
        {**scan.meta, "moments": said}, loads=None if loads is None else loads[rows] * share,
        presses=scan.press_numbers[rows],
        moments=share if scan.moments is None else scan.moments[rows] * share,
    )  # fmt: skip


def at_load(scan: Scan, share: float, split: str = "test") -> Scan:
    """Exchange the readings of a split for the presses' images at a share of their load, on the rise.

    share: above 0, at most 1. A press that has no such moment is left out, unless it touches nothing: then its reading
    stays. So a scan with sequences tells how well lighter presses are recognised. The result has no sequences.
    Raises InputError as `with_moments` does.
    """
    if not 0 < share <= 1:
        raise InputError(f"share is {short(share)}; give a share of the load above 0, at most 1")
    chosen = np.flatnonzero(scan.split == split)
    readings, kept = np.array(scan.readings), np.ones(len(scan), dtype=bool)
    of_load = np.ones(len(scan))
    for press in chosen.tolist():
        load = _load(scan, press)
        found, images = moments_of(_images(scan, press), np.array([share]), load)
        if found[0]:
            readings[press], of_load[press] = images[0], share
        else:
            kept[press] = plateau(load) is None
    return Scan(
        readings[kept], scan.poses[kept], scan.labels[kept], scan.split[kept], scan.taxel_xy, scan.meta,
        loads=None if scan.loads is None else (scan.loads * of_load)[kept],
        presses=None if scan.presses is None else scan.presses[kept],
        moments=None if scan.moments is None else (scan.moments * of_load)[kept],
    )  # fmt: skip


def _longest(chosen: NDArray[np.bool_]) -> slice:
    """Find the longest run of True in (frames,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return slice(0, 0)
    longest = int(np.argmax(stops - starts))
    return slice(int(starts[longest]), int(stops[longest]))
