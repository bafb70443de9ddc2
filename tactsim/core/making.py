"""What of a scan most runs do without: its file, arrays in the forms in which people have them, two scans in one.

And what may be said of each reading and of the whole, training presses chosen, and trials drawn.
"""

from __future__ import annotations

import logging
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactsim.core.documents import parse_json
from tactsim.core.errors import InputError, short
from tactsim.core.finite import finite
from tactsim.core.idle import SELDOM
from tactsim.core.npz import MissingArrayError, read_npz
from tactsim.core.pad import Pad, offsets, pitch
from tactsim.core.poses import FloatArray, compose, invert
from tactsim.core.provenance import NO_POSES, OWN_LICENCE, may_name_a_licence, poses_unknown
from tactsim.core.scan import MOST_TURNED, OF_PRESSES, SEQUENCE, Scan, as_names, as_numbers

S = TypeVar("S", bound=Scan)
# kPa of other units of pressure, which are converted where readings come in.
IN_KPA = {
    "Pa": 1e-3,
    "hPa": 0.1,
    "mbar": 0.1,
    "MPa": 1e3,
    "bar": 100.0,
    "psi": 6.894757293,
    "mmHg": 0.1333223874,
}
_SOURCES = ("simulated", "recorded", "imported")
_TURNED_AT = 3.0  # mm from the middle at which a turn is a way, when poses are spread: places come first
_POSE_COLUMNS = {"x": 0, "x_mm": 0, "y": 1, "y_mm": 1, "theta": 2, "theta_rad": 2}
# What holds of so many readings where a scan does not say it: nobody knows the load, each is a press of its own, under
# the whole load, of its object's one view.
_UNSAID: dict[str, Callable[[int], NDArray[Any]]] = {
    "loads": lambda count: np.full(count, np.nan),
    "presses": np.arange,
    "moments": np.ones,
    "views": lambda count: np.zeros(count, np.int64),
}


def loaded(kind: type[S], path: str | Path) -> S:
    """Read a scan of this kind from its file, as `Scan.load` says."""
    try:
        arrays = read_npz(path, (*kind._ARRAYS, "meta"), kind._OPTIONAL)
    except InputError as error:
        if kind is Scan and isinstance(error, MissingArrayError) and "taxel_points" in error.there:
            raise InputError(
                f"scan {path}: it holds objects in space, which only `bench run --task solids` takes"
            ) from None
        recording = str(path).endswith(".tactrec")
        made_by = from_recording(path) if recording else kind._MADE_BY
        raise InputError(f"scan {path}: {error}; make one with {made_by}") from error
    try:
        meta = arrays.pop("meta")
        if meta.shape != () or meta.dtype.kind != "U":
            raise InputError(f"scan: meta must be a text, got {meta.dtype} {meta.shape}")
        return kind(meta=parse_json(str(as_names("meta", meta)), "scan: meta"), **arrays)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def from_recording(path: str | Path) -> str:
    """Say what makes a scan of a recording, .tactrec."""
    return f"`bench replay {path} --scan FILE` (and --marks FILE if no session led to its presses)"


def checked_entries(given: Mapping[str, Any], count: int, taxels: int) -> dict[str, NDArray[Any]]:
    """Check what a scan of `count` readings says of each, and its sequence: the arrays, read only.

    Raises InputError for a load below 0, a moment that is not above 0, at most 1, other numbers that are not whole and
    from 0 on, what are no `count` numbers, and a sequence that is not whole or whose times do not rise.
    """
    checked = {name: _entries(name, given[name], count) for name in OF_PRESSES if name in given}
    for array in checked.values():
        array.setflags(write=False)
    parts = [name for name in SEQUENCE if name in given]
    if not parts:
        return checked
    if len(parts) < len(SEQUENCE):
        missing = next(name for name in SEQUENCE if name not in given)
        raise InputError(f"scan: {parts[0]} without {missing}; a sequence has {', '.join(SEQUENCE)}")
    axes = {"sequence": (3, np.float32), "sequence_times": (1, float), "sequence_force": (2, np.float32)}
    sequence = {name: as_numbers(name, given[name], *axes[name]) for name in SEQUENCE}
    times = sequence["sequence_times"]
    frames = sequence["sequence"].shape[1]
    wanted = ((count, frames, taxels), (frames,), (count, frames))
    for (name, array), shape in zip(sequence.items(), wanted, strict=True):
        if array.shape != shape:
            raise InputError(f"scan: {name} has shape {array.shape}, not {shape}")
    if not frames or (np.diff(times) <= 0).any():
        raise InputError("scan: sequence_times do not rise from frame to frame, or there are none")
    return checked | sequence


def _entries(name: str, values: Any, count: int) -> NDArray[Any]:
    """Return an array of `count` numbers, one a reading, of loads (NaN: not known), moments or whole numbers."""
    array = np.asarray(values)
    real = name in ("loads", "moments")
    if array.dtype.kind not in ("fiu" if real else "iu") or array.shape != (count,):
        numbers = "numbers" if real else "whole numbers from 0 on"
        raise InputError(
            f"scan: {name} must be {count:,} {numbers}, one a reading, got {array.dtype} {array.shape}"
        )
    array = array.astype(float if real else np.int64)
    if name == "loads":
        known = array[~np.isnan(array)]
        if (finite(known, "scan: loads") < 0).any():
            raise InputError(f"scan: a load is {short(float(known.min()))} N; a press is made with 0 or more")
    elif name == "moments":
        wrong = array[~((array > 0) & (array <= 1))]
        if len(wrong):
            raise InputError(
                f"scan: a moment is {short(float(wrong[0]))}; it is the share of its press's load, above 0, at most 1"
            )
    elif (array < 0).any():
        raise InputError(f"scan: {name} must be {count:,} whole numbers from 0 on, got {array.min()}")
    return array


def with_train_presses(scan: S, count: int, rng: np.random.Generator) -> S:
    """Keep so many training presses of each object, as `Scan.with_train_presses` says."""
    press = scan.press_numbers
    kept = scan.split != "train"
    for label in scan.where("train").letters:
        of_label = (scan.split == "train") & (scan.labels == label)
        pressed, first = np.unique(press[of_label], return_index=True)
        if len(pressed) < count:
            raise InputError(f"{label} has {len(pressed)} training presses; {count} are asked for")
        drawn = rng.permutation(len(pressed))
        chosen = drawn[spread_out(scan.poses[of_label][first[drawn]], count)]
        kept |= of_label & np.isin(press, pressed[chosen])
    return scan.chosen(kept)


def spread_out(poses: FloatArray, count: int) -> NDArray[np.intp]:
    """Choose `count` of poses (n, 3), the first and then each time the one farthest from all chosen: their numbers.

    This is the farthest-point ordering of Gonzalez (1985). Of those that are equally far it takes the first.
    """
    turn = _TURNED_AT * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    places = np.concatenate([poses[:, :2], turn], axis=1)
    nearest, chosen = np.full(len(poses), np.inf), []
    for _ in range(count):
        number = int(nearest.argmax())
        chosen.append(number)
        nearest = np.minimum(nearest, ((places - places[number]) ** 2).sum(axis=1))
        nearest[number] = -1.0
    return np.array(chosen, dtype=np.intp)


def licensed(scan: Scan, licence: str) -> Scan:
    """State the licence of a scan, as `Scan.licensed` says."""
    licence = spdx_name(licence)
    stated = scan.meta.get("licence")
    if stated not in (None, licence):
        raise InputError(
            f"the scan is under the licence {stated}, which nobody but its owner replaces by {licence}"
        )
    return replace(scan, meta={**scan.meta, "licence": licence})


def spdx_name(licence: str) -> str:
    """Return a licence that is stated now, or an expression of several, in the letters that SPDX writes it in.

    Raises InputError for a name that is not on SPDX's list and does not begin with LicenseRef-. What a file states is
    not asked for this: readings under an odd name can still be read.
    """
    from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

    try:
        if may_name_a_licence(licence):
            return str(canonicalize_license_expression(licence))
    except InvalidLicenseExpression:
        pass
    raise InputError(
        f"licence {short(licence)} is no SPDX name; give one of spdx.org/licenses, like {OWN_LICENCE}, or "
        "LicenseRef-NAME for terms of your own"
    )


def statements(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Collect from a scan's `meta` what a stranger needs to use the readings; what is not known is None.

    units: of each kind of number. frames: in which frame the numbers are. pad: the fields of a `Pad`. licence: an
    SPDX name; without one nobody but the owner may use the data. source: one of `_SOURCES`.
    versions, seed, options: of the program and the press that made simulated readings. recordings: the sessions
    that recorded ones come from. train: the same of the training readings where they come from another scan.
    """
    tables = {name: meta.get(name) for name in ("versions", "options", "train")}
    versions, options, train = (value if isinstance(value, Mapping) else None for value in tables.values())
    source, recordings = meta.get("source", "simulated" if options else None), meta.get("recordings")
    return {
        "units": {
            "readings": meta.get("unit", "kPa"),
            "lengths": "mm",
            "angles": "rad",
            "times": "s",
            "force": "N",
        },
        "frames": {
            "poses": "how readings of a press lie to each other, [x, y, theta]; nobody noted how to the object"
            if poses_unknown(meta)
            else "sensor_in_object: the pose [x, y, theta] of the sensor in the frame of the object",
            "taxel_xy": "the centres of the taxels in the frame of the sensor",
            "taxels": "taxel = columns * row + column on a whole grid; rows run along +y, columns along +x",
        },
        "pad": meta.get("pad", (options or {}).get("pad")),
        "licence": meta.get("licence"),
        "source": source if source in _SOURCES else None,
        "versions": versions,
        "options": options,
        "seed": (options or {}).get("seed"),
        "recordings": recordings if isinstance(recordings, list) else None,
        "train": statements(train) if train is not None else None,
    }


def scan_of(
    kind: type[Scan], readings: Any, poses: Any, labels: Any, split: Any, pad: Pad | None, unit: str,
    licence: str | None, each: dict[str, Any],
) -> Scan:  # fmt: skip
    """Make a scan of this kind, as `Scan.from_arrays` says. each: what may be said of each reading."""
    pad = Pad() if pad is None else pad
    tables = [
        one.index for one in (readings, poses, labels, split) if hasattr(getattr(one, "index", 0), "equals")
    ]
    if any(not tables[0].equals(other) for other in tables[1:]):
        raise InputError(
            "tables of readings, poses, labels and split have other indices; give them one order"
        )
    if labels is None:
        raise InputError("labels are missing; name the object of each press")
    values, unposed = readings_a_press(in_order(readings), pad), poses is None
    poses = np.zeros((len(values), 3)) if unposed else unmasked(in_order(poses, _POSE_COLUMNS), "poses")
    each = {name: None if given is None else unmasked(given, name) for name, given in each.items()}
    if np.shape(poses) != (len(values), 3):
        raise InputError(f"poses are {np.shape(poses)}; give ({len(values)}, 3): x mm, y mm, theta rad")
    if unit in IN_KPA:
        values, unit = values * IN_KPA[unit], "kPa"
    stated = {"unit": unit} if licence is None else {"unit": unit, "licence": spdx_name(licence)}
    made = {"source": "imported", "versions": {"tactsim": version("tactsim")}}
    meta: dict[str, Any] = {**made, "pad": pad.model_dump(mode="json"), **stated}
    lost = np.isnan(values)
    dead = lost.sum(axis=0) > SELDOM * len(lost)
    whole = ~lost[:, ~dead].any(axis=1)
    if len(values) and (dead.all() or not whole.any()):
        raise InputError(
            f"every taxel or press has a cell without a number (NaN); in readings[{lost.sum(axis=1).argmax()}] "
            f"{lost.sum(axis=1).max()} do: leave out the presses that failed"
        )
    for taxel in np.flatnonzero(dead).tolist():
        why = f"no number (NaN) in {lost[:, taxel].sum():,} of {len(lost):,} presses"
        meta.setdefault("left_out", {})[str(taxel)] = why
        logging.getLogger(__name__).warning("taxel %d is left out: %s", taxel, why)
    meta |= NO_POSES if unposed else {}
    names, halves = names_of(labels, "labels"), splits_of(split, len(values))
    scan = kind(np.where(lost, 0, values)[:, ~dead], poses, names, halves, pad.taxel_xy[~dead], meta, **each)
    if not whole.all():
        said = "%d of %d readings have a cell without a number (NaN), and are left out"
        logging.getLogger(__name__).warning(said, (~whole).sum(), len(whole))
        scan = scan.chosen(whole)
    check_pose_units(scan.poses, scan.taxel_xy)
    return scan


def joined(first: Scan, second: Scan, meta: Mapping[str, Any]) -> Scan:
    """Append one scan to another, as `Scan.joined` says."""
    units = [scan.meta.get("unit", "kPa") for scan in (first, second)]
    if units[0] != units[1]:
        raise InputError(f"two scans of different units cannot be one: {units[0]} and {units[1]}")
    if first.taxel_xy.shape != second.taxel_xy.shape or not np.allclose(
        first.taxel_xy, second.taxel_xy, rtol=0, atol=1e-6
    ):
        raise InputError(
            f"two scans of different pads cannot be one: {len(first.taxel_xy)} and "
            f"{len(second.taxel_xy)} taxels, or the same number at second places"
        )
    both = [np.concatenate([getattr(first, name), getattr(second, name)]) for name in first._ARRAYS[:4]]
    readings, poses, labels, split = both
    others = _joined_sequences(first, second) | _joined_entries(first, second)
    return Scan(readings, poses, labels, split, first.taxel_xy, meta, **others)


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


def without_poses(scan: S) -> S:
    """State that nobody noted the poses of a scan in the plane; one that says so of all its readings stays as it is.

    Readings of one press, such as windows of it, keep how they lie to its first.
    """
    meta = _unposed(scan.meta)
    if meta == scan.meta:
        return scan
    _, first, press = np.unique(scan.press_numbers, return_index=True, return_inverse=True)
    begin = scan.poses[first[press.ravel()]]
    there = (scan.poses == begin).all(axis=1, keepdims=True)
    poses = np.where(there, 0.0, compose(invert(begin), scan.poses))
    return replace(scan, poses=poses, meta=meta)


def _unposed(meta: Mapping[str, Any]) -> dict[str, Any]:
    """State in a scan's `meta` that nobody noted poses, and so in that of the scan its training readings are from."""
    train = meta.get("train")
    return {**meta, **NO_POSES} | ({"train": _unposed(train)} if isinstance(train, Mapping) else {})


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
    said = [name for name in OF_PRESSES if any(getattr(scan, name) is not None for scan in both)]
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


class Batch(NamedTuple):
    """Trials as a method meets them, and what it is to find out.

    readings: (trials, readings, taxels), in the scan's unit. sensor_in_robot: (trials, readings, 3) mm, mm, rad.
    letter: (trials,) the index in the scan's `letters`. robot_in_object: (trials, 3) mm, mm, rad.
    """

    readings: FloatArray
    sensor_in_robot: FloatArray
    letter: NDArray[np.int64]
    robot_in_object: FloatArray


def batches(scan: Scan, trials: int, readings: int, rng: np.random.Generator, split: str) -> Iterator[Batch]:
    """Draw trials as `Scan.batches` says."""
    if scan.kind != "plane":
        raise InputError("scan: batches are of objects in the plane")
    half = scan.where(split)
    letter = np.array([scan.letters.index(label) for label in half.labels.tolist()], dtype=np.int64)
    rows_of = {number: np.flatnonzero(letter == number) for number in np.unique(letter).tolist()}
    fewest = min(map(len, rows_of.values()), default=0)
    if trials < 1 or not 1 <= readings <= fewest:
        raise InputError(
            f"scan: batches of {short(trials)} trials with {short(readings)} readings each; give at least 1 of "
            f"both, and at most {fewest} readings, which an object has to {split}"
        )
    return _drawn(half, rows_of, trials, readings, rng)


def _drawn(
    scan: Scan, rows_of: dict[int, NDArray[np.intp]], trials: int, readings: int, rng: np.random.Generator
) -> Iterator[Batch]:
    """Draw batches from all readings of a scan. rows_of: those of each object, by its number."""
    reach = np.array([offsets(scan.taxel_xy)] * 2 + [np.pi])
    while True:
        hidden = rng.choice(list(rows_of), size=trials)
        rows = np.array([rng.choice(rows_of[number], readings, replace=False) for number in hidden.tolist()])
        robot_in_object = rng.uniform(-reach, reach, (trials, 3))
        sensor_in_robot = compose(invert(robot_in_object)[:, None], scan.poses[rows])
        yield Batch(scan.readings[rows], sensor_in_robot, hidden, robot_in_object)


def check_pose_units(poses: FloatArray, taxel_xy: FloatArray) -> None:
    """Refuse poses (n, 3) from elsewhere whose angles are degrees, and log it if their places look like metres.

    taxel_xy: (taxels, 2) mm. Presses that lie apart by less than a quarter of a taxel, but not all in one place, are
    seldom meant, and those of metres always do.
    """
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
    if isinstance(values, list | tuple) and any(map(np.ma.is_masked, values)):
        values = np.ma.array(values)  # each row with its mask
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
    # PyArrow's have other names
    columns = list(getattr(frame, "column_names", getattr(frame, "columns", ())))
    if not columns or not (names is None or all(isinstance(name, str) for name in columns)):
        return frame
    levels = getattr(getattr(frame, "columns", None), "names", None) or [None]
    columns = [
        " ".join(f"{level or ''}{part}" for level, part in zip(levels, name, strict=True))
        if isinstance(name, tuple) else str(name)
        for name in columns
    ]  # fmt: skip
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
    if array.dtype.kind == "U":  # of two spellings that look the same
        return np.array(
            [unicodedata.normalize("NFC", name.strip()) for name in array.tolist()], dtype=np.str_
        )
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
