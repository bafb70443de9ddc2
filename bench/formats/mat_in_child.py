"""Read arrays of a MAT file in a process of its own, since SciPy's compiled reader crashes on some damaged files.

    python mat_in_child.py MOST_BYTES NAME... <FILE.mat >FILE.npz

The arrays come out in the order of the names, as arr_0 and so on; NAME{2} is the second array of a cell. Exit status 2:
one line on standard error says what is wrong with the file.
"""

import sys
from contextlib import suppress
from io import BytesIO
from math import prod
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

_MEMORY = 4 << 30  # bytes of addresses: what a file unpacks to is bounded by it
_KINDS = ("double", "single", "logical", "char", "cell")
_WHOLE = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]


def main(most: int, names: list[str]) -> None:
    """Read the named arrays from standard input and write them to standard output."""
    with suppress(ImportError, ValueError, OSError):  # a system without such limits
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    content = sys.stdin.buffer.read()
    try:
        there = {name: (shape, kind) for name, shape, kind in whosmat(BytesIO(content))}
        variables = [name.partition("{")[0] for name in names]
        for name in variables:
            if name not in there:
                refuse(f"it has no array {name!r}; it has {', '.join(map(repr, there))}")
            shape, kind = there[name]
            if kind not in (*_KINDS, *_WHOLE):
                refuse(f"array {name!r} is a {kind}, no numbers or names")
            most -= 8 * prod(shape)
            if most < 0:
                refuse(f"array {name!r} claims {8 * prod(shape):,} bytes, more than a scan may hold")
        read = loadmat(BytesIO(content), variable_names=variables)
        arrays = [
            plain(read[variable], name) if name == variable else in_cell(read[variable], name)
            for name, variable in zip(names, variables, strict=True)
        ]
    except Exception as error:
        refuse(f"it is no whole MAT file: {type(error).__name__} {error}")
    found = BytesIO()
    np.savez(found, *arrays, allow_pickle=False)
    sys.stdout.buffer.write(found.getbuffer())


def plain(array: NDArray[Any], name: str) -> NDArray[Any]:
    """Read a cell of texts as an array of names; other arrays stay as they are."""
    if array.dtype.kind != "O":
        return array
    words = []
    for cell in array.reshape(-1):
        if not isinstance(cell, np.ndarray) or cell.dtype.kind != "U" or cell.size != 1:
            refuse(f"array {name!r} is a cell of more than texts")
        words.append(str(cell.reshape(-1)[0]))
    return np.array(words, dtype=np.str_)


def in_cell(cell: NDArray[Any], name: str) -> NDArray[Any]:
    """Take the array of numbers that `name`, such as TS{2}, means."""
    number = int(name.partition("{")[2].rstrip("}"))
    if cell.dtype.kind != "O" or not 1 <= number <= cell.size:
        refuse(f"it has no {name!r}")
    array = cell.reshape(-1, order="F")[number - 1]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        refuse(f"{name!r} is no array of numbers")
    return array


def refuse(message: str) -> NoReturn:
    """End with one line that says what is wrong with the file."""
    print(" ".join(message.split())[:1000], file=sys.stderr)
    sys.exit(2)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
