"""Choose where results go, and check before the work starts that they can be written there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from tactsim.core import InputError

RESULTS = Path("results")
RUNS = RESULTS / "runs"
SWEEPS = RESULTS / "sweeps"


def new_place(name: str) -> Path:
    """Name a folder under results/runs that does not exist yet, by what is run and when."""
    stamp = f"{datetime.now():%Y-%m-%d-%H%M%S}"
    place = RUNS / f"{name}-{stamp}"
    number = 2
    while place.exists():
        place, number = RUNS / f"{name}-{stamp}-{number}", number + 1
    return place


def check_new_folder(path: Path) -> None:
    """Raise InputError unless a new folder can be made at `path`, or an empty one stands there."""
    with _refusing(path):
        if path.exists() and not path.is_dir():
            raise InputError(f"--out {path}: that is a file; name a new folder")
        _check_writable(path)
        if path.is_dir() and any(path.iterdir()):
            raise InputError(f"--out {path}: the folder holds something already; name a new one")


def check_new_file(path: Path) -> None:
    """Raise InputError unless a file can be written at `path`."""
    with _refusing(path):
        if path.is_dir():
            raise InputError(f"--out {path}: that is a folder; name a file in it")
        _check_writable(path.parent)


def _check_writable(path: Path) -> None:
    standing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not standing.is_dir():
        raise InputError(f"--out {path}: {standing} is a file, no folder")
    if not os.access(standing, os.R_OK | os.W_OK | os.X_OK):
        raise InputError(f"--out {path}: {standing} cannot be written; name another folder")


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Turn the system's error for an impossible path into an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(f"--out {path}: {error.strerror or error}") from error
