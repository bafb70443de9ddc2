"""How the inner loops are compiled: ahead of use, for one signature, and kept for the next run.

All are serial: trials are what runs in parallel.
"""

from __future__ import annotations

import ast
import logging
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numba import float32, float64, int64, njit
from numba.core.caching import FunctionCache
from numpy.typing import NDArray

_Function = TypeVar("_Function", bound=Callable[..., Any])
Ints = NDArray[np.int64]
Reals = NDArray[np.float64]
Floats = NDArray[np.float32]

# The same arrays, contiguous, as signatures name them.
INTS, INTS_2D, INTS_3D = int64[::1], int64[:, ::1], int64[:, :, ::1]
INTS_4D = int64[:, :, :, ::1]
REALS, REALS_2D, REALS_3D = float64[::1], float64[:, ::1], float64[:, :, ::1]
REALS_4D, REALS_5D = float64[:, :, :, ::1], float64[:, :, :, :, ::1]
FLOATS, FLOATS_2D = float32[::1], float32[:, ::1]
FLOATS_3D, FLOATS_4D = float32[:, :, ::1], float32[:, :, :, ::1]


def compiled(
    signature: Any, *, ordered: bool = True, called_from_python: bool = True
) -> Callable[[_Function], _Function]:
    """Compile a function for one signature, or load what an earlier run has compiled.

    Of IEEE arithmetic only this is given up: a * b + c may be one instruction; with ordered=False
    also NaN and the sign of zero, for loops that take a maximum. A function that only other compiled
    ones call takes half as long to compile.

    What was compiled is used again while the function's file and all files of its package that it
    imports, directly or not, are unchanged. A file with compiled functions therefore imports only such files.
    """
    choices: dict[str, Any] = {
        "error_model": "numpy",
        "fastmath": {"contract"} if ordered else {"contract", "nnan", "nsz"},
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not called_from_python,
    }

    def decorate(function: _Function) -> _Function:
        dispatcher: Any = njit(**choices)(function)
        dispatcher._cache = _Cache(function)
        dispatcher.compile(signature)
        dispatcher.disable_compile()
        made: _Function = dispatcher
        return made

    return decorate


class _Cache(FunctionCache):
    """Numba's cache on disk, which by itself notices changes of the function's own file only."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = _stamp(function.__module__)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Give what was compiled for a signature before; None, said once, if it has to be compiled."""
        kept = super().load_overload(sig, target_context)
        if kept is None:
            _say_why_it_takes_long()
        return kept


@cache
def _say_why_it_takes_long() -> None:
    logging.getLogger(__name__).warning(
        "compiling the inner loops for this machine: half a minute or more, kept for later runs"
    )


def _stamp(module: str) -> str:
    """Hash the source of a module and of what it imports of its own package, directly or not."""
    found, waiting = {module}, [module]
    while waiting:
        new = _imported(waiting.pop()) - found
        found |= new
        waiting += new
    return sha256(b"\0".join(_source(name) for name in sorted(found))).hexdigest()


@cache
def _imported(module: str) -> frozenset[str]:
    """Name the modules of its own package from which a loaded module imports names."""
    package = module.partition(".")[0]
    nodes = ast.walk(ast.parse(_source(module)))
    named = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return frozenset(name for name in named if name.partition(".")[0] == package)


@cache
def _source(module: str) -> bytes:
    return Path(sys.modules[module].__file__ or "").read_bytes()
