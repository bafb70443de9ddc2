"""Keep compiled functions on disk: beside their source, or in the cache folder where that cannot be written.

A file holds one function, compiled for one kind of processor by one version of numba and Python. It repeats all that
the machine code depends on and a hash of itself. A file that does not say both, because the source has changed, the
installation was copied to another machine or a disk was full, is compiled and written again. Nothing that can happen to
these files is more than a loss of time.
"""

from __future__ import annotations

import logging
import os
import pickle
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from tactsim.core.cache_folder import cache_folder, can_be_written
from tactsim.core.errors import InputError
from tactsim.core.files import read_bytes, write_bytes

_LARGEST = 1 << 26  # bytes of a file; most have 30,000
_IMPORTED = re.compile(rb"^ *from ([\w.]+) import ", re.M)


class KernelCache(NullCache):
    """What numba asks for a function's machine code, and gives it to."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._module, self._name = function.__module__, function.__qualname__
        self._folders = _folders(Path(function.__code__.co_filename).parent)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Give what was compiled for a signature before; None, said once, if it has to be compiled."""
        target_context.refresh()
        name, head = self._place(sig, target_context.codegen())
        for folder in self._folders:
            with suppress(InputError):
                content = read_bytes(folder / name, _LARGEST)
                body = content[len(head) + 32 :]
                if content[: len(head) + 32] == head + sha256(body).digest():
                    return CompileResult._rebuild(target_context, *pickle.loads(body))
        _say_why_it_takes_long(any(map(can_be_written, self._folders)))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, in the first folder that takes it."""
        name, head = self._place(sig, data.codegen)
        body = dumps(data._reduce())
        for folder in self._folders:
            with suppress(InputError):
                write_bytes(folder / name, head + sha256(body).digest() + body)
                return

    def _place(self, sig: Any, codegen: Any) -> tuple[str, bytes]:
        """Name the file for a signature, and say what it must begin with: a hash of all that it depends on.

        A change of the source overwrites the file; another processor or version has a file of its own.
        """
        machine = repr((codegen.magic_tuple(), numba.__version__, sys.version, str(sig))).encode()
        name = f"{self._module.rpartition('.')[2]}.{self._name}-{sha256(machine).hexdigest()[:16]}.kernel"
        return name, sha256(machine + _stamp(self._module).encode()).digest()


def _folders(beside: Path) -> list[Path]:
    """List where compiled functions are looked for, and kept, of source files in one folder."""
    apart = f"{beside.name}-{sha256(str(beside.absolute()).encode()).hexdigest()[:16]}"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    first = [Path(chosen) / apart] if chosen else []
    return [*first, beside / "__pycache__", cache_folder() / "kernels" / apart]


@cache
def _say_why_it_takes_long(kept: bool) -> None:
    logging.getLogger(__name__).warning(
        "compiling the inner loops for this machine: half a minute or more, "
        + ("kept for later runs" if kept else "each time, since no cache folder can be written")
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
    """Name the loaded modules of its own package from which a module imports names."""
    package = module.partition(".")[0]
    named = {name.decode() for name in _IMPORTED.findall(_source(module))}
    return frozenset(name for name in named & sys.modules.keys() if name.partition(".")[0] == package)


@cache
def _source(module: str) -> bytes:
    return Path(sys.modules[module].__file__ or "").read_bytes()
