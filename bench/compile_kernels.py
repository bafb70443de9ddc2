"""Compile what most runs need, and keep it for later ones: `python -m tactsim.bench.compile_kernels [--all]`.

Without it the first run that needs a kernel compiles it. Those of exact presses and reliefs, of solids and of pads on
others' robots, which few runs need, are left to that but with `--all`. Then a small run and its report are made, so
that Python keeps what it compiles of all that they import: later the environment may be one that cannot be written.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path

from tactsim.core.compiling import HOLDS_KERNELS, compile_waiting
from tactsim.core.source_digest import python_files

_SELDOM_NEEDED = ("tactsim.solids.", "tactsim.attach.", "tactsim.press.")


def compile_kernels(left_out: tuple[str, ...]) -> None:
    """Compile or load kernels on all cores, a module on each.

    left_out: how the names of modules begin that are not.
    """
    wanted = [module for module in modules_with_kernels() if not module.startswith(left_out)]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=spawn) as pool:
        list(pool.map(_compile_module, wanted))


def modules_with_kernels() -> list[str]:
    """List the modules that hold kernels, without importing them."""
    return [
        "tactsim." + name.removesuffix(".py").replace(os.sep, ".")
        for name, path in python_files("tactsim")
        if HOLDS_KERNELS in Path(path).read_bytes()
    ]


def compile_packages() -> None:
    """Make a small run and its report, of which Python keeps what it compiles, whatever the environment says."""
    bench = [sys.executable, "-c", "from tactsim.bench.cli import main; main()"]
    run = ["run", "--letters", "IL", "--trials", "1", "--readings", "1", "--no-cache", "--out", "made"]
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": ""}
    with tempfile.TemporaryDirectory() as folder:
        for words in (run, ["report", "made"]):
            subprocess.run(
                [*bench, *words], cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL
            )


def _compile_module(module: str) -> None:
    # Who asks for this knows why it takes long.
    logging.getLogger("tactsim.core.compiling").setLevel(logging.ERROR)
    sys.dont_write_bytecode = False
    import_module(module)
    compile_waiting(module)


if __name__ == "__main__":
    compile_kernels(() if "--all" in sys.argv else _SELDOM_NEEDED)
    compile_packages()
