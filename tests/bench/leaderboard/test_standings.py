"""Who stands where: which bundles are ranked on which task, by which figures, and why others are not."""

import csv
import shlex
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from best_known_results import main
from command_line import refused
from entered import changed, entered, make_bundle, record_of

from tactsim.bench import leaderboard as best_known
from tactsim.bench.config import RunConfig
from tactsim.bench.intervals import wilson
from tactsim.bench.leaderboard import standings
from tactsim.bench.leaderboard.bundle import write_bundle
from tactsim.bench.leaderboard.ranking import rank_words
from tactsim.bench.leaderboard.site import command, write_site
from tactsim.bench.leaderboard.standings import OTHER_TRIALS, read_folder
from tactsim.bench.plane import Plane
from tactsim.bench.results import save
from tactsim.bench.runs.pooled import cell
from tactsim.bench.tasks import task
from tactsim.bench.trials import OneTrial, generator
from tactsim.core import Pad, Scan

TASK = "active-v1"


@pytest.fixture(scope="module")
def made():
    """Four methods on one task: two alike, one better, one worse."""
    return {
        "best": entered("best", TASK, skill=2.5, mm=0.1),
        "twin": entered("twin", TASK, skill=1.5, mm=1.0),
        "other twin": entered("other twin", TASK, skill=1.5, mm=1.0),
        "worst": entered("worst", TASK, skill=0.7, mm=6.0),
    }


def folder_of(folder, bundles):
    for name, bundle in bundles.items():
        write_bundle(bundle, folder / f"{name}.tar.xz")
    return read_folder(folder)


def test_methods_that_differ_have_ranks_and_those_that_do_not_share_them(made, tmp_path):
    (of,) = folder_of(tmp_path, made).standings
    assert of.known == task(TASK)
    assert of.by == "error_all_mm@10"
    assert [one.rank for one in of.ranked] == [(1, 1), (2, 3), (2, 3), (4, 4)]
    values = [one.figure(of.by).value for one in of.ranked]
    assert values == sorted(values)


def test_figures_are_those_of_the_trials(made, tmp_path):
    (of,) = folder_of(tmp_path, {"twin": made["twin"]}).standings
    (one,) = of.ranked
    assert one.rank == (1, 1)
    each = [run.summary for run in made["twin"].runs]  # as many trials each
    assert one.figure("accuracy@5").value == pytest.approx(np.mean([run["accuracy"][4] for run in each]))
    assert one.figure("error_all_mm@10").value == pytest.approx(
        np.mean([run["error_all_mm"][9] for run in each])
    )
    for name in ("accuracy@5", "error_mm@10", "error_all_mm@10"):
        figure = one.figure(name)
        assert figure.low < figure.value < figure.high
    # 1 to 2 ms each of ten readings of 250 trials
    assert 1.4 < one.ms_per_reading < 1.6


def test_the_interval_of_a_perfect_accuracy_still_allows_a_mistake(tmp_path):
    (of,) = folder_of(tmp_path, {"sure": entered("sure", TASK, skill=20)}).standings
    found = of.ranked[0].figure("accuracy@10")
    assert (found.value, found.high) == (1, 1)
    assert found.low == pytest.approx(float(wilson(250, 250)[0]))


def test_mcnemar_and_the_bootstrap_pair_the_same_trials_whatever_their_order(made, tmp_path):
    def turned(run):
        back = {one.name: getattr(run.trials, one.name)[::-1] for one in fields(run.trials)}
        return replace(run, trials=replace(run.trials, **back))

    twin = changed(made["twin"], method="turned", runs=tuple(map(turned, made["twin"].runs)))
    (of,) = folder_of(tmp_path, {"twin": made["twin"], "turned": twin}).standings
    assert of.ranking.accuracies.wins.tolist() == [[0, 0], [0, 0]]
    assert of.ranking.errors.difference[0, 1] == 0
    assert [one.rank for one in of.ranked] == [(1, 2), (1, 2)]


def test_bundles_with_other_trials_have_no_score(made, tmp_path):
    fewer = changed(made["twin"], method="fewer", runs=made["twin"].runs[:4])
    moved = made["twin"].runs[0]
    moved = replace(moved, trials=replace(moved.trials, true_pose=moved.trials.true_pose + 0.1))
    moved = changed(made["twin"], method="moved", runs=(moved, *made["twin"].runs[1:]))
    (of,) = folder_of(tmp_path, {"fewer": fewer, "moved": moved, **made}).standings
    assert [(one.label, one.status, one.rank) for one in of.unranked] == [
        ("fewer", OTHER_TRIALS, None),
        ("moved", OTHER_TRIALS, None),
    ]
    assert len(of.ranked) == 4


def test_a_method_that_places_nothing_has_no_rank_among_errors(tmp_path):
    ranked = {name: entered(name, "letters-offgrid-v1", mm=mm) for name, mm in (("near", 0.1), ("far", 6.0))}
    memory = entered("memory", "letters-offgrid-v1")
    runs = [
        replace(run, trials=replace(run.trials, pose=np.zeros_like(run.trials.pose))) for run in memory.runs
    ]
    memory = changed(memory, runs=tuple(runs))
    (alone,) = folder_of(tmp_path, {"memory": memory}).standings
    assert "accuracy@5" in alone.columns
    assert not [name for name in alone.columns if "error" in name]
    found = folder_of(tmp_path, {**ranked, "memory": memory})
    (of,) = found.standings
    assert [(one.label, one.rank) for one in of.ranked] == [
        ("near", (1, 1)),
        ("far", (2, 2)),
        ("memory", None),
    ]
    assert rank_words(of.ranked[-1].rank) == cell(of.ranked[-1].pooled, of.by).replace("-", "–") == "–"
    write_site(found, tmp_path / "site")
    lines = (tmp_path / "site" / "figures.csv").read_text(encoding="utf-8").splitlines()
    by_name = {row["figure"]: row for row in csv.DictReader(lines) if row["method"] == "memory"}
    assert by_name["accuracy@5"]["value"]
    assert not by_name[of.by]["value"]
    assert not by_name[of.by]["rank_best"]


@pytest.mark.parametrize("poses", ["unknown", "one"])
def test_trials_on_a_recording_are_hidden_as_its_pad_and_poses_say(tmp_path, poses):
    pad = Pad(rows=14, columns=6, pitch_x=3.4, pitch_y=3.4, seam=None, unread_columns=0)
    meta = {"pad": pad.model_dump(), "poses": poses}
    scan = Scan(np.zeros((1, 84)), np.zeros((1, 3)), ["a"], ["test"], pad.taxel_xy, meta)
    bundle = entered("best", "schunk5-v1")

    def recorded(run):
        hidden = np.array(
            [Plane().hide(scan, generator(run.seed, OneTrial(*of), 0)) for of in run.trials.ids]
        )
        trials = replace(run.trials, true_pose=np.repeat(hidden[:, None], run.readings, axis=1))
        return replace(run, trials=trials, about=run.about | {"scan": meta})

    bundle = changed(bundle, runs=tuple(map(recorded, bundle.runs)))
    (of,) = folder_of(tmp_path, {"best": bundle}).standings
    assert [one.label for one in of.ranked] == ["best"]


def test_other_data_and_tasks_of_other_versions_are_kept_apart(made, tmp_path):
    old = entered("old", TASK, task_data="d" * 64)
    unknown = changed(old, method="unknown", task="letters-v99")
    lost = entered("lost", TASK, task="letters-v98", status="crashed")
    found = folder_of(tmp_path, {"best": made["best"], "old": old, "unknown": unknown, "lost": lost})
    assert [(of.task, of.known is not None, len(of.ranked)) for of in found.standings] == [
        (TASK, True, 1), (TASK, False, 1), ("letters-v98", False, 0), ("letters-v99", False, 1),
    ]  # fmt: skip
    assert all(one.rank == (1, 1) for of in found.standings for one in of.ranked)


def test_a_method_that_is_there_twice_is_told_by_its_files(made, tmp_path):
    (of,) = folder_of(tmp_path, {"a": made["best"], "b": made["best"], "c": made["worst"]}).standings
    assert [one.label for one in of.ranked] == ["best (a.tar.xz)", "best (b.tar.xz)", "worst"]
    assert [one.rank for one in of.ranked] == [(1, 2), (1, 2), (3, 3)]


def test_what_cannot_be_read_is_said_and_the_rest_is_ranked(made, tmp_path, monkeypatch):
    (tmp_path / "cut.tar.xz").write_bytes(b"PK")
    (tmp_path / "older.zip").write_bytes(b"PK")
    monkeypatch.setattr(standings, "MOST_TRIALS", 249)
    odd, no_pad = make_bundle(), {"scan": {"pad": {"rows": 0}}}
    odd = changed(odd, runs=tuple(replace(run, about=run.about | no_pad) for run in odd.runs))
    found = folder_of(tmp_path, {"best": made["best"], "odd": odd, "small": make_bundle()})
    assert [path.name for path, _ in found.unreadable] == [
        "best.tar.xz", "cut.tar.xz", "odd.tar.xz", "older.zip",
    ]  # fmt: skip
    assert found.unreadable[0][1] == "250 trials; a leaderboard takes 249"
    assert found.unreadable[3][1].startswith("it is of an earlier version")
    assert found.unreadable[2][1] == "pad: rows: give a number of at least 1, got 0"
    assert [one.status for one in found.entrants] == [OTHER_TRIALS]


def test_a_check_beside_a_bundle_counts_and_one_that_failed_takes_the_score(made, tmp_path):
    for name in ("best", "worst"):
        write_bundle(made[name], tmp_path / f"{name}.tar.xz")
    record_of(tmp_path / "best.tar.xz")
    record_of(tmp_path / "worst.tar.xz", verified=False, said="trial 3 of A differs")
    (of,) = folder_of(tmp_path, {"twin": made["twin"]}).standings
    assert {one.label: one.confirmed for one in of.ranked} == {"best": True, "twin": False}
    assert [(one.label, one.status) for one in of.unranked] == [
        ("worst", "not confirmed: trial 3 of A differs")
    ]


def test_the_check_of_another_file_does_not_count(made, tmp_path):
    place = tmp_path / "best.tar.xz"
    write_bundle(made["best"], place)
    said = record_of(place)
    write_bundle(made["worst"], place)
    found = read_folder(tmp_path)
    assert [path for path, _ in found.unreadable] == [said]
    assert found.standings[0].ranked[0].check is None


def test_the_command_of_a_method_survives_a_shell(made, tmp_path):
    options = {"bins": 100, "dead": [1, 2], "name": "a b'; rm -rf ~", "none": None, "on": True}
    hostile = entered("$(rm -rf ~)", TASK, status="crashed", options=options, reproducible=False)
    ((one,), *_) = [of.unranked for of in folder_of(tmp_path, {"a b": hostile}).standings]
    assert shlex.split(command(one)) == [
        "bench", "submit", TASK, "--estimator", "histogram", "--title", "$(rm -rf ~)", "--set", "bins=100",
        "--set", "dead=[1, 2]", "--set", "name=a b'; rm -rf ~", "--set", "none=none", "--set", "on=true",
        "--not-reproducible", "--out", "a b.tar.xz",
    ]  # fmt: skip


def test_a_task_says_which_of_its_figures_ranks(tmp_path):
    # open-set-v1 ranks by accuracy; among equals the error decides the order, not the rank. Only of known letters is
    # there an error.
    sure = {name: entered(name, "open-set-v1", skill=20, mm=mm) for name, mm in (("b", 1), ("a", 2))}
    poor = {"poor": entered("poor", "open-set-v1", skill=0.3, mm=1)}
    (of,) = folder_of(tmp_path, sure | poor).standings
    assert (of.by, of.ranking.accuracy_by, of.ranking.error_by) == (
        "accuracy@15",
        "accuracy@15",
        "error_all_mm@15",
    )
    assert [(one.label, one.rank) for one in of.ranked] == [("b", (1, 2)), ("a", (1, 2)), ("poor", (3, 3))]
    accuracy = [one.figure("accuracy@15").value for one in of.ranked]
    assert accuracy[:2] == [1, 1]
    assert of.ranking.accuracies.wins[2, 1] == 0
    assert of.ranking.accuracies.wins[1, 2] == round((1 - accuracy[2]) * of.trials)
    assert of.ranking.errors.p[0, 1] < 0.05
    each = [run.summary["error_all_mm"][14] for run in sure["b"].runs]
    assert of.ranked[0].figure("error_all_mm@15").value == pytest.approx(np.mean(each))


@pytest.mark.long
def test_every_bundle_that_is_kept_has_a_score():
    """Also of a task whose pad is not the paper's: objects are hidden in a range that grows with the pad."""
    kept = read_folder(Path(__file__).parents[3] / "results" / "leaderboard")
    assert not kept.unreadable
    assert [one.label for of in kept.standings for one in of.unranked] == []


def test_runs_on_the_same_trials_are_ranked_by_bench_table_as_bundles_are(made, tmp_path, here):
    for name in ("best", "twin", "worst"):
        for run in made[name].runs:
            config = run.config | {"bins": {"best": 1, "twin": 2, "worst": 3}[name]}
            budget = {"option": "bins", "value": config["bins"]}
            (tmp_path / f"{name}-{run.seed}").mkdir()
            save(
                replace(run, config=config, about=run.about | {"budget": budget}),
                tmp_path / f"{name}-{run.seed}",
            )
    (of,) = folder_of(tmp_path, {name: made[name] for name in ("best", "twin", "worst")}).standings
    folders = [str(path) for path in sorted(tmp_path.iterdir()) if path.is_dir()]
    done = here("table", *folders, "--rank", "error_all_mm@10", "--figure", "error_all_mm@10")
    assert done.returncode == 0, done.stderr
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines()[2:]]
    assert [row[0] for row in rows] == [rank_words(one.rank) for one in of.ranked]
    assert [row[-1].split()[0] for row in rows] == [cell(one.pooled, of.by).split()[0] for one in of.ranked]
    refused(here("table", *folders, "--rank", "settled_95"), "ranked by accuracy@N")


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
