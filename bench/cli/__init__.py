"""The command line: `main` is the command `bench`, `app` holds its verbs, and each verb has a file `cmd_*`."""

from __future__ import annotations

from typing import NoReturn


def main() -> NoReturn:
    """Run the command `bench`."""
    from tactsim.bench.cli.app import run_app

    run_app()
