"""How the inner loops are compiled: ahead of use, for one signature, and kept for the next run.

All are serial: trials are what runs in parallel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import float32, float64, int64, njit, types
from numpy.typing import NDArray

from tactsim.core.kernel_cache import KernelCache

_Function = TypeVar("_Function", bound=Callable[..., Any])
Ints = NDArray[np.int64]
Reals = NDArray[np.float64]
Floats = NDArray[np.float32]

# The same arrays, contiguous, as signatures name them.
INTS, INTS_2D, INTS_4D = int64[::1], int64[:, ::1], int64[:, :, :, ::1]
REALS, REALS_2D, REALS_3D = float64[::1], float64[:, ::1], float64[:, :, ::1]
REALS_4D, REALS_5D = float64[:, :, :, ::1], float64[:, :, :, :, ::1]
FLOATS, FLOATS_2D = float32[::1], float32[:, ::1]
FLOATS_3D, FLOATS_4D = float32[:, :, ::1], float32[:, :, :, ::1]
# Arrays of others that are only looked at: those that may not be written are taken too.
GIVEN_REALS, GIVEN_REALS_2D = (types.Array(float64, dimensions, "C", readonly=True) for dimensions in (1, 2))


def compiled(
    signature: Any, *, ordered: bool = True, summed_in_order: bool = True, called_from_python: bool = True
) -> Callable[[_Function], _Function]:
    """Compile a function for one signature, or load what an earlier run has compiled.

    Of IEEE arithmetic only this is given up: a * b + c may be one instruction; with ordered=False
    also NaN and the sign of zero, for loops that take a maximum; with summed_in_order=False also the order
    in which numbers are added, for loops whose sums are only compared. A function that only other compiled
    ones call takes half as long to compile.

    What was compiled is used again while the function's file and all files of its package that it
    imports, directly or not, are unchanged. A file with compiled functions therefore imports only such files.
    """
    given_up = {"contract"}
    if not ordered:
        given_up |= {"nnan", "nsz"}
    if not summed_in_order:
        given_up |= {"reassoc"}
    choices: dict[str, Any] = {
        "error_model": "numpy",
        "fastmath": given_up,
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not called_from_python,
    }

    def decorate(function: _Function) -> _Function:
        dispatcher: Any = njit(**choices)(function)
        dispatcher._cache = KernelCache(function)
        dispatcher.compile(signature)
        dispatcher.disable_compile()
        made: _Function = dispatcher
        return made

    return decorate


def _without_scipy() -> None:
    """Let numba look for a BLAS only when a function is compiled that uses one.

    It looks before the first function is compiled or loaded, by importing scipy.linalg: half as long as importing numba
    itself. No function here uses one, and a user's function still finds it.
    """
    import numba.np.linalg

    look = numba.np.linalg.ensure_blas
    numba.np.linalg.ensure_blas = lambda: None
    try:
        import numba.np.arraymath
    finally:
        numba.np.linalg.ensure_blas = look


_without_scipy()
