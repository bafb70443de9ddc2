"""How the inner loops are compiled: ahead of use, for one signature, and kept for the next run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

_Function = TypeVar("_Function", bound=Callable[..., Any])
Ints = NDArray[np.int64]
Reals = NDArray[np.float64]
Floats = NDArray[np.float32]


def compiled(
    signature: Any, *, ordered: bool = True, called_from_python: bool = True
) -> Callable[[_Function], _Function]:
    """Compile a function for one signature, or load what an earlier run has compiled.

    Of IEEE arithmetic only this is given up: a * b + c may be one instruction; with ordered=False
    also NaN and the sign of zero, for loops that take a maximum. A function that only other compiled
    ones call takes half as long to compile. Numba's cache notices changes of the function's own file
    only: keep a compiled function and those that it calls in one file.
    """
    choices: dict[str, Any] = {
        "cache": True,
        "error_model": "numpy",
        "fastmath": {"contract"} if ordered else {"contract", "nnan", "nsz"},
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not called_from_python,
    }
    decorate: Callable[[_Function], _Function] = njit(signature, **choices)
    return decorate
