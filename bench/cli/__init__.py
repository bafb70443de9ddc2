"""The command line: `main` is the command `bench`, `app` holds its verbs, and each verb has a file `cmd_*`.

Lives here: what a user types, and how a command ends. Does not live here: anything that computes; a verb calls
the rest of `tactsim`, which it imports when it runs, so that `bench --help` answers at once.
"""

from __future__ import annotations

import sys
from typing import NoReturn

INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command `bench`."""
    if sys.platform == "win32":
        print("bench: tactsim runs on Linux and macOS; on Windows, use it within WSL", file=sys.stderr)
        sys.exit(2)
    try:  # importing takes long enough to be interrupted
        from tactsim.bench.cli.app import run_app

        run_app()
    except KeyboardInterrupt:
        end_interrupted()


def end_interrupted() -> NoReturn:
    """Say in one line that the command was interrupted, and exit."""
    print("bench: interrupted; nothing half-written was kept", file=sys.stderr)
    sys.exit(INTERRUPTED)
