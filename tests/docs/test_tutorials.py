"""Every tutorial runs to its end in a folder with a `models/`, `bench/` and `estimators/` of its own.

The first of them runs from the checkout. The slow suite runs it from a wheel, as a new user has it, and the others from
the checkout; `make docs` runs them too.
"""

import json
import os
import shutil
import subprocess
import sys

import pytest
from pages import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))

# Runs the cells of a notebook as Jupyter would, without needing it: an error ends it, and the value of a
# cell's last line is made into what Jupyter would show.
RUNNER = """
import ast, json, pathlib, sys
import tactsim
assert not sys.argv[2] or pathlib.Path(tactsim.__file__).is_relative_to(sys.argv[2]), tactsim.__file__
names = {"__name__": "__main__"}
for cell in json.loads(pathlib.Path(sys.argv[1]).read_text())["cells"]:
    if cell["cell_type"] == "code":
        tree = ast.parse("".join(cell["source"]))
        shown = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, cell["id"], "exec"), names)
        if shown:
            value = eval(compile(ast.Expression(shown.value), cell["id"], "eval"), names)
            for form in ("_repr_html_", "_repr_png_", "__repr__"):
                if hasattr(value, form):
                    getattr(value, form)()
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel from the checkout, and install it alone into a folder."""
    place = tmp_path_factory.mktemp("wheel")
    left_out = shutil.ignore_patterns(
        ".*", "build", "_build", "docs", "tests", "*.egg-info", "__pycache__", "runs"
    )
    shutil.copytree(ROOT, place / "source", ignore=left_out)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = ["wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", place, place / "source"]
    subprocess.run([*pip, *build], check=True, cwd=place)
    (built,) = place.glob("*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", place / "site", built], check=True)
    return place / "site"


def run(notebook, folder, cache, wheel=""):
    """Run a copy of a notebook in a folder, with the package of the wheel or of the checkout."""
    for name in ("models", "bench", "estimators", "hardware"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("raise ImportError('a folder of the user was imported')")
    copy = folder / notebook.name
    copy.write_bytes(notebook.read_bytes())
    environment = os.environ | {
        "PYTHONPATH": f"{folder}{os.pathsep}{wheel}",
        "TACTSIM_CACHE_DIR": str(cache),
        "MPLBACKEND": "agg",
    }
    result = subprocess.run(
        [sys.executable, "-c", RUNNER, copy, str(wheel)], cwd=folder, env=environment, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_a_new_user_brings_an_estimator_with_the_wheel_alone(wheel, shared_cache, tmp_path):
    """All is compiled anew there; tests/packaging says that the wheel is whole."""
    run(ROOT / "docs" / "tutorials" / "bring-an-estimator.ipynb", tmp_path, shared_cache, wheel)


@pytest.mark.long
@pytest.mark.parametrize(
    "notebook",
    [
        pytest.param(one, marks=[] if one.stem == "bring-an-estimator" else pytest.mark.slow)
        for one in NOTEBOOKS
    ],
    ids=lambda path: path.stem,
)
def test_a_tutorial_runs(notebook, shared_cache, tmp_path):
    run(notebook, tmp_path, shared_cache)


def test_there_are_five_tutorials():
    assert len(NOTEBOOKS) == 5


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_tutorial_prints_and_shows_is_kept(notebook):
    """A reader on GitHub sees it, too: every cell ran, one after another, and none ended in an error."""
    cells = [cell for cell in json.loads(notebook.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    kinds = [output["output_type"] for cell in cells for output in cell["outputs"]]
    assert kinds
    assert "error" not in kinds
