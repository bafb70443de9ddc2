"""`Bundle`: what a method did on a task, in one small file that somebody else can check; and `Record`, of such a check.

The file is an archive (.tar.xz) of the folders of the runs, one a seed, and of bundle.json, which says who did what,
where and with which code. In a folder are run.json and times.json as every run has them, and its trials as NumPy reads
them, rounded to what the figures of a table can tell (`rounded`).
"""

from __future__ import annotations

import hashlib
import io
import lzma
import re
import tarfile
import zipfile
from collections.abc import Iterable
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from tactsim.bench import results
from tactsim.bench.columns import Table
from tactsim.bench.results import PACKED, Run
from tactsim.bench.runs.pooled import Pooled, pool
from tactsim.bench.runs.saved import load
from tactsim.bench.score import summarise
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import parse_json, read_text
from tactsim.core.errors import short
from tactsim.core.files import read_bytes, replacing, write_text
from tactsim.core.poses import FloatArray

SUFFIX = ".tar.xz"
DONE = "done"
LARGEST = 1 << 28  # bytes of a file, and of all that is packed in it
_MOST_ROWS = 500_000
_MEMBER = re.compile(rf"bundle\.json|seed-(0|[1-9]\d{{0,18}})/(run\.json|times\.json|{re.escape(PACKED)})")
_POSE_STEPS = np.array([2.0**-9, 2.0**-9, 2.0**-12])  # mm, mm, rad
_BITS = {"p_truth": 7, "p_label": 7, "radius_90": 4, "nees": 4, "evaluations": 3}  # of a number's mantissa
_SECONDS_BITS, _BOUND_BITS = 5, 7


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


class Bundle(BaseModel):
    """What a method did on a task; all but the runs stand in bundle.json.

    task, task_data: the task's name, and the hash of the readings that it stands for. method: how tables call it.
    estimator, options: its registered name, and the options that were given. reproducible: whether the same seed
    gives the same bits, as its author says. status: DONE, or why there is no score. versions: of Python and the
    libraries. source_hash: of the code that the trials depend on. machine: where it ran. commit: of the harness, if it
    is known. made: when, ISO 8601. package: name and version of the distribution that the estimator came in; None if
    it is built in. runs: one a seed, as `kept` gives them; none without a score.
    """

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

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
    runs: tuple[Any, ...] = Field((), exclude=True)  # of `Run`, which is checked by itself

    @cached_property
    def pooled(self) -> Pooled:
        """Pool the runs, for figures with intervals over scans and trials. Raises InputError if there are none."""
        if not self.runs:
            raise InputError(f"{self.method} has no score on {self.task}: {self.status}")
        pools = pool(self.runs)
        if len(pools) != 1:
            raise InputError(f"the runs of {self.method} differ in more than the seed")
        return pools[0]


def kept(runs: Iterable[Run]) -> tuple[Run, ...]:
    """Give what a bundle keeps of runs: their rows rounded, and neither maps nor plans."""
    found = []
    for run in runs:
        bounds = None if run.bounds is None else _mantissa(run.bounds, _BOUND_BITS)
        found.append(replace(run, trials=rounded(run.trials), bounds=bounds, plan=None, maps={}))
    return tuple(found)


def rounded(trials: Trials) -> Trials:
    """Round the columns of trials as a bundle keeps them: a second time changes nothing.

    Poses are counted in steps of 1/512 mm and 1/4096 rad. Probabilities keep 7 binary digits; radii, times and counts
    of work 3 to 5, since only their means over many trials are looked at. The credibility is that of the middle of
    its percent, so that it counts as below 50 or 90 % as before. Not kept is which touch was taken (-1): the task
    says so, or the method. The time of a reading is kept as a whole, as `update_s`.
    """
    true_pose = _steps(trials.true_pose)
    few: dict[str, Any] = {
        name: _mantissa(getattr(trials, name).astype(float), bits) for name, bits in _BITS.items()
    }
    percent = np.floor(trials.credibility * 100 + 1e-9)
    return replace(
        trials,
        **few | {"evaluations": few["evaluations"].astype(np.int64)},
        # The error is rounded once, not twice
        pose=_steps(true_pose + _steps(trials.pose - trials.true_pose)),
        true_pose=true_pose,
        credibility=np.minimum((percent + 0.5) / 100, 1).astype("<f4").astype(float),
        touch_index=np.full(trials.touch_index.shape, -1),
        update_s=_mantissa(trials.seconds, _SECONDS_BITS),
        estimate_s=np.zeros(trials.label.shape),
        propose_s=np.zeros(trials.label.shape),
    )


def _steps(poses: FloatArray) -> FloatArray:
    return (np.round(poses / _POSE_STEPS) * _POSE_STEPS).astype("<f4").astype(float)


def _mantissa(values: FloatArray, bits: int) -> FloatArray:
    """Round numbers to so many binary digits, as 32 bits hold them."""
    mantissa, exponent = np.frexp(values)
    with np.errstate(under="ignore"):
        return np.ldexp(np.round(mantissa * 2**bits) / 2**bits, exponent).astype("<f4").astype(float)


def select(trials: Trials, chosen: slice | NDArray[Any]) -> Trials:
    """Select trials by their numbers or by a mask."""
    return type(trials)(**{one.name: getattr(trials, one.name)[chosen] for one in fields(trials)})


def write_bundle(bundle: Bundle, path: str | Path) -> None:
    """Write a bundle, whole or not at all; the same bundle gives the same bytes.

    Raises InputError if it says what `read_bundle` would refuse, or cannot be written.
    """
    _check(bundle)
    members = {"bundle.json": results.to_json(bundle.model_dump()).encode()}
    for run in bundle.runs:
        about, times = results.documents(run)
        table = run.columns() | ({} if run.bounds is None else {"bound_mm": run.bounds.ravel()})
        of_run = {"run.json": results.to_json(about).encode(), "times.json": results.to_json(times).encode()}
        of_run[PACKED] = _packed(table)
        members |= {f"seed-{run.seed}/{name}": member for name, member in of_run.items()}
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w:xz") as archive:
        for name, member in members.items():
            info = tarfile.TarInfo(name)  # without a date
            info.size = len(member)
            archive.addfile(info, io.BytesIO(member))
    with replacing(path) as stream:
        stream.write(content.getbuffer())


def _packed(table: Table) -> bytes:
    """Write columns as .npz, not compressed: numbers in 32 bits, counts in as few bytes as hold them.

    The same columns give the same bytes.
    """
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, values in table.items():
            if values.dtype.kind == "f":
                values = values.astype(np.float32)
            elif values.dtype.kind == "i":
                ends = np.min_scalar_type(values.min()), np.min_scalar_type(values.max())
                values = values.astype(np.promote_types(*ends))
            content = io.BytesIO()
            np.save(content, values, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getbuffer())
    return packed.getvalue()


def read_bundle(path: str | Path) -> Bundle:
    """Read a bundle; nothing in it is unpickled or run, and what it may claim is limited.

    Raises InputError if it is not a whole bundle, is of an earlier version, or has another file or a link in it.
    """
    try:
        members = _members(read_bytes(path, LARGEST))
        said = parse_json(members.pop("bundle.json", b"{}"), "bundle.json")
        bundle = checked(Bundle, {**said, "runs": ()}, "bundle.json")
        runs = []
        with TemporaryDirectory(prefix="tactsim-") as folder:
            for name, member in members.items():
                place = Path(folder) / name
                place.parent.mkdir(exist_ok=True)
                place.write_bytes(member)
            for place in sorted(Path(folder).iterdir(), key=lambda one: int(one.name.removeprefix("seed-"))):
                try:
                    runs.append(load(place))
                except InputError as error:
                    raise InputError(str(error).replace(str(place), place.name)) from error
        bundle = bundle.model_copy(update={"runs": tuple(runs)})
        _check(bundle)
    except InputError as error:
        raise InputError(f"bundle {path}: {error}") from error
    return bundle


def _members(content: bytes) -> dict[str, bytes]:
    """Unpack an archive in memory. Raises InputError for one that is damaged, too large or no bundle."""
    if content[:2] == b"PK":
        raise InputError("it is of an earlier version, which this one does not read; `bench submit` anew")
    members = dict[str, bytes]()
    try:
        unpacker = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=LARGEST)
        unpacked = unpacker.decompress(content, LARGEST + 1)
        if len(unpacked) > LARGEST:
            raise InputError(f"more than {LARGEST:,} bytes are packed in it")
        if not unpacker.eof:
            raise InputError("it is cut short")
        with tarfile.open(fileobj=io.BytesIO(unpacked), mode="r:") as archive:
            for info in archive:
                name = info.name
                plain = info.type == tarfile.REGTYPE and not info.issparse()
                if not plain or not _MEMBER.fullmatch(name) or name in members:
                    raise InputError(f"{short(name)} is no file of a bundle, or is there twice")
                stream = archive.extractfile(info)
                assert stream is not None
                members[name] = stream.read()
    except (lzma.LZMAError, tarfile.TarError, EOFError, ValueError) as error:
        raise InputError(f"it is damaged, or no bundle, which `bench submit` makes ({error})") from error
    return members


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
    if sum(run.trials.label.size for run in bundle.runs) > _MOST_ROWS:
        raise InputError(f"it has more than {_MOST_ROWS:,} rows")


def figures_of(bundle: Bundle, scored: Iterable[str]) -> dict[str, float | None]:
    """Compute figures, METRIC@READINGS or METRIC, over the trials of all seeds; None where one is not defined.

    Raises InputError if there are no runs.
    """
    summary = summarise(bundle.pooled.scored)
    found = {}
    for figure in scored:
        metric, at, reading = figure.partition("@")
        found[figure] = summary[metric][int(reading) - 1] if at else summary[metric]
    return found


# ---- what a check found


class Record(BaseModel):
    """What `bench verify --record` found, in a file beside the bundle.

    bundle: SHA-256 of the file that was checked. verified: whether it was confirmed. said: what was found. again,
    trials: how many trials were done again, of how many. seed: which trials were chosen by; None if all were done.
    commit: of the harness that checked. made: when, ISO 8601.
    """

    model_config = ConfigDict(strict=True, extra="forbid")

    bundle: Hash
    verified: bool
    said: Line
    again: int = Field(ge=0)
    trials: int = Field(ge=0)
    seed: int | None
    commit: Name | None
    made: Name


def record_path(bundle: Path) -> Path:
    """Name the file of a bundle's record: letters.tar.xz has letters.verified.json beside it."""
    return bundle.with_name(f"{bundle.name.removesuffix(SUFFIX)}.verified.json")


def bundle_hash(bundle: Path) -> str:
    """Hash a bundle's file (SHA-256, hex). Raises InputError if it cannot be read."""
    return hashlib.sha256(read_bytes(bundle, LARGEST)).hexdigest()


def write_record(record: Record, bundle: Path) -> Path:
    """Write a record beside its bundle, in the place of an older one; gives its path. Raises InputError."""
    path = record_path(bundle)
    write_text(path, results.to_json(record.model_dump(mode="json")))
    return path


def read_record(bundle: Path) -> Record | None:
    """Read the record beside a bundle; None if there is none.

    Raises InputError if it is damaged, or is of another file: a bundle that was changed since counts as unchecked.
    """
    path = record_path(bundle)
    if not path.exists():
        return None
    said = parse_json(read_text(path, "record of a check"), f"record {path}")
    record = checked(Record, said, f"record {path}")
    if record.bundle != bundle_hash(bundle):
        raise InputError(f"record {path} is of another file than {bundle}; do `bench verify --record` anew")
    return record
