"""Write a file or a folder whole or not at all; read untrusted files safely."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import IO

from tactsim.core.errors import InputError

_PIECE = 1 << 20  # bytes that are read at a time
_IN_THE_WAY = {
    errno.ENOTEMPTY: "it holds something already; name a new folder",
    errno.EEXIST: "it is there already; name a new folder",
    errno.EISDIR: "it is a folder; name a file in it",
    errno.ENOTDIR: "a file is in the way; name another folder",
}


class KeptBeside(InputError):
    """A folder that was written whole and could not be put in its place. place: where it is."""

    def __init__(self, target: Path, error: OSError, place: Path) -> None:
        taken = error.errno in _IN_THE_WAY
        why = "was taken meanwhile" if taken else f"cannot be replaced ({error.strerror or error})"
        super().__init__(f"{target} {why}; the results are in {place}")
        self.place = place


@contextmanager
def replacing(path: str | Path) -> Iterator[IO[bytes]]:
    """Open a temporary file beside `path` for writing and move it there when all went well.

    A reader sees the old file or the new one, never half of it. After an exception or an interrupt the
    old file stands and the temporary file is removed. Missing folders are made.

    Raises InputError if the place cannot be written or the disk is full.
    """
    target = Path(path)
    temporary: Path | None = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent)
        temporary = Path(name)
        with os.fdopen(descriptor, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(target)
    except OSError as error:
        raise _unwritable(target, error) from error
    finally:
        if temporary is not None:
            with suppress(FileNotFoundError):
                temporary.unlink()


@contextmanager
def new_folder(path: str | Path) -> Iterator[Path]:
    """Give a temporary folder to fill; it becomes `path` when all went well and vanishes otherwise.

    `path` must not exist yet or be an empty folder. One that cannot be replaced, such as the working folder, a mounted
    one or a link to one, gets what was filled. Raises InputError if it holds something or cannot be written. Raises
    KeptBeside if all was written and cannot be put in its place: then it stays beside it.
    """
    target = Path(path)
    temporary: Path | None = None
    try:
        if target.exists() and not target.is_dir():
            raise OSError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if target.is_dir() and any(target.iterdir()):
            raise OSError(errno.ENOTEMPTY, os.strerror(errno.ENOTEMPTY))
        stays = target.is_dir() and _stays(target)
        if not stays:
            target.parent.mkdir(parents=True, exist_ok=True)
        room = target if stays else target.parent
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".part", dir=room))
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        try:
            if stays:
                _move_up(temporary, target)
            else:
                temporary.replace(target)
        except OSError as error:
            kept, temporary = _kept_beside(temporary, target), None
            raise KeptBeside(target, error, kept) from error
    except OSError as error:
        raise _unwritable(target, error) from error
    except KeptBeside:
        raise
    except InputError as error:  # of a file in it, by the name that the user knows
        raise InputError(str(error).replace(str(temporary), str(target))) from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def write_bytes(path: str | Path, content: bytes) -> None:
    """Replace the file at `path` by `content`, whole or not at all. Raises InputError as `replacing` does."""
    with replacing(path) as stream:
        stream.write(content)


def write_text(path: str | Path, content: str) -> None:
    """Replace the file at `path` by UTF-8 `content`, whole or not at all. Raises InputError."""
    # Names of files need not be text: what stands for their other bytes is no UTF-8, and is written as an escape.
    write_bytes(path, content.encode("utf-8", "backslashreplace"))


def open_regular(path: str | Path) -> BufferedReader:
    """Open a regular file for reading; refuse folders, devices and pipes, whose reading may never end.

    Raises InputError if `path` is not a regular file or cannot be opened. The message does not name the path.
    """
    # Without O_NONBLOCK, opening a pipe that nobody writes to would wait for ever. Windows has no such pipes, and reads
    # text unless it is told otherwise.
    flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        descriptor = os.open(path, os.O_RDONLY | flags)
    except OSError as error:
        raise InputError(error.strerror or str(error)) from error
    except ValueError as error:  # the path holds a NUL character
        raise InputError(f"it is no path: {error}") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise InputError("it is not a regular file")
    return os.fdopen(descriptor, "rb")


@contextmanager
def opened(path: str | Path) -> Iterator[BufferedReader]:
    """Open a regular file for as long as the block lasts. Raises InputError as `open_regular` does."""
    with open_regular(path) as stream:
        try:
            yield stream
        except OSError as error:
            raise InputError(error.strerror or str(error)) from error


def read_bytes(path: str | Path, most: int) -> bytes:
    """Read a regular file of at most `most` bytes. Raises InputError as `opened` does, and for a larger file."""
    pieces, size = [], 0
    with opened(path) as stream:
        while piece := stream.read(_PIECE):  # read(most) would allocate `most` bytes at once
            pieces.append(piece)
            size += len(piece)
            if size > most:
                raise InputError(f"it is larger than {most:,} bytes")
    return b"".join(pieces)


def lock(descriptor: int) -> None:
    """Keep an open file for this process alone, until it is closed; a system that locks no files does without.

    Raises OSError if another process has it.
    """
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        return
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _stays(folder: Path) -> bool:
    """Tell whether an existing folder is to be filled where it is: nothing can be renamed to it, or should be."""
    with suppress(OSError):
        if folder.samefile(Path.cwd()):
            return True
    fixed = folder.is_symlink() or os.path.ismount(folder) or sys.platform == "win32"
    return fixed or not os.access(folder.absolute().parent, os.W_OK)


def _move_up(filled: Path, target: Path) -> None:
    """Move all that a folder in `target` holds into `target`, or nothing. Raises OSError."""
    # By names: from Python 3.12 on a temporary folder's path is absolute.
    if any(entry.name != filled.name for entry in target.iterdir()):
        raise OSError(errno.ENOTEMPTY, os.strerror(errno.ENOTEMPTY))
    moved: list[str] = []
    try:
        for name in sorted(entry.name for entry in filled.iterdir()):
            (filled / name).rename(target / name)
            moved.append(name)
        filled.rmdir()
    except OSError:
        for name in moved:
            (target / name).rename(filled / name)
        raise


def _kept_beside(filled: Path, target: Path) -> Path:
    """Rename a filled folder to a new name beside `target`, if that can be done; returns where it is."""
    whole, number = target if target.name not in ("", "..") else target.resolve(), 2
    beside = whole.with_name(f"{whole.name}-{number}")
    while os.path.lexists(beside):
        number += 1
        beside = whole.with_name(f"{whole.name}-{number}")
    try:
        return filled.rename(beside)
    except OSError:
        return filled


def _unwritable(target: Path, error: OSError) -> InputError:
    why = _IN_THE_WAY.get(error.errno or 0, f"{error.strerror or error}; name a folder that can be written")
    return InputError(f"cannot write {target}: {why}")


def _umask() -> int:
    """Read the process's umask; the only call that reads it also sets it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
