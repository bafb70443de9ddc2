"""The rooms of the source: a sign on every door, and no way in by an old name."""

import ast
import re
import subprocess
import sys

import pytest
from building import ROOMS, ROOT

# Rooms that lie in the package itself; the others are linked into it.
INSIDE = ("tactsim/core", "tactsim/env", "tactsim/press")
SOURCES = sorted(path for room in (*INSIDE, *ROOMS) for path in (ROOT / room).rglob("*.py"))
PACKAGES = sorted({path.parent for path in SOURCES} | {ROOT / "tactsim"})
TESTS = sorted((ROOT / "tests").rglob("*.py"))
# Tests in which these are a user's own folders.
OWN_FOLDERS = {"tests/packaging/test_distributions.py", "tests/packaging/test_names.py"}


def relative(path):
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("folder", PACKAGES, ids=relative)
def test_a_package_says_what_lives_there(folder):
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
    assert text, f"{relative(folder)}/__init__.py: a docstring should say what lives there"
    assert len(text.splitlines()[0]) > 20


@pytest.mark.parametrize("room", [*INSIDE, *ROOMS])
def test_a_room_says_what_does_not_live_there(room):
    text = ast.get_docstring(ast.parse((ROOT / room / "__init__.py").read_text(encoding="utf-8")))
    said = " ".join(text.split())
    assert "Lives here: " in said
    assert "Does not live here: " in said


@pytest.mark.parametrize(
    "line",
    ["import models", "import bench.runner", "from estimators import create", "from hardware.port import x"],
)
def test_the_linter_refuses_a_folder_s_bare_name(line):
    done = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--select", "TID251", "--stdin-filename", "bench/x.py", "-"],
        input=line + "\n", cwd=ROOT, text=True, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "TID251" in done.stdout


@pytest.mark.parametrize("path", [*SOURCES, *TESTS], ids=relative)
def test_no_string_names_a_module_by_its_folder(path):
    """Find `import_module("models")` and programs in strings, which no linter looks into."""
    names, name = "|".join(ROOMS), relative(path)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        where = f"{name}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and name not in OWN_FOLDERS:
            assert not re.search(rf"^\s*(from|import) ({names})\b", node.value, re.M), where
        if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("import_module", "find_spec", "files", "__import__", "importorskip", "run_module"):
                assert not re.match(rf"({names})(\.|$)", str(node.args[0].value)), where
