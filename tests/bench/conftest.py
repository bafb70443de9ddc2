"""Runs for the tests of the report: small, real, made once."""

import json
import shutil
from contextlib import ExitStack
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import BENCH
from small_runs import draw_nothing, make_run_in
from terminal import OnTerminal
from typer.testing import CliRunner

from tactsim.bench import experiment, results
from tactsim.bench.cli.app import app
from tactsim.bench.config import run_config
from tactsim.bench.runs.saved import load
from tactsim.core import Scan

SCRIPT = "<script>document.title='harmed'</script>"
IMAGE = '"><img src=x onerror="document.title=1">'


@pytest.fixture
def drawn():
    """Have the pictures of runs drawn, for a test that looks at them."""


@pytest.fixture
def undrawn(monkeypatch):
    """Draw no pictures."""
    draw_nothing(monkeypatch)


@pytest.fixture(autouse=True)
def undrawn_here(request, monkeypatch):
    """Draw no pictures where the command line is called in this process, unless a test asks for them."""
    if "here" in request.fixturenames and "drawn" not in request.fixturenames:
        draw_nothing(monkeypatch)


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """Three runs: two budgets under the paper's protocol, one on readings off the grid."""
    folder = tmp_path_factory.mktemp("runs")
    return SimpleNamespace(
        small=make_run_in(folder / "small", bins=100, test_poses="same"),
        large=make_run_in(folder / "large", bins=1000, test_poses="same"),
        off_grid=make_run_in(folder / "off-grid", bins=1000),
    )


@pytest.fixture(scope="session")
def open_set_run(tmp_path_factory):
    """Give a run in which U was held out and may be refused."""
    words = {"estimator": "refined", "set": {"unknown": 0.5}, "bins": 1000, "hold_out": "U", "readings": 10}
    return make_run_in(tmp_path_factory.mktemp("open") / "set", **words)


@pytest.fixture(scope="session")
def hostile_run(tmp_path_factory):
    """Give a run whose every name tries to become markup."""
    folder = tmp_path_factory.mktemp("hostile")
    scan = experiment.gather(run_config(letters="AU")).scan
    labels = np.where(scan.labels == "A", SCRIPT, IMAGE)
    Scan(scan.readings, scan.poses, labels, scan.split, scan.taxel_xy).save(folder / "scan.npz")
    place = make_run_in(
        folder / "<img src=x onerror=alert(1)>", letters=None, scan=folder / "scan.npz", bins=100
    )
    content = json.loads((place / "run.json").read_text())
    content["description"] = "</script><script>document.title='harmed'</script><!--"
    content["protocol"] = "<b onmouseover=alert(1)>protocol</b>"
    content["machine"]["processor"] = "<iframe src=//example.org>"
    (place / "run.json").write_text(json.dumps(content))
    return place


@pytest.fixture(scope="session")
def scan_through_time(tmp_path_factory, shared_cache):
    """Scan the letter I with the images of each press, at one angle; gives the file, and what the command answered."""
    path = tmp_path_factory.mktemp("through-time") / "full.npz"
    full = ["--scan-set", "press.dynamics=full", "--scan-set", "press.frame_rate=100"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactsim.press.scan_poses.ANGLES", 1)
        words = ["scan", "--out", str(path), "--letters", "I", *full, "--sequence"]
        answer = CliRunner().invoke(app, words, env={"COLUMNS": "120", "NO_COLOR": "1"})
    return path, answer


@pytest.fixture
def on_terminal(bench, tmp_path):
    """Run `bench` on a terminal of 80 x 24, in colours; what still runs at the end of the test is killed."""
    with ExitStack() as running:
        yield lambda *words: running.enter_context(
            OnTerminal([BENCH, *words], cwd=tmp_path, environment=bench.environment)
        )


@pytest.fixture
def copied(tmp_path):
    """Copy a run's folder, to be damaged."""
    return lambda place, name="copy": shutil.copytree(place, tmp_path / name)


@pytest.fixture
def changed(copied):
    """Copy a run with some of its trials' columns replaced."""

    def change(place, name="copy", **columns):
        run = load(place)
        folder = copied(place, name)
        trials = replace(run.trials, **columns)
        bounds = None if run.bounds is None else run.bounds[:, : trials.label.shape[1]]
        results.save(replace(run, trials=trials, bounds=bounds), folder)
        return folder

    return change
