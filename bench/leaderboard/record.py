"""`Record`: that a bundle was checked, by whom with what, and what came of it; a file beside the bundle."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from tactsim.bench import results
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import parse_json, read_text
from tactsim.core.files import read_bytes, write_text

_LARGEST_BUNDLE = 1 << 28  # bytes


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


class Record(BaseModel):
    """What `bench verify --record` found.

    bundle: SHA-256 of the file that was checked. verified: whether it was confirmed. exact: whether all trials that
    were done again were the same to the bit; if not, they were compared within the bound. said: what was found. again,
    trials: how many trials were done again, of how many. fresh: whether a run on a fresh seed was done too. seed: which
    trials were chosen by; None if all were done.
    machine, versions, commit: where it was checked and with what. made: when, ISO 8601.
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
    return hashlib.sha256(read_bytes(bundle, _LARGEST_BUNDLE)).hexdigest()


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
    said: dict[str, Any] = parse_json(read_text(path, "record of a check"), f"record {path}")
    record = checked(Record, said, f"record {path}")
    if record.bundle != bundle_hash(bundle):
        raise InputError(
            f"record {path} is of another file than {bundle}; `bench verify --record` makes a new one"
        )
    return record
