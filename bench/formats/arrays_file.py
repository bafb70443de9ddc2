"""Arrays in a .npz, .mat or HDF5 file of somebody else, as a scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

from tactsim.bench.formats.csv_file import unposed
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
    unknown = names.get("poses") == "none"
    names = {role: name for role, name in names.items() if role != "poses" or not unknown}
    wanted = list(dict.fromkeys(names.values()))
    try:
        content = read_bytes(path, LARGEST) if path.suffix.lower() == ".mat" else b""
        if content and not is_of_hdf5(content):
            found = mat_arrays(content, wanted)
        elif path.suffix.lower() == ".npz":
            found = read_npz(path, wanted)
        else:
            from tactsim.bench.formats.hdf5_file import read_named  # its library is an extra

            found = read_named(path, wanted)
        arrays: dict[str, Any] = {role: found[name] for role, name in names.items()}
        if path.suffix.lower() != ".npz":
            arrays = presses_first(arrays)
        if unknown:
            arrays["poses"] = np.zeros((len(arrays["readings"]), 3))
        scan = Scan.from_arrays(**arrays, pad=pad, unit=unit)
        scan = unposed(scan) if unknown else scan
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
    """Read arrays of a MAT file by SciPy, which unpickles and runs nothing; `TS{2}` is the second array of a cell.

    Raises InputError if the file is not whole, lacks an array or holds one of another kind.
    """
    variables = {name: name.partition("{")[0] for name in names}
    try:
        there = {name: (shape, kind) for name, shape, kind in whosmat(BytesIO(content))}
        left = LARGEST
        for name in dict.fromkeys(variables.values()):
            if name not in there:
                raise MissingArrayError(name, {other: shape for other, (shape, _) in there.items()})
            shape, kind = there[name]
            if kind not in _KINDS:
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
        name: _texts(read[variable], name) if name == variable else _in_cell(read[variable], name)
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


def _in_cell(cell: NDArray[Any], name: str) -> NDArray[Any]:
    """Take the array of numbers that `name`, such as TS{2}, means."""
    number = int(name.partition("{")[2].rstrip("}"))
    if cell.dtype.kind != "O" or number > cell.size:
        raise InputError(f"it has no {name!r}")
    array = cell.reshape(-1, order="F")[number - 1]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        raise InputError(f"{name!r} is no array of numbers")
    return array
