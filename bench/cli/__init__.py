"""The command line: `main` is the command `bench`, `app` holds its verbs, and each verb has a file `cmd_*`.

Lives here: what a user types, and how a command ends. Does not live here: anything that computes; a verb calls
the rest of `tactsim`, which it imports when it runs, so that `bench --help` answers at once.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command `bench`, and end the process."""
    gc.set_threshold(
        50_000, 20, 20
    )  # what modules make stays: looking through it for garbage is 4 % of a run
    try:
        run()
    except SystemExit as ended:
        _leave(ended.code if isinstance(ended.code, int) else 0)


def run() -> NoReturn:
    """Run the command `bench`; raises SystemExit at its end."""
    if sys.platform == "win32":
        print("bench: tactsim runs on Linux and macOS; on Windows, use it within WSL", file=sys.stderr)
        sys.exit(2)
    try:  # importing takes long enough to be interrupted
        from tactsim.bench.cli.app import run_app

        _let_matplotlib_keep_its_fonts()
        run_app()
    except KeyboardInterrupt:
        end_interrupted()


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


def _leave(status: int) -> NoReturn:
    """End the process without freeing every object first, which takes half a second after a run.

    What was registered for the end is done, and what was printed is written.
    """
    atexit._run_exitfuncs()
    try:
        print(end="", flush=True)
    except BrokenPipeError:  # nobody reads any more
        status = status or 1
    except OSError as error:
        if not status:
            print(f"bench: cannot write to standard output: {error.strerror}", file=sys.stderr)
        status = status or 2
    with suppress(OSError, ValueError):  # it may be closed
        sys.stderr.flush()
    os._exit(status)
