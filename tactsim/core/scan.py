"""`Scan`: tactile readings with the poses at which they were taken, and the file that holds them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError, short, unknown
from tactsim.core.finite import finite
from tactsim.core.poses import POSE, FloatArray
from tactsim.core.provenance import check_statements

if TYPE_CHECKING:
    from tactsim.core.making import Batch
    from tactsim.core.pad import Pad

SPLITS = ("train", "test")
SEQUENCE = ("sequence", "sequence_times", "sequence_force")
OF_PRESSES = ("loads", "presses", "moments", "views")
_LONGEST_NAME = 100  # characters of a label
MOST_TURNED = 4 * np.pi  # rad: two turns each way are more than a wrist makes


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """Readings of objects pressed against a pad at known poses, in the plane; `SpaceScan` is one in space.

    readings: (n, taxels) kPa. poses: (n, 3) sensor_in_object [mm, mm, rad]. labels: (n,) names of the objects. split:
    (n,) "train" or "test". taxel_xy: (taxels, 2) mm, the taxels' centres in the sensor frame. meta: how it was made, a
    JSON object; `meta["objects"][label]` holds, where known, `symmetry` (order of the rotational symmetry, 0 for a
    disc), `centre` ([x, y] mm) and `inertia_over_mass` (mm^2). `meta["unit"]` is the unit of the readings if it is not
    kPa, `meta["licence"]` the licence by its SPDX name; `about` collects what a scan says of itself.

    A scan may also hold the images of each press on its way to rest: sequence: (n, frames, taxels) kPa, float32.
    sequence_times: (frames,) s since the letter began to move, the same for all presses; a press that rests earlier
    keeps its last image until then. sequence_force: (n, frames) N, the contact force, float32. All three or none.

    loads: (n,) N, with how much force each press was made, as a gauge said or as it was set; NaN where nobody knows.
    None if no press's is known.

    presses: (n,) whole numbers. Readings of one number were taken of one press: its moments, or the windows that its
    image was cut into. They share its errors. None: each reading is of a press of its own.

    moments: (n,) the share of its press's load at which each reading was taken, above 0, at most 1. None: all were
    taken under the whole load, or nobody knows.

    views: (n,) whole numbers, which of its object's pictures a training reading belongs to, where one does not do: an
    object that lies on one side or on another gives two. Each view has a frame of its own. None: each object has one.

    Raises InputError when shapes disagree, there are no taxels, a number is not finite or beyond 1e9, a
    label is empty, over 100 characters long or not printable, a split has another name, `meta` is not JSON, or it
    states an unknown unit.
    """

    readings: FloatArray
    poses: FloatArray
    labels: NDArray[np.str_]
    split: NDArray[np.str_]
    taxel_xy: FloatArray
    meta: Mapping[str, Any] = field(default_factory=dict)
    sequence: NDArray[np.float32] | None = None
    sequence_times: FloatArray | None = None
    sequence_force: NDArray[np.float32] | None = None
    loads: FloatArray | None = None
    presses: NDArray[np.int64] | None = None
    moments: FloatArray | None = None
    views: NDArray[np.int64] | None = None

    # What differs of a scan in space, see `space_scan`: the numbers of a pose, the arrays of a file, which of them have
    # an entry a reading, and the command that makes one.
    kind: ClassVar[str] = "plane"  # of run, that such readings are for (`tactsim.bench.kinds`)
    POSE: ClassVar[tuple[str, ...]] = POSE
    _ARRAYS: ClassVar[tuple[str, ...]] = ("readings", "poses", "labels", "split", "taxel_xy")
    _OPTIONAL: ClassVar[tuple[str, ...]] = SEQUENCE + OF_PRESSES
    PER_READING: ClassVar[tuple[str, ...]] = (
        "readings", "poses", "labels", "split", "sequence", "sequence_force", "loads", "presses",
        "moments", "views",
    )  # fmt: skip
    _MADE_BY: ClassVar[str] = "`bench scan --out FILE`, or of readings of your own with `bench import`"

    def __post_init__(self) -> None:
        self._check_arrays()
        given = {
            name: values for name in SEQUENCE + OF_PRESSES if (values := getattr(self, name)) is not None
        }
        if given:
            from tactsim.core.making import checked_entries

            for name, array in checked_entries(given, *self.readings.shape).items():
                object.__setattr__(self, name, array)
        for label in self.letters:
            if not is_label(label):
                raise InputError(
                    f"scan: the label {label[:_LONGEST_NAME]!r} is empty, too long or not printable"
                )
        try:
            json.dumps(self.meta, allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"scan: meta is no JSON without NaN and infinity: {error}") from None
        check_statements(self.meta)
        other = sorted(set(self.split.tolist()) - set(SPLITS))
        if other:
            raise InputError(f"scan: split says {other[0]!r}; only 'train' and 'test' have a meaning")

    def _check_arrays(self) -> None:
        for name in ("readings", "poses", "taxel_xy"):
            object.__setattr__(self, name, as_numbers(name, getattr(self, name), 2))
        for name in ("labels", "split"):
            object.__setattr__(self, name, as_names(name, getattr(self, name)))
        count, taxels = self.readings.shape
        self._check_shapes(
            poses=(count, len(self.POSE)), labels=(count,), split=(count,), taxel_xy=(taxels, 2)
        )

    def _check_shapes(self, **wanted: tuple[int, ...]) -> None:
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"scan: {name} has shape {getattr(self, name).shape}, but readings of shape "
                    f"{self.readings.shape} ask for {shape}"
                )
        if not self.readings.shape[1]:
            raise InputError("scan: readings have no taxels")

    def __len__(self) -> int:
        return len(self.readings)

    def __repr__(self) -> str:
        """Say in one line what was read: a notebook shows it."""
        counts = ", ".join(f"{np.count_nonzero(self.split == split):,} to {split}" for split in SPLITS)
        names = short(" ".join(self.letters)).strip("'\"")
        return f"<{type(self).__name__} of {names}: {counts}, {self.readings.shape[1]} taxels>"

    @classmethod
    def from_arrays(
        cls,
        readings: Any,
        poses: Any = None,
        labels: Any = None,
        split: Any = None,
        pad: Pad | None = None,
        *,
        unit: str = "kPa",
        licence: str | None = None,
        loads: Any = None,
        presses: Any = None,
        moments: Any = None,
    ) -> Scan:
        """Make a scan of arrays from elsewhere.

        readings: (n, taxels) or (n, rows, columns); (n, images, taxels) or (n, images, rows, columns) where several
        images were taken of a press, whose mean is its reading. poses: (n, 3) sensor_in_object, mm, mm, rad; None:
        nobody noted them, as `meta["poses"]` then says. labels: (n,) names or whole numbers. split: (n,) "train" or
        "test", or whether to train on it; None: all to train. pad: None for the paper's. unit: of the readings; other
        pressures, such as mmHg, become kPa. licence: an SPDX name. loads: (n,) N, NaN where not known. presses: (n,)
        whole numbers, the same for readings of one press. moments: (n,) the share of its press's load at which each
        reading was taken. A taxel that reads NaN, or is masked, in more than a twentieth of the presses is left out, as
        `meta["left_out"]` says, else the presses in which one does; it is logged. Columns of a table go by their names:
        t0, t1, ...; x_mm, y_mm, theta_rad.

        Raises InputError when shapes disagree, without labels, for angles that are degrees, and for what `Scan`
        refuses.
        """
        from tactsim.core.making import scan_of

        each = {"loads": loads, "presses": presses, "moments": moments}
        return scan_of(cls, readings, poses, labels, split, pad, unit, licence, each)

    @property
    def letters(self) -> tuple[str, ...]:
        """List the labels in the order of their first appearance."""
        return tuple(dict.fromkeys(self.labels.tolist()))

    @property
    def press_numbers(self) -> NDArray[np.int64]:
        """Number the press that each reading was taken of, (n,); without `presses` each is of one of its own."""
        return np.arange(len(self)) if self.presses is None else self.presses

    @property
    def at_one_pose(self) -> bool:
        """Tell whether each object has all of its readings stated at one pose."""
        return not any(np.ptp(self.poses[self.labels == label], axis=0).any() for label in self.letters)

    @property
    def about(self) -> dict[str, Any]:
        """Say units, frames, pad, licence and how the scan was made, as `provenance.statements` lists them."""
        from tactsim.core.making import statements

        return statements(self.meta)

    @property
    def _arrays(self) -> tuple[str, ...]:
        return self._ARRAYS + tuple(name for name in self._OPTIONAL if getattr(self, name) is not None)

    @cached_property
    def digest(self) -> str:
        """Name the scan by its content: equal scans have equal digests (SHA-256, hex)."""
        content = sha256(json.dumps(self.meta, sort_keys=True).encode())
        for name in self._arrays:
            array = np.ascontiguousarray(getattr(self, name))
            content.update(f"{name} {array.dtype.str} {array.shape}".encode())
            content.update(array.tobytes())
        return content.hexdigest()

    def where(self, split: str | None = None, label: str | None = None) -> Self:
        """Select the readings of one split and/or one label, in their order; none of a label that is not there.

        Raises InputError for a split that is neither "train" nor "test".
        """
        chosen = np.ones(len(self), dtype=bool)
        if split is not None:
            if split not in SPLITS:
                raise unknown("split", split, SPLITS)
            chosen &= self.split == split
        if label is not None:
            chosen &= self.labels == label
        return self.chosen(chosen)

    def of_letters(self, letters: Iterable[str]) -> Self:
        """Select the readings of these letters, in their order."""
        return self.chosen(np.isin(self.labels, list(letters)))

    def untrained(self, letters: Iterable[str]) -> Self:
        """Leave out the training readings of these letters, so that they are unknown objects."""
        return self.chosen((self.split != "train") | ~np.isin(self.labels, list(letters)))

    def by_view(self) -> tuple[Self, dict[str, str]]:
        """Label the training readings of each view by themselves, and say of which object each label is.

        Raises InputError if an object is called as a view of another is.
        """
        if self.views is None:
            return self, {letter: letter for letter in self.letters}
        names, object_of = self.labels.astype(object), {}
        for letter in self.letters:
            own = (self.labels == letter) & (self.split == "train")
            for number, view in enumerate(np.unique(self.views[own]).tolist() or [0]):
                name = letter if number == 0 else f"{letter}, view {number + 1}"
                if name in object_of or (number and name in self.letters):
                    raise InputError(f"scan: an object is called {name!r}, which is a view of {letter!r}")
                names[own & (self.views == view)], object_of[name] = name, letter
        return replace(self, labels=names.astype(np.str_), views=None), object_of

    def with_train_presses(self, count: int, rng: np.random.Generator) -> Self:
        """Keep that many training presses of each object, spread as far as they go, from one that is drawn.

        A press is a reading where the scan does not say `presses`. Those of a smaller count are among those of a larger
        one. Raises InputError if an object has fewer.
        """
        from tactsim.core.making import with_train_presses

        return with_train_presses(self, count, rng)

    def joined(self, other: Scan, meta: Mapping[str, Any]) -> Scan:
        """Append another scan of the same pad; the result has the given `meta`.

        Sequences are kept if both scans have them at the same times, one of them perhaps for longer.
        Raises InputError if the taxels lie elsewhere or the readings have another unit.
        """
        from tactsim.core.making import joined

        return joined(self, other, meta)

    def batches(
        self, trials: int, readings: int, rng: np.random.Generator, split: str = "train"
    ) -> Iterator[Batch]:
        """Draw trials as a run does, many at once and without end, for a method that learns from them.

        trials, readings: of a batch, and of each of its trials. Each trial hides one of the scan's objects, all alike,
        at x and y uniform in +-10 mm (in proportion to the pad) and at any angle (paper, section IV), and takes
        readings of it without replacement.

        Raises InputError for a scan of another kind, a number below 1, and an object with fewer readings.
        """
        from tactsim.core.making import batches

        return batches(self, trials, readings, rng, split)

    def licensed(self, licence: str) -> Scan:
        """State the licence of the readings, by its SPDX name.

        Raises InputError if it is no such name, or if they state another one.
        """
        from tactsim.core.making import licensed

        return licensed(self, licence)

    def on_taxels_of(self, other: Scan) -> Scan:
        """Keep the taxels that `other` has at the same places, in the order of this scan.

        A recorded scan leaves out taxels that are dead or stuck. Raises InputError if there are none.
        """
        apart = np.abs(self.taxel_xy[:, None] - other.taxel_xy[None]).max(axis=-1, initial=0.0)
        shared = (apart < 1e-3).any(axis=1)  # mm
        if not shared.any():
            raise InputError(
                "two scans have no taxel at the same place: their pads differ, so neither teaches about the other"
            )
        sequence = None if self.sequence is None else self.sequence[:, :, shared]
        return replace(
            self, readings=self.readings[:, shared], taxel_xy=self.taxel_xy[shared], sequence=sequence
        )

    def chosen(self, chosen: NDArray[Any]) -> Self:
        """Select readings by a mask (n,), or by their numbers (k,), in the order of these."""
        given = [name for name in self.PER_READING if getattr(self, name) is not None]
        return replace(self, **{name: getattr(self, name)[chosen] for name in given})

    def save(self, path: str | Path) -> None:
        """Write the scan as .npz: its arrays and `meta`, a JSON string. Whole or not at all.

        The same scan gives the same bytes. Raises InputError if `path` cannot be written.
        """
        from tactsim.core.npz import write_npz

        write_npz(path, self.meta, {name: getattr(self, name) for name in self._arrays})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a scan written by `save`; nothing in the file is unpickled or run.

        Raises InputError if the file is missing, cut short, of another kind, claims more than 1 GiB
        or holds what `Scan` refuses.
        """
        from tactsim.core.making import loaded

        return loaded(cls, path)


def is_label(name: str) -> bool:
    """Tell whether `name` can label an object: 1 to 100 printable characters."""
    return name.isprintable() and 0 < len(name) <= _LONGEST_NAME


def as_numbers(name: str, values: Any, axes: int, kind: Any = float) -> NDArray[Any]:
    """Return finite numbers along so many axes, read only. Raises InputError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.ndim != axes:
        what = "a table of numbers" if axes == 2 else f"numbers along {axes} axes"
        raise InputError(f"scan: {name} must be {what}, got {array.dtype} {array.shape}")
    array = finite(array, f"scan: {name}").astype(kind)
    array.setflags(write=False)
    return array


def as_names(name: str, values: Any) -> NDArray[np.str_]:
    """Return texts, read only. Raises InputError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind != "U" and array.size:
        raise InputError(f"scan: {name} must be names, got {array.dtype}")
    array = array.astype(np.str_)
    try:
        longest = max(map(len, array.ravel().tolist()), default=0)
    except (ValueError, SystemError) as error:  # a code beyond Unicode
        raise InputError(f"scan: {name} are no text: {error}") from None
    array = array.astype(f"U{max(longest, 1)}")  # so that equal scans are alike, bit for bit
    array.setflags(write=False)
    return array
