"""What `bench verify --record` found of a bundle, kept beside it: NAME.verified.json for NAME.zip."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from tactsim.bench.leaderboard.verification import Verdict
from tactsim.bench.machine import machine
from tactsim.bench.results import to_json
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import read_json
from tactsim.core.files import read_bytes, write_text
from tactsim.core.source_digest import git_commit

_LARGEST = 1 << 30  # bytes of a bundle


class Check(BaseModel):
    """What was compared, by which commit, when and where.

    bundle: SHA-256 of the file that was checked. verified, said, again, trials, notes: as `Verdict` says. seed: of the
    choice of the trials. commit: of the harness that did them again; None if it is unknown. made: when, ISO 8601.
    """

    model_config = ConfigDict(strict=True, extra="forbid")

    schema_: Literal[1] = Field(1, alias="schema")
    bundle: str = Field(pattern="^[0-9a-f]{64}$")
    verified: bool
    said: str = Field(max_length=2000)
    again: int = Field(ge=0)
    trials: int = Field(ge=0)
    notes: list[str] = Field(max_length=100)
    seed: int = Field(ge=0)
    commit: str | None
    processor: str
    made: str


def check_place(bundle: Path) -> Path:
    """Name the file that holds the check of a bundle."""
    return bundle.with_name(f"{bundle.name.removesuffix('.zip')}.verified.json")


def write_check(bundle: Path, verdict: Verdict, seed: int) -> Path:
    """Write what was found beside the bundle, and return its place. Raises InputError if it cannot be written."""
    found = Check(
        bundle=_digest(bundle), verified=verdict.verified, said=verdict.said, again=verdict.again,
        trials=verdict.trials, notes=list(verdict.notes), seed=seed, commit=git_commit(),
        processor=str(machine()["processor"]), made=datetime.now(UTC).isoformat(timespec="seconds"),
    )  # fmt: skip
    write_text(check_place(bundle), to_json(found.model_dump(by_alias=True)))
    return check_place(bundle)


def read_check(bundle: Path) -> Check | None:
    """Read the check of a bundle; None if it was not checked.

    Raises InputError if the file is damaged or is the check of another file than this bundle.
    """
    place = check_place(bundle)
    if not place.exists():
        return None
    found = checked(Check, read_json(place, "check of a bundle"), str(place))
    if found.bundle != _digest(bundle):
        raise InputError(
            f"{place} is the check of another file than {bundle}; do `bench verify --record` anew"
        )
    return found


def _digest(bundle: Path) -> str:
    return hashlib.sha256(read_bytes(bundle, _LARGEST)).hexdigest()
