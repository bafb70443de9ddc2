"""Choose where results go, and check before the work starts that they can be written there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryFile

from tactsim.bench.console import plain_console
from tactsim.core import InputError
from tactsim.core.files import KeptBeside

RESULTS = Path("results")
RUNS = RESULTS / "runs"
SWEEPS = RESULTS / "sweeps"


def results_folder(out: Path | None, name: str) -> Path:
    """Choose the folder where results go: `out`, or one under results/runs, named by what is run and when.

    Of two runs that begin in the same second `save_beside` keeps both. Raises InputError if it cannot be written or
    `out` holds something.
    """
    if out is not None:
        check_new_folder(out)
        return out
    with _refusing(RUNS):
        _check_writable(RUNS, RUNS)
    return RUNS / f"{name}-{datetime.now():%Y-%m-%d-%H%M%S}"


def save_beside(save: Callable[[Path], Path], folder: Path) -> Path:
    """Save a new folder as `folder`, or, if it cannot be put there, beside it, and say so.

    save: writes a new folder whole or not at all, and returns its path. Returns the path that was written. Raises
    InputError as `save` does where it could not be written.
    """
    place, number = folder, 1
    while True:
        try:
            saved = save(place)
        except KeptBeside as kept:
            plain_console(stderr=True).print(str(kept))
            return kept.place
        except InputError:
            if not (place.is_file() or (place.is_dir() and any(place.iterdir()))):
                raise
        else:
            if place != folder:
                plain_console(stderr=True).print(f"{folder} was taken meanwhile; the results are in {place}")
            return saved
        number += 1
        whole = folder if folder.name not in ("", "..") else folder.resolve()
        place = whole.with_name(f"{whole.name}-{number}")


@contextmanager
def saved(save: Callable[[], Path] | None) -> Iterator[Path | None]:
    """Save results for the block, which shows them; where saving fails, as on a full disk, the error comes after it.

    save: writes them and returns where; None if they are only to be shown. Yields the place; None: in no file.
    """
    place: Path | None = None
    failure: InputError | None = None
    try:
        place = None if save is None else save()
    except InputError as error:
        failure = InputError(f"{error}; the results are in no file, only in what was printed")
        failure.__cause__ = error
    yield place
    if failure is not None:
        raise failure


def check_folder(path: Path) -> None:
    """Raise InputError unless a folder that can be written is at `path`, or can be made there."""
    with _refusing(path):
        if path.exists() and not path.is_dir():
            raise InputError(f"--out {path}: that is a file; name a new folder")
        _check_writable(path, path)


def check_new_folder(path: Path) -> None:
    """Raise InputError unless a new folder can be made at `path`, or an empty one stands there."""
    check_folder(path)
    with _refusing(path):
        if path.is_dir() and any(path.iterdir()):
            raise InputError(f"--out {path}: the folder holds something already; name a new one")


def check_new_file(
    path: Path, *others: Path | None, suffix: str = "", picture: str = "", option: str = "--out"
) -> None:
    """Raise InputError unless a file can be written at `path` and nothing that is wanted is lost by it.

    A file that exists may hold what somebody measured, and is not replaced. others: what the command reads, or writes
    besides; the file may be none of them. suffix: how the name has to end. picture: the same of a picture or page; one
    that exists is replaced, since it can be drawn again. option: what names the file.
    """
    with _refusing(path, option):
        if path.is_dir():
            raise InputError(f"{option} {path}: that is a folder; name a file in it")
        _check_writable(path.parent, path, option)
        if path.resolve() in [other.resolve() for other in others if other is not None]:
            raise InputError(f"{option} {path}: the command reads or writes that besides; name another file")
        if not picture and path.exists():
            raise InputError(f"{option} {path} exists; name another file")
        if not path.name.lower().endswith(ending := picture or suffix):
            raise InputError(f"{option} {path}: name it FILE{ending}")


def _check_writable(folder: Path, path: Path, option: str = "--out") -> None:
    """Raise InputError unless files can be made in the folder, or it can be made. path: what the user named."""
    standing = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not standing.is_dir():
        raise InputError(f"{option} {path}: {standing} is a file, no folder")
    try:
        with TemporaryFile(dir=standing):  # permissions alone do not tell: root has them all, also in /proc
            pass
    except OSError as error:
        raise InputError(f"{option} {path}: {standing} cannot be written; name another folder") from error


@contextmanager
def _refusing(path: Path, option: str = "--out") -> Iterator[None]:
    """Turn the system's error for an impossible path into an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{option} {path}: {error.strerror or error}") from error
