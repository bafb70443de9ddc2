"""`Bundle`: what a method did on a task, in one file that somebody else can check.

The file is a zip archive. `bundle.json` says who did what, where and with which code, and has a checksum of every
other member. `seed-N/` is the folder of a run, as `bench run` writes it, for each seed of the task: unpacked, it can be
read, reported and compared like any run. Checksums find damage and careless edits. What they cannot find, because
whoever edits rows can seal them again, `bench verify` finds: it does trials again.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from tactsim.bench import results
from tactsim.bench.leaderboard.record import Hash, Line, Machine, Name
from tactsim.bench.pooled import Pooled, pool
from tactsim.bench.results import Run
from tactsim.bench.score import summarise
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import parse_json
from tactsim.core.errors import short
from tactsim.core.files import opened, replacing

SCHEMA = 1
DONE = "done"
_LARGEST = 1 << 28  # bytes of all members together, unpacked
_MOST_ROWS = 500_000  # of a table
_PIECE = 1 << 20  # bytes that are unpacked at a time
_HEAD = "bundle.json"
_MEMBER = re.compile(
    r"seed-(0|[1-9]\d{0,18})/(run\.json|trials\.csv|times\.csv|bounds\.csv|summary\.json|times\.json)"
)
_DATE = (1980, 1, 1, 0, 0, 0)  # of every member: the same content gives the same bytes
_ENCRYPTED = 1  # bit of a member's flags


@dataclass(frozen=True, eq=False)
class Bundle:
    """What a method did on a task.

    task, task_data: the task's name, and the hash of the readings that it stands for. method: how tables call it.
    estimator, options: its registered name, and the options that were given. reproducible: whether the same seed
    gives the same bits, as its author says. status: DONE, or why there is no score. versions: of Python and the
    libraries. source_hash: of the code that the trials depend on. machine: where it ran. commit: of the harness, if it
    is known. made: when, ISO 8601. runs: one for each seed; none without a score. package: name and version of the
    distribution that the estimator came in; None if it is built in.
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
    runs: tuple[Run, ...] = field(default=())
    package: str | None = None

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


def write_bundle(bundle: Bundle, path: str | Path) -> None:
    """Write a bundle, whole or not at all; the same bundle gives the same bytes.

    Raises InputError if it says what `read_bundle` would refuse, or cannot be written.
    """
    with TemporaryDirectory(prefix="tactsim-") as name:
        folder = Path(name)
        for run in bundle.runs:
            inside = folder / f"seed-{run.seed}"
            inside.mkdir()
            results.save(run, inside)
        places = sorted(one for one in folder.rglob("*") if one.is_file())
        members = {str(one.relative_to(folder)): one.read_bytes() for one in places}
    names = [name for name in _Head.model_fields if name not in ("schema_", "files")]
    said = {name: getattr(bundle, name) for name in names}
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in members.items()}
    content = results.to_json({**said, "schema": SCHEMA, "files": sums})
    _check(_head(content), bundle.runs)
    with replacing(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, member in {_HEAD: content.encode(), **members}.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), member, zipfile.ZIP_DEFLATED)


def read_bundle(path: str | Path) -> Bundle:
    """Read a bundle; nothing in it is unpickled or run, and what it may claim is limited.

    Raises InputError if it is not a whole bundle, was edited, or has another schema.
    """
    try:
        return _read(path)
    except InputError as error:
        raise InputError(f"bundle {path}: {error}") from error


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


class _Head(BaseModel):
    """What bundle.json says."""

    model_config = ConfigDict(strict=True, extra="forbid")

    schema_: Literal[1] = Field(alias="schema")
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
    files: dict[str, Hash] = Field(max_length=1000)


def _head(content: str | bytes) -> _Head:
    said = parse_json(content, _HEAD)
    if said.get("schema") != SCHEMA:
        raise InputError(
            f"{_HEAD}: schema {short(said.get('schema'))}; this version of tactsim reads schema {SCHEMA}"
        )
    return checked(_Head, said, _HEAD)


def _read(path: str | Path) -> Bundle:
    with opened(path) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                members = _members(archive)
        # A name that is not UTF-8 is a ValueError.
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            NotImplementedError,
            RuntimeError,
            ValueError,
        ) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"it is cut short, damaged or no bundle ({error})") from error
    if _HEAD not in members:
        raise InputError(f"it is no bundle: it has no {_HEAD}; `bench submit` makes one")
    head = _head(members.pop(_HEAD))
    for name in sorted(head.files.keys() ^ members.keys()):
        raise InputError(f"{short(name)} is {'missing' if name in head.files else 'not one of its files'}")
    for name, content in members.items():
        if hashlib.sha256(content).hexdigest() != head.files[name]:
            raise InputError(f"it was edited: {name} is not what the checksum in {_HEAD} says")
    runs = _runs(members)
    _check(head, runs)
    said = {name: getattr(head, name) for name in _Head.model_fields if name not in ("schema_", "files")}
    return Bundle(**said | {"machine": head.machine.model_dump()}, runs=runs)


def _members(archive: zipfile.ZipFile) -> dict[str, bytes]:
    left, members = _LARGEST, dict[str, bytes]()
    for info in archive.infolist():
        name = info.filename
        if name != _HEAD and not _MEMBER.fullmatch(name):
            raise InputError(f"{short(name)} is no file of a bundle")
        if name in members:
            raise InputError(f"{name} is there twice")
        if info.flag_bits & _ENCRYPTED or info.compress_type not in (
            zipfile.ZIP_STORED,
            zipfile.ZIP_DEFLATED,
        ):
            raise InputError(f"{name} is encrypted or compressed in a way that `bench submit` does not use")
        if info.file_size > left:
            raise InputError(f"{name} claims {info.file_size:,} bytes; {left:,} are left of {_LARGEST:,}")
        pieces = []
        with archive.open(info) as member:
            while piece := member.read(_PIECE):
                pieces.append(piece)
                left -= len(piece)
                if left < 0:
                    raise InputError(f"its files take more than {_LARGEST:,} bytes")
        members[name] = b"".join(pieces)
        if name.endswith(".csv") and members[name].count(b"\n") > _MOST_ROWS + 1:
            raise InputError(f"{name} has more than {_MOST_ROWS:,} rows")
    return members


def _runs(members: Mapping[str, bytes]) -> tuple[Run, ...]:
    """Load the runs by seed; each must be whole, and its summary what its rows give."""
    runs = []
    with TemporaryDirectory(prefix="tactsim-") as name:
        for place, content in members.items():
            path = Path(name) / place
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
        for seed in sorted({int(place.partition("/")[0].removeprefix("seed-")) for place in members}):
            folder = Path(name) / f"seed-{seed}"
            try:
                run = results.load(folder)
                if run.seed != seed:
                    raise InputError(f"run.json: its seed is {run.seed}")
                if not (folder / "summary.json").is_file():
                    raise InputError("summary.json is missing")
                stated = parse_json(members[f"seed-{seed}/summary.json"], "summary.json")
                if not _alike(stated, json.loads(results.to_json(run.summary))):
                    raise InputError("it was edited: summary.json is not what the rows of trials.csv give")
            except InputError as error:
                raise InputError(str(error).replace(str(folder), f"seed-{seed}")) from error
            runs.append(run)
    return tuple(runs)


def _check(head: _Head, runs: tuple[Run, ...]) -> None:
    """Raise InputError if the runs are not those of one method, or their number is not what the status says."""
    if (head.status == DONE) != bool(runs):
        raise InputError(
            f"{_HEAD}: the status is {short(head.status)}, and there are {len(runs)} runs; only a method that was "
            "done has runs"
        )
    shape: dict[tuple[str, int], int] = {}
    for run in runs:
        shape.setdefault((run.estimator, run.readings), run.seed)
        if run.estimator != head.estimator:
            raise InputError(f"seed-{run.seed} is a run of {short(run.estimator)}, not of {head.estimator}")
    if len(shape) > 1:
        raise InputError("its runs have different numbers of readings")


def _alike(one: Any, other: Any) -> bool:
    """Compare nested values; numbers may differ by rounding, which another machine may do in another order."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_alike(value, other[key]) for key, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, float) or isinstance(other, float):
        numbers = isinstance(one, int | float) and isinstance(other, int | float)
        return numbers and math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)
    return one == other
