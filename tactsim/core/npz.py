"""Write arrays as .npz, and read an untrusted file: nothing is unpickled, and every fault is an InputError."""

from __future__ import annotations

import json
import lzma
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError, some
from tactsim.core.files import opened, replacing

LARGEST = 1 << 30  # bytes that all arrays of a file may claim: 100,000 readings of 1,000 taxels fit

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_ENCRYPTED = 1  # bit of a member's flags
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA)


class MissingArrayError(InputError):
    """An array that was asked for is not in the file. there: the shapes of those that are, by their names."""

    def __init__(self, name: str, there: Mapping[str, Any]) -> None:
        self.name, self.there = name, dict(sorted(there.items()))
        super().__init__(f"it has no array {name!r}; it has {some(map(repr, self.there))}")

    def __reduce__(self) -> tuple[type[MissingArrayError], tuple[str, dict[str, Any]]]:
        """Let it be sent to another process."""
        return type(self), (self.name, self.there)


def read_npz(
    source: str | Path | BytesIO, names: Iterable[str], optional: Iterable[str] = ()
) -> dict[str, NDArray[Any]]:
    """Read the named arrays: numbers, texts or bytes of at most four dimensions. Other members are ignored.

    An `optional` array that is not there is left out.

    A claimed size is checked before memory is allocated. Raises InputError if the file is not a whole .npz,
    lacks an array, which is a MissingArrayError, or holds one of another kind. The message does not name the path.
    """
    with nullcontext(source) if isinstance(source, BytesIO) else opened(source) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                return _members(archive, tuple(names), tuple(optional))
        except InputError:
            raise
        # A name that is not UTF-8 is a ValueError.
        except (
            zipfile.BadZipFile,
            zlib.error,
            lzma.LZMAError,
            EOFError,
            NotImplementedError,
            ValueError,
        ) as error:
            raise InputError(f"it is not a whole .npz file: {error}") from error


def write_npz(path: str | Path, meta: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays and `meta`, a JSON string, as .npz: whole or not at all, and equal ones as equal bytes.

    Raises InputError if `path` cannot be written.
    """
    content = BytesIO()
    stated = np.array(json.dumps(meta, sort_keys=True))
    # As np.savez_compressed does, but that a member has no date: equal arrays give equal bytes.
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in {**arrays, "meta": stated}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
    with replacing(path) as stream:
        stream.write(content.getbuffer())


def _members(
    archive: zipfile.ZipFile, names: tuple[str, ...], optional: tuple[str, ...]
) -> dict[str, NDArray[Any]]:
    known = {info.filename: info for info in archive.infolist()}
    names += tuple(name for name in optional if f"{name}.npy" in known)
    left = LARGEST
    arrays = {}
    for name in names:
        info = known.get(f"{name}.npy")
        if info is None:
            raise MissingArrayError(name, {one.removesuffix(".npy"): _shape(archive, one) for one in known})
        if info.flag_bits & _ENCRYPTED or info.compress_type not in _COMPRESSIONS:
            raise InputError(f"array {name!r} is encrypted or compressed in a way that NumPy does not write")
        if info.file_size > left:
            raise InputError(
                f"array {name!r} claims {info.file_size:,} bytes; {left:,} are left of {LARGEST:,}"
            )
        left -= info.file_size
        with archive.open(info) as member:
            arrays[name] = _array(member, name)
    return arrays


def _shape(archive: zipfile.ZipFile, name: str) -> tuple[int, ...] | str:
    try:
        with archive.open(name) as member:
            return _HEADERS[np.lib.format.read_magic(member)](member)[0]
    except Exception:  # as in `_array`, or packed in another way
        return "?"


def _array(member: IO[bytes], name: str) -> NDArray[Any]:
    try:
        shape, fortran, dtype = _HEADERS[np.lib.format.read_magic(member)](member)
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError):
        raise
    except Exception as error:
        # NumPy reads a header with Python's tokenizer and parser, which may raise anything.
        raise InputError(f"array {name!r} has no header that NumPy writes") from error
    if dtype.hasobject:
        raise InputError(
            f"array {name!r} holds Python objects, which only unpickling could read; save it as numbers or texts, "
            "such as labels.astype(str)"
        )
    if dtype.kind not in "bfiuUS" or len(shape) > 4 or min(shape, default=0) < 0:
        raise InputError(f"array {name!r} holds {dtype} of shape {shape}, no numbers or names")
    size = dtype.itemsize * int(np.prod([int(n) for n in shape], dtype=object))
    if size > LARGEST:
        raise InputError(f"array {name!r} claims {size:,} bytes; the most is {LARGEST:,}")
    content = member.read(size)
    if len(content) != size or member.read(1):
        raise InputError(f"array {name!r} does not have the {size:,} bytes that it claims")
    flat = np.frombuffer(content, dtype=dtype) if size else np.zeros(0, dtype=dtype)
    return flat.reshape(shape, order="F" if fortran else "C").copy()
