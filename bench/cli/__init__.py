"""The command line: `main` is the command `bench`, `app` lists its verbs, and each file `cmd_*` has those
of one subject.

Lives here: what a user types, and how a command ends. Does not live here: anything that computes; a verb calls
the rest of `tactsim`, which it imports when it runs, so that `bench --help` answers at once.
"""

from __future__ import annotations

import os
import signal
import sys
from _thread import interrupt_main
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from types import FrameType

INTERRUPTED, NOBODY_READS = 130, 141  # as a shell says of a command that SIGINT or SIGPIPE has ended


def main() -> NoReturn:
    """Run the command `bench`; raises SystemExit at its end."""
    # A scheduler or a container ends it as Ctrl-C does: frames are kept, and nothing is left half-written.
    interrupt = _Interrupt()
    signal.signal(signal.SIGTERM, interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored, as behind `nohup`
        signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = _come_again
    for size in ("COLUMNS", "LINES"):  # 0 where a terminal does not say: nothing would fit
        if not os.environ.get(size, "").strip("0"):
            os.environ.pop(size, None)
    for window in ("MPLBACKEND", "MUJOCO_GL"):  # all is drawn into files, and unknown ones are errors
        os.environ.pop(window, None)
    try:  # importing takes long enough to be interrupted
        from tactsim.bench.cli.app import run_app

        _let_matplotlib_keep_its_fonts()
        run_app()
    except KeyboardInterrupt:
        end_interrupted()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 0
        if isinstance(ended.__context__, BrokenPipeError):  # which rich takes for a failure
            status = NOBODY_READS
        sys.exit(_printed(status))


class _Interrupt:
    """Raise KeyboardInterrupt, as Python does, and remember it: extensions clear errors that are none of theirs."""

    came = False

    def __call__(self, _number: int, _frame: FrameType | None) -> NoReturn:
        self.came = True
        raise KeyboardInterrupt


def _come_again(lost: UnraisableHookArgs) -> None:
    """Let an interrupt come again that came where Python cannot raise it, in a `__del__` or a callback.

    While Python collects garbage there are many. This function is called there too, so the other comes later.
    """
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    if sys.platform == "win32":
        Timer(0.05, interrupt_main).start()
    else:
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_REAL, 0.05)


def _let_matplotlib_keep_its_fonts() -> None:
    """Give matplotlib a folder where its own cannot be written: it would warn, and look for all fonts in every run."""
    from tactsim.core.cache_folder import cache_folder, can_be_written

    home = Path(os.path.expanduser("~"))  # noqa: PTH111  (pathlib raises an error where there is no home)
    folders = (("XDG_CONFIG_HOME", ".config"), ("XDG_CACHE_HOME", ".cache"))
    if not all(can_be_written(Path(os.environ.get(name) or home / own)) for name, own in folders):
        os.environ.setdefault("MPLCONFIGDIR", str(cache_folder() / "matplotlib"))


def end_interrupted() -> NoReturn:
    """Say in one line that the command was interrupted, and exit."""
    print("bench: interrupted; nothing half-written was kept", file=sys.stderr)
    sys.exit(INTERRUPTED)


def _printed(status: int) -> int:
    """Write what was printed; returns the exit status, which is no longer 0 if that fails."""
    try:
        print(end="", flush=True)
    except OSError as error:  # a full disk, or nobody reads any more
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # else Python would try again at its end, and complain
        if not status and not isinstance(error, BrokenPipeError):
            print(f"bench: cannot write to standard output: {error.strerror}", file=sys.stderr)
        status = status or (NOBODY_READS if isinstance(error, BrokenPipeError) else 2)
    return status
