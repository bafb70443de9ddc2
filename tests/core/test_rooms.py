"""Names of modules in strings, which the import contracts do not see: registries, lazy imports, entry points."""

import ast
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import pytest

import tactsim

ROOT = Path(tactsim.__file__).parent
# What each room may name: itself and what lies below it.
SEEN = {
    "core": {"core"},
    "models": {"core", "models"},
    "press": {"core", "models", "press"},
    "estimators": {"core", "estimators"},
    "hardware": {"core", "hardware"},
    "bench": {"core", "models", "press", "estimators", "hardware", "bench"},
}


def named_modules(room):
    """List (file, name) of every string in a room's code that is the name of a module of another."""
    for path in sorted((ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                module = node.value.partition(":")[0]
                if module.startswith("tactsim.") and all(map(str.isidentifier, module.split("."))):
                    yield path.name, module


@pytest.mark.parametrize("room", SEEN)
def test_a_room_names_no_module_that_it_may_not_import(room):
    wrong = [
        (file, module)
        for file, module in named_modules(room)
        if (ROOT / module.split(".")[1]).is_dir() and module.split(".")[1] not in SEEN[room]
    ]
    assert not wrong


def test_the_registries_are_among_the_names_that_are_looked_at():
    assert ("sources.py", "tactsim.hardware.live") in set(named_modules("hardware"))
    assert any(module.startswith("tactsim.estimators.filters.") for _, module in named_modules("estimators"))


def own_entry_points():
    """List the entry points, (group, name, target), that this project's own package declares."""
    project = tomllib.loads((ROOT.parent / "pyproject.toml").read_text())["project"]
    return [
        (group, name, target)
        for group, points in project["entry-points"].items()
        for name, target in points.items()
    ]


@pytest.mark.parametrize(("group", "name", "target"), own_entry_points())
def test_an_entry_point_brings_nothing_from_above(group, name, target):
    """A source is opened by the hardware's room: what it names must not bring the bench, nor look back."""
    (installed,) = entry_points(group=group, name=name)
    assert installed.value == target
    module, attribute = target.split(":")
    code = (
        f"import sys; from {module} import {attribute}\n"
        "print(*{name.split('.')[1] for name in sys.modules if name.startswith('tactsim.')})"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) <= SEEN[module.split(".")[1]]
