"""What a report is made of: which runs belong together, the points, the curves as CSV, the trials again."""

import base64
import csv
import itertools
import json
import math
import re
import zlib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import make_run
from manifold3d import Manifold
from matplotlib.figure import Figure
from small_runs import make_run_in

import tactsim
from tactsim import models
from tactsim.bench import score
from tactsim.bench.config import run_config
from tactsim.bench.placement import Properties, placement_error
from tactsim.bench.report import Sheet
from tactsim.bench.report import recognition as replay
from tactsim.bench.report.curves import (
    axis_of_errors,
    below_bound,
    confusion_counts,
    frontier,
    points,
    reliability,
)
from tactsim.bench.report.page import page
from tactsim.bench.report.picture import _draw_ranks, look, pareto_figure, plots, readings_figure
from tactsim.bench.report.write import find, write_pages, write_report
from tactsim.bench.results import task_name
from tactsim.bench.runs.paper import in_figure
from tactsim.bench.runs.pooled import budget, collect, figure_of, method_name, pool
from tactsim.bench.runs.saved import load
from tactsim.bench.score import LEAST_ERROR, recognition_seconds
from tactsim.bench.terminal import headline
from tactsim.bench.trials import OneTrial, Trials
from tactsim.core import Pad, invert
from tactsim.core.errors import InputError
from tactsim.core.pad import offsets
from tactsim.estimators import Estimate, create
from tactsim.estimators.estimator import PoseSamples, about_estimator


def loaded(places):
    return [(place, load(place)) for place in places]


@pytest.fixture(scope="module")
def report(runs, tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "report.html"
    written, remarks = write_report([runs.small, runs.large, runs.off_grid], out)
    assert remarks == []
    assert all(path.is_file() for path in written)
    return out


def data_in(text):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


def data_of(path):
    return data_in(path.read_text(encoding="utf-8"))


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


FOREIGN = {
    "report.html": "<title>My notes</title>",
    "readings.csv": "time,kPa\n0,1\n",
    "pareto.svg": "<svg/>",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_report_replaces_nothing_that_is_of_no_report(runs, tmp_path, name):
    (tmp_path / name).write_text(FOREIGN[name])
    with pytest.raises(InputError, match=f"{name}.* is (of )?no report") as caught:
        write_report([runs.small, runs.large], tmp_path / "report.html")
    assert "\n" not in str(caught.value)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, FOREIGN[name])]


def test_a_report_replaces_an_older_one_and_the_same_runs_give_the_same_bytes(runs, tmp_path):
    out = tmp_path / "r.html"
    written, _ = write_report([runs.small], out)
    before = [path.read_bytes() for path in written]
    assert write_report([runs.small], out)[0] == written
    assert [path.read_bytes() for path in written] == before


def test_the_page_names_no_other_place(report):
    text = report.read_text(encoding="utf-8")
    text = re.sub(r'<script type="text/plain" id="arrays">.*?</script>', "", text, flags=re.S)
    assert set(re.findall(r"\w+://[^\"'\s)]*", text)) == {
        "http://www.w3.org/1999/xhtml",
        "http://www.w3.org/2000/svg",
    }
    assert not re.search(r"<(?:link|script|img|iframe)[^>]+(?:src|href)=\"(?!data:)", text)


def test_two_protocols_share_no_section(report):
    data = data_of(report)
    labels = [[run["folder"] for task in of["tasks"] for run in task["runs"]] for of in data["protocols"]]
    assert [len(one) for one in labels] == [2, 1]
    assert [of["name"].split(",")[0] for of in data["protocols"]] == ["test poses same", "test poses random"]
    for name in ("readings", "pareto", "confusion"):
        for row in rows_of(report.with_name(f"{name}.csv")):
            assert ("off-grid" in row["folder"]) == ("random," in row["protocol"])


def test_curves_are_those_of_the_summary(runs, report):
    for place in (runs.small, runs.large):
        summary = load(place).summary
        rows = [row for row in rows_of(report.with_name("readings.csv")) if row["folder"] == str(place)]
        assert [int(row["reading"]) for row in rows] == [*range(1, 9)]
        for name in (
            "accuracy",
            "accuracy_low",
            "accuracy_high",
            "error_mm",
            "error_all_mm",
            "rank_p",
            "nees",
        ):
            wanted = ["" if value is None else repr(value) for value in summary[name]]
            assert [row[name] for row in rows] == wanted
    drawn = {run["folder"]: run for task in data_of(report)["protocols"][0]["tasks"] for run in task["runs"]}
    assert drawn[str(runs.small)]["figures"]["accuracy"][0] == pytest.approx(
        load(runs.small).summary["accuracy"], rel=1e-5
    )


def test_ranks_are_drawn_beside_the_band_that_the_test_of_them_asks_for(runs):
    whole = load(runs.large)
    found = whole.trials.credibility[whole.trials.sure[:, -1], -1]
    narrow = replace(whole, trials=replace(whole.trials, credibility=whole.trials.credibility**0.05))
    for one in (whole, narrow):
        (group,) = collect([(runs.large, one)])
        axes = Figure().subplots()
        _draw_ranks(axes, group)
        x, away = axes.lines[0].get_data()
        low, high = axes.patches[0].get_y(), axes.patches[0].get_y() + axes.patches[0].get_height()
        assert (np.abs(away).max() > high) == (one.summary["rank_p"][-1] < 0.05)
        assert low == -high
        assert len(x) == 2 * len(found) + 2
        assert (away[0], away[-1]) == (0, 0)
    assert one.summary["rank_p"][-1] < 0.05


def test_the_reliability_diagram_counts_every_estimate(runs):
    trials = load(runs.small).trials
    bins = reliability(trials)
    assert sum(one.count for one in bins) == trials.label.size
    assert sum(one.count * one.right for one in bins) == pytest.approx(trials.right.sum())
    assert sum(one.count * one.probability for one in bins) == pytest.approx(trials.p_label.sum())
    sure = reliability(replace(trials, p_label=np.where(trials.right, 1.0, 0.05)))
    assert [(one.probability, one.right) for one in sure] == [(pytest.approx(0.05), 0), (1, 1)]


def test_the_ellipse_is_about_where_the_letters_centre_truly_lies():
    of, rng = Properties(1, (1.0, 2.0), 60.0), np.random.default_rng(0)
    true_pose = np.array([3.0, -2.0, 0.7])
    placed = invert(true_pose) + rng.normal(size=(20_000, 3)) * [0.3, 0.1, 0]
    samples = PoseSamples(invert(placed), np.full(len(placed), 1 / len(placed)))
    ((x, y, long, short, turn),) = replay.regions(
        [Estimate("A", {"A": 1.0}, true_pose, samples)], true_pose[None], of
    )
    assert (x, y) == pytest.approx(of.centre, abs=0.01)  # in the object's own frame
    assert (long, short) == pytest.approx((0.3 * 2.146, 0.1 * 2.146), rel=0.03)
    assert math.sin(turn - true_pose[2]) == pytest.approx(0, abs=0.02)


def test_confusion_counts_every_trial_at_every_reading(runs, report):
    rows = [row for row in rows_of(report.with_name("confusion.csv")) if row["folder"] == str(runs.small)]
    run = load(runs.small)
    for k in range(run.trials.label.shape[1]):
        counted = {(r["truth"], r["label"]): int(r["trials"]) for r in rows if int(r["reading"]) == k + 1}
        pairs = list(zip(run.trials.truth.tolist(), run.trials.label[:, k].tolist(), strict=True))
        assert counted == {pair: pairs.count(pair) for pair in set(pairs)}


def test_time_is_the_median_trials_whole_sequence():
    trials = make_run(n=3, r=4).trials
    spent = sum(getattr(trials, name)[:, :2].sum(axis=1) for name in ("update_s", "estimate_s", "propose_s"))
    assert recognition_seconds(trials, 2) == pytest.approx(sorted(spent)[1])


losses = st.one_of(st.none(), st.integers(0, 6).map(float))


@given(st.lists(st.tuples(st.integers(0, 6).map(float), losses), max_size=12))
def test_the_frontier_is_what_nothing_dominates(pairs):
    costs, values = [cost for cost, _ in pairs], [value for _, value in pairs]
    on = frontier(costs, values)
    pairs = [(cost, math.inf if value is None else value) for cost, value in pairs]
    for one, value, flag in zip(pairs, values, on, strict=True):
        better = [other for other in pairs if other != one and all(np.less_equal(other, one))]
        assert flag == (value is not None and not better)
    if any(value is not None for value in values):
        assert any(on)


def test_points_are_taken_at_the_readings_that_all_runs_have(runs, tmp_path, changed):
    run = load(runs.large)
    wide = [name for name, values in vars(run.trials).items() if values.shape[1:2] == (8,)]
    short = {name: getattr(run.trials, name)[:, :5] for name in wide}
    folder = changed(runs.large, **short)
    (group,) = collect(loaded([runs.small, folder]))
    assert group.readings == 5
    by_folder = {point.entry.folder: point for point in points(group)}
    point = by_folder[runs.small]
    assert point.error == load(runs.small).summary["error_mm"][4]
    assert point.low < point.error < point.high
    assert point.settled == score.settled_by(load(runs.small).trials.right[:, :5], 0.95)


TASKS = {
    "defaults": {},
    "letters A-Z0-9": {"letters": "A-Z0-9"},
    "sensor.noise 4.0": {"noise": 4.0},
    "shapes relief: cone.stl, dome.stl": {
        "letters": "none",
        "shapes": ["relief/cone.stl", "relief/dome.stl"],
    },
    "paper-like, press.force 5.0": {"world": "paper-like", "scan_set": {"press": {"force": 5}}},
}


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_named_by_what_differs_from_the_defaults(name):
    run = make_run()
    config = run_config(**TASKS[name], trials=7, readings=9, test_poses="random", bins=100)
    run.config.update(config.model_dump(mode="json"))
    run.about["scan"] = {"options": config.scan_options.model_dump(mode="json")}
    assert task_name(run) == name


def test_a_task_on_readings_of_its_own_is_named_by_them():
    run = make_run()
    run.config.update(scan="pad.npz", train_scan="sim.npz", letters=["A", "E"], seed=3)
    assert task_name(run) == "seed 3, scan pad.npz, train_scan sim.npz, letters AE"
    run.config.update(scan=None, train_scan=None, given="0123456789abcdef", seed=0)
    assert task_name(run) == "readings 0123456789ab"


METHODS = {
    "histogram": ({}, ("bins", "10,000", 10_000)),
    "histogram, gamma 0.3": ({"bins": "3", "gamma": "0.3", "likelihood": "paper"}, ("bins", "3", 3)),
    "refined": ({"split": "4x5x6"}, ("split", "4x5x6", 120)),
}


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_its_options_without_budget_and_defaults(name):
    options, said = METHODS[name]
    estimator = create(name.partition(",")[0], **options)
    run = make_run()
    run.config["estimator"] = name.partition(",")[0]
    run.about.update(about_estimator(estimator))
    assert (method_name(run), budget(run)) == (name, said)


def test_runs_of_one_label_are_told_apart_by_their_folder(runs, copied):
    (group,) = collect(loaded([runs.small, copied(runs.small, "again")]))
    assert [entry.label for entry in group.entries] == [
        "histogram, 100 bins (small)",
        "histogram, 100 bins (again)",
    ]


def sweep_folder(tmp_path, copied, places, asked):
    for name, place in places.items():
        copied(place, f"sweep/runs/{name}")
    (tmp_path / "sweep" / "sweep.json").write_text(
        json.dumps({"schema": 1, "runs": [{"name": n} for n in asked]})
    )
    return tmp_path / "sweep"


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """Three runs that differ in the seed alone."""
    folder = tmp_path_factory.mktemp("seeds")
    return [
        make_run_in(folder / str(seed), bins=1000, letters="AE", seed=seed, trials=2, readings=5)
        for seed in range(3)
    ]


def test_seeds_are_pooled_as_the_table_pools_them_and_apart_on_request(seeds, tmp_path, undrawn):
    write_report(seeds, tmp_path / "pooled.html")
    (protocol,) = data_of(tmp_path / "pooled.html")["protocols"]
    (task,) = protocol["tasks"]
    (run,) = task["runs"]
    assert (run["scans"], run["trials"]) == (3, 12)
    (one,) = pool(load(seed) for seed in seeds)
    for name in ("accuracy", "error_mm"):
        found = figure_of(one, f"{name}@5")
        shown = [part[4] for part in run["figures"][name]]
        assert shown == pytest.approx([found.value, found.low, found.high], rel=1e-5)
    rows = rows_of(tmp_path / "pooled-readings.csv")
    assert {(row["seed"], row["estimator"], row["budget"]) for row in rows} == {
        ("0 1 2", "histogram", "1000")
    }


def test_what_the_paper_prints_stands_beside_runs_of_its_filter_and_protocol():
    run = make_run()
    run.about.update(letters=list("AEIOU"), budget={"option": "bins", "value": 1000})
    assert (in_figure(run).readings, in_figure(run).share) == (46, 1.0)
    other = {"letters": ["A"], "protocol": "test poses random", "budget": {"option": "bins", "value": 7}}
    for name, value in other.items():
        assert in_figure(replace(run, about=run.about | {name: value})) is None


def with_budgets(slowness):
    """Make up runs of one method: of each budget, how many times as slow and, a little, how much nearer it is."""
    for amount, times in slowness.items():
        run = make_run(r=60)
        run.about.update(letters=list("AEIOU"), budget={"option": "bins", "value": amount})
        slower = {name: getattr(run.trials, name) * times for name in ("update_s", "estimate_s", "propose_s")}
        nearer = run.trials.true_pose + (run.trials.pose - run.trials.true_pose) * (1 - times / 1000)
        yield Path(str(amount)), replace(run, trials=replace(run.trials, pose=nearer, **slower))


def test_the_papers_figures_look_different_and_their_legend_lies_on_no_curve():
    (group,) = collect(list(with_budgets({1_000: 1, 10_000: 2})))
    figure = readings_figure(group)
    stars = [line.get_markerfacecolor() for line in figure.axes[0].lines if line.get_marker() == "*"]
    assert len(stars) == len(set(stars)) == 2
    assert "the paper: 1.3 mm (10,000 bins)" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert figure.axes[1].get_legend() is None


@pytest.mark.parametrize(
    ("width", "panel", "axes"),
    [(3.4, "error", 1), (3.4, "accuracy", 1), (3.4, None, 2), (7.16, "accuracy", 1)],
)
def test_a_figure_for_a_column_has_its_width_and_type(width, panel, axes):
    (group,) = collect(list(with_budgets({1_000: 1, 10_000: 2})))
    figure = readings_figure(group, Sheet(width, panel, caption=False))
    figure.canvas.draw()
    assert figure.get_figwidth() == width
    assert len(figure.axes) == axes
    assert {text.get_fontsize() for one in figure.axes for text in (one.yaxis.label, one.xaxis.label)} == {8}
    (legend,) = figure.legends
    assert legend.get_window_extent().width <= width * figure.dpi
    assert figure.get_supxlabel() == ""
    labels = [one.get_ylabel() for one in figure.axes]
    assert ("placement error, mm" in labels) == (panel != "accuracy")


def test_budgets_beside_crowded_marks_do_not_overlap():
    (group,) = collect(list(with_budgets({300: 1, 5_000: 1.35, 30_000: 4, 100_000: 4.5, 500_000: 100})))
    figure = pareto_figure(group)
    figure.canvas.draw()
    for axes in figure.axes:
        boxes = [text.get_window_extent() for text in axes.texts]
        assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    assert figure.axes[0].texts


def test_a_method_that_copies_a_pose_collapses_no_axis_and_is_noted(tmp_path):
    place = make_run_in(
        tmp_path / "copies", estimator="nearest", test_poses="same", letters="AE", trials=1, readings=40
    )
    (group,) = collect(loaded([place]))
    low, high = axis_of_errors(group)
    assert group.entries[0].summary["error_mm"][-1] < 1e-9
    assert low == LEAST_ERROR
    assert high < 100
    (note,) = below_bound(group)
    assert note.startswith("nearest errs less than 0.01 mm from reading ")
    assert "at the poses of its training readings" in note
    axes = readings_figure(group).axes[1]
    assert axes.get_ylim() == pytest.approx((low, high))
    assert min(axes.lines[0].get_ydata()) == low


def test_a_sweeps_runs_come_in_its_own_order(runs, copied, tmp_path):
    place = sweep_folder(tmp_path, copied, {"a": runs.large, "b": runs.small}, ["b", "a"])
    (place / "runs" / ".c.part").mkdir()  # a run that is being written
    folders, remarks = find([place, place / "runs" / "a"])
    assert [folder.name for folder in folders] == ["b", "a"]
    assert remarks == []


def test_a_sweep_that_has_not_ended_is_said(runs, copied, tmp_path, undrawn):
    place = sweep_folder(tmp_path, copied, {"a": runs.small}, ["b", "a"])
    written, remarks = write_report([place], place / "report.html")
    assert remarks == [f"{place} has not ended: 1 of its 2 runs are there"]
    assert data_of(written[0])["remarks"] == remarks


def test_a_folder_of_runs_is_taken_whole(runs):
    assert {folder.name for folder in find([runs.small.parent])[0]} == {"small", "large", "off-grid"}


def test_a_foreign_folder_among_a_sweeps_runs_is_named(runs, copied, tmp_path):
    place = sweep_folder(tmp_path, copied, {"a": runs.small}, ["a"])
    (place / "runs" / "notes").mkdir()
    with pytest.raises(InputError, match="notes"):
        write_report([place], tmp_path / "r.html")


def test_a_trial_done_again_is_the_recorded_one(runs):
    groups = collect(loaded([runs.small, runs.large]))
    replayed, failed = replay.replay_all(groups, {})
    assert not failed
    (one,) = replayed
    assert one.entry.folder == runs.large  # of a method, the largest budget
    run = one.entry.run
    for trial in one.recognitions:
        row = [i for i, key in enumerate(zip(run.trials.truth, run.trials.trial, strict=True))
               if key == (trial.task.truth, trial.task.trial)]  # fmt: skip
        assert trial.same
        assert np.array_equal(trial.robot_in_object, run.trials.pose[row[0]])
        assert np.array_equal(trial.error, score.errors(run.trials, run.objects)[row[0]])
        assert trial.probabilities.sum(axis=1) == pytest.approx(1)
        assert trial.probabilities.max(axis=1) == pytest.approx(run.trials.p_label[row[0]])


def test_labels_that_an_estimate_leaves_out_have_no_probability(runs, monkeypatch):
    run_trial = replay.run_trial

    def sure(*of, observe, **how):
        def keep(estimate, touch):
            observe(replace(estimate, probabilities={estimate.label: 1.0}), touch)

        return run_trial(*of, observe=keep, **how)

    monkeypatch.setattr(replay, "run_trial", sure)
    (one,), _ = replay.replay_all(collect(loaded([runs.large])), {})
    assert any(len(trial.labels) > 1 for trial in one.recognitions)
    assert all((trial.probabilities.sum(axis=1) == 1).all() for trial in one.recognitions)


def test_where_the_estimate_is_drawn_has_the_placement_error(runs):
    (one,), _ = replay.replay_all(collect(loaded([runs.large])), {})
    trial = one.recognitions[0]
    assert placement_error(
        np.zeros(3), trial.estimate_in_object, one.entry.run.objects[trial.task.truth]
    ) == pytest.approx(trial.error, abs=1e-9)


def test_a_trial_that_comes_out_differently_is_marked(runs, changed):
    run = load(runs.large)
    pose = run.trials.pose + 0.5
    (one,), _ = replay.replay_all(collect(loaded([changed(runs.large, pose=pose)])), {})
    assert not any(trial.same for trial in one.recognitions)


def test_typical_and_hardest_are_the_median_and_the_last_to_settle(runs, changed):
    run = load(runs.small)
    n, r = run.trials.label.shape
    right = np.arange(r)[None, :] >= np.arange(n)[:, None] % 7
    right[5, :-1] = False
    label = np.where(right, run.trials.truth[:, None], "?")
    (group,) = collect(loaded([changed(runs.small, label=label)]))
    tasks = replay.trials_to_show([entry.run.trials for entry in group.entries])
    assert tasks["hardest"] == OneTrial(run.trials.truth[5], run.trials.trial[5])
    settled = score.settled_at(right)
    typical = tasks["typical"]
    row = [(t, k) for t, k in zip(run.trials.truth, run.trials.trial, strict=True)].index(
        (typical.truth, typical.trial)
    )
    assert settled[row] == np.sort(settled)[(n - 1) // 2]


def test_a_report_without_its_readings_says_so_and_shows_the_rest(hostile_run, copied, tmp_path, undrawn):
    folder = copied(hostile_run)
    content = json.loads((folder / "run.json").read_text())
    content["config"]["scan"] = str(tmp_path / "gone.npz")
    (folder / "run.json").write_text(json.dumps(content))
    written, remarks = write_report([folder], tmp_path / "r.html")
    assert len([remark for remark in remarks if "gone.npz" in remark]) == 1
    assert data_of(written[0])["protocols"][0]["recognitions"] == []


@pytest.mark.long
def test_an_object_that_was_not_trained_is_said_to_be_explained_badly(tmp_path, undrawn):
    words = {"letters": ["A", "E", "U"], "estimator": "refined", "trials": 1, "readings": 10}
    known, unknown = tactsim.run(**words), tactsim.run(**words, hold_out=["A", "E"])
    assert known.badly_explained is None
    share = unknown.work["badly_explained"] / 30
    assert unknown.badly_explained.startswith(f"{share:.0%} of the readings are explained worse")
    assert unknown.badly_explained in headline(unknown)
    _, remarks = write_pages([(tmp_path / "unknown", unknown)], tmp_path / "report.html")
    assert any(unknown.badly_explained in remark for remark in remarks)


def test_a_method_that_was_written_in_a_notebook_is_in_the_legend(runs):
    run = load(runs.small)
    run = replace(run, config=run.config | {"estimator": "__main__:Mine"})
    (group,) = collect([(runs.small, run)])
    (legend,) = readings_figure(group).legends
    assert [text.get_text().strip() for text in legend.get_texts()] == [group.entries[0].label]
    assert group.entries[0].label.startswith("__main__:Mine")


def test_names_cannot_end_the_data(hostile_run, tmp_path):
    written, _ = write_report([hostile_run], tmp_path / "r.html")
    text = written[0].read_text(encoding="utf-8")
    assert len(re.findall("<script", text)) == 3
    assert "<iframe" not in text
    assert "<img" not in text
    run = data_of(written[0])["protocols"][0]["tasks"][0]["runs"][0]
    assert run["description"].startswith("</script><script>")
    assert "<script>" in run["letters"][0]


@pytest.mark.long
def test_counts_of_very_many_trials_are_shown_as_they_are():
    run = make_run(n=1, r=1)
    arrays = {field.name: getattr(run.trials, field.name) for field in fields(run.trials)}
    many = Trials(**{name: np.repeat(values, 70_000, axis=0) for name, values in arrays.items()})
    many.trial[:] = np.arange(70_000)
    many.label[:] = "E"  # no right one: no intervals of errors, which take long
    text = page(collect([(Path("run"), replace(run, trials=many))]), [], [])
    place = data_in(text)["protocols"][0]["tasks"][0]["runs"][0]["confusion"]["counts"]
    content = zlib.decompress(base64.b64decode(re.search(r'id="arrays">(.*?)</script>', text, re.S)[1]))
    counts = np.frombuffer(content, f"<{place['kind']}", math.prod(place["shape"]), place["at"])
    assert counts.max() == 70_000


@pytest.mark.long
def test_a_letter_held_out_is_right_when_it_is_refused(open_set_run):
    groups = collect(loaded([open_set_run]))
    (entry,) = groups[0].entries
    labels, counts = confusion_counts(entry)
    assert labels == ["A", "E", "U", "none"]
    assert counts.sum() == entry.run.trials.label.size
    (replayed,), _ = replay.replay_all(groups, {})
    answers = {(trial.task.truth, trial.answer) for trial in replayed.recognitions}
    assert answers <= {("A", "A"), ("E", "E"), ("U", "none")}
    assert all(trial.same for trial in replayed.recognitions)


def test_many_methods_all_look_different():
    assert len(set(map(look, range(128)))) == 128


def test_a_plot_on_the_page_has_no_colours_style_or_names_of_its_own(runs):
    (group,) = collect(loaded([runs.small, runs.large]))
    drawn = plots(group, "plots-0") | plots(group, "plots-1")
    for svg in drawn.values():
        assert svg.count("<svg") == 1
        assert not re.search(r"#[0-9a-f]{6}|style|<script|<!--", svg)
        assert set(re.findall(r'class="([\w-]+)"', svg)) <= {"plot", "note", "run-0", "run-1"}
        named = re.findall(r' id="(\w+)"', svg)
        assert set(re.findall(r"(?<!&)#(\w+)", svg)) <= set(named)
        assert sum(f' id="{name}"' in other for name in named for other in drawn.values()) == len(named)
    assert plots(group, "plots-0") == {name: svg for name, svg in drawn.items() if name.startswith("plots-0")}


WORDS = {"estimator": "histogram", "bins": 100, "trials": 1, "readings": 3}


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    """Write a bar and a plate as files."""
    folder = tmp_path_factory.mktemp("shapes")
    for name, size in (("bar", (22, 7, 4)), ("plate", (15, 12, 4))):
        models.export(models.relief(name, Manifold.cube(size, True)), folder / f"{name}.stl")
    return [folder / "bar.stl", folder / "plate.stl"]


def test_shapes_beside_letters_that_are_named_are_tried(shapes):
    assert tactsim.run(letters="A", shapes=shapes, **WORDS).letters == ["A", "bar", "plate"]


def test_shapes_are_pressed_without_a_letter_and_known_when_recorded(shapes, tmp_path):
    scan = tactsim.scan(letters="none", shapes=shapes)
    assert scan.letters == ("bar", "plate")
    scan.save(tmp_path / "pressed.npz")
    replace(scan, meta={}).where("test").save(tmp_path / "recorded.npz")
    files = {"scan": tmp_path / "recorded.npz", "train_scan": tmp_path / "pressed.npz"}
    run = tactsim.run(**files, **WORDS)
    assert run.letters == ["bar", "plate"]
    assert run.objects["bar"].symmetry == 2
    assert tactsim.run(**files, letters="plate", **WORDS).letters == ["plate"]
    with pytest.raises(tactsim.InputError, match="unknown letter of the scan 'bolt'"):
        tactsim.run(**files, letters="plate,bolt", **WORDS)


def test_a_file_s_label_goes_before_the_letters_that_it_spells(shapes, tmp_path):
    scan = tactsim.scan("AT")
    labels = np.array([{"A": "A", "T": "AT"}[label] for label in scan.labels.tolist()])
    path = tmp_path / "labels.npz"
    replace(scan, labels=labels, meta={}).save(path)
    assert tactsim.run(scan=path, letters="AT", **WORDS).letters == ["AT"]
    assert tactsim.run(scan=path, letters="AT,A", **WORDS).letters == ["AT", "A"]
    scan.save(tmp_path / "letters.npz")
    assert tactsim.run(scan=tmp_path / "letters.npz", letters="TA", **WORDS).letters == ["T", "A"]


def test_a_pad_and_shapes_twice_as_large_are_pressed_and_hidden_twice_as_far(shapes, tmp_path):
    pad = Pad(pitch_x=3.8, pitch_y=3.8, taxel_width=3.6, taxel_height=3.6, seam=0.8)
    models.export(models.relief("bar", Manifold.cube((44, 14, 8), True)), tmp_path / "bar.stl")
    firm = {"press.force": 8.0, "press.wrist_stiffness": 2400.0}
    large = tactsim.scan(
        letters="none", shapes=tmp_path / "bar.stl", scan_set={"pad": pad.model_dump(), **firm}
    )
    small = tactsim.scan(letters="none", shapes=shapes[0])
    assert large.where("train").poses[:, :2] == pytest.approx(2 * small.where("train").poses[:, :2])
    assert large.where("test").poses[:, :2] == pytest.approx(2 * small.where("test").poses[:, :2])
    assert offsets(pad.taxel_xy) == pytest.approx(20.0)
    hidden = [tactsim.run(scan, **WORDS).trials.true_pose[..., :2] for scan in (small, large)]
    assert hidden[1] == pytest.approx(2 * hidden[0])
