"""Arrays in a .npz or a .mat file of somebody else, as a scan."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from io import BytesIO
from math import prod
from pathlib import Path
from struct import unpack_from
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core import InputError, Pad, Scan
from tactsim.core.errors import short, unknown
from tactsim.core.files import read_bytes
from tactsim.core.npz import LARGEST, read_npz

SUFFIXES = (".npz", ".mat")
_HDF5 = b"\x89HDF"  # MATLAB's -v7.3
_COMPRESSED = 15  # kind of an element of a MAT file
_PIECE = 1 << 20  # bytes that are unpacked at a time
_NUMBERS = (
    "double",
    "single",
    "logical",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
)


def read_arrays(path: Path, names: Mapping[str, str], pad: Pad, unit: str) -> Scan:
    """Read a scan from arrays as `Scan.from_arrays` takes them; nothing is unpickled.

    names: what the arrays `readings`, `poses`, `labels` and perhaps `split` are called in the file. Without a split
    all presses are to train on. Raises InputError if the file is not whole, lacks an array or holds one of another
    kind.
    """
    try:
        found = (_of_mat if path.suffix.lower() == ".mat" else read_npz)(path, tuple(names.values()))
        arrays: dict[str, Any] = {role: found[name] for role, name in names.items()}
        return Scan.from_arrays(**arrays, pad=pad, unit=unit)
    except InputError as error:
        raise InputError(f"cannot read {path}: {error}") from error


def _of_mat(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    from scipy.io import loadmat, whosmat

    content = read_bytes(path, LARGEST)
    if content.startswith(_HDF5) or b"MATLAB 7.3" in content[:128]:
        raise InputError("it is a MAT file of version 7.3; save it with -v7")
    _check_unpacked(content)
    left = LARGEST
    try:
        there = {name: (shape, kind) for name, shape, kind in whosmat(BytesIO(content))}
        for name in names:
            if name not in there:
                raise unknown("array", name, there)
            shape, kind = there[name]
            if kind not in (*_NUMBERS, "char", "cell"):
                raise InputError(f"array {name!r} is a {short(kind)}, no numbers or names")
            left -= 8 * prod(shape)
            if left < 0:
                raise InputError(
                    f"array {name!r} claims {8 * prod(shape):,} bytes; a scan has at most {LARGEST:,}"
                )
        read = loadmat(BytesIO(content), variable_names=list(names))
    except InputError:
        raise
    except Exception as error:  # SciPy's reader trusts the file, and may raise anything
        raise InputError(
            f"it is no whole MAT file: {type(error).__name__} {' '.join(str(error).split())}"
        ) from error
    return {name: _texts(read[name], name) for name in names}


def _check_unpacked(content: bytes) -> None:
    """Raise InputError if the compressed arrays of a MAT file of version 5 unpack to more than a scan may hold."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    left, place = LARGEST, 128
    while order is not None and place + 8 <= len(content):
        kind, size = unpack_from(f"{order}II", content, place)
        if kind == _COMPRESSED:
            unpacking = zlib.decompressobj()
            piece = content[place + 8 : place + 8 + size]
            try:
                while piece and left >= 0:
                    left -= len(unpacking.decompress(piece, _PIECE))
                    piece = unpacking.unconsumed_tail
            except zlib.error as error:
                raise InputError(f"it is no whole MAT file: {error}") from error
            if left < 0:
                raise InputError(f"it unpacks to more than {LARGEST:,} bytes")
        place += 8 + size


def _texts(array: NDArray[Any], name: str) -> NDArray[Any]:
    """Read a cell of texts as an array of names; other arrays stay as they are."""
    if array.dtype.kind != "O":
        return array
    words = []
    for cell in array.reshape(-1):
        if not isinstance(cell, np.ndarray) or cell.dtype.kind != "U" or cell.size != 1:
            raise InputError(f"array {name!r} is a cell of more than texts")
        words.append(str(cell.reshape(-1)[0]))
    return np.array(words, dtype=np.str_)
