"""Compile what most runs need, and keep it for later ones: `python -m tactsim.bench.compile_kernels [--all]`.

Without it the first run that needs a kernel compiles it. Those of exact presses and reliefs, of solids and of pads on
others' robots, which few runs need, are left to that but with `--all`.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path

from tactsim.core.compiling import HOLDS_KERNELS
from tactsim.core.source_digest import python_files

_SELDOM_NEEDED = ("tactsim.solids.", "tactsim.attach.", "tactsim.press.")


def compile_kernels(left_out: tuple[str, ...]) -> None:
    """Import what holds kernels, on all cores: each is compiled, or loaded, when its module is imported.

    left_out: how the names of modules begin that are not.
    """
    wanted = [module for module in modules_with_kernels() if not module.startswith(left_out)]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=spawn) as pool:
        list(pool.map(_import, wanted))


def modules_with_kernels() -> list[str]:
    """List the modules that hold kernels, without importing them."""
    return [
        "tactsim." + name.removesuffix(".py").replace(os.sep, ".")
        for name, path in python_files("tactsim")
        if HOLDS_KERNELS in Path(path).read_bytes()
    ]


def _import(module: str) -> None:
    # Who asks for this knows why it takes long.
    logging.getLogger("tactsim.core.compiling").setLevel(logging.ERROR)
    import_module(module)


if __name__ == "__main__":
    compile_kernels(() if "--all" in sys.argv else _SELDOM_NEEDED)
