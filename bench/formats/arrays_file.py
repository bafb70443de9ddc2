"""Arrays in a .npz or a .mat file of somebody else, as a scan."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from tactsim.bench.trials import check_labels
from tactsim.core import InputError, Pad, Scan
from tactsim.core.files import read_bytes
from tactsim.core.npz import LARGEST, read_npz

SUFFIXES = (".npz", ".mat")
_CHILD = Path(__file__).with_name("mat_in_child.py")
_LONGEST_S = 300


def read_arrays(path: Path, names: Mapping[str, str], pad: Pad, unit: str) -> Scan:
    """Read a scan from arrays as `Scan.from_arrays` takes them; nothing is unpickled.

    names: what the arrays `readings`, `poses`, `labels` and perhaps `split` are called in the file. Without a split
    all presses are to train on. Raises InputError if the file is not whole, lacks an array or holds one of another
    kind.
    """
    wanted = list(dict.fromkeys(names.values()))
    try:
        mat = path.suffix.lower() == ".mat"
        found = mat_arrays(read_bytes(path, LARGEST), wanted) if mat else read_npz(path, wanted)
        arrays: dict[str, Any] = {role: found[name] for role, name in names.items()}
        scan = Scan.from_arrays(**arrays, pad=pad, unit=unit)
        if not len(scan):
            raise InputError("it holds no presses: its arrays have no rows")
        check_labels(scan.letters)
        return scan
    except InputError as error:
        raise InputError(f"cannot read {path}: {error}") from error


def mat_arrays(content: bytes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Read arrays of a MAT file in a process of its own; `TS{2}` is the second array of the cell `TS`.

    Raises InputError if the file is not whole, is of version 7.3, lacks an array or holds one of another kind.
    """
    if b"MATLAB 7.3" in content[:128]:
        raise InputError("it is a MAT file of version 7.3; save it with -v7")
    # A thread more is a stack more, and the child's memory is limited.
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-I", str(_CHILD), str(LARGEST), *names]
    try:
        done = subprocess.run(
            command, input=content, env=environment, capture_output=True, timeout=_LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise InputError(f"it was not read within {_LONGEST_S} s") from error
    if done.returncode == 2:
        raise InputError(done.stderr.decode(errors="replace").strip() or "it is no whole MAT file")
    if done.returncode:
        raise InputError("it is no whole MAT file: SciPy's reader died of it")
    read = read_npz(BytesIO(done.stdout), [f"arr_{number}" for number in range(len(names))])
    return dict(zip(names, read.values(), strict=True))
