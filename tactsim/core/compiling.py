"""How the inner loops are compiled: when they are first needed, for one signature, and kept by numba for the next run.

numba keeps a function by its own file and does not see a change of a function in another file that it calls. So
what is kept lies in a folder that is named by a hash of all files that hold compiled functions. All are serial: trials
are what runs in parallel.
"""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from time import monotonic
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from tactsim.core.cache_folder import cache_folder, temporary_folder
from tactsim.core.errors import InputError, counted
from tactsim.core.source_digest import package_digest

try:
    import numba
    from numba import boolean, float32, float64, int8, int16, int32, int64, njit, types
except ValueError as wrong:  # as of NUMBA_NUM_THREADS=0
    settings = ", ".join(f"{name}={value}" for name, value in os.environ.items() if name.startswith("NUMBA_"))
    raise InputError(
        f"numba, which compiles the inner loops, does not start with {settings}: {wrong}"
    ) from None

_Function = TypeVar("_Function", bound=Callable[..., Any])
Ints = NDArray[np.int64]
Reals = NDArray[np.float64]
Floats = NDArray[np.float32]

# Contiguous arrays of so many dimensions, as compiled functions and the tuples that they take name them.
Reals1D = Annotated[Reals, float64[::1]]
Reals2D = Annotated[Reals, float64[:, ::1]]
Reals3D = Annotated[Reals, float64[:, :, ::1]]
Reals4D = Annotated[Reals, float64[:, :, :, ::1]]
Floats1D = Annotated[Floats, float32[::1]]
Floats2D = Annotated[Floats, float32[:, ::1]]
Floats3D = Annotated[Floats, float32[:, :, ::1]]
Floats4D = Annotated[Floats, float32[:, :, :, ::1]]
Ints1D = Annotated[Ints, int64[::1]]
Ints2D = Annotated[Ints, int64[:, ::1]]
Int32s1D = Annotated[NDArray[np.int32], int32[::1]]
Int32s2D = Annotated[NDArray[np.int32], int32[:, ::1]]
Int32s3D = Annotated[NDArray[np.int32], int32[:, :, ::1]]
Int16s1D = Annotated[NDArray[np.int16], int16[::1]]
Int16s4D = Annotated[NDArray[np.int16], int16[:, :, :, ::1]]
Int8s3D = Annotated[NDArray[np.int8], int8[:, :, ::1]]
Int8s5D = Annotated[NDArray[np.int8], int8[:, :, :, :, ::1]]
Bools1D = Annotated[NDArray[np.bool_], boolean[::1]]
# Arrays of others that are only looked at: those that may not be written are taken too.
GivenReals1D = Annotated[Reals, types.Array(float64, 1, "C", readonly=True)]
GivenReals2D = Annotated[Reals, types.Array(float64, 2, "C", readonly=True)]
config: Any = numba.config
_SCALARS = {float: float64, int: int64, bool: boolean, type(None): types.void}

HOLDS_KERNELS = b"\nfrom tactsim.core.compiling import "  # what a file with compiled functions holds
_waiting: list[tuple[str, Callable[[], Any]]] = []  # what is not compiled: its module, and what does it
_MOST_FOLDERS = 10  # of kernels of other source, each of some 10 MB


def compiled(
    *, ordered: bool = True, summed_in_order: bool = True, called_from_python: bool = True
) -> Callable[[_Function], _Function]:
    """Let a function be compiled for the types of its annotations, or loaded as an earlier run has compiled it.

    That is done when it is first called, or called by a compiled one, or at `compile_waiting`: who imports a module
    waits for nothing. Of IEEE arithmetic only this is given up: a * b + c may be one instruction; with ordered=False
    also NaN and the sign of zero, for loops that take a maximum; with summed_in_order=False also the order
    in which numbers are added, for loops whose sums are only compared. A function that only other compiled
    ones call takes half as long to compile.

    What was compiled is used again while all files of the function's package that hold compiled functions are
    unchanged. So a compiled function takes its constants from such files only.
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

    def decorate(function: _Function) -> Any:
        dispatcher = njit(**choices)(function)

        def compile_now(*_: Any) -> Any:
            if config.DISABLE_JIT:
                raise InputError("NUMBA_DISABLE_JIT is set, and the inner loops are compiled: unset it")
            vars(dispatcher).pop("_compile_for_args", None)
            vars(dispatcher).pop("get_call_template", None)
            if not dispatcher.overloads:
                _compile(dispatcher, function, choices)
            return dispatcher

        _waiting.append((function.__module__, compile_now))
        if config.DISABLE_JIT:  # then `njit` leaves a function as it is, minutes where it is milliseconds
            return compile_now
        # numba asks these two when Python, or another compiled function, calls one that is not compiled.
        dispatcher._compile_for_args = compile_now
        dispatcher.get_call_template = lambda args, words: compile_now().get_call_template(args, words)
        return dispatcher

    return decorate


def compile_waiting(of: str) -> None:
    """Compile or load now what was imported so far of modules whose names begin so, and say how long it took.

    For work that is timed or seen, and for several processes, of which each would compile it.
    """
    start = monotonic()
    chosen = [one for one in _waiting if one[0].startswith(of)]
    _waiting[:] = [one for one in _waiting if one not in chosen]
    if count := sum(bool(compile_now().stats.cache_misses) for _, compile_now in chosen):
        logging.getLogger(__name__).warning(
            "compiled %s in %.0f s", counted(count, "inner loop"), monotonic() - start
        )


def _compile(dispatcher: Any, function: Callable[..., Any], choices: dict[str, Any]) -> None:
    """Load a function from the folder of what is kept, or compile it and keep it there if that is possible."""
    *arguments, returned = (numba_type(hint) for hint in _hints(function))
    signature = returned(*arguments)
    folder = kernel_folder(function.__module__.partition(".")[0])
    if folder is not None:
        users, config.CACHE_DIR = config.CACHE_DIR, str(folder)
        try:
            dispatcher.enable_caching()
        finally:
            config.CACHE_DIR = users
    made = dispatcher
    try:
        dispatcher.compile(signature)
    except Exception as error:  # what a power failure has left of a file may raise anything when it is loaded
        if not dispatcher.overloads:
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)
            made = njit(**choices)(function)  # which keeps nothing
            made.compile(signature)
            dispatcher.add_overload(made.overloads[signature.args])
        elif not isinstance(error, OSError):  # it is compiled, and could not be written: the disk is full
            raise
        folder = None
    if made.stats.cache_misses:
        _say_why_it_takes_long(".".join(function.__module__.split(".")[:-1][:2]), folder is not None)
    dispatcher.disable_compile()


def numba_type(hint: Any) -> Any:
    """Give the type that an annotation names: an array of so many dimensions, a number, or a tuple of these.

    Raises TypeError if it names something else, such as an array without its dimensions.
    """
    if get_origin(hint) is Annotated:
        return get_args(hint)[1]
    if get_origin(hint) is tuple:
        return types.Tuple([numba_type(part) for part in get_args(hint)])
    if isinstance(hint, type) and issubclass(hint, tuple):  # a NamedTuple
        return types.BaseTuple.from_types([numba_type(part) for part in _hints(hint)], hint)
    if hint not in _SCALARS:
        raise TypeError(f"no compiled function can take or give {hint}")
    return _SCALARS[hint]


def _hints(annotated: Any) -> Iterable[Any]:
    """Give the annotations of a class or a function, that of what it returns last."""
    return get_type_hints(annotated, include_extras=True).values()


@cache
def kernel_folder(package: str) -> Path | None:
    """Give the folder for what is compiled of a package as its source is now; None if none can be written.

    It is below NUMBA_CACHE_DIR if that is set and can be written, else below the cache folder, or if need be among
    temporary files.
    """
    name = f"{package}-{package_digest(package, holding=HOLDS_KERNELS)[:16]}"
    # A temporary folder is made only where nothing else will do.
    for choice in (os.environ.get("NUMBA_CACHE_DIR"), cache_folder() / "kernels", temporary_folder):
        parent = choice() if callable(choice) else choice
        if not parent:
            continue
        folder = Path(parent) / name
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            Path(tempfile.mkdtemp(dir=folder)).rmdir()  # a full disk refuses this
            os.utime(folder)
            kept = folder.parent.glob(f"{package}-{'[0-9a-f]' * 16}")
            for unused in sorted(kept, key=lambda one: one.stat().st_mtime)[:-_MOST_FOLDERS]:
                shutil.rmtree(unused, ignore_errors=True)
            return folder
    return None


@cache
def _say_why_it_takes_long(room: str, kept: bool) -> None:
    logging.getLogger(__name__).warning(
        "compiling the inner loops of %s that this command needs: up to a minute, or several where the machine is "
        "busy; %s",
        room,
        "kept for later runs" if kept else "each time, since no cache folder takes it",
    )
