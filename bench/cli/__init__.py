"""The command line: `main` is the command `bench`, `app` holds its verbs, and each verb has a file."""

from __future__ import annotations

from typing import NoReturn


def main() -> NoReturn:
    """Run the command `bench` after making sure that its sibling packages are its own."""
    from bench.cli.siblings import check_siblings

    check_siblings()
    from bench.cli.app import run_app

    run_app()
