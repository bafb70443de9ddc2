"""Scans made of arrays in the forms in which people have them, and of two scans; and trials drawn from one."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError, short
from tactsim.core.pad import Pad, offsets, pitch
from tactsim.core.poses import FloatArray, compose, invert
from tactsim.core.provenance import IN_KPA, spdx_name
from tactsim.core.scan import MOST_TURNED, OF_PRESSES, Scan

_POSE_COLUMNS = {"x": 0, "x_mm": 0, "y": 1, "y_mm": 1, "theta": 2, "theta_rad": 2}
# What holds of so many readings where a scan does not say it: nobody knows the load, each is a press of its own, under
# the whole load, of its object's one view.
_UNSAID: dict[str, Callable[[int], NDArray[Any]]] = {
    "loads": lambda count: np.full(count, np.nan),
    "presses": np.arange,
    "moments": np.ones,
    "views": lambda count: np.zeros(count, np.int64),
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
    values = readings_a_press(in_order(readings), pad)
    poses = unmasked(in_order(poses, _POSE_COLUMNS), "poses")
    each = {name: None if given is None else unmasked(given, name) for name, given in each.items()}
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
    names, halves = names_of(labels, "labels"), splits_of(split, len(values))
    scan = kind(values[:, ~dead], poses, names, halves, pad.taxel_xy[~dead], meta, **each)
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
    columns = list(
        getattr(frame, "column_names", getattr(frame, "columns", ()))
    )  # PyArrow's have other names
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
