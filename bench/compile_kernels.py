"""Compile all kernels and keep them for later runs: `python -m tactsim.bench.compile_kernels`.

Without it the first run that needs a kernel compiles it, which takes up to half a minute.
"""

from __future__ import annotations

import logging
import pkgutil
from importlib import import_module

import tactsim.estimators
import tactsim.press


def compile_kernels() -> None:
    """Import every module that has some: a kernel is compiled, or loaded from the cache, when it is imported."""
    logging.getLogger("tactsim.core.kernel_cache").setLevel(logging.ERROR)  # who calls this knows why
    import_module("tactsim.bench.placement_kernels")
    for package in (tactsim.estimators, tactsim.press):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            import_module(module.name)


if __name__ == "__main__":
    compile_kernels()
