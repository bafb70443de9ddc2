"""The command line: `main` is the command `bench`, `app` holds its verbs, and each verb has a file `cmd_*`."""

from __future__ import annotations

import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run the command `bench`."""
    if sys.platform == "win32":
        print("bench: tactsim runs on Linux and macOS; on Windows, use it within WSL", file=sys.stderr)
        sys.exit(2)
    from tactsim.bench.cli.app import run_app

    run_app()
