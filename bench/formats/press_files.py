"""Frames as others keep them, a press in each file or array: a folder of texts, .npy, .npz and .mat, as a scan."""

from __future__ import annotations

import logging
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import whosmat

from tactsim.bench.formats.arrays_file import is_of_hdf5, mat_arrays
from tactsim.bench.formats.csv_file import TABLES
from tactsim.bench.trials import check_labels
from tactsim.core import InputError, Pad, Scan
from tactsim.core.documents import LARGE, read_text
from tactsim.core.files import read_bytes
from tactsim.core.idle import failed_cells, flickering
from tactsim.core.npz import LARGEST, read_npz
from tactsim.core.poses import FloatArray
from tactsim.hardware.text_tables import frames_of_text

# Of a press's range of total load: frames above it are its plateau.
_LOADED = 0.9
_MOST = 0.9  # of the presses, of which all read less under load if these do
# What tells the presses of one object apart, at the end of their names: `poke05`, `Rotate_1_2_d100`, `poke (5)`.
_NUMBER = re.compile(r"([\W_]+[A-Za-z]?\d+|\d+)+\W*$")
_DIGITS = re.compile(r"(\d+)")


def read_press_folder(
    folder: Path, pad: Pad, unit: str, by: str | None = None, files: str = "*", test: Sequence[str] = ()
) -> Scan:
    """Read a scan from the files of frames in a folder and below it, a press in each file, or in each array of a file.

    by: folder or name, whether an object is called as its file's folder, or as the file or the array without the number
    at its end; None: as the folder, if the files lie in several. files, test: patterns of paths in the folder, such as
    `S13/*`: which are read, and whose presses are to test with. A press reads the mean of its loaded frames; its pose
    is unknown. Raises InputError, with the file, where frames do not fit the pad.
    """
    if by not in (None, "folder", "name"):
        raise InputError(f"--labels {by}: say folder or name, whichever is the object's")
    places = {
        path: place
        for path in folder.rglob("*")
        if path.suffix.lower() in _READERS and fnmatch(place := path.relative_to(folder).as_posix(), files)
    }
    if not places:
        raise InputError(f"{folder}: no file of frames is called {files}; known are {', '.join(_READERS)}")

    def by_number(path: Path) -> list[int | str]:
        return [int(part) if part.isdigit() else part for part in _DIGITS.split(places[path])]

    paths = sorted(places, key=by_number)
    for pattern in test:
        if not any(fnmatch(place, pattern) for place in places.values()):
            raise InputError(f"--test {pattern}: no file is called so; paths are as {places[paths[0]]}")
    by = by or ("folder" if len({path.parent for path in paths}) > 1 else "name")
    presses, labels, split = list[FloatArray](), [], []
    for path in paths:
        try:
            found = dict(_READERS[path.suffix.lower()](path, pad))
        except InputError as error:
            raise InputError(f"cannot read {path}: {error}") from error
        for name, frames in found.items():
            presses.append(frames)
            labels.append(path.parent.name if by == "folder" else _NUMBER.sub("", name) or name)
            split.append("test" if any(fnmatch(places[path], pattern) for pattern in test) else "train")
    check_labels(labels)
    if len({*labels}) == len(labels) > 1:
        said = (
            "each of %d objects has one press: %s, %s ...; --labels folder or name, whichever is the object's"
        )
        logging.getLogger(__name__).warning(said, len(labels), *labels[:2])
    presses = _whole_frames(presses)
    if falls := sum(map(_falls, presses)) > _MOST * len(presses):
        logging.getLogger(__name__).warning(
            "frames read less under load: a press reads those of the least total"
        )
    loads = [-frames if falls else frames for frames in presses]
    readings = [frames[loaded(load)].mean(axis=0) for frames, load in zip(presses, loads, strict=True)]
    return Scan.from_arrays(np.array(readings), None, labels, split, pad, unit=unit)


def with_last_to_test(scan: Scan, share: float) -> Scan:
    """Leave the last presses of each object, this share of them, to test with. Raises InputError if none is left."""
    split = scan.split.copy()
    for label in scan.letters:
        own = np.flatnonzero(scan.labels == label)
        press = scan.press_numbers[own]
        numbers = np.unique(press)
        count = max(1, round(share * len(numbers)))
        if count >= len(numbers):
            raise InputError(f"{label!r} has too few presses, {len(numbers)}, to train on some and to test")
        split[own[np.isin(press, numbers[-count:])]] = "test"
    return replace(scan, split=split)


def loaded(frames: FloatArray) -> slice:
    """Find the longest run of frames (n, taxels) whose total is within a tenth of the largest one."""
    total = np.nansum(frames, axis=1)
    low, high = float(total.min()), float(total.max())
    above = np.flatnonzero(total >= low + _LOADED * (high - low))
    longest = max(np.split(above, np.flatnonzero(np.diff(above) > 1) + 1), key=len)
    return slice(int(longest[0]), int(longest[-1]) + 1)


def _whole_frames(presses: Sequence[FloatArray]) -> list[FloatArray]:
    """Leave out frames (n, taxels) in which a cell failed or is no number, unless its taxel has none in any frame.

    Raises InputError if none is left of a press.
    """
    every = np.concatenate(presses)
    every[np.isinf(every)] = np.nan
    every[:, flickering(every)] = np.nan
    lost = (np.isnan(every) & ~np.isnan(every).all(axis=0)) | failed_cells(every)
    bad: NDArray[np.bool_] = np.asarray(lost.any(axis=1))
    if bad.any():
        said = "%d of %d frames have a failed cell, as 65535 is, or one that is no number, and are left out"
        logging.getLogger(__name__).warning(said, bad.sum(), len(bad))
    ends = np.cumsum([len(frames) for frames in presses])[:-1]
    whole = [frames[~out] for frames, out in zip(np.split(every, ends), np.split(bad, ends), strict=True)]
    if not all(map(len, whole)):
        raise InputError("of a press every frame has a cell that failed or is no number; leave its taxel out")
    return whole


def _falls(frames: FloatArray) -> bool:
    """Tell whether a press's frames (n, taxels) begin and end with the largest totals, and so read less under load."""
    total = np.nansum(frames, axis=1)
    least = total.min() + _LOADED * np.ptp(total)
    return bool(len(total) > 2 and least > total.min() and min(total[0], total[-1]) >= least)


def _text(path: Path, pad: Pad) -> Iterator[tuple[str, FloatArray]]:
    yield path.stem, frames_of_text(read_text(path, "frames", LARGE), pad.taxels)


def _npy(path: Path, pad: Pad) -> Iterator[tuple[str, FloatArray]]:
    packed = BytesIO()  # as a member of an .npz, whose reader checks sizes first and unpickles nothing
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("frames.npy", read_bytes(path, LARGEST))
    yield path.stem, _frames(read_npz(packed, ["frames"])["frames"], path.name, pad)


def _npz(path: Path, pad: Pad) -> Iterator[tuple[str, FloatArray]]:
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
    except (zipfile.BadZipFile, OSError) as error:
        raise InputError(f"it is not a whole .npz file: {error}") from error
    yield from _all(read_npz(path, names), path, pad)


def _mat(path: Path, pad: Pad) -> Iterator[tuple[str, FloatArray]]:
    content = read_bytes(path, LARGEST)
    try:
        if is_of_hdf5(content):
            from tactsim.bench.formats.hdf5_file import read_named  # its library is an extra

            yield from _all(read_named(path), path, pad)
            return
        there = whosmat(BytesIO(content))
        names = [name for name, shape, _ in there if _fits(shape, pad)]
        if not names:
            raise _misfit({name: shape for name, shape, _ in there}, pad)
    except InputError:
        raise
    except Exception as error:  # SciPy's reader fails in many ways on a file that is not whole
        raise InputError(f"it is no whole MAT file: {error}") from error
    yield from _all(mat_arrays(content, names), path, pad)


def _all(arrays: dict[str, NDArray[Any]], path: Path, pad: Pad) -> Iterator[tuple[str, FloatArray]]:
    """Give the arrays of a file that are frames; a single one is called as the file."""
    found = {name: of for name, of in arrays.items() if of.dtype.kind in "biuf" and _fits(of.shape, pad)}
    if not found:
        raise _misfit({name: array.shape for name, array in arrays.items()}, pad)
    for name, array in found.items():
        yield name if len(found) > 1 else path.stem, _frames(array, name, pad)


def _misfit(shapes: Mapping[str, Sequence[int]], pad: Pad) -> InputError:
    said = ", ".join(f"{name} {tuple(shape)}" for name, shape in shapes.items())
    return InputError(f"no array is (frames, {pad.rows}, {pad.columns}) or (frames, {pad.taxels}): {said}")


def _fits(shape: Sequence[int], pad: Pad) -> bool:
    picture = (pad.rows, pad.columns)
    flat = len(shape) in (1, 2) and shape[-1] == pad.taxels
    return tuple(shape[-2:]) == picture or flat or _frames_last(shape, pad)


def _frames_last(shape: Sequence[int], pad: Pad) -> bool:
    """Tell whether frames come last, (rows, columns, frames), as MATLAB's users have them."""
    return len(shape) == 3 and tuple(shape[:2]) == (pad.rows, pad.columns) != tuple(shape[1:])


def _frames(array: NDArray[Any], name: str, pad: Pad) -> FloatArray:
    if array.dtype.kind not in "biuf" or not _fits(array.shape, pad) or not array.size:
        raise InputError(
            f"{name} is {array.dtype} of shape {array.shape}; give (frames, {pad.rows}, {pad.columns}) or (frames, "
            f"{pad.taxels}) numbers"
        )
    array = np.moveaxis(array, -1, 0) if _frames_last(array.shape, pad) else array
    return array.reshape(-1, pad.taxels).astype(float)


_READERS: dict[str, Callable[[Path, Pad], Iterator[tuple[str, FloatArray]]]] = {
    **dict.fromkeys(TABLES, _text),
    ".npy": _npy,
    ".npz": _npz,
    ".mat": _mat,
}
