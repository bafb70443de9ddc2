"""Draw where the time of presses, a scan and a run goes: `python tests/profile/flame_graphs.py`; `make profile`.

py-spy looks at the stack of the working process a hundred times a second from outside. Compiled inner loops have no
Python frames, so each is called through a frame with its name and a star. What such a loop calls is not told apart.
"""

import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from time import process_time

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
GLYPHS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
WORK = ("press-6", "press-32", "press-64", "scan", "run")


def press(side):
    """Press an A at 64 poses, tilted, for three seconds, on a pad of the default size with side x side taxels."""
    import numpy as np

    from tactsim import Pad, models
    from tactsim.press import ScanOptions
    from tactsim.press.engine import press_at
    from tactsim.press.scan_poses import grid_poses
    from tactsim.press.touches import Touches

    pitch, width = 11.4 / side, 10.8 / side
    pad = Pad(rows=side, columns=side, pitch_x=pitch, pitch_y=pitch, taxel_width=width, taxel_height=width,
              unread_columns=round(side / 6))  # fmt: skip
    options, tilts = ScanOptions(pad=pad), np.random.default_rng(0).normal(scale=0.0044, size=(64, 2))
    touches = Touches(models.letter("A"), grid_poses()[:64], tilts)
    start = process_time()
    while process_time() - start < 3:
        press_at(touches, options).readings(options)


def do(name):
    """Do the work of that name in this process."""
    if name == "run":  # its imports count, and loops cannot be named before they are imported
        from tactsim.bench.cli.app import app

        with tempfile.TemporaryDirectory() as folder:
            app(
                ["run", "--estimator", "histogram", "--bins", "10000", "--out", f"{folder}/run"],
                standalone_mode=False,
            )
        return
    name_loops()
    if name == "scan":
        from tactsim.press import ScanOptions, scan_letters

        scan_letters(ScanOptions(letters=tuple(GLYPHS)), cache=False)
    else:
        press(int(name.removeprefix("press-")))


def name_loops():
    """Put a Python frame with a name around every compiled loop that Python calls."""
    from numba.extending import is_jitted

    from tactsim.bench.compile_kernels import modules_with_kernels

    for module in modules_with_kernels():
        import_module(module)
    for module in [module for name, module in sys.modules.items() if name.startswith("tactsim.")]:
        for name, value in list(vars(module).items()):
            if is_jitted(value):
                setattr(module, name, named(value))


def named(loop):
    """Wrap a compiled loop in a function of its name, with a star."""

    def call(*arguments):
        return loop(*arguments)

    name, file = f"{loop.py_func.__name__}*", loop.py_func.__code__.co_filename
    call.__code__ = call.__code__.replace(co_name=name, co_qualname=name, co_filename=file)
    return call


def main():
    """Draw every picture, each of a process of its own."""
    for name in WORK:
        target = PICTURES / f"flame-{name}.svg"
        look = [
            Path(sys.executable).parent / "py-spy",
            "record",
            "--function",
            "--nonblocking",
            "--output",
            target,
        ]
        subprocess.run([*look, "--", sys.executable, __file__, name], check=True)


if __name__ == "__main__":
    do(sys.argv[1]) if len(sys.argv) > 1 else main()
