"""Tables of a page, filled from sweeps by the command that `make tables` calls."""

import json
import shutil

import pytest
from page_tables import fill, main
from small_runs import draw_nothing
from typer.testing import CliRunner

from tactsim.bench.cli.app import app
from tactsim.core import InputError

SWEEP = """
[defaults]
letters = "IO"
trials = 1
readings = 3
seed = [0, 1, 2, 3, 4]
test_poses = ["same", "random"]

[[run]]
estimator = "histogram"
bins = [100, 1000]

[[run]]
estimator = "nearest"
"""

PAGE = """Words before.

<!-- table: s; accuracy@1; error_mm@3; all_right_from -->
what stood here
<!-- end of table -->

Words between.

<!-- table: s by method; settled_95 -->
<!-- end of table -->

Words behind.
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, shared_cache):
    place = tmp_path_factory.mktemp("tables")
    (place / "s.toml").write_text(SWEEP)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.setattr("tactsim.press.scan_poses.ANGLES", 1)
        draw_nothing(patch)
        swept = CliRunner().invoke(app, ["sweep", "s.toml", "--jobs", "1"], env={"COLUMNS": "120"})
    assert swept.exit_code == 0, swept.output
    return place


@pytest.mark.long
def test_a_page_gets_its_tables_and_keeps_its_words(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "page.md").write_text(PAGE)
    for _ in range(2):  # a filled page is filled again
        assert main(["page.md"]) == 0
        assert capsys.readouterr().err == ""
    page = (folder / "page.md").read_text()
    assert "what stood here" not in page
    lines = page.splitlines()
    assert [lines[0], lines[-1]] == ["Words before.", "Words behind."]
    assert "| method | protocol | right after 1 | error after 3, mm | all right from |" in lines
    assert sum(line.startswith("| histogram, 100 bins | test poses same") for line in lines) == 1
    assert "| condition | histogram, 100 bins | histogram, 1,000 bins | nearest |" in lines
    assert page.count("`bench sweep s`: 5 scans, 10 trials; commit ") == 2


@pytest.mark.long
def test_a_sweep_of_other_source_code_is_refused(folder, monkeypatch):
    monkeypatch.setattr("page_tables.source_of_trials", lambda estimator: "f" * 64)
    with pytest.raises(InputError, match="s was made by other source code"):
        fill(PAGE, folder / "results" / "sweeps")


@pytest.mark.long
def test_a_figure_of_fewer_than_five_scans_is_refused(folder, tmp_path):
    shutil.copytree(folder / "results" / "sweeps" / "s", tmp_path / "s")
    (tmp_path / "s" / "sweep.json").unlink()  # or it would not have ended
    for run in (tmp_path / "s" / "runs").iterdir():
        if json.loads((run / "run.json").read_text())["config"]["seed"] == 4:
            shutil.rmtree(run)
    with pytest.raises(InputError, match="s has 4 seeds; a published figure takes 5 at least"):
        fill(PAGE, tmp_path)
