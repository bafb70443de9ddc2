"""Find how presses lie to each other of which nobody noted the poses: joint mapping and localisation.

A person presses an object fifty times, wherever. What is the same in all presses is the object. So the presses of an
object are laid over each other: turned in steps of 10 degrees and shifted by whole taxels, correlated by FFT. An object
that lies on one side or on another gives several pictures, its views.

    1. Compare all presses with each other, on a grid half as fine. The press that all others resemble most begins the
       first view; the one that adds most resemblance the next, while that is worth a view.
    2. Lay every press over the picture of the view that it fits best, and average the presses of each view. Again, over
       these pictures, which are clearer than single presses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, sparse

from tactsim.bench.placement import Properties, fold_angle, placement_error, properties
from tactsim.core import InputError, Scan
from tactsim.core.idle import find_idle
from tactsim.core.pad import pitch
from tactsim.core.poses import FloatArray, compose, invert, transform
from tactsim.core.provenance import NO_POSES, poses_unknown

ANGLES = 36
VIEWS = 3  # of an object, at most
_COARSER = 2.0  # times the pitch, where all presses are compared with all
# How much more of a press the pictures are to resemble, on average, for another view (the correlation is 1 at most).
_WORTH_A_VIEW = 0.02
_PASSES = 3
_FITS = 0.5  # a press that resembles no picture of others as much fits nowhere
_IDLE = 0.05  # of what presses feel at most: a press that feels no more is an idle frame


@dataclass(frozen=True, eq=False)
class Alignment:
    """How the presses of an object lie over its pictures.

    poses: (n, 3) sensor_in_object [mm, mm, rad]. views: (n,) from 0. resemblance: (n,) correlation of each press with
    its view's picture, at most 1; of one that is alone in its view, with the press that it resembles most.
    """

    poses: FloatArray
    views: NDArray[np.int64]
    resemblance: FloatArray


def align(
    scan: Scan, *, withheld: bool = False, progress: Callable[[int, int], None] | None = None
) -> tuple[Scan, dict[str, Alignment]]:
    """Find the poses of the training presses of each object, and its views.

    Returns the scan with these poses, `views`, `presses`, and `meta["aligned"]`: of each object how many presses each
    view has, and the mean resemblance. Its `meta["poses"]` still says that those of test presses are unknown. Frames
    begin in the middle of what was felt. progress(done, total) counts objects.

    withheld: the poses are known, and not looked at, to see what is found without them. Each view is brought to the
    frame of the true ones, which no press tells, by the rigid motion that fits best; test poses, and what the scan says
    of poses, stay.

    Raises InputError if poses are known and not withheld, or the other way round, for idle frames, too few readings
    that are not 0 at rest, objects with fewer than two training presses, two objects with a press in common, and a
    press that fits nowhere.
    """
    train = scan.where("train")
    if not len(train):
        raise InputError("the scan has no training presses to align")
    known = not poses_unknown(scan.meta) and bool(np.ptp(train.poses, axis=0).any())
    if known and not withheld:
        raise InputError(
            "the scan states the poses of its training presses; say --poses unknown (in Python withheld=True) to see "
            "what is found without them"
        )
    if withheld and not known:
        states = "says that nobody noted poses" if poses_unknown(scan.meta) else "has all presses at one pose"
        raise InputError(
            f"the scan {states}, so there are none to withhold: leave out --poses unknown (in Python withheld)"
        )
    idle, least = find_idle(train.readings, train.presses), np.abs(train.readings).min(axis=0)
    if not idle.known.any() and np.median(least) > _IDLE * np.ptp(train.readings):
        raise InputError(
            f"what taxels read at rest is not 0, and {len(train)} training presses are too few to find it; import or "
            "replay them with --zero or --idle"
        )
    rise = np.clip(idle.rise(train.readings), 0, None)
    most, nothing = rise.max(axis=1), "are idle frames, which feel next to nothing: {}; leave them out"
    refuse_presses(train, most <= _IDLE * np.median(most), "training presses", nothing)
    for label in train.letters:
        if np.count_nonzero(train.labels == label) < 2:
            raise InputError(f"{label!r} has one training press; two or more can be laid over each other")
    check_labels_apart(train, np.ones(len(train), dtype=bool))
    objects = properties(scan) if withheld else {}
    found: dict[str, Alignment] = {}
    poses, views = scan.poses.copy(), np.zeros(len(scan), dtype=np.int64)
    for number, label in enumerate(train.letters):
        own = np.flatnonzero((scan.labels == label) & (scan.split == "train"))
        found[label] = align_presses(rise[train.labels == label], scan.taxel_xy)
        poor = int(found[label].resemblance.argmin())
        if found[label].resemblance[poor] < _FITS:
            raise InputError(
                f"press {poor + 1} of the {len(own)} training presses of {label!r} fits nowhere: it resembles the "
                f"others by {found[label].resemblance[poor]:.2f} of 1; was another object pressed? Leave it out"
            )
        if withheld:
            found[label] = _in_frame_of(found[label], scan.poses[own], objects[label])
        poses[own], views[own] = found[label].poses, found[label].views
        if progress is not None:
            progress(number + 1, len(train.letters))
    said = {
        label: {"presses": np.bincount(one.views).tolist(), "resemblance": float(one.resemblance.mean())}
        for label, one in found.items()
    }
    meta = {**scan.meta, "aligned": said} | ({} if withheld else NO_POSES)
    presses = scan.press_numbers
    views_of = views if views.any() else None
    return replace(scan, poses=poses, views=views_of, presses=presses, meta=meta), found


def refuse_presses(scan: Scan, wrong: NDArray[np.bool_], kind: str, what: str) -> None:
    """Raise InputError if some presses (n,) are `wrong`, with the numbers of the first label's in place of `{}`."""
    for label in scan.letters:
        own = wrong[scan.labels == label]
        if own.any():
            numbers = ", ".join(map(str, np.flatnonzero(own)[:10] + 1))
            raise InputError(f"of the {len(own)} {kind} of {label!r} these {what.format(numbers)}")


def check_labels_apart(scan: Scan, judged: NDArray[np.bool_]) -> None:
    """Raise InputError if two labels have a press in common, of those that are `judged`, (n,)."""
    first: dict[bytes, tuple[str, int]] = {}
    for label in scan.letters:
        for number, row in enumerate(np.flatnonzero(scan.labels == label), 1):
            here = label, number
            other, place = first.setdefault(scan.readings[row].tobytes(), here) if judged[row] else here
            if other != label:
                raise InputError(
                    f"press {number} of {label!r} is press {place} of {other!r}, to the last bit: the same object "
                    "under two labels, or a file read twice"
                )


def align_presses(rise: FloatArray, taxel_xy: FloatArray) -> Alignment:
    """Lay the presses of one object over each other. rise: (n, taxels) above the idle level. taxel_xy: (taxels, 2) mm.

    The roots of readings are compared: so one taxel that reads very much does not decide alone.
    """
    felt, fine = np.sqrt(rise), pitch(taxel_xy)
    coarse = Turned(felt, taxel_xy, _COARSER * fine)
    alike = np.eye(len(felt))
    for k in range(len(felt) - 1):
        rest = np.arange(k + 1, len(felt))
        alike[k, rest] = alike[rest, k] = coarse.laid_over(coarse.images[0][k], rest)[0]
    presses = Turned(felt, taxel_xy, fine)
    pictures = [presses.images[0][k] for k in _begin(alike)]
    every = np.arange(len(felt))
    for _ in range(_PASSES):
        each = [presses.laid_over(picture, every) for picture in pictures]
        resemblance = np.array([of_view for of_view, _ in each])
        views = resemblance.argmax(axis=0)
        _, views = np.unique(views, return_inverse=True)  # without those that no press fits best
        lies = np.array([each[view][1] for view in range(len(each))])[resemblance.argmax(axis=0), every]
        pictures = [presses.mean(np.flatnonzero(views == view), lies) for view in range(views.max() + 1)]
    np.fill_diagonal(alike, 0.0)
    alone = np.bincount(views)[views] == 1
    return Alignment(presses.poses(lies), views, np.where(alone, alike.max(axis=1), resemblance.max(axis=0)))


def _in_frame_of(found: Alignment, true: FloatArray, of: Properties) -> Alignment:
    """Bring the poses of each view to the frame of true ones (n, 3), by the rigid motion that fits best.

    It begins with the press that brings most others nearest. Then it is that of the least mean square of the placement
    error of the half that lies nearest, so that presses that lie elsewhere have no say. The error's parts, how far the
    object's centre is off and how far it is turned but for its symmetry, are least each by itself.
    """
    poses = found.poses.copy()
    for view in range(found.views.max() + 1):
        own = np.flatnonzero(found.views == view)
        lies, truly = poses[own], true[own]
        centre = np.column_stack([transform(invert(truly), np.array([of.centre]))[:, 0], np.zeros(len(own))])
        seen, turns = compose(lies, centre)[:, :2], truly[:, 2] - lies[:, 2]
        tried = [_motion(turn, place, of) for turn, place in zip(turns, seen, strict=True)]
        off = np.array([placement_error(compose(motion, lies), truly, of) for motion in tried])
        best = int(np.median(off, axis=1).argmin())
        motion, nearest = tried[best], off[best].argsort()[: (len(own) + 1) // 2]
        for _ in range(_PASSES):
            turn = motion[2] + fold_angle(turns[nearest] - motion[2], of.symmetry).mean()
            motion = _motion(turn, seen[nearest].mean(axis=0), of)
            nearest = placement_error(compose(motion, lies), truly, of).argsort()[: len(nearest)]
        poses[own] = compose(motion, lies)
    return replace(found, poses=poses)


def _motion(turn: float, place: FloatArray, of: Properties) -> FloatArray:
    """Make the rigid motion (3,) that turns by `turn` rad and brings `place` (2,) mm to the object's centre."""
    return np.append(of.centre - transform([0, 0, turn], place[None])[0], turn)


def _begin(alike: FloatArray) -> list[int]:
    """Choose the presses that the views begin with, from how much all resemble each other (n, n)."""
    chosen: list[int] = []
    best = np.zeros(len(alike))
    while len(chosen) < VIEWS:
        mean = np.maximum(alike, best[:, None]).mean(axis=0)
        press = int(mean.argmax())
        if chosen and mean[press] - best.mean() < _WORTH_A_VIEW:
            break
        chosen.append(press)
        best = np.maximum(best, alike[press])
    return chosen


class Turned:
    """Presses as images on a square grid, turned by each of ANGLES angles about the middle of the pad.

    images: (angles, n, side, side). A grid is large enough that no press meets itself around its edge.
    """

    def __init__(self, felt: FloatArray, taxel_xy: FloatArray, cell: float) -> None:
        self.middle = (taxel_xy.min(axis=0) + taxel_xy.max(axis=0)) / 2
        self.cell = cell
        xy = taxel_xy - self.middle
        self.side = int(fft.next_fast_len(int(4 * np.hypot(*xy.T).max() / cell) + 6, real=True))
        self.angles = np.arange(ANGLES) * 2 * np.pi / ANGLES
        self.images = np.array([self._turned(felt, xy, angle) for angle in self.angles])
        self._norms = np.sqrt((self.images**2).sum(axis=(2, 3)))
        self._spectra = fft.rfft2(self.images)

    def _turned(self, felt: FloatArray, xy: FloatArray, angle: float) -> NDArray[np.float32]:
        """Share each taxel's reading among the four cells around it, and average in each cell."""
        cos, sin = np.cos(angle), np.sin(angle)
        place = xy @ np.array([[cos, sin], [-sin, cos]]) / self.cell + self.side // 2
        corner = np.floor(place).astype(np.intp)
        x, y = (place - corner).T
        shares = sparse.csr_matrix((self.side**2, len(xy)))
        for right, across in ((0, 1 - x), (1, x)):
            for up, along in ((0, 1 - y), (1, y)):
                cells = (corner[:, 1] + up) * self.side + corner[:, 0] + right
                shares += sparse.csr_matrix(
                    (across * along, (cells, np.arange(len(xy)))), shape=(self.side**2, len(xy))
                )
        whole = np.maximum(np.asarray(shares.sum(axis=1)), 0.5)
        return ((shares @ felt.T) / whole).T.reshape(len(felt), self.side, self.side).astype(np.float32)

    def laid_over(
        self, picture: NDArray[np.float32], rows: NDArray[np.intp]
    ) -> tuple[FloatArray, NDArray[np.intp]]:
        """Lay some presses over a picture (side, side), each where it resembles it most.

        Returns the correlations (rows,), and (rows, 3) the angle's number and the shift along y and x in cells.
        """
        best, lies = np.full(len(rows), -1.0), np.zeros((len(rows), 3), dtype=np.intp)
        spectrum, norm = fft.rfft2(picture), np.sqrt((picture**2).sum())
        for number in range(ANGLES):
            products = fft.irfft2(spectrum * np.conj(self._spectra[number, rows]), (self.side, self.side))
            products = products.reshape(len(rows), -1)
            top = products.argmax(axis=1)
            value = products[np.arange(len(rows)), top] / (self._norms[number, rows] * norm)
            more = value > best
            best[more] = value[more]
            lies[more] = np.column_stack([np.full(len(rows), number), *np.divmod(top, self.side)])[more]
        return best, lies

    def mean(self, rows: NDArray[np.intp], lies: NDArray[np.intp]) -> NDArray[np.float32]:
        """Average presses as they lie: (side, side)."""
        moved = [np.roll(self.images[lies[k, 0], k], lies[k, 1:], (0, 1)) for k in rows]
        return np.asarray(np.mean(moved, axis=0))

    def poses(self, lies: NDArray[np.intp]) -> FloatArray:
        """Give sensor_in_object (n, 3), mm and rad, of presses as they lie."""
        shift = (lies[:, 1:] + self.side // 2) % self.side - self.side // 2
        angle = self.angles[lies[:, 0]]
        cos, sin = np.cos(angle), np.sin(angle)
        x, y = self.middle
        back = np.column_stack([cos * x - sin * y, sin * x + cos * y])
        return np.column_stack([shift[:, ::-1] * self.cell - back, angle])
