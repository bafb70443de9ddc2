"""`Bundle`: what a method did on a task, in one small file that somebody else can check; and `Record`, of such a check.

The file is a .npz, as a scan is. Its `meta`, a JSON string, says who did what, where and with which code, and describes
each run. The other arrays are the rows of all runs: what was estimated after every reading of every trial, rounded to
what the figures of a table can tell (`rounded`). `digest` is a hash of all bits of each trial: by it `bench verify`
compares trials that it does again to the bit.

Version 0.1 wrote a zip archive of the folders of the runs, with all digits. Such files are read too.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from tactsim.bench import results
from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import Pooled, pool
from tactsim.bench.score import summarise
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import parse_json, read_text
from tactsim.core.errors import short
from tactsim.core.files import read_bytes, write_text
from tactsim.core.finite import finite
from tactsim.core.npz import read_npz, write_npz
from tactsim.core.poses import FloatArray
from tactsim.core.scan import is_label

SCHEMA = 2
DONE = "done"
LARGEST = 1 << 28  # bytes of a file, and of all that is packed in it
_MOST_ROWS = 500_000
_POSE_STEPS = np.array([2.0**-9, 2.0**-9, 2.0**-12])  # mm, mm, rad
_BITS = {"p_truth": 7, "p_label": 7, "radius_90": 4, "evaluations": 3}  # of a number's mantissa
_SECONDS_BITS, _BOUND_BITS = 5, 7
_POSES = {"pose": ("x", "y", "theta"), "true_pose": ("true_x", "true_y", "true_theta")}
COMPARED = tuple(one.name for one in fields(Trials) if not one.name.endswith("_s"))  # columns; times differ
_UNSURE = 255  # a credibility, counted in percent, of an estimator that did not say


# ---- what a file may say


def _printable(value: str) -> str:
    """Let a text pass that can be shown in one line. Raises ValueError for another."""
    if not value.isprintable():
        raise ValueError("it holds characters that cannot be printed")
    return value


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
Line = Annotated[str, Field(min_length=1, max_length=2100), AfterValidator(_printable)]
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Machine(BaseModel):
    """Where something was computed."""

    model_config = ConfigDict(strict=True, extra="forbid")

    processor: Name
    cores: int = Field(ge=1, le=1_000_000)
    system: Name


class _Head(BaseModel):
    """What a bundle says of the method and of what it was done with."""

    model_config = ConfigDict(strict=True, extra="forbid")

    task: Name
    task_data: Hash
    method: Name
    estimator: Name
    options: dict[str, Any] = Field(max_length=100)
    reproducible: bool
    status: Line
    versions: dict[Name, Name] = Field(max_length=100)
    source_hash: Hash
    machine: Machine
    commit: Name | None
    made: Name
    package: Name | None


class _OneRun(BaseModel):
    """What a bundle says of one run besides its rows: its number of trials, and what run.json and times.json say."""

    model_config = ConfigDict(strict=True, extra="forbid")

    trials: int = Field(ge=1)
    about: dict[str, Any]
    times: dict[str, Any]


class _Meta(_Head):
    schema_: Literal[2] = Field(alias="schema")
    runs: list[_OneRun] = Field(max_length=1000)


class _OldHead(_Head):
    """bundle.json of version 0.1, with the hash of each of its files."""

    schema_: Literal[1] = Field(alias="schema")
    files: dict[str, Hash] = Field(max_length=1000)


# ---- a bundle, its rows, and its file


@dataclass(frozen=True, eq=False)
class Bundle:
    """What a method did on a task.

    task, task_data: the task's name, and the hash of the readings that it stands for. method: how tables call it.
    estimator, options: its registered name, and the options that were given. reproducible: whether the same seed
    gives the same bits, as its author says. status: DONE, or why there is no score. versions: of Python and the
    libraries. source_hash: of the code that the trials depend on. machine: where it ran. commit: of the harness, if it
    is known. made: when, ISO 8601. package: name and version of the distribution that the estimator came in; None if
    it is built in. runs, digests: see `kept`; none without a score.
    """

    task: str
    task_data: str
    method: str
    estimator: str
    options: Mapping[str, Any]
    reproducible: bool
    status: str
    versions: Mapping[str, str]
    source_hash: str
    machine: Mapping[str, Any]
    commit: str | None
    made: str
    package: str | None = None
    runs: tuple[Run, ...] = ()
    digests: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, dtype=np.uint64))

    @cached_property
    def trials(self) -> Trials:
        """Give the trials of all runs, one run after the other. Raises InputError if there are none."""
        return Trials.joined(run.trials for run in self._scored)

    @cached_property
    def ids(self) -> list[tuple[int, str, int]]:
        """Name each of `trials`: seed, letter, number within the letter; two bundles of a task are paired by them."""
        return [
            (run.seed, letter, number)
            for run in self._scored
            for letter, number in zip(run.trials.truth.tolist(), run.trials.trial.tolist(), strict=True)
        ]

    @cached_property
    def pooled(self) -> Pooled:
        """Pool the runs, for figures with intervals over scans and trials. Raises InputError if there are none."""
        pools = pool(self._scored)
        if len(pools) != 1:
            raise InputError(f"the runs of {self.method} differ in more than the seed")
        return pools[0]

    @property
    def _scored(self) -> tuple[Run, ...]:
        if not self.runs:
            raise InputError(f"{self.method} has no score on {self.task}: {self.status}")
        return self.runs


def kept(runs: Iterable[Run]) -> tuple[tuple[Run, ...], NDArray[np.uint64]]:
    """Give what a bundle keeps of runs: their rows rounded, and the digest of each trial, one run after the other."""
    runs = tuple(runs)
    small = tuple(
        replace(
            run,
            trials=rounded(run.trials),
            bounds=None if run.bounds is None else _mantissa(run.bounds, _BOUND_BITS),
            plan=None,
            maps={},
        )
        for run in runs
    )
    found = [digests_of(run.trials) for run in runs]
    return small, np.concatenate(found) if found else np.zeros(0, dtype=np.uint64)


def rounded(trials: Trials) -> Trials:
    """Round the columns of trials as a bundle keeps them: a second time changes nothing.

    Poses are counted in steps of 1/512 mm and 1/4096 rad. Probabilities keep 7 binary digits; radii, times and counts
    of work 3 to 5, since only their means over many trials are looked at. The credibility is cut to a percent, so that
    it counts as below 50 or 90 % as before. Not kept is which reading was taken (-1): the task says so, or the method.
    The time of a reading is kept as a whole, as `update_s`.
    """
    true_pose = _steps(trials.true_pose)
    evaluations = _mantissa(trials.evaluations.astype(float), _BITS["evaluations"]).astype(np.int64)
    return replace(
        trials,
        pose=true_pose + _steps(trials.pose - trials.true_pose),  # so the error is rounded once, not twice
        true_pose=true_pose,
        p_truth=_mantissa(trials.p_truth, _BITS["p_truth"]),
        p_label=_mantissa(trials.p_label, _BITS["p_label"]),
        radius_90=_mantissa(trials.radius_90, _BITS["radius_90"]),
        evaluations=evaluations,
        credibility=np.floor(trials.credibility * 100 + 1e-9) / 100,
        reading=np.full(trials.reading.shape, -1),
        update_s=_mantissa(trials.seconds, _SECONDS_BITS),
        estimate_s=np.zeros(trials.label.shape),
        propose_s=np.zeros(trials.label.shape),
    )


def digests_of(trials: Trials) -> NDArray[np.uint64]:
    """Hash each of n trials (n,): all but the times, to the bit; NaN is NaN."""
    found = np.empty(len(trials.truth), dtype=np.uint64)
    for n in range(len(found)):
        content = hashlib.blake2b(digest_size=8)
        for name in COMPARED:
            value = np.asarray(getattr(trials, name)[n])
            if value.dtype.kind == "U":
                content.update("\0".join(value.ravel().tolist()).encode())
            else:
                number = value.astype("<f8" if value.dtype.kind == "f" else "<i8")
                content.update(np.where(np.isnan(number), np.nan, number).astype(number.dtype).tobytes())
        found[n] = int.from_bytes(content.digest(), "little")
    return found


def _steps(poses: FloatArray) -> FloatArray:
    return np.round(poses / _POSE_STEPS) * _POSE_STEPS


def _mantissa(values: FloatArray, bits: int) -> FloatArray:
    """Round numbers to so many binary digits, as 32 bits hold them."""
    mantissa, exponent = np.frexp(values)
    with np.errstate(under="ignore"):
        return np.ldexp(np.round(mantissa * 2**bits) / 2**bits, exponent).astype("<f4").astype(float)


def write_bundle(bundle: Bundle, path: str | Path) -> None:
    """Write a bundle, whole or not at all; the same bundle gives the same bytes.

    Raises InputError if it says what `read_bundle` would refuse, or cannot be written.
    """
    runs = []
    for run in bundle.runs:
        about, times = results.documents(run)
        runs.append({"trials": len(run.trials.truth), "about": about, "times": times})
    said: dict[str, Any] = {name: getattr(bundle, name) for name in _Head.model_fields}
    meta = json.loads(results.to_json({**said, "schema": SCHEMA, "runs": runs}))
    checked(_Meta, meta, "bundle")
    _check(bundle)
    arrays: dict[str, NDArray[Any]] = {}
    if bundle.runs:
        trials = bundle.trials
        arrays = {"truth": trials.truth, "trial": trials.trial, "known": trials.known, "label": trials.label}
        for name, columns in _POSES.items():
            arrays |= {
                column: getattr(trials, name)[..., k].astype("<f4") for k, column in enumerate(columns)
            }
        arrays |= {name: getattr(trials, name).astype("<f4") for name in _BITS}
        percent = np.nan_to_num(np.round(trials.credibility * 100), nan=_UNSURE)
        arrays |= {"credibility_percent": percent.astype("u1"), "seconds": trials.update_s.astype("<f4")}
        if bundle.pooled.bounds is not None:
            arrays["bound_mm"] = bundle.pooled.bounds.astype("<f4")
        arrays["digest"] = bundle.digests
    write_npz(path, meta, arrays, zipfile.ZIP_LZMA)


def read_bundle(path: str | Path) -> Bundle:
    """Read a bundle; nothing in it is unpickled or run, and what it may claim is limited.

    Raises InputError if it is not a whole bundle, was edited, or has another schema.
    """
    try:
        content = io.BytesIO(read_bytes(path, LARGEST))
        try:
            with zipfile.ZipFile(content) as archive:
                names = archive.namelist()
        except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
            raise InputError(f"it is cut short, damaged or no bundle ({error})") from error
        bundle = _read_old(content) if "bundle.json" in names else _read(content)
        _check(bundle)
    except InputError as error:
        raise InputError(f"bundle {path}: {error}") from error
    return bundle


def _read(content: io.BytesIO) -> Bundle:
    try:
        said = parse_json(str(read_npz(content, ["meta"])["meta"]), "meta")
    except InputError as error:
        raise InputError(f"it is no bundle, which `bench submit` makes, or not whole: {error}") from error
    if "schema" not in said:
        raise InputError("it is no bundle, which `bench submit` makes")
    if said["schema"] != SCHEMA:
        raise InputError(
            f"schema {short(said['schema'])}; this version of tactsim reads schema 1 and {SCHEMA}"
        )
    meta = checked(_Meta, said, "meta")
    head = {name: said[name] for name in _Head.model_fields}
    if not meta.runs:
        return Bundle(**head)
    columns = [column for names in _POSES.values() for column in names]
    numbers = [*columns, *_BITS, "credibility_percent", "seconds"]
    arrays = read_npz(content, ["truth", "trial", "known", "label", "digest", *numbers], ["bound_mm"])
    shape = arrays["label"].shape
    if len(shape) != 2 or not 0 < arrays["label"].size <= _MOST_ROWS:
        raise InputError(f"label has the shape {shape}; a bundle has 1 to {_MOST_ROWS:,} rows")
    kinds = dict.fromkeys(("truth", "label"), "U") | {"trial": "iu", "known": "b", "digest": "u"}
    for name, values in arrays.items():
        one_a_trial = name in ("truth", "trial", "known", "digest")
        if values.shape != (shape[:1] if one_a_trial else shape):
            raise InputError(f"{name} has the shape {values.shape}, and label {shape}")
        if values.dtype.kind not in kinds.get(name, "fu"):
            raise InputError(f"{name} holds {values.dtype}")
    for label in np.unique(np.concatenate([arrays["truth"], arrays["label"].ravel()])).tolist():
        if not is_label(label):
            raise InputError(f"label {short(label)} is empty, too long or not printable")
    if sum(run.trials for run in meta.runs) != shape[0]:
        raise InputError(
            f"its runs have {sum(run.trials for run in meta.runs)} trials, and there are {shape[0]}"
        )
    if "bound_mm" in arrays and not (arrays["bound_mm"] > 0).all():
        raise InputError("bound_mm: a bound is not above 0")

    numbers_of = {name: arrays[name].astype(float) for name in numbers}
    for name, values in numbers_of.items():
        if name == "evaluations":
            if not ((values >= 0) & (values < 2**62)).all():
                raise InputError(f"{name} are no counts")
        else:
            finite(np.nan_to_num(values, nan=0) if name == "radius_90" else values, name)
    percent = numbers_of["credibility_percent"]
    trials = Trials(
        truth=arrays["truth"],
        known=arrays["known"],
        trial=arrays["trial"].astype(np.int64),
        label=arrays["label"],
        reading=np.full(shape, -1),
        **{name: np.stack([numbers_of[one] for one in names], axis=-1) for name, names in _POSES.items()},
        **{name: numbers_of[name] for name in ("p_truth", "p_label", "radius_90")},
        credibility=np.where(percent == _UNSURE, np.nan, percent / 100),
        evaluations=numbers_of["evaluations"].astype(np.int64),
        update_s=numbers_of["seconds"],
        estimate_s=np.zeros(shape),
        propose_s=np.zeros(shape),
    )
    runs, first = [], 0
    for number, run in enumerate(meta.runs):
        rows = slice(first, first + run.trials)
        first += run.trials
        bounds = arrays["bound_mm"][rows].astype(float) if "bound_mm" in arrays else None
        try:
            runs.append(results.run_of(run.about, run.times, select(trials, rows), bounds))
        except InputError as error:
            raise InputError(f"run {number}: {error}") from error
    return Bundle(**head, runs=tuple(runs), digests=arrays["digest"].astype(np.uint64))


def select(trials: Trials, chosen: slice | NDArray[Any]) -> Trials:
    """Select trials by their numbers or by a mask."""
    return Trials(**{one.name: getattr(trials, one.name)[chosen] for one in fields(Trials)})


def _check(bundle: Bundle) -> None:
    """Raise InputError if the runs are not those of one method, or their number is not what the status says."""
    if (bundle.status == DONE) != bool(bundle.runs):
        raise InputError(
            f"the status is {short(bundle.status)}, and there are {len(bundle.runs)} runs; only a method that was "
            "done has runs"
        )
    for run in bundle.runs:
        if run.estimator != bundle.estimator:
            raise InputError(f"seed {run.seed} is a run of {short(run.estimator)}, not of {bundle.estimator}")
    if len({run.readings for run in bundle.runs}) > 1:
        raise InputError("its runs have different numbers of readings")
    if bundle.runs and len(bundle.digests) != len(bundle.trials.truth):
        raise InputError(f"it has {len(bundle.digests)} digests of {len(bundle.trials.truth)} trials")


# ---- the archive that version 0.1 wrote


_OLD_MEMBER = re.compile(
    r"bundle\.json|"
    r"seed-(0|[1-9]\d{0,18})/(run\.json|trials\.csv|times\.csv|bounds\.csv|summary\.json|times\.json)"
)


def _read_old(content: io.BytesIO) -> Bundle:
    try:
        with zipfile.ZipFile(content) as archive:
            members = _old_members(archive)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"it is cut short, damaged or no bundle ({error})") from error
    said = parse_json(members.pop("bundle.json"), "bundle.json")
    head = checked(_OldHead, said, "bundle.json")
    for name in sorted(head.files.keys() ^ members.keys()):
        raise InputError(f"{short(name)} is {'missing' if name in head.files else 'not one of its files'}")
    for name, member in members.items():
        if hashlib.sha256(member).hexdigest() != head.files[name]:
            raise InputError(f"it was edited: {name} is not what the checksum in bundle.json says")
    runs = []
    with TemporaryDirectory(prefix="tactsim-") as folder:
        for name, member in members.items():
            path = Path(folder) / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(member)
        for path in sorted(Path(folder).iterdir(), key=lambda one: int(one.name.removeprefix("seed-"))):
            try:
                runs.append(results.load(path))
            except InputError as error:
                raise InputError(str(error).replace(str(path), path.name)) from error
    small, digests = kept(runs)
    return Bundle(**{name: said[name] for name in _Head.model_fields}, runs=small, digests=digests)


def _old_members(archive: zipfile.ZipFile) -> dict[str, bytes]:
    left, members = LARGEST, dict[str, bytes]()
    for info in archive.infolist():
        name = info.filename
        if not _OLD_MEMBER.fullmatch(name) or name in members:
            raise InputError(f"{short(name)} is no file of a bundle, or is there twice")
        if info.file_size > left:
            raise InputError(f"{name} claims {info.file_size:,} bytes; {left:,} are left of {LARGEST:,}")
        members[name] = archive.read(info)  # never more than it claims
        left -= info.file_size
        if name.endswith(".csv") and members[name].count(b"\n") > _MOST_ROWS + 1:
            raise InputError(f"{name} has more than {_MOST_ROWS:,} rows")
    return members


# ---- figures


def figures_of(bundle: Bundle, scored: Iterable[str]) -> dict[str, float | None]:
    """Compute figures, METRIC@READINGS or METRIC, over the trials of all seeds; None where one is not defined.

    Raises InputError if there are no runs.
    """
    summary = summarise(bundle.trials, bundle.runs[0].objects)
    found = {}
    for figure in scored:
        metric, at, reading = figure.partition("@")
        found[figure] = summary[metric][int(reading) - 1] if at else summary[metric]
    return found


# ---- what a check found


class Record(BaseModel):
    """What `bench verify --record` found, in a file beside the bundle.

    bundle: SHA-256 of the file that was checked. verified: whether it was confirmed. exact: whether all trials that
    were done again were the same to the bit; if not, they were compared within the bound. said: what was found. again,
    trials: how many trials were done again, of how many. fresh: whether a run on a fresh seed was done too. other_code:
    whether the code there was not that of the bundle; then one that is not confirmed is not refuted either. seed: which
    trials were chosen by; None if all were done. machine, versions, commit: where it was checked and with what. made:
    when, ISO 8601.
    """

    model_config = ConfigDict(strict=True, extra="forbid", populate_by_name=True)

    schema_: Literal[1] = Field(1, alias="schema")
    bundle: Hash
    verified: bool
    exact: bool
    said: Line
    again: int = Field(ge=0)
    trials: int = Field(ge=0)
    fresh: bool = False
    other_code: bool = False
    seed: int | None
    machine: Machine
    versions: dict[Name, Name] = Field(max_length=100)
    commit: Name | None
    made: Name


def record_path(bundle: Path) -> Path:
    """Name the file of a bundle's record: letters.zip has letters.verified.json beside it."""
    return bundle.with_suffix(".verified.json")


def bundle_hash(bundle: Path) -> str:
    """Hash a bundle's file (SHA-256, hex). Raises InputError if it cannot be read."""
    return hashlib.sha256(read_bytes(bundle, LARGEST)).hexdigest()


def write_record(record: Record, bundle: Path) -> Path:
    """Write a record beside its bundle, in the place of an older one; gives its path. Raises InputError."""
    path = record_path(bundle)
    write_text(path, results.to_json(record.model_dump(mode="json", by_alias=True)))
    return path


def read_record(bundle: Path) -> Record | None:
    """Read the record beside a bundle; None if there is none.

    Raises InputError if it is damaged, or is of another file: a bundle that was changed since counts as unchecked.
    """
    path = record_path(bundle)
    if not path.exists():
        return None
    record = checked(
        Record, parse_json(read_text(path, "record of a check"), f"record {path}"), f"record {path}"
    )
    if record.bundle != bundle_hash(bundle):
        raise InputError(
            f"record {path} is of another file than {bundle}; `bench verify --record` makes a new one"
        )
    return record
