"""The best known results: found among bundles by the task's figures, written, read, and shown by `bench tasks`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from bundles import make_bundle

from tactsim.bench.leaderboard import best_known
from tactsim.bench.leaderboard.bundle import write_bundle
from tactsim.bench.score import errors
from tactsim.bench.tasks import names, task

TASK = task("letters-offgrid-v1")


def bundle(method, share_right, off_mm=1.0, **changes):
    """Make a bundle with this share of the letters right at every reading, each estimate off by so much."""
    said = {"method": method, "task": TASK.name, "task_data": TASK.data, "commit": "c" * 40}
    made = make_bundle(seeds=TASK.seeds, **said | changes)

    def altered(run):
        wanted = TASK.readings
        trials = {
            name: np.repeat(getattr(run.trials, name)[:, :1], wanted, axis=1)
            for name in ("true_pose", "reading", "label", "p_truth", "p_label", "pose", "credibility", "radius_90",
                         "evaluations", "update_s", "estimate_s", "propose_s")
        }  # fmt: skip
        truth = run.trials.truth
        right = np.arange(len(truth)) < round(share_right * len(truth))
        trials["label"][:] = np.where(right, truth, np.where(truth == "A", "E", "A"))[:, None]
        trials["pose"] = trials["true_pose"] + [off_mm, 0, 0]
        return replace(
            run, trials=replace(run.trials, **trials), config=run.config | {"readings": wanted, "trials": 20}
        )

    return replace(made, runs=tuple(altered(run) for run in made.runs))


def test_the_best_is_by_the_figure_that_ranks_and_then_by_the_next():
    assert TASK.scored[:2] == ("error_all_mm@20", "accuracy@5")
    close, far = bundle("close", 1 / 3, off_mm=0.5), bundle("far", 1.0, off_mm=0.6)
    found = best_known.best_of([far, close])
    run = close.runs[0]
    assert set(found) == {TASK.name}
    assert found[TASK.name].model_dump() == {
        "figure": "error_all_mm@20",
        "value": pytest.approx(
            np.mean([errors(one.trials, one.objects)[:, 19].mean() for one in close.runs])
        ),
        "method": "close",
        "commit": "c" * 40,
    }
    assert errors(run.trials, run.objects)[0, 19] == pytest.approx(0.5)
    wrong, right = bundle("a wrong one", 1 / 3), bundle("right", 1.0)
    assert best_known.best_of([wrong, right])[TASK.name].method == "right"


@pytest.mark.parametrize(
    "changes", [{"task_data": "f" * 64}, {"task": "letters-offgrid-v9"}, {"task": "mine-v1.toml"}]
)
def test_other_data_and_other_tasks_count_for_nothing(changes):
    assert best_known.best_of([bundle("x", 1.0, **changes)]) == {}


def test_a_part_of_a_task_counts_for_nothing():
    whole = bundle("x", 1.0)
    assert best_known.best_of([replace(whole, runs=whole.runs[1:])]) == {}
    for change in ({"trials": 4}, {"trials": 21}):
        runs = tuple(replace(run, config=run.config | change) for run in whole.runs)
        assert best_known.best_of([replace(whole, runs=runs)]) == {}
    assert best_known.best_of([make_bundle(seeds=TASK.seeds, task=TASK.name, task_data=TASK.data)]) == {}


def test_a_method_without_a_score_counts_for_nothing():
    failed = replace(bundle("x", 1.0), status="crashed", runs=())
    assert best_known.best_of([failed, bundle("y", 0.0)])[TASK.name].method == "y"


def test_the_file_is_made_from_bundles_and_shown(tmp_path, monkeypatch, here):
    (tmp_path / "results" / "leaderboard").mkdir(parents=True)
    monkeypatch.setattr(best_known, "FILE", tmp_path / "best_known.toml")
    monkeypatch.chdir(tmp_path)
    assert best_known.main() == 0
    assert best_known.best_known() == {}
    (tmp_path / "results" / "leaderboard" / "broken.zip").write_text("no bundle")
    assert best_known.main() == 2
    (tmp_path / "results" / "leaderboard" / "broken.zip").unlink()
    write_bundle(bundle("mine", 1.0, off_mm=0.25), tmp_path / "results" / "leaderboard" / "mine.zip")
    assert best_known.main() == 0
    shown = here("tasks")
    assert "best error_all_mm@20 0.25: mine (commit cccccccccccc)" in " ".join(shown.stdout.split())
    assert shown.stdout.count("best not known yet") == len(names()) - 1
    content = json.loads(here("tasks", "--json").stdout)
    assert {one["name"]: one["best"] and one["best"]["method"] for one in content["tasks"]} == {
        name: "mine" if name == TASK.name else None for name in names()
    }


def test_what_is_kept_can_be_read_and_is_of_tasks_that_exist():
    kept = best_known.best_known()
    assert set(kept) <= set(names())
    for name, one in kept.items():
        assert one.figure == task(name).scored[0]
