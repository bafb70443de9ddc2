"""Make sure that `models`, `tactsim` and the rest are the project's, before any of them is imported."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

SIBLINGS = ("models", "tactsim", "estimators", "hardware")


def check_siblings() -> None:
    """Exit with status 2 and one line if a folder of the user's hides one of the project's packages.

    The packages have plain names, so a folder `models` on PYTHONPATH could be imported instead.
    """
    home = Path(__file__).resolve().parents[2]
    for name in SIBLINGS:
        spec = find_spec(name)
        origin = Path(spec.origin).resolve() if spec and spec.origin else None
        if origin is None or origin.parents[1] != home:
            print(
                f"bench: the package {name!r} comes from {origin.parent if origin else 'nowhere'}, not from "
                f"{home} like bench itself; start bench elsewhere or rename that folder",
                file=sys.stderr,
            )
            sys.exit(2)
