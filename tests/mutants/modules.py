"""Read modules.toml: which files are mutated, which tests are tried on their mutants, and which files are left out."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


class Modules(NamedTuple):
    """What modules.toml says; all paths are counted from the project's folder.

    rooms: folders in which every file is listed. deselected: tests that are never tried.
    tests: of each file, the test files that are tried on its mutants. left_out: the reason of each other file.
    """

    rooms: tuple[str, ...]
    deselected: tuple[str, ...]
    tests: dict[str, list[str]]
    left_out: dict[str, str]


def read_modules(path: Path = HERE / "modules.toml") -> Modules:
    """Read the file; it need not be right, see `faults`."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return Modules(tuple(table["rooms"]), tuple(table["deselected"]), table["tests"], table["left_out"])


def faults(modules: Modules, root: Path = ROOT) -> Iterator[str]:
    """Say what is wrong: a file that is forgotten, listed twice or gone, and a test that is gone."""
    mutated, left_out = set(modules.tests), set(modules.left_out)
    there = {str(path.relative_to(root)) for room in modules.rooms for path in (root / room).rglob("*.py")}
    yield from (f"{name} is neither mutated nor left out" for name in sorted(there - mutated - left_out))
    yield from (f"{name} is mutated and left out" for name in sorted(mutated & left_out))
    yield from (
        f"{name} is no file of {', '.join(modules.rooms)}" for name in sorted((mutated | left_out) - there)
    )
    for name, tests in modules.tests.items():
        if not tests:
            yield f"{name} has no tests"
        yield from (f"{name}: there is no {test}" for test in tests if not (root / test).is_file())
    for test in modules.deselected:
        file, _, function = test.partition("::")
        if not (root / file).is_file() or f"def {function}(" not in (root / file).read_text(encoding="utf-8"):
            yield f"there is no {test}"
