"""`Scan`: tactile readings with the poses at which they were taken, and the file that holds them."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tactsim.core.documents import parse_json
from tactsim.core.errors import InputError, short, unknown
from tactsim.core.finite import finite
from tactsim.core.npz import MissingArrayError, read_npz, write_npz
from tactsim.core.poses import POSE, FloatArray, compose, invert, spread_out
from tactsim.core.provenance import IN_KPA, check_statements, spdx_name, statements

if TYPE_CHECKING:
    from tactsim.core.pad import Pad

SPLITS = ("train", "test")
_SEQUENCE = ("sequence", "sequence_times", "sequence_force")
# What holds of so many readings where a scan does not say it: nobody knows the load, each is a press of its own, under
# the whole load, of its object's one view.
_UNSAID: dict[str, Callable[[int], NDArray[Any]]] = {
    "loads": lambda count: np.full(count, np.nan),
    "presses": np.arange,
    "moments": np.ones,
    "views": lambda count: np.zeros(count, np.int64),
}
_OF_PRESSES = tuple(_UNSAID)
_LONGEST_NAME = 100  # characters of a label
MOST_TURNED = 4 * np.pi  # rad: two turns each way are more than a wrist makes


class Batch(NamedTuple):
    """Trials as a method meets them, and what it is to find out.

    readings: (trials, readings, taxels), in the scan's unit. sensor_in_robot: (trials, readings, 3) mm, mm, rad.
    letter: (trials,) the index in the scan's `letters`. robot_in_object: (trials, 3) mm, mm, rad.
    """

    readings: FloatArray
    sensor_in_robot: FloatArray
    letter: NDArray[np.int64]
    robot_in_object: FloatArray


_POSE_COLUMNS = {"x": 0, "x_mm": 0, "y": 1, "y_mm": 1, "theta": 2, "theta_rad": 2}


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """Readings of objects pressed against a pad at known poses, in the plane; `SpaceScan` is one in space.

    readings: (n, taxels) kPa. poses: (n, 3) sensor_in_object [mm, mm, rad]. labels: (n,) names of
    the objects. split: (n,) "train" or "test". taxel_xy: (taxels, 2) mm, the taxels' centres in the
    sensor frame. meta: how it was made, a JSON object; `meta["objects"][label]` holds, where known,
    `symmetry` (order of the rotational symmetry, 0 for a disc), `centre` ([x, y] mm) and
    `inertia_over_mass` (mm^2). `meta["unit"]` is the unit of the readings if it is not kPa, `meta["licence"]` the
    licence by its SPDX name; `about` collects what a scan says of itself.

    A scan may also hold the images of each press on its way to rest: sequence: (n, frames, taxels) kPa,
    float32. sequence_times: (frames,) s since the letter began to move, the same for all presses; a press
    that rests earlier keeps its last image until then. sequence_force: (n, frames) N, the contact force,
    float32. All three or none.

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
    _OPTIONAL: ClassVar[tuple[str, ...]] = _SEQUENCE + _OF_PRESSES
    PER_READING: ClassVar[tuple[str, ...]] = (
        "readings", "poses", "labels", "split", "sequence", "sequence_force", "loads", "presses",
        "moments", "views",
    )  # fmt: skip
    _MADE_BY: ClassVar[str] = "`bench scan --out FILE`, or of readings of your own with `bench import`"

    def __post_init__(self) -> None:
        self._check_arrays()
        self._check_sequence()
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
        checked = {"loads": _as_loads, "moments": _as_moments}
        for name in _OF_PRESSES:
            if getattr(self, name) is not None:
                array = checked.get(name, partial(_as_whole_numbers, name))(getattr(self, name), count)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    def _check_shapes(self, **wanted: tuple[int, ...]) -> None:
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"scan: {name} has shape {getattr(self, name).shape}, but readings of shape "
                    f"{self.readings.shape} ask for {shape}"
                )
        if not self.readings.shape[1]:
            raise InputError("scan: readings have no taxels")

    def _check_sequence(self) -> None:
        given = [name for name in _SEQUENCE if getattr(self, name) is not None]
        if not given:
            return
        if len(given) < len(_SEQUENCE):
            missing = next(name for name in _SEQUENCE if name not in given)
            raise InputError(f"scan: {given[0]} without {missing}; a sequence has {', '.join(_SEQUENCE)}")
        sequence = as_numbers("sequence", self.sequence, 3, np.float32)
        times = as_numbers("sequence_times", self.sequence_times, 1)
        force = as_numbers("sequence_force", self.sequence_force, 2, np.float32)
        (count, taxels), frames = self.readings.shape, sequence.shape[1]
        wanted = ((count, frames, taxels), (frames,), (count, frames))
        for name, array, shape in zip(_SEQUENCE, (sequence, times, force), wanted, strict=True):
            if array.shape != shape:
                raise InputError(f"scan: {name} has shape {array.shape}, not {shape}")
            object.__setattr__(self, name, array)
        if not frames or (np.diff(times) <= 0).any():
            raise InputError("scan: sequence_times do not rise from frame to frame, or there are none")

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
        poses: Any,
        labels: Any,
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
        images were taken of a press, whose mean is its reading. poses: (n, 3) sensor_in_object, mm, mm, rad. labels:
        (n,) names or whole numbers. split: (n,) "train" or "test", or whether to train on it; None: all to train.
        pad: None for the paper's. unit: of the readings; other pressures, such as mmHg, become kPa. licence: an SPDX
        name. loads: (n,) N, NaN where not known. presses: (n,) whole numbers, the same for readings of one press.
        moments: (n,) the share of its press's load at which each reading was taken. A taxel that reads NaN in a press,
        or is masked, is left out, which is logged and stated in `meta["left_out"]`. Columns of a table go by their
        names: t0, t1, ...; x_mm, y_mm, theta_rad.

        Raises InputError when shapes disagree, for angles that are degrees, and for what `Scan` refuses.
        """
        from tactsim.core.pad import Pad  # brings pydantic, which a scan does without

        pad = Pad() if pad is None else pad
        tables = [
            one.index
            for one in (readings, poses, labels, split)
            if hasattr(getattr(one, "index", 0), "equals")
        ]
        if any(not tables[0].equals(other) for other in tables[1:]):
            raise InputError(
                "tables of readings, poses, labels and split have other indices; give them one order"
            )
        values = readings_a_press(in_order(readings), pad)
        poses = unmasked(in_order(poses, _POSE_COLUMNS), "poses")
        loads, presses, moments = (
            None if values is None else unmasked(values, name)
            for name, values in (("loads", loads), ("presses", presses), ("moments", moments))
        )
        if np.shape(poses) != (len(values), 3):
            raise InputError(f"poses are {np.shape(poses)}; give ({len(values)}, 3): x mm, y mm, theta rad")
        if unit in IN_KPA:
            values, unit = values * IN_KPA[unit], "kPa"
        stated = {"unit": unit} if licence is None else {"unit": unit, "licence": spdx_name(licence)}
        made = {"source": "imported", "versions": {"tactsim": version("tactsim")}}
        meta: dict[str, Any] = {**made, "pad": pad.model_dump(mode="json"), **stated}
        lost = np.isnan(values)
        dead = lost.any(axis=0)
        if dead.all() and len(values):
            raise InputError(
                f"every taxel reads no number (NaN) in some press; in readings[{lost.sum(axis=1).argmax()}] "
                f"{lost.sum(axis=1).max()} do: leave out the presses that failed"
            )
        for taxel in np.flatnonzero(dead).tolist():
            why = f"no number (NaN) in {lost[:, taxel].sum():,} of {len(lost):,} presses"
            meta.setdefault("left_out", {})[str(taxel)] = why
            logging.getLogger(__name__).warning("taxel %d is left out: %s", taxel, why)
        scan = cls(
            values[:, ~dead],
            poses,
            names_of(labels, "labels"),
            splits_of(split, len(values)),
            pad.taxel_xy[~dead],
            meta,
            loads=loads,
            presses=presses,
            moments=moments,
        )
        check_pose_units(scan.poses, scan.taxel_xy)
        return scan

    @property
    def letters(self) -> tuple[str, ...]:
        """List the labels in the order of their first appearance."""
        return tuple(dict.fromkeys(self.labels.tolist()))

    @property
    def press_numbers(self) -> NDArray[np.int64]:
        """Number the press that each reading was taken of, (n,); without `presses` each is of one of its own."""
        return np.arange(len(self)) if self.presses is None else self.presses

    @property
    def about(self) -> dict[str, Any]:
        """Say units, frames, pad, licence and how the scan was made, as `provenance.statements` lists them."""
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
        press = self.press_numbers
        kept = self.split != "train"
        for label in self.where("train").letters:
            of_label = (self.split == "train") & (self.labels == label)
            pressed, first = np.unique(press[of_label], return_index=True)
            if len(pressed) < count:
                raise InputError(f"{label} has {len(pressed)} training presses; {count} are asked for")
            drawn = rng.permutation(len(pressed))
            chosen = drawn[spread_out(self.poses[of_label][first[drawn]], count)]
            kept |= of_label & np.isin(press, pressed[chosen])
        return self.chosen(kept)

    def joined(self, other: Scan, meta: Mapping[str, Any]) -> Scan:
        """Append another scan of the same pad; the result has the given `meta`.

        Sequences are kept if both scans have them at the same times, one of them perhaps for longer.
        Raises InputError if the taxels lie elsewhere or the readings have another unit.
        """
        units = [scan.meta.get("unit", "kPa") for scan in (self, other)]
        if units[0] != units[1]:
            raise InputError(f"two scans of different units cannot be one: {units[0]} and {units[1]}")
        if self.taxel_xy.shape != other.taxel_xy.shape or not np.allclose(
            self.taxel_xy, other.taxel_xy, rtol=0, atol=1e-6
        ):
            raise InputError(
                f"two scans of different pads cannot be one: {len(self.taxel_xy)} and "
                f"{len(other.taxel_xy)} taxels, or the same number at other places"
            )
        both = [np.concatenate([getattr(self, name), getattr(other, name)]) for name in self._ARRAYS[:4]]
        readings, poses, labels, split = both
        others = _joined_sequences(self, other) | _joined_entries(self, other)
        return Scan(readings, poses, labels, split, self.taxel_xy, meta, **others)

    def batches(
        self, trials: int, readings: int, rng: np.random.Generator, split: str = "train"
    ) -> Iterator[Batch]:
        """Draw trials as a run does, many at once and without end, for a method that learns from them.

        trials, readings: of a batch, and of each of its trials. Each trial hides one of the scan's objects, all alike,
        at x and y uniform in +-10 mm (in proportion to the pad) and at any angle (paper, section IV), and takes
        readings of it without replacement.

        Raises InputError for a scan of another kind, a number below 1, and an object with fewer readings.
        """
        if self.kind != "plane":
            raise InputError("scan: batches are of objects in the plane")
        half = self.where(split)
        letter = np.array([self.letters.index(label) for label in half.labels.tolist()], dtype=np.int64)
        fewest = int(np.bincount(letter)[np.unique(letter)].min(initial=len(half)))
        if trials < 1 or not 1 <= readings <= fewest:
            raise InputError(
                f"scan: batches of {short(trials)} trials with {short(readings)} readings each; give at least 1 of "
                f"both, and at most {fewest} readings, which an object has to {split}"
            )
        return _drawn(half, letter, trials, readings, rng)

    def licensed(self, licence: str) -> Scan:
        """State the licence of the readings, by its SPDX name.

        Raises InputError if it is no such name, or if they state another one.
        """
        licence = spdx_name(licence)
        stated = self.meta.get("licence")
        if stated not in (None, licence):
            raise InputError(
                f"the scan is under the licence {stated}, which nobody but its owner replaces by {licence}"
            )
        return replace(self, meta={**self.meta, "licence": licence})

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
        write_npz(path, self.meta, {name: getattr(self, name) for name in self._arrays})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a scan written by `save`; nothing in the file is unpickled or run.

        Raises InputError if the file is missing, cut short, of another kind, claims more than 1 GiB
        or holds what `Scan` refuses.
        """
        try:
            arrays = read_npz(path, (*cls._ARRAYS, "meta"), cls._OPTIONAL)
        except InputError as error:
            if cls is Scan and isinstance(error, MissingArrayError) and "taxel_points" in error.there:
                raise InputError(
                    f"scan {path}: it holds objects in space, which only `bench run --task solids` takes"
                ) from None
            raise InputError(f"scan {path}: {error}; make one with {cls._MADE_BY}") from error
        try:
            return cls(meta=_meta(arrays.pop("meta")), **arrays)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def _drawn(
    scan: Scan, letter: NDArray[np.int64], trials: int, readings: int, rng: np.random.Generator
) -> Iterator[Batch]:
    """Draw the batches of `Scan.batches` from all readings of a scan. letter: (n,) the number of each one's object."""
    from tactsim.core.pad import offsets  # brings pydantic, which a scan does without

    reach = np.array([offsets(scan.taxel_xy)] * 2 + [np.pi])
    rows_of = {number: np.flatnonzero(letter == number) for number in np.unique(letter).tolist()}
    while True:
        hidden = rng.choice(list(rows_of), size=trials)
        rows = np.array([rng.choice(rows_of[number], readings, replace=False) for number in hidden.tolist()])
        robot_in_object = rng.uniform(-reach, reach, (trials, 3))
        sensor_in_robot = compose(invert(robot_in_object)[:, None], scan.poses[rows])
        yield Batch(scan.readings[rows], sensor_in_robot, hidden, robot_in_object)


def train_on(train: Scan, test: Scan) -> Scan:
    """Join the training readings of one scan and the test readings of another, on their common taxels.

    A recording often holds one split only. So a scan without the wanted split gives all its readings. What the
    training scan says of an object, its symmetry say, holds for the other's readings of that label too.
    Raises InputError if the pads differ.
    """
    halves = []
    for scan, other, split in ((train, test, "train"), (test, train, "test")):
        half = scan.where(split)
        half = half if len(half) else replace(scan, split=np.full(len(scan), split))
        halves.append(half.on_taxels_of(other))
    stated = (scan.meta.get("objects") for scan in (test, train))
    objects = {label: facts for of in stated if isinstance(of, Mapping) for label, facts in of.items()}
    return halves[0].joined(halves[1], {**test.meta, "train": dict(train.meta), "objects": objects})


def is_label(name: str) -> bool:
    """Tell whether `name` can label an object: 1 to 100 printable characters."""
    return name.isprintable() and 0 < len(name) <= _LONGEST_NAME


def _meta(array: NDArray[Any]) -> dict[str, Any]:
    if array.shape != () or array.dtype.kind != "U":
        raise InputError(f"scan: meta must be a text, got {array.dtype} {array.shape}")
    return parse_json(str(as_names("meta", array)), "scan: meta")


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


def _entry_each(name: str, values: Any, count: int, kinds: str = "fiu") -> NDArray[Any]:
    """Return an array of `count` numbers, one a reading. Raises InputError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind not in kinds or array.shape != (count,):
        numbers = "numbers" if "f" in kinds else "whole numbers from 0 on"
        raise InputError(
            f"scan: {name} must be {count:,} {numbers}, one a reading, got {array.dtype} {array.shape}"
        )
    return array


def _as_loads(values: Any, count: int) -> FloatArray:
    """Return the loads of `count` presses, N; NaN stands for one that is not known.

    Raises InputError for a load below 0, and for what are no `count` numbers.
    """
    array = _entry_each("loads", values, count).astype(float)
    known = array[~np.isnan(array)]
    if (finite(known, "scan: loads") < 0).any():
        raise InputError(f"scan: a load is {short(float(known.min()))} N; a press is made with 0 or more")
    return array


def _as_moments(values: Any, count: int) -> FloatArray:
    """Return the shares of `count` readings. Raises InputError for one that is not above 0, at most 1."""
    array = _entry_each("moments", values, count).astype(float)
    wrong = array[~((array > 0) & (array <= 1))]
    if len(wrong):
        raise InputError(
            f"scan: a moment is {short(float(wrong[0]))}; it is the share of its press's load, above 0, at most 1"
        )
    return array


def _as_whole_numbers(name: str, values: Any, count: int) -> NDArray[np.int64]:
    """Return whole numbers from 0 on, one for each of `count` readings. Raises InputError for others."""
    array = _entry_each(name, values, count, "iu").astype(np.int64)
    if (array < 0).any():
        raise InputError(f"scan: {name} must be {count:,} whole numbers from 0 on, got {array.min()}")
    return array


def _joined_sequences(first: Scan, second: Scan) -> dict[str, Any]:
    """Append the sequences of two scans, the shorter ones held at their last image; nothing if times differ."""
    times, more = first.sequence_times, second.sequence_times
    if times is None or more is None:
        return {}
    if len(more) > len(times):
        times, more = more, times
    if not np.array_equal(times[: len(more)], more):
        return {}
    joined: dict[str, Any] = {"sequence_times": times}
    for name in ("sequence", "sequence_force"):
        longer = []
        for array in (getattr(first, name), getattr(second, name)):
            rest = [(0, 0)] * array.ndim
            rest[1] = (0, len(times) - array.shape[1])
            longer.append(np.pad(array, rest, mode="edge"))
        joined[name] = np.concatenate(longer)
    return joined


def _joined_entries(first: Scan, second: Scan) -> dict[str, Any]:
    """Append what two scans say of each reading, as far as either does; presses are counted on."""
    both = (first, second)
    said = [name for name in _OF_PRESSES if any(getattr(scan, name) is not None for scan in both)]
    halves = {
        name: [
            _UNSAID[name](len(scan)) if getattr(scan, name) is None else getattr(scan, name) for scan in both
        ]
        for name in said
    }
    if "presses" in halves:
        before, after = halves["presses"]
        halves["presses"] = [before, after + before.max(initial=-1) + 1]
    return {name: np.concatenate(arrays) for name, arrays in halves.items()}


def check_pose_units(poses: FloatArray, taxel_xy: FloatArray) -> None:
    """Refuse poses (n, 3) from elsewhere whose angles are degrees, and log it if their places look like metres.

    taxel_xy: (taxels, 2) mm. Presses that lie apart by less than a quarter of a taxel, but not all in one place, are
    seldom meant, and those of metres always do.
    """
    from tactsim.core.pad import pitch  # brings pydantic, which a scan does without

    turned = float(np.abs(poses[:, 2]).max(initial=0.0))
    if turned > MOST_TURNED:
        raise InputError(
            f"poses turn by {short(turned)} rad; are these degrees? give x, y, theta in mm, mm, rad"
        )
    places = poses[:, :2]
    if len(places) and 0 < np.abs(places).max() <= 1:
        extent, apart = float(np.ptp(places, axis=0).max()), pitch(taxel_xy)
        if 0 < extent < apart / 4:
            logging.getLogger(__name__).warning(
                "all poses lie within %.3g mm, and taxels are %.3g mm apart; if poses are in metres, give x, y, theta "
                "in mm, mm, rad",
                extent,
                apart,
            )


def readings_a_press(values: Any, pad: Pad) -> NDArray[Any]:
    """Bring readings into the shape (n, taxels): the pictures of a pad in a row, several images of a press averaged.

    values: (n, taxels), (n, rows, columns), (n, images, taxels) or (n, images, rows, columns) numbers. Raises
    InputError for another shape.
    """
    array = unmasked(values, "readings")
    if array.dtype.kind not in "fiu":
        raise InputError(f"readings are {array.dtype}, no numbers")
    picture = (pad.rows, pad.columns)
    if array.ndim > 2 and array.shape[-2:] == picture:
        array = array.reshape(*array.shape[:-2], pad.taxels)
    if array.ndim not in (2, 3) or array.shape[-1] != pad.taxels or not all(array.shape[1:]):
        raise InputError(
            f"readings have the shape {np.shape(values)}; a pad of {pad.rows}x{pad.columns} taxels asks for (presses, "
            f"{pad.taxels}), (presses, {pad.rows}, {pad.columns}), or several images of each press between the two"
        )
    if array.ndim == 2:
        return array
    if array.shape[1] > 1:
        said = "each reading is the mean of %d images of its press; of taxels with several axes give one"
        logging.getLogger(__name__).warning(said, array.shape[1])
    lost = np.isnan(array)  # of what some images of a press say, the mean is taken
    images = np.ma.array(array, float, mask=lost) if lost.any() else array
    return np.asarray(np.ma.filled(images.mean(axis=1), np.nan))


def unmasked(values: Any, what: str) -> NDArray[Any]:
    """Make an array of anything; numbers that NumPy's mask hides become NaN. Raises InputError for hidden names."""
    if not np.ma.is_masked(values):
        return np.asarray(values)
    if values.dtype.kind not in "fiu":
        raise InputError(f"{what} are masked in {np.ma.count_masked(values)} places; leave these presses out")
    return np.asarray(values.astype(float).filled(np.nan))


def in_order(frame: Any, names: Mapping[str, int] | None = None) -> Any:
    """Put the columns of a table with named ones (pandas, Polars) in order; anything else stays as it is.

    names: the places of the columns that must be there; None: taxels, by the numbers in their names. Raises InputError
    for other names.
    """
    columns = list(getattr(frame, "columns", ()))
    if not columns or not (names is None or all(isinstance(name, str) for name in columns)):
        return frame
    columns = [" ".join(map(str, name if isinstance(name, tuple) else [name])) for name in columns]
    places: list[tuple[int, ...]]
    if names is not None:
        places = [(names.get(name.strip().lower(), -1),) for name in columns]
        if sorted(places) != [(at,) for at in range(len({*names.values()}))]:
            raise InputError(f"columns {', '.join(columns)}: poses are x_mm, y_mm and theta_rad")
    else:
        places = [tuple(map(int, re.findall(r"\d+", name))) for name in columns]
        kinds = {re.sub(r"\d+", "#", name) for name in columns}
        if len(columns) > 1 and (len(kinds) > 1 or len({*places}) < len(columns)):
            raise InputError(
                f"columns {short(', '.join(columns))} are no taxels in an order, as t0, t1, ... are"
            )
        if re.match(r"(x|c|col|column)[\W_]*#.*#", min(kinds), re.IGNORECASE):
            places = [place[::-1] for place in places]
    order = sorted(range(len(columns)), key=places.__getitem__)
    values = np.asarray(frame)
    if values.dtype == object and all(getattr(kind, "kind", "O") in "iuf" for kind in frame.dtypes):
        values = frame.to_numpy(dtype=float, na_value=np.nan)  # pandas' numbers that may be missing
    return values[:, order]


def names_of(values: Any, what: str) -> NDArray[np.str_]:
    """Read names (n,): texts as they are without blanks around them, bytes as UTF-8, whole numbers written out.

    Raises InputError for anything else.
    """
    array = unmasked(values, what)
    if array.dtype.kind in "SO":
        array = np.array(_as_texts(array.ravel(), what), dtype=np.str_).reshape(array.shape)
    array = array.reshape(-1) if array.size == max(array.shape, default=1) else array  # a row or a column
    if array.ndim != 1 or array.dtype.kind not in "Ufiu":
        raise InputError(f"{what} are {array.dtype} of shape {array.shape}, no row of names or whole numbers")
    if array.dtype.kind == "U":
        return np.char.strip(array)
    whole = np.isfinite(array) & (array == np.round(array)) & (np.abs(array) < 2**53)
    if not whole.all():
        raise InputError(
            f"{what} are numbers that are not whole, such as {short(float(array[~whole][0]))}; give names"
        )
    return array.astype(np.int64).astype(np.str_)


def _as_texts(values: NDArray[Any], what: str) -> list[str]:
    """Read texts or bytes. Raises InputError for other objects, and for bytes that are no UTF-8."""
    texts = []
    for value in values.tolist():
        if isinstance(value, bytes):
            try:
                value = value.decode()
            except UnicodeDecodeError:
                raise InputError(
                    f"{what} hold {short(value)}, which is no UTF-8; give them as texts"
                ) from None
        if not isinstance(value, str):
            raise InputError(
                f"{what} hold {short(value)}, which is no text; give names, as in labels.astype(str)"
            )
        texts.append(value)
    return texts


def splits_of(values: Any, count: int) -> NDArray[np.str_]:
    """Read a split (n,): "train" or "test", or whether each press is to train on; None: all are.

    Raises InputError for anything else.
    """
    if values is None:
        return np.full(count, "train")
    array = unmasked(values, "split")
    if array.dtype.kind in "fiu" and np.isin(array, (0, 1)).all():
        array = array.astype(bool)
    if array.dtype.kind == "b":
        return np.where(array.reshape(-1), "train", "test")
    if array.dtype.kind not in "USO":
        raise InputError("the split is neither 'train' and 'test' nor 1 (to train on) and 0 (to test with)")
    return names_of(array, "split")
