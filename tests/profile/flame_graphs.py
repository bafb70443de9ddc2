"""Draw where the time of a press, a scan, a sweep and a run goes: `python tests/profile/flame_graphs.py [NAME...]`.

py-spy looks at the stack of the working process 100 times a second from outside. So nothing is slowed down, and time in
compiled code counts where it is spent. The compiled inner loops have no Python frames; here each is called through a
frame with its name, marked with a star. What such a loop calls in turn is not told apart.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from pathlib import Path
from time import process_time
from types import CodeType, FunctionType

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
RATE = 100  # looks a second
LONG_ENOUGH = 3.0  # s of processor time; shorter work is repeated
GLYPHS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
ROW, WIDTH, LEAST = 17, 1000, 4.0  # of the picture; frames narrower than LEAST are left out

Work = Callable[[], object]


def press(side: int) -> Work:
    """Press an A at 64 poses, tilted as by default, on a pad as large as the default one with side x side taxels."""
    from tactsim import Pad, models
    from tactsim.press import ScanOptions
    from tactsim.press.engine import press_at
    from tactsim.press.scan_poses import grid_poses
    from tactsim.press.touches import Touches

    pitch, width, unread = 11.4 / side, 10.8 / side, round(side / 6)
    pad = Pad(
        rows=side, columns=side, pitch_x=pitch, pitch_y=pitch, taxel_width=width, taxel_height=width,
        unread_columns=unread,
    )  # fmt: skip
    options = ScanOptions(pad=pad)
    touches = Touches(models.letter("A"), grid_poses()[:64], tilts_of(64))
    return lambda: press_at(touches, options).readings(options)


def tilts_of(count: int):
    """Draw tilts (count, 2) as large as those of the default world, rad."""
    import numpy as np

    return np.random.default_rng(0).normal(scale=0.0044, size=(count, 2))


def scan() -> Work:
    """Press the 36 glyphs at 384 poses each."""
    from tactsim.press import ScanOptions, scan_letters

    return lambda: scan_letters(ScanOptions(letters=tuple(GLYPHS)), cache=False)


def sweep() -> Work:
    """Do 40 runs: ten worlds of the suite robustness with four estimators, 2 trials of 20 readings a letter each."""
    from tactsim.bench import sweep
    from tactsim.bench import sweep as sweeps
    from tactsim.bench.experiment import silent

    @contextmanager
    def here() -> Iterator[ThreadPoolExecutor]:
        with ThreadPoolExecutor(1) as pool:
            yield pool

    names = ("histogram", "particle", "refined", "force-mosaic")
    _, suite = sweep.read("robustness")
    worlds = list(dict.fromkeys(config.source for config in suite if config.seed == 0))[:10]
    chosen = [
        config.model_copy(update={"trials": 2})
        for config in suite
        if config.source in worlds and config.estimator in names
    ]

    def work() -> None:
        with tempfile.TemporaryDirectory() as folder:
            sweeps.perform(chosen, Path(folder), jobs=1, pool=here, cache=False, progress=silent)

    return work


def run() -> Work:
    """Do `bench run --estimator histogram --bins 10000`, imports and pictures included."""

    def work() -> None:
        from tactsim.bench.cli.app import app

        with tempfile.TemporaryDirectory() as folder:
            words = ["run", "--estimator", "histogram", "--bins", "10000", "--out", f"{folder}/run"]
            app(words, standalone_mode=False)

    return work


WORK: dict[str, Callable[[], Work]] = {
    "press-6": lambda: press(6),
    "press-32": lambda: press(32),
    "press-64": lambda: press(64),
    "scan": scan,
    "sweep": sweep,
    "run": run,
}


def the_work(work: Work) -> None:
    """Do work: what is drawn are the stacks in which this function stands."""
    work()


def do(name: str) -> None:
    """Prepare work and do it, repeatedly if it is short."""
    work = WORK[name]()
    if name != "run":  # its imports count, and loops cannot be named before they are imported
        name_loops()
    start = process_time()
    while True:
        the_work(work)
        if name in ("run", "sweep", "scan") or process_time() - start > LONG_ENOUGH:
            return


def name_loops() -> None:
    """Put a Python frame with a name around every compiled loop that Python calls."""
    from numba.extending import is_jitted

    from tactsim.bench.compile_kernels import modules_with_kernels

    for module in modules_with_kernels():
        import_module(module)
    for module in [module for name, module in sys.modules.items() if name.startswith("tactsim.")]:
        for name, value in list(vars(module).items()):
            if is_jitted(value):
                setattr(module, name, _named(value))


def _named(loop: Callable[..., object]) -> Callable[..., object]:
    def call(*arguments: object) -> object:
        return loop(*arguments)

    python: FunctionType = loop.py_func  # type: ignore[attr-defined]
    name = f"{python.__name__}*"
    code: CodeType = call.__code__.replace(
        co_name=name, co_qualname=name, co_filename=python.__code__.co_filename
    )
    call.__code__ = code
    return call


@dataclass
class Frame:
    """A frame of a stack, the looks in which it stood and those that it called."""

    name: str
    looks: int = 0
    calls: dict[str, Frame] = field(default_factory=dict)

    def add(self, stack: list[str], looks: int) -> None:
        """Count looks at a stack of frames within this one."""
        self.looks += looks
        if stack:
            self.calls.setdefault(stack[0], Frame(stack[0])).add(stack[1:], looks)

    @property
    def depth(self) -> int:
        """Count the rows of the picture."""
        return 1 + max((call.depth for call in self.calls.values()), default=0)


def record(name: str) -> Frame:
    """Do work in a process of its own and look at its stacks. Raises CalledProcessError if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "stacks"
        subprocess.run(
            [Path(sys.executable).parent / "py-spy", "record", "--rate", str(RATE), "--format", "raw", "--function",
             "--nonblocking", "--output", out, "--", sys.executable, __file__, "--do", name],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        whole = Frame(name)
        for line in out.read_text(encoding="utf-8").splitlines():
            stack, _, looks = line.rpartition(" ")
            frames = [_short(frame) for frame in stack.split(";") if "<frozen importlib" not in frame]
            start = next((k for k, frame in enumerate(frames) if frame.startswith("the_work ")), None)
            if start is None and "run_chunk" in stack:  # the thread of the sweep's only worker
                start = next(k for k, frame in enumerate(frames) if frame.startswith("run_chunk ")) - 1
            if start is not None:
                whole.add(frames[start + 1 :], int(looks))
    return whole


def _short(frame: str) -> str:
    """Turn py-spy's `name (path)` into `name (file)`."""
    name, _, path = frame.partition(" (")
    return f"{name} ({path.rstrip(')').rsplit('/', 1)[-1]})"


def draw(whole: Frame) -> str:
    """Draw stacks from above: a frame is as wide as its time, and what it calls lies below it."""
    shapes: list[str] = []
    lowest = 0

    def place(frame: Frame, x: float, row: int) -> None:
        nonlocal lowest
        width = WIDTH * frame.looks / whole.looks
        if width < LEAST:
            return
        lowest = max(lowest, row)
        share = f"{frame.looks / whole.looks:.1%}"
        colour = "#e8b04a" if frame.name.partition(" ")[0].endswith("*") else "#a9c7e8"
        text = escape(frame.name)
        shapes.append(
            f'<g><title>{text} {share}</title><rect x="{x:.1f}" y="{row * ROW}" width="{width:.1f}" height="{ROW - 1}"'
            f' fill="{colour}"/>'
        )
        room = int(width / 6.3)
        if room > 4:
            label = f"{frame.name.partition(' ')[0]} {share}"
            shown = label if len(label) <= room else f"{label[: room - 1]}…"
            shapes.append(f'<text x="{x + 2:.1f}" y="{row * ROW + 12}">{escape(shown)}</text>')
        shapes.append("</g>")
        for call in sorted(frame.calls.values(), key=lambda call: -call.looks):
            place(call, x, row + 1)
            x += WIDTH * call.looks / whole.looks

    place(whole, 0, 0)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {(lowest + 1) * ROW}" '
        'font-family="monospace" font-size="10.5">' + "".join(shapes) + "</svg>\n"
    )


def main(names: list[str]) -> None:
    """Draw the pictures, and print in which frames the time is spent itself."""
    for name in names or WORK:
        whole = record(name)
        if not whole.looks:
            sys.exit(f"{name}: py-spy saw nothing of the work; did it fail?")
        target = PICTURES / f"flame-{name}.svg"
        target.write_text(draw(whole), encoding="utf-8")
        print(f"{name}: {whole.looks / RATE:.1f} s, {target.relative_to(ROOT)}")
        own: dict[str, int] = {}
        _own(whole, own)
        for frame, looks in sorted(own.items(), key=lambda item: -item[1])[:8]:
            print(f"  {looks / whole.looks:6.1%}  {frame}")


def _own(frame: Frame, found: dict[str, int]) -> None:
    inner = sum(call.looks for call in frame.calls.values())
    found[frame.name] = found.get(frame.name, 0) + frame.looks - inner
    for call in frame.calls.values():
        _own(call, found)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--do"]:
        do(sys.argv[2])
    else:
        main(sys.argv[1:])
