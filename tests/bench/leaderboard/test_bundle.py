"""The one file of a method and task: it travels to the bit, and what is damaged or hostile is refused in one line."""

import json
import zipfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from bundles import make_bundle
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_up import make_run

from tactsim.bench.leaderboard.bundle import digests_of, kept, read_bundle, rounded, write_bundle
from tactsim.bench.score import summarise
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.npz import write_npz

OLD = Path(__file__).with_name("bundle-0.1.zip")  # as version 0.1 wrote `make_bundle()`, with all digits


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    path = tmp_path_factory.mktemp("bundle") / "good.zip"
    write_bundle(make_bundle(), path)
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_bundle(path)
    said = str(caught.value)
    assert said.startswith(f"bundle {path}: ")
    assert "\n" not in said
    assert "/tmp" not in said.removeprefix(f"bundle {path}"), "names no file that is gone"
    return said


def same(one, other):
    return all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in ((getattr(one, field.name), getattr(other, field.name)) for field in fields(Trials))
    )


def test_what_is_written_is_read_to_the_bit(good):
    bundle, again = make_bundle(), read_bundle(good)
    for field in fields(bundle):
        if field.name not in ("runs", "digests"):
            assert getattr(again, field.name) == getattr(bundle, field.name)
    assert same(again.trials, bundle.trials)
    assert np.array_equal(again.digests, bundle.digests)
    for run, other in zip(bundle.runs, again.runs, strict=True):
        assert (run.config, run.about, run.objects, run.work, run.times) == (
            other.config, other.about, other.objects, other.work, other.times,
        )  # fmt: skip
    assert again.ids == [(seed, letter, n) for seed in (0, 1) for letter, n in (("A", 0), ("E", 0), ("A", 1))]


def test_an_estimator_that_does_not_say_how_sure_it_is_and_known_bounds_travel_too(tmp_path):
    run = make_run()
    unsure = np.full((3, 4), np.nan)
    run = replace(
        run, trials=replace(run.trials, credibility=unsure, radius_90=unsure), bounds=np.full((3, 4), 0.3)
    )
    (small,), digests = kept([run])
    write_bundle(replace(make_bundle((0,)), runs=(small,), digests=digests), tmp_path / "a.zip")
    again = read_bundle(tmp_path / "a.zip")
    assert np.isnan(again.trials.credibility).all()
    assert np.isnan(again.trials.radius_90).all()
    assert again.pooled.bounds == pytest.approx(0.3, rel=0.005)


def test_rounding_changes_no_figure_that_a_table_shows():
    run = make_run(r=12)
    exact, small = summarise(run.trials, run.objects), summarise(rounded(run.trials), run.objects)
    for name in ("accuracy", "coverage_50", "coverage_90", "confusion", "settled_95", "all_right_from"):
        assert small[name] == exact[name], name
    assert small["error_all_mm"] == pytest.approx(exact["error_all_mm"], abs=0.005)
    # Of three trials; a table averages hundreds.
    for name, rel in (("negative_log_likelihood", 0.02), ("sharpness_mm", 0.04), ("evaluations", 0.07)):
        assert np.array(small[name], float) == pytest.approx(
            np.array(exact[name], float), rel=rel, nan_ok=True
        ), name
    assert same(rounded(rounded(run.trials)), rounded(run.trials))


@given(arrays(float, 8, elements=st.floats(0, 1)))
def test_a_credibility_stays_on_its_side_of_every_percent(values):
    trials = make_run(n=2).trials
    small = rounded(replace(trials, credibility=values.reshape(2, 4))).credibility.ravel()
    for percent in (10, 50, 90, 95):
        far = np.abs(values - percent / 100) > 1e-9
        assert ((small < percent / 100) == (values < percent / 100))[far].all()


@pytest.mark.parametrize("column", [one.name for one in fields(Trials)])
def test_the_digest_of_a_trial_depends_on_all_its_bits_but_the_times(column):
    trials = make_run().trials
    values = getattr(trials, column).copy()
    if values.dtype.kind == "f":
        values[1] = np.nextafter(values[1], np.inf)
    elif values.dtype.kind == "U":
        values[1] = np.where(values[1] == "E", "A", "E")
    else:
        values[1] = ~values[1]
    changed = digests_of(replace(trials, **{column: values})) != digests_of(trials)
    assert changed.tolist() == [False, not column.endswith("_s"), False]


def test_a_method_without_a_score_has_a_status_and_no_runs(tmp_path):
    write_bundle(make_bundle(seeds=(), status="crashed: ValueError"), tmp_path / "a.zip")
    bundle = read_bundle(tmp_path / "a.zip")
    assert bundle.runs == ()
    for asked in ("trials", "ids", "pooled"):
        with pytest.raises(InputError, match="has no score on letters-offgrid-v1: crashed: ValueError"):
            getattr(bundle, asked)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"status": "crashed"}, "only a method that was done has runs"),
        ({"estimator": "particle"}, "seed 0 is a run of 'histogram', not of particle"),
        ({"method": "two\nlines"}, "cannot be printed"),
    ],
)
def test_what_would_be_refused_is_not_written(changes, said, tmp_path):
    with pytest.raises(InputError, match=said):
        write_bundle(make_bundle(**changes), tmp_path / "bad.zip")
    assert not list(tmp_path.iterdir())


def meta(**changes):
    return lambda content: content["meta"].update(changes)


def array(name, change):
    def edit(content):
        content[name] = change(content[name])

    return edit


DAMAGES = {
    "no schema": (lambda content: content["meta"].pop("schema"), "it is no bundle, which `bench submit` makes"),
    "schema": (meta(schema=3), "schema 3; this version of tactsim reads schema 1 and 2"),
    "no run": (lambda content: content["meta"]["runs"].pop(), "its runs have 3 trials, and there are 6"),
    "a run without objects": (
        lambda content: content["meta"]["runs"][1]["about"].update(objects={}), "run 1: run.json: objects",
    ),
    "no column": (lambda content: content.pop("theta"), "it has no array 'theta'"),
    "a row less": (array("x", lambda x: x[1:]), "x has the shape (5, 4), and label (6, 4)"),
    "hostile label": (array("label", lambda x: np.full(x.shape, "\x1b[2J")), "not printable"),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGES)
def test_a_damaged_bundle_is_refused_in_one_line(kind, good, tmp_path):
    damage, said = DAMAGES[kind]
    with np.load(good) as npz:
        content = dict(npz)
    content["meta"] = json.loads(str(content["meta"]))
    damage(content)
    write_npz(tmp_path / "bad.zip", content.pop("meta"), content)
    assert said in refusal(tmp_path / "bad.zip")


def test_an_archive_that_claims_too_much_is_refused_before_it_is_unpacked(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("bundle.json", "w") as member,
    ):
        for _ in range(300):
            member.write(bytes(1 << 20))
    assert "claims 314,572,800 bytes" in refusal(tmp_path / "bomb.zip")


def test_a_bundle_of_version_0_1_is_read(tmp_path):
    old, bundle = read_bundle(OLD), make_bundle()
    assert (old.task, old.method, old.options, old.ids) == (
        bundle.task,
        bundle.method,
        bundle.options,
        bundle.ids,
    )
    assert same(old.trials, bundle.trials)
    assert np.array_equal(old.digests, bundle.digests), "it has all bits"
    write_bundle(old, tmp_path / "new.zip")
    assert same(read_bundle(tmp_path / "new.zip").trials, old.trials)


def test_an_edited_bundle_of_version_0_1_is_refused_in_one_line(tmp_path):
    with zipfile.ZipFile(OLD) as old, zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        for name in old.namelist():
            archive.writestr(name, b"truth\n" if name == "seed-1/trials.csv" else old.read(name))
    assert "it was edited: seed-1/trials.csv is not what the checksum" in refusal(tmp_path / "bad.zip")
