"""Tables of a page, filled from sweeps by the command that `make tables` calls."""

import json
import shutil

import numpy as np
import page_performance
import pytest
from page_tables import fill, main
from referee_bodies import FORCE, HALF, PAD, STIFFNESS, bodies, truth, within
from small_runs import draw_nothing
from typer.testing import CliRunner

import tactsim
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


def test_every_reading_of_a_trial_has_a_time_and_the_fit_has_one():
    scan = tactsim.scan(letters="IL")
    timed = page_performance.in_turns("nearest", [scan, scan.of_letters("I")], readings=7, trials=2)
    assert len(timed) == 2
    for spent, fit in timed:
        assert spent.shape == (7,)
        assert (spent > 0).all()
        assert fit > 0


def test_many_letters_are_the_pressed_ones_and_stretched_copies():
    scan = tactsim.scan(letters="IL")
    many = page_performance.enlarged(scan, 5)
    assert many.letters == ("I", "L", "I1", "L1", "I2")
    copy, pressed = (many.where(label=label).poses for label in ("L1", "L"))
    stretch = copy.max(axis=0) / pressed.max(axis=0)
    assert np.allclose(copy, pressed * stretch)
    assert (abs(stretch[:2] - 1) < 0.2).all()
    assert stretch[2] == 1


def test_a_page_that_asks_for_no_table_is_refused_before_the_work(tmp_path, capsys):
    (tmp_path / "page.md").write_text("<!-- time: letters -->\n<!-- end of time -->\n")
    assert page_performance.main([str(tmp_path / "page.md")]) == 2
    assert "<!-- time: taxels -->" in capsys.readouterr().err


BODIES = {body.name: body for body in bodies()}


@pytest.mark.parametrize("name", BODIES)
def test_the_mesh_is_the_height_field(name):
    """Both are cut level by level."""
    body = BODIES[name]
    x, y = np.random.default_rng(0).uniform(-HALF, HALF, (2, 2000))
    for height in (0.003, 0.02, 0.13, 0.31):
        within_mesh = within(body.solid.slice(height).to_polygons(), x, y)
        within_field = body.gap(x, y) < height
        assert within_mesh.any() == within_field.any()
        assert (within_mesh == within_field).mean() > 0.99, height  # some lie at a rim


@pytest.mark.parametrize("name", BODIES)
def test_springs_carry_the_force(name):
    kpa, depth = truth(BODIES[name])
    assert kpa.sum() * 1.9**2 * 1e-3 == pytest.approx(FORCE, rel=1e-6)
    assert 0 < depth < 1
    assert len(kpa) == PAD.taxels


def test_springs_under_a_sphere_and_a_cone_are_those_of_the_closed_forms():
    """F = pi k d^2 (R - d / 3) and F = pi k d^3 / (3 s^2)."""
    depth = truth(BODIES["sphere"])[1]
    assert np.pi * STIFFNESS * depth**2 * (10 - depth / 3) == pytest.approx(FORCE, rel=1e-4)
    assert truth(BODIES["cone"])[1] == pytest.approx((3 * FORCE * 0.2**2 / np.pi) ** (1 / 3), rel=1e-4)
