"""Types reach a user's own code: in the checkout and from an installed wheel.

A lenient editable install, setuptools' default, is invisible to every type checker outside the checkout.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from building import ROOT

# Both calls are wrong; a checker that sees no types would find nothing, or that nothing is there.
CODE = """
import numpy as np
from tactsim.core import Scan
from tactsim.models import letter
from tactsim.estimators import Estimator
import tactsim.bench.experiment, tactsim.hardware.sources

name: int = letter("A").name
Scan.load(3.5)
"""
WRONG = {8, 9}


def mypy(folder, python):
    words = [
        sys.executable, "-m", "mypy", "--python-executable", python, "--no-incremental", "--config-file", "",
    ]  # fmt: skip
    done = subprocess.run(
        [*words, "--output", "json", "own.py"], cwd=folder, capture_output=True, text=True, timeout=300,
        check=False, env={k: v for k, v in os.environ.items() if k != "MYPYPATH"},
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    found = map(json.loads, done.stdout.splitlines())
    return {line["line"] for line in found if line["file"] == "own.py" and line["severity"] == "error"}


def pyright(folder, python):
    pytest.importorskip("basedpyright", reason="`make test-slow` installs it")
    command = Path(sys.executable).with_name("basedpyright")
    done = subprocess.run(
        [command, "--pythonpath", python, "--level", "error", "--outputjson", "own.py"],
        cwd=folder, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    return {found["range"]["start"]["line"] + 1 for found in json.loads(done.stdout)["generalDiagnostics"]}


@pytest.mark.slow
@pytest.mark.parametrize("checker", [mypy, pyright])
@pytest.mark.parametrize("place", ["checkout", "wheel"])
def test_types_are_seen(checker, place, request, install, tmp_path):
    folder = tmp_path / "own"
    python = sys.executable
    if place == "checkout":
        folder = request.getfixturevalue("checkout")
    else:
        python = install(request.getfixturevalue("wheel")) / "bin" / "python"
    folder.mkdir(exist_ok=True)
    (folder / "own.py").write_text(CODE)
    if place == "checkout":
        (folder / "pyproject.toml").write_text("")  # judge the user's lines as a user's checker does
    assert checker(folder, python) == WRONG


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "tactsim" / "py.typed").is_file()
