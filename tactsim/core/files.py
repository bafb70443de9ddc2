"""Write a file or a folder whole or not at all; read untrusted files safely."""

from __future__ import annotations

import errno
import os
import shutil
import stat
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

    `path` must not exist yet or be an empty folder. Raises InputError if it cannot be written.
    """
    target = Path(path)
    temporary: Path | None = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent))
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        temporary.replace(target)
    except OSError as error:
        raise _unwritable(target, error) from error
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
    write_bytes(path, content.encode("utf-8"))


def open_regular(path: str | Path) -> BufferedReader:
    """Open a regular file for reading; refuse folders, devices and pipes, whose reading may never end.

    Raises InputError if `path` is not a regular file or cannot be opened. The message does not name the path.
    """
    # Without O_NONBLOCK, opening a pipe that nobody writes to would wait for ever.
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
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


def _unwritable(target: Path, error: OSError) -> InputError:
    why = _IN_THE_WAY.get(error.errno or 0, f"{error.strerror or error}; name a folder that can be written")
    return InputError(f"cannot write {target}: {why}")


def _umask() -> int:
    """Read the process's umask; the only call that reads it also sets it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
