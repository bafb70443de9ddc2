"""Compile the kernels of the plane and keep them for later runs: `python -m tactsim.bench.compile_kernels`.

Without it the first run that needs a kernel compiles it. Those of solids and of pads on others' robots, which few runs
need, are left to that.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path

from tactsim.core.compiling import HOLDS_KERNELS
from tactsim.core.source_digest import python_files

_SELDOM_NEEDED = (
    "tactsim.estimators.space.", "tactsim.press.space.",
    "tactsim.press.pad_", "tactsim.press.geom_gap", "tactsim.press.layer_balance",
)  # fmt: skip


def compile_kernels() -> None:
    """Import every module that holds some, on all cores: a kernel is compiled, or loaded, when it is imported."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=spawn) as pool:
        list(pool.map(_import, modules_with_kernels()))


def modules_with_kernels() -> list[str]:
    """List the modules that hold kernels, but for those that few runs need, without importing them."""
    names = [
        "tactsim." + name.removesuffix(".py").replace(os.sep, ".")
        for name, path in python_files("tactsim")
        if HOLDS_KERNELS in Path(path).read_bytes()
    ]
    return [name for name in names if not name.startswith(_SELDOM_NEEDED)]


def _import(module: str) -> None:
    logging.getLogger("tactsim.core.compiling").setLevel(
        logging.ERROR
    )  # who asks for this knows why it takes long
    import_module(module)


if __name__ == "__main__":
    compile_kernels()
