"""Every tutorial runs to its end in a folder with a `models/`, `bench/` and `estimators/` of its own.

The slow suite runs all but the first of them; `make docs` runs them too.
"""

import json
import os
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


def run(notebook, folder, cache):
    """Run a copy of a notebook in a folder."""
    for name in ("models", "bench", "estimators", "hardware"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("raise ImportError('a folder of the user was imported')")
    copy = folder / notebook.name
    copy.write_bytes(notebook.read_bytes())
    environment = os.environ | {
        "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
        "TACTSIM_CACHE_DIR": str(cache),
        "MPLBACKEND": "agg",
    }
    result = subprocess.run(
        [sys.executable, "-c", RUNNER, copy], cwd=folder, env=environment, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr


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


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_tutorial_prints_and_shows_is_kept(notebook):
    """A reader on GitHub sees it, too: every cell ran, one after another, and none ended in an error."""
    cells = [cell for cell in json.loads(notebook.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    kinds = [output["output_type"] for cell in cells for output in cell["outputs"]]
    assert kinds
    assert "error" not in kinds
