"""Public recordings of real pads: what is known of each, how its files are fetched and checked, and its scan.

None is part of this package. The list says where each lies, under which licence, and the SHA-256 of every file.
"""

from __future__ import annotations

import bz2
import hashlib
import io
import re
import urllib.request
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote, unquote
from xml.etree import ElementTree

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tactsim.bench.formats.press_files import loaded
from tactsim.core import InputError, Pad, Scan
from tactsim.core.cache_folder import cache_folder
from tactsim.core.checking import checked
from tactsim.core.documents import read_toml
from tactsim.core.errors import unknown
from tactsim.core.files import read_bytes, write_bytes
from tactsim.core.poses import FloatArray
from tactsim.core.source_digest import source_digest
from tactsim.hardware.text_tables import frames_of_text

KNOWN = Path(__file__).with_name("public_recordings.toml")
_LARGEST = 1 << 28  # bytes of a file
_WAIT_S = 30.0
_ONE_BY_ONE = 60  # files; more come in one archive
_IDLE = 0.1  # of a press's range of total load: below it a frame is idle
_READ_REVERSED = slice(5, 14)  # columns of the TactileDTMF pad that its readout has in reverse
_TIPS = (1, 5)  # of the six arrays in a .dsa file those between which the hand held its objects
Presses = tuple[list[FloatArray], list[str]]  # of each press its readings (readings, taxels), and its label


class Prepared(BaseModel):
    """How a scan for trials is made of a recording.

    shares: of its load, at which training readings are taken of a press while it rises. test_share: the same of a test
    press, one of `shares`. align: whether presses are laid over each other (`pad.alignment`). cut, stride, touching: of
    `hardware.cutting.cut`. folds: if above 0, not the recording's split: the press of each object of the number that is
    the run's seed, modulo its presses, is to test, and all others are to train on.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    shares: tuple[Annotated[float, Field(gt=0, le=1)], ...] = (1.0,)
    test_share: float = 1.0
    align: bool = False
    cut: tuple[int, int] | None = None
    stride: int = 1
    touching: tuple[int, float] | None = None
    folds: int = 0


class Recording(BaseModel):
    """What is known of a public recording.

    licence: an SPDX name, None where the source states none. commit: of the repository, in which the files have been
    looked at. address: of the folder of the files. unverified: what the source does not say. train: the share of each
    object's presses, the first ones, that are to train on. renamed: objects that are called otherwise in the files.
    files: SHA-256 (hex) by their paths from `address`. scans: for trials, by name: `--scan recording:NAME`.
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
    layout: Literal["trials", "images", "grasps", "dsa", "fingers"]
    unit: Literal["kPa", "N", "V", "count"] = "count"
    poses: Literal["unknown", "one"]
    train: float = Field(gt=0, le=1)
    renamed: dict[str, str] = Field(default_factory=dict)
    pad: Pad
    files: dict[str, Annotated[str, Field(pattern="^[0-9a-f]{64}$")]]
    scans: dict[str, Prepared] = Field(default_factory=dict)


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
    then, and copies are kept. Many files come in the repository's archive. Raises InputError for a file that is
    missing, cannot be had or has another content.
    """
    kept = cache_folder() / "recordings" / name
    if given is None and sum(not (kept / path).exists() for path in recording.files) > _ONE_BY_ONE:
        with suppress(InputError):  # else they come one by one
            _unpack(recording, kept)
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
        if given is not None:
            write_bytes(_folder_of(kept / path), content)
        yield path, content


def prepared_scan(name: str, seed: int) -> Scan:
    """Make a scan for trials of a recording whose files are kept here, or read it if it was made before.

    seed: of the run; says which presses are left out where the scan has `folds`. Raises InputError for an unknown name,
    and if the files are not here, with how to get them.
    """
    known = {scan: (of, one) for of, one in recordings().items() for scan in one.scans}
    if name not in known:
        raise unknown("scan of a recording", name, tuple(known))
    source, recording = known[name]
    folder, how = cache_folder() / "recordings", recording.scans[name]
    if not all((folder / source / path).exists() for path in recording.files):
        raise InputError(
            f"{name} is made of the public recording {source}, which is not here: `bench data get {source}` downloads "
            f"it ({recording.size / 1e6:.1f} MB), and with --from FOLDER takes files that you have"
        )
    made_of = hashlib.sha256(f"{source_digest()} {recording.model_dump_json()}".encode()).hexdigest()
    place = folder / f"{name}-{made_of[:16]}.npz"
    if not place.exists():
        _prepared(recording, how, files_of(source, recording)).save(_folder_of(place))
    scan = Scan.load(place)
    if how.folds:
        assert scan.presses is not None
        test = np.zeros(len(scan), dtype=bool)
        for label in scan.letters:
            numbers = np.unique(scan.presses[scan.labels == label])
            test |= scan.presses == numbers[seed % len(numbers)]
        scan = replace(scan, split=np.where(test, "test", "train"))
    return scan


def _prepared(recording: Recording, how: Prepared, files: Iterator[tuple[str, bytes]]) -> Scan:
    from tactsim.bench.pad.alignment import align  # nobody else needs SciPy's transforms
    from tactsim.hardware.cutting import cut

    scan = scan_of(recording, files, how.shares)
    if scan.moments is not None:
        scan = scan.chosen((scan.split == "train") | (scan.moments == how.test_share))
    if how.align:
        scan, _ = align(scan)
    return scan if how.cut is None else cut(scan, *how.cut, how.stride, how.touching)


def scan_of(
    recording: Recording, files: Iterator[tuple[str, bytes]], shares: Sequence[float] = (1.0,)
) -> Scan:
    """Make a scan of the files (path, content) of a recording.

    The readings of a press are what its loaded frames have above its idle ones; of shares of its load below 1, what the
    frame on the way there has that comes nearest. Poses are 0: none are published. Raises InputError for a file of
    another layout.
    """
    presses: list[FloatArray] = []
    labels: list[str] = []
    for path, content in files:
        try:
            found, names = _LAYOUTS[recording.layout](path, content, recording.pad, shares)
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
        moments=np.tile(shares, len(counts)) if len(shares) > 1 else None,
    )
    source = {name: getattr(recording, name) for name in ("repository", "commit", "citation", "terms")}
    meta = {**scan.meta, "recording": source, "poses": recording.poses}
    return replace(scan, meta=meta, presses=np.repeat(np.arange(len(counts)), counts))


def _press_reading(frames: FloatArray, share: float = 1.0) -> FloatArray:
    """Take from a press's frames (n, taxels) the mean of its loaded frames, less the mean of the idle ones.

    Of a share of the load below 1, take the frame before those that comes nearest, since the last idle one. Idle frames
    are those within a tenth of the least total.
    """
    total = frames.sum(axis=1)
    low, high = float(total.min()), float(total.max())
    if high <= low:
        raise InputError("a press has no rise: all its frames carry the same load")
    held = loaded(frames)
    idle = frames[total <= low + _IDLE * (high - low)].mean(axis=0)
    if share == 1:
        return np.asarray(frames[held].mean(axis=0) - idle)
    before = np.flatnonzero(total[: held.start] <= low + _IDLE * (high - low))
    rise = np.arange(before[-1] if len(before) else 0, held.start + 1)
    return np.asarray(frames[rise[np.abs(total[rise] - low - share * (high - low)).argmin()]] - idle)


def _trials(path: str, content: bytes, pad: Pad, shares: Sequence[float]) -> Presses:
    """Read `all_trials` (presses, taxels, frames) of a MAT file that is named after its object."""
    from tactsim.bench.formats.arrays_file import mat_arrays  # SciPy's reader; `bench data` lists without it

    trials = mat_arrays(content, ["all_trials"])["all_trials"]
    if trials.ndim != 3 or trials.shape[1] != pad.taxels:
        raise InputError(f"all_trials has shape {trials.shape}, not (presses, {pad.taxels}, frames)")
    images = trials.astype(float).transpose(0, 2, 1).reshape(len(trials), -1, pad.rows, pad.columns)
    images[..., _READ_REVERSED] = images[..., _READ_REVERSED][..., ::-1]
    readings = [
        np.array([_press_reading(press.reshape(len(press), -1), share) for share in shares])
        for press in images
    ]
    return readings, [Path(path).stem.removesuffix("_raster")] * len(readings)


def _grasps(path: str, content: bytes, pad: Pad, shares: Sequence[float]) -> Presses:
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


def _dsa(path: str, content: bytes, pad: Pad, shares: Sequence[float]) -> Presses:
    """Read a grasp that DSA Konqueror kept in its object's folder: the readings of two fingertips.

    The file is XML, packed by bzip2. A frame has the cells of all arrays, the rows of one after another, as big-endian
    32-bit floats in hexadecimal; a negative number stands for so many zeros.
    """
    try:
        root = ElementTree.fromstring(bz2.decompress(content))
        shapes = [
            tuple(int(array.findtext(f"cells_{of}", "")) for of in "yx") for array in root.iter("matrix")
        ]
        packed = [np.frombuffer(bytes.fromhex(frame.text or ""), ">f4") for frame in root.iter("frame_data")]
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise InputError(f"it is no whole file of DSA Konqueror: {error}") from error
    if [shape for number, shape in enumerate(shapes) if number in _TIPS] != 2 * [(pad.rows, pad.columns)]:
        raise InputError(f"its arrays are {shapes}; arrays {_TIPS} are to be {pad.rows} by {pad.columns}")
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    frames = [np.repeat(np.maximum(row, 0), np.maximum(-row, 1).astype(int)) for row in packed]
    if not frames or {len(frame) for frame in frames} != {ends[-1]}:
        raise InputError(f"its frames are not of {ends[-1]} cells, as its arrays have")
    tips = np.hstack([np.array(frames, dtype=float)[:, ends[tip] - pad.taxels : ends[tip]] for tip in _TIPS])
    return [_press_reading(tips).reshape(2, pad.taxels)], [Path(path).parent.name]


def _fingers(path: str, content: bytes, pad: Pad, shares: Sequence[float]) -> Presses:
    """Read a grasp of five fingers, a line each, which read less under load; the file is named after its object."""
    frames = -frames_of_text(content.decode("utf-8", "replace"), pad.taxels)
    return [_press_reading(frames)[None]], [re.sub(r"_\d+$", "", Path(path).stem)]


def _images(path: str, content: bytes, pad: Pad, shares: Sequence[float]) -> Presses:
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


_LAYOUTS: Mapping[str, Callable[[str, bytes, Pad, Sequence[float]], Presses]] = {
    "trials": _trials,
    "images": _images,
    "grasps": _grasps,
    "dsa": _dsa,
    "fingers": _fingers,
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


def _unpack(recording: Recording, kept: Path) -> None:
    """Download the archive of the repository at its commit, and keep the recording's files of it."""
    owner, repository, commit, folder = unquote(recording.address).split("/", 6)[3:]
    address = f"https://codeload.github.com/{owner}/{repository}/zip/{commit}"
    content = _download(address, kept)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            for path in recording.files:
                write_bytes(_folder_of(kept / path), archive.read(f"{repository}-{commit}/{folder}{path}"))
    except (zipfile.BadZipFile, KeyError) as error:
        raise InputError(f"{address} is no whole archive of {recording.repository}: {error}") from error


def _download(address: str, place: Path) -> bytes:
    try:
        with urllib.request.urlopen(address, timeout=_WAIT_S) as answer:
            return bytes(answer.read(_LARGEST))
    except OSError as error:
        reason = getattr(error, "reason", error)
        raise InputError(
            f"cannot download {address} ({reason}); put it at {place}, or say --from FOLDER where it lies"
        ) from error
