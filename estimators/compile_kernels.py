"""Compile all kernels of the estimators and keep them for later runs: `python -m tactsim.estimators.compile_kernels`.

Without it the first run of an estimator compiles the kernels that it needs, which takes about half a minute.
"""

from __future__ import annotations

import logging
import pkgutil
from importlib import import_module

import tactsim.estimators


def compile_kernels() -> None:
    """Import every module of the estimators: a kernel is compiled, or loaded from the cache, when it is imported."""
    logging.getLogger("tactsim.core.compiling").setLevel(logging.ERROR)  # who calls this knows why
    for module in pkgutil.walk_packages(tactsim.estimators.__path__, "tactsim.estimators."):
        import_module(module.name)


if __name__ == "__main__":
    compile_kernels()
