"""Public recordings of real pads: what is known of each, how its files are fetched and checked, and its scan.

None is part of this package. The list says where each lies, under which licence, and the SHA-256 of every file.
"""

from __future__ import annotations

import hashlib
import io
import re
import urllib.request
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tactsim.core import InputError, Pad, Scan
from tactsim.core.cache_folder import cache_folder
from tactsim.core.checking import checked
from tactsim.core.documents import read_toml
from tactsim.core.errors import unknown
from tactsim.core.files import read_bytes, write_bytes
from tactsim.core.poses import FloatArray

KNOWN = Path(__file__).with_name("public_recordings.toml")
_LARGEST = 1 << 28  # bytes of a file
_WAIT_S = 30.0
_LOADED, _IDLE = (
    0.9,
    0.1,
)  # of a press's range of total load: frames above the first are its plateau, below it is idle
_READ_REVERSED = slice(5, 14)  # columns of the TactileDTMF pad that its readout has in reverse

Presses = tuple[list[FloatArray], list[str]]  # of each press its readings (readings, taxels), and its label


class Recording(BaseModel):
    """What is known of a public recording.

    licence: an SPDX name, None where the source states none. commit: of the repository, in which the files have been
    looked at. address: of the folder of the files. unverified: what the source does not say. train: the share of each
    object's presses, the first ones, that are to train on. renamed: objects that are called otherwise in the files.
    files: SHA-256 (hex) by their paths from `address`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    what: str
    size: int = Field(description="bytes of all files", ge=1)
    licence: str | None = None
    terms: str
    citation: str
    repository: str
    commit: Annotated[str, Field(pattern="^[0-9a-f]{40}$")]
    address: str
    unverified: str
    layout: Literal["trials", "images", "grasps"]
    unit: Literal["kPa", "N", "V", "count"] = "count"
    poses: Literal["unknown", "one"]
    train: float = Field(gt=0, le=1)
    renamed: dict[str, str] = Field(default_factory=dict)
    pad: Pad
    files: dict[str, Annotated[str, Field(pattern="^[0-9a-f]{64}$")]]


def recordings() -> dict[str, Recording]:
    """Read what is known of the recordings, by name. Raises InputError if the list that came along is damaged."""
    return {
        name: checked(Recording, values, f"{KNOWN}: {name}")
        for name, values in read_toml(KNOWN, "recordings").items()
    }


def known_recording(name: str) -> Recording:
    """Find a recording. Raises InputError that lists the names for one that is not known."""
    known = recordings()
    if name not in known:
        raise unknown("recording", name, tuple(known))
    return known[name]


def files_of(name: str, recording: Recording, given: Path | None = None) -> Iterator[tuple[str, bytes]]:
    """Give each file's path and content, checked against its SHA-256; downloads and keeps what is not there.

    given: the only file, or a folder that holds the files, by their paths or their names alone; nothing is downloaded
    then. Raises InputError for a file that is missing, cannot be downloaded or has another content.
    """
    kept = cache_folder() / "recordings" / name
    for path, sha in recording.files.items():
        if given is None:
            place = kept / path
            if not place.exists():
                write_bytes(_folder_of(place), _download(recording.address + quote(path), place))
        elif given.is_dir():
            place = next(
                (one for one in (given / path, given / Path(path).name) if one.exists()), given / path
            )
        elif len(recording.files) == 1:
            place = given
        else:
            raise InputError(
                f"--from {given}: {name} has {len(recording.files)} files; name the folder that holds them"
            )
        try:
            content = read_bytes(place, _LARGEST)
        except InputError as error:
            raise InputError(
                f"cannot read {place}, which is to be {recording.address}{quote(path)}: {error}"
            ) from error
        found = hashlib.sha256(content).hexdigest()
        if found != sha:
            raise InputError(
                f"{place} is not the file of {name} that is known: its SHA-256 is {found}, not {sha}; "
                f"take it from {recording.repository} at commit {recording.commit}"
            )
        yield path, content


def scan_of(recording: Recording, files: Iterator[tuple[str, bytes]]) -> Scan:
    """Make a scan of the files (path, content) of a recording.

    The readings of a press are what its loaded frames have above its idle ones. Poses are 0: none are published.
    Raises InputError for a file of another layout.
    """
    presses: list[FloatArray] = []
    labels: list[str] = []
    for path, content in files:
        try:
            found, names = _LAYOUTS[recording.layout](path, content, recording.pad)
        except InputError as error:
            raise InputError(f"cannot read {path}: {error}") from error
        presses += found
        labels += [recording.renamed.get(name, name) for name in names]
    counts = [len(readings) for readings in presses]
    of_press = np.array(labels)
    train = np.zeros(len(labels), dtype=bool)
    for label in dict.fromkeys(labels):
        rows = np.flatnonzero(of_press == label)
        train[rows[: max(1, round(recording.train * len(rows)))]] = True
    scan = Scan.from_arrays(
        np.concatenate(presses),
        np.zeros((sum(counts), 3)),
        np.repeat(of_press, counts),
        np.repeat(train, counts),
        recording.pad,
        unit=recording.unit,
        licence=recording.licence,
    )
    source = {name: getattr(recording, name) for name in ("repository", "commit", "citation", "terms")}
    meta = {**scan.meta, "recording": source, "poses": recording.poses}
    return replace(scan, meta=meta, presses=np.repeat(np.arange(len(counts)), counts))


def _press_reading(frames: FloatArray) -> FloatArray:
    """Take from a press's frames (n, taxels) the mean of the longest loaded run, less the mean of the idle ones.

    Loaded frames are those within a tenth of the largest total, idle ones those within a tenth of the least.
    """
    total = frames.sum(axis=1)
    low, high = float(total.min()), float(total.max())
    if high <= low:
        raise InputError("a press has no rise: all its frames carry the same load")
    loaded = np.flatnonzero(total >= low + _LOADED * (high - low))
    runs = np.split(loaded, np.flatnonzero(np.diff(loaded) > 1) + 1)
    idle = frames[total <= low + _IDLE * (high - low)].mean(axis=0)
    return np.asarray(frames[max(runs, key=len)].mean(axis=0) - idle)


def _trials(path: str, content: bytes, pad: Pad) -> Presses:
    """Read `all_trials` (presses, taxels, frames) of a MAT file that is named after its object."""
    from tactsim.bench.formats.arrays_file import mat_arrays  # SciPy's reader; `bench data` lists without it

    trials = mat_arrays(content, ["all_trials"])["all_trials"]
    if trials.ndim != 3 or trials.shape[1] != pad.taxels:
        raise InputError(f"all_trials has shape {trials.shape}, not (presses, {pad.taxels}, frames)")
    images = trials.astype(float).transpose(0, 2, 1).reshape(len(trials), -1, pad.rows, pad.columns)
    images[..., _READ_REVERSED] = images[..., _READ_REVERSED][..., ::-1]
    readings = [_press_reading(press.reshape(len(press), -1))[None] for press in images]
    return readings, [Path(path).stem.removesuffix("_raster")] * len(readings)


def _grasps(path: str, content: bytes, pad: Pad) -> Presses:
    """Read the arrays `TS` (rows, columns, frames) of a MAT file in its object's folder: readings of one grasp.

    Fingertips have a row less; the last one is 0 then.
    """
    from tactsim.bench.formats.arrays_file import mat_arrays

    cells = mat_arrays(content, [f"TS{{{number}}}" for number in range(1, 7)]).values()
    whole = []
    for cell in cells:
        if cell.ndim != 3 or cell.shape[1] != pad.columns or not 0 <= pad.rows - cell.shape[0] <= 1:
            raise InputError(
                f"an array of TS has shape {cell.shape}, not ({pad.rows}, {pad.columns}, frames)"
            )
        filled = np.zeros((pad.rows, pad.columns, cell.shape[2]))
        filled[: len(cell)] = cell
        whole.append(filled.reshape(pad.taxels, -1))
    if len({cell.shape[1] for cell in whole}) > 1:
        raise InputError("its arrays have different numbers of frames")
    frames = np.concatenate(whole).T
    return [_press_reading(frames).reshape(len(whole), pad.taxels)], [Path(path).parent.name]


def _images(path: str, content: bytes, pad: Pad) -> Presses:
    """Read grey images `OBJECT/OBJECT12.jpg` of a ZIP file, the presses of each object by their numbers."""
    from matplotlib.image import imread

    readings, labels = [], []
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = [name for name in archive.namelist() if name.endswith(".jpg")]
            for name in sorted(names, key=_by_number):
                image = np.asarray(imread(io.BytesIO(archive.read(name)), format="jpg"), dtype=float)
                if image.shape != (pad.rows, pad.columns):
                    raise InputError(f"{name} has shape {image.shape}, not ({pad.rows}, {pad.columns})")
                readings.append(image.reshape(1, -1))
                labels.append(Path(name).parent.name)
    except (zipfile.BadZipFile, OSError) as error:
        raise InputError(f"it is no whole ZIP file of images: {error}") from error
    if not readings:
        raise InputError("it holds no images")
    return readings, labels


_LAYOUTS: Mapping[str, Callable[[str, bytes, Pad], Presses]] = {
    "trials": _trials,
    "images": _images,
    "grasps": _grasps,
}


def _by_number(name: str) -> tuple[str, int]:
    """Sort a12 behind a9."""
    digits = re.search(r"(\d+)\.\w+$", name)
    return str(Path(name).parent), int(digits[1]) if digits else 0


def _folder_of(place: Path) -> Path:
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make {place.parent}: {error.strerror}") from error
    return place


def _download(address: str, place: Path) -> bytes:
    try:
        with urllib.request.urlopen(address, timeout=_WAIT_S) as answer:
            return bytes(answer.read(_LARGEST))
    except OSError as error:
        reason = getattr(error, "reason", error)
        raise InputError(
            f"cannot download {address} ({reason}); put it at {place}, or say --from FOLDER where it lies"
        ) from error
