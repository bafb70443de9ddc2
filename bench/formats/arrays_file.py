"""Arrays in a .npz, .mat or HDF5 file of somebody else, as a scan."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

from tactsim.bench.trials import check_labels
from tactsim.core import InputError, Pad, Scan
from tactsim.core.files import read_bytes
from tactsim.core.npz import LARGEST, MissingArrayError, read_npz

SUFFIXES = (".npz", ".mat")
_KINDS = ("double", "single", "logical", "char", "cell") + tuple(
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
)


def read_arrays(path: Path, names: Mapping[str, str], pad: Pad, unit: str) -> Scan:
    """Read a scan from arrays as `Scan.from_arrays` takes them; nothing is unpickled.

    names: what the arrays `readings`, `poses`, `labels` and perhaps `split` are called in the file; poses called `none`
    are unknown. Without a split all presses are to train on. Raises InputError if the file is not whole, lacks an array
    or holds one of another kind.
    """
    names = {role: name for role, name in names.items() if (role, name) != ("poses", "none")}
    wanted, unsaid = list(dict.fromkeys(names.values())), False
    try:
        content = read_bytes(path, LARGEST) if path.suffix.lower() == ".mat" else b""
        if content and not is_of_hdf5(content):
            found = mat_arrays(content, wanted)
        elif path.suffix.lower() == ".npz":
            found = read_npz(path, wanted)
        else:
            from tactsim.bench.formats.hdf5_file import read_named, says_matlab  # its library is an extra

            found = read_named(path, wanted)
            unsaid = not says_matlab(path)
        arrays: dict[str, Any] = {role: found[name] for role, name in names.items()}
        if unsaid:
            arrays = _as_matlab_has_them(arrays)
        if path.suffix.lower() != ".npz":
            arrays = presses_first(arrays)
        scan = Scan.from_arrays(**arrays, pad=pad, unit=unit)
        if not len(scan):
            raise InputError("it holds no presses: its arrays have no rows")
        check_labels(scan.letters)
        return scan
    except MissingArrayError as error:
        shapes = ", ".join(str(shape) for shape in error.there.values())
        raise InputError(
            f"cannot read {path}: {error}, shapes {shapes}; --readings, --poses, --labels and --split name them, and "
            "--poses none says that nobody noted them"
        ) from error
    except InputError as error:
        raise InputError(f"cannot read {path}: {error}") from error


def _as_matlab_has_them(arrays: dict[str, Any]) -> dict[str, Any]:
    """Turn dimensions that `h5create` of MATLAB turned round, which does not say so: poses are (3, n) there.

    Raises InputError where they may be those of somebody else, who has presses last.
    """
    count = arrays["labels"].size
    shape = arrays["readings"].shape
    if len(shape) != 3 or count == 3 or getattr(arrays.get("poses"), "shape", ()) != (3, count):
        return arrays
    if shape[0] != count and shape[0] == shape[1]:
        raise InputError(
            f"readings of shape {shape} beside poses of shape (3, {count}) may be MATLAB's, whose dimensions h5create "
            "turns round, or have presses last; save(..., '-v7.3') says whose they are, and presses first is clear, too"
        )
    return {role: array.T for role, array in arrays.items()}


def presses_first(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Put the presses first in readings and poses that have them last, as MATLAB's users do.

    Raises InputError where both the first and the last dimension are as long as there are labels.
    """
    count = arrays["labels"].size
    turned = dict(arrays)
    for role, least in (("readings", 3), ("poses", 2)):
        shape: tuple[int, ...] = arrays[role].shape if role in arrays else ()
        if len(shape) < least or shape[-1] != count:
            continue
        if shape[0] != count:
            turned[role] = np.moveaxis(arrays[role], -1, 0)
        elif turned["readings"] is not arrays["readings"] or (role == "readings" and len(shape) == 3):
            raise InputError(
                f"its {role} of shape {shape} may have the {count} presses first or last; save another number of them"
            )
    return turned


def is_of_hdf5(content: bytes) -> bool:
    """Tell whether a MAT file is of version 7.3, which is HDF5."""
    return b"MATLAB 7.3" in content[:128]


def mat_arrays(content: bytes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Read arrays of a MAT file by SciPy, which unpickles and runs nothing.

    `TS{2}` is the second array of a cell; `trial.press` are the fields of a struct, an array of which has them stacked.
    Raises InputError if the file is not whole, lacks an array or holds one of another kind.
    """
    variables = {name: re.split(r"[{.]", name)[0] for name in names}
    try:
        there = {name: (shape, kind) for name, shape, kind in whosmat(BytesIO(content))}
        left = LARGEST
        for name in dict.fromkeys(variables.values()):
            if name not in there:
                raise MissingArrayError(name, {other: shape for other, (shape, _) in there.items()})
            shape, kind = there[name]
            if kind not in _KINDS and not any(name == of and "." in one for one, of in variables.items()):
                raise InputError(f"array {name!r} is a {kind}, no numbers or names")
            left -= 8 * prod(shape)
            if left < 0:
                raise InputError(
                    f"array {name!r} claims {8 * prod(shape):,} bytes, more than a scan may hold"
                )
        read = loadmat(BytesIO(content), variable_names=list(variables.values()))
    except InputError:
        raise
    except Exception as error:  # SciPy's reader fails in many ways on a file that is not whole
        said = " ".join(str(error).split())
        raise InputError(f"it is no whole MAT file: {type(error).__name__} {said}") from error
    return {
        name: _texts(read[variable], name)
        if name == variable
        else (_in_cell if "{" in name else _in_struct)(read[variable], name)
        for name, variable in variables.items()
    }


def _texts(array: NDArray[Any], name: str) -> NDArray[Any]:
    """Read a cell of texts as an array of names; other arrays stay as they are."""
    if array.dtype.kind != "O":
        return array
    cells = [np.asarray(cell) for cell in array.flat]
    if any(cell.dtype.kind != "U" or cell.size != 1 for cell in cells):
        raise InputError(f"array {name!r} is a cell of more than texts")
    return np.array([str(cell.item()) for cell in cells], dtype=np.str_)


def _in_struct(struct: NDArray[Any], name: str) -> NDArray[Any]:
    """Take the field that `name`, such as trial.press, means; of an array of structs all, one behind the other."""
    field = name.partition(".")[2]
    if field not in (struct.dtype.names or ()):
        raise InputError(
            f"it has no {name!r}; its fields are {', '.join(struct.dtype.names or ()) or 'none'}"
        )
    found = [_texts(np.asarray(one), name) for one in struct[field].flat]
    if any(one.shape != found[0].shape or one.dtype.kind not in "biufU" for one in found):
        raise InputError(f"{name!r} has other shapes in other structs, or is no array of numbers or texts")
    return found[0] if len(found) == 1 else np.array([one[0] if len(one) == 1 else one for one in found])


def _in_cell(cell: NDArray[Any], name: str) -> NDArray[Any]:
    """Take the array of numbers that `name`, such as TS{2}, means."""
    number = int(name.partition("{")[2].rstrip("}"))
    if cell.dtype.kind != "O" or number > cell.size:
        raise InputError(f"it has no {name!r}")
    array = cell.reshape(-1, order="F")[number - 1]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        raise InputError(f"{name!r} is no array of numbers")
    return array
