"""The best known results: the first of the standings, written, read, and shown by `bench tasks`."""

import pytest
from best_known_results import main
from entered import entered

from tactsim.bench import leaderboard as best_known
from tactsim.bench.config import RunConfig
from tactsim.bench.leaderboard.bundle import write_bundle
from tactsim.bench.leaderboard.standings import read_folder
from tactsim.bench.tasks import task

TASK = "active-v1"
DEFAULT = RunConfig.model_fields["estimator"].default


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Give an empty folder of bundles, and a file of its own to write."""
    monkeypatch.setattr(best_known, "FILE", tmp_path / "best_known.toml")
    (tmp_path / "bundles").mkdir()
    return tmp_path / "bundles"


def test_the_file_has_the_first_of_each_task_and_is_shown(folder, here):
    write_bundle(entered("good", TASK, skill=2.5, mm=0.1), folder / "good.tar.xz")
    write_bundle(entered("poor", TASK, skill=0.7, mm=6.0), folder / "poor.tar.xz")
    write_bundle(entered(DEFAULT, TASK, skill=0.6, mm=7.0), folder / "default.tar.xz")
    write_bundle(entered("failed", "slip-v1", status="crashed"), folder / "failed.tar.xz")
    write_bundle(entered("other", TASK, skill=9.0, mm=0.0, task_data="f" * 64), folder / "other-data.tar.xz")
    write_bundle(entered("own", TASK, skill=9.0, mm=0.0, task="mine-v1.toml"), folder / "own.tar.xz")
    assert main([str(folder)]) == 0
    found = best_known.best_known()
    assert set(found) == {TASK}
    (of,) = (one for one in read_folder(folder).standings if one.known and one.ranked)
    best = found[TASK]
    assert (best.method, best.commit, best.figure) == ("good", "c" * 40, task(TASK).scored[0])
    assert best.value == of.ranked[0].figure(best.figure).value < of.ranked[1].figure(best.figure).value
    assert best.default == of.ranked[2].figure(best.figure).value > best.value
    shown = " ".join(here("tasks").stdout.split())
    assert f"best error_all_mm@10 {best.value:.4g}: --estimator {best.words} (commit cccccccccccc)" in shown
    assert f"the default estimator: {best.default:.4g}" in shown
