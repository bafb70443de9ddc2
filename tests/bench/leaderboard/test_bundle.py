"""The one file of a method and task: it travels to the bit, and what is damaged or hostile is refused in one line."""

import io
import json
import lzma
import tarfile
import zipfile
from dataclasses import fields, replace

import numpy as np
import pytest
from entered import make_bundle
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_up import make_run

from tactsim.bench.leaderboard.bundle import kept, read_bundle, rounded, write_bundle
from tactsim.bench.runs.saved import load
from tactsim.bench.score import Scored, summarise
from tactsim.bench.trials import Trials
from tactsim.core import InputError


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    path = tmp_path_factory.mktemp("bundle") / "good.tar.xz"
    write_bundle(make_bundle(), path)
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_bundle(path)
    why = str(caught.value)
    assert why.startswith(f"bundle {path}: ")
    assert "\n" not in why
    assert "/tmp" not in why.removeprefix(f"bundle {path}"), "names no file that is gone"
    return why


def same(one, other):
    return all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in ((getattr(one, field.name), getattr(other, field.name)) for field in fields(Trials))
    )


def test_what_is_written_is_read_to_the_bit(good):
    bundle, again = make_bundle(), read_bundle(good)
    assert again.model_dump() == bundle.model_dump()
    assert same(again.pooled.trials, bundle.pooled.trials)
    for run, other in zip(bundle.runs, again.runs, strict=True):
        assert (run.config, run.about, run.objects, run.work, run.times) == (
            other.config, other.about, other.objects, other.work, other.times,
        )  # fmt: skip
    assert again.pooled.ids == [
        (seed, letter, n) for seed in (0, 1) for letter, n in (("A", 0), ("E", 0), ("A", 1))
    ]


def test_an_estimator_that_does_not_say_how_sure_it_is_and_known_bounds_travel_too(tmp_path):
    run = make_run()
    unsure = np.full((3, 4), np.nan)
    run = replace(
        run, trials=replace(run.trials, credibility=unsure, radius_90=unsure), bounds=np.full((3, 4), 0.3)
    )
    write_bundle(make_bundle((0,)).model_copy(update={"runs": kept([run])}), tmp_path / "a.tar.xz")
    again = read_bundle(tmp_path / "a.tar.xz")
    assert np.isnan(again.pooled.trials.credibility).all()
    assert np.isnan(again.pooled.trials.radius_90).all()
    assert again.pooled.scored.bounds == pytest.approx(0.3, rel=0.005)


def test_rounding_changes_no_figure_that_a_table_shows():
    run = make_run(r=12)
    exact, small = (summarise(Scored(of, run.objects)) for of in (run.trials, rounded(run.trials)))
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


def test_a_method_without_a_score_has_a_status_and_no_runs(tmp_path):
    write_bundle(make_bundle(seeds=(), status="crashed: ValueError"), tmp_path / "a.tar.xz")
    bundle = read_bundle(tmp_path / "a.tar.xz")
    assert bundle.runs == ()
    with pytest.raises(InputError, match="has no score on letters-offgrid-v1: crashed: ValueError"):
        _ = bundle.pooled


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"status": "crashed"}, "only a method that was done has runs"),
        ({"estimator": "particle"}, "seed 0 is a run of 'histogram', not of particle"),
        ({"method": "two\nlines"}, "cannot be printed"),
    ],
)
def test_what_would_be_refused_is_not_written(changes, why, tmp_path):
    with pytest.raises(InputError, match=why):
        write_bundle(make_bundle(**changes), tmp_path / "bad.tar.xz")
    assert not list(tmp_path.iterdir())


def edited(good, path, change):
    """Write the members of a good bundle again, changed: a dict of bytes, or of TarInfo for what is no file."""
    with tarfile.open(good) as archive:
        members = {info.name: archive.extractfile(info).read() for info in archive}
    change(members)
    with tarfile.open(path, "w:xz") as archive:
        for name, content in members.items():
            info = content if isinstance(content, tarfile.TarInfo) else tarfile.TarInfo(name)
            if isinstance(content, bytes):
                info.size = len(content)
            archive.addfile(info, io.BytesIO(content) if isinstance(content, bytes) else None)
    return path


def link(name, to):
    info = tarfile.TarInfo(name)
    info.type, info.linkname = tarfile.SYMTYPE, to
    return info


def said(name, **changes):
    def edit(members):
        members[name] = json.dumps(json.loads(members[name]) | changes).encode()

    return edit


def column(name, change):
    """Change a column of the trials of seed 1."""

    def edit(members):
        with np.load(io.BytesIO(members["seed-1/trials.npz"])) as npz:
            columns = dict(npz)
        columns[name] = change(columns[name])
        packed = io.BytesIO()
        np.savez(packed, **{key: values for key, values in columns.items() if values is not None})
        members["seed-1/trials.npz"] = packed.getvalue()

    return edit


DAMAGES = {
    "no head": (lambda members: members.pop("bundle.json"), "bundle.json: missing are task"),
    "a field more": (said("bundle.json", fields=1), "fields"),
    "a run of another": (said("bundle.json", estimator="nearest"), "seed 0 is a run of 'histogram', not of nearest"),
    "no run": (said("bundle.json", status="crashed"), "only a method that was done has runs"),
    "a run without objects": (said("seed-1/run.json", objects={}), "seed-1 is not a whole run: run.json: objects"),
    "another schema": (said("seed-1/run.json", schema=99), "unknown schema"),
    "another file": (lambda members: members.update({"seed-1/readme.txt": b"hello"}), "is no file of a bundle"),
    "a path": (lambda members: members.update({"../../seed-1/run.json": b"{}"}), "is no file of a bundle"),
    "a link": (lambda members: members.update({"seed-2/run.json": link("seed-2/run.json", "/etc/passwd")}),
               "is no file of a bundle"),
    "no column": (column("theta", lambda values: None), "it has no array 'theta'"),
    "a row less": (column("x", lambda values: values[1:]), "seed-1 is not a whole run"),
    "an object": (column("x", lambda values: values.astype(object)), "holds Python objects"),
    "infinity": (column("p_truth", lambda values: values + np.inf), "the column p_truth"),
    "hostile label": (column("label", lambda values: np.full(values.shape, "\x1b[2J")), "not printable"),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGES)
def test_a_damaged_or_hostile_bundle_is_refused_in_one_line(kind, good, tmp_path):
    damage, why = DAMAGES[kind]
    assert why in refusal(edited(good, tmp_path / "bad.tar.xz", damage))


def test_any_byte_that_flips_is_refused_or_changes_nothing(good, tmp_path):
    content, path = good.read_bytes(), tmp_path / "bad.tar.xz"
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(content), 12):
        path.write_bytes(
            content[:place] + bytes([content[place] ^ 1 << int(rng.integers(8))]) + content[place + 1 :]
        )
        try:
            again = read_bundle(path)
        except InputError:
            refusal(path)
        else:
            assert same(again.pooled.trials, make_bundle().pooled.trials)
    path.write_bytes(content[:-100])
    assert "it is cut short" in refusal(path)


def test_an_archive_in_which_too_much_is_packed_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("tactsim.bench.leaderboard.bundle.LARGEST", 1 << 22)
    with lzma.open(tmp_path / "bomb.tar.xz", "w", preset=0) as stream:
        for _ in range(5):
            stream.write(bytes(1 << 20))
    assert "more than 4,194,304 bytes are packed in it" in refusal(tmp_path / "bomb.tar.xz")


def test_a_bundle_of_an_earlier_version_is_refused_in_one_line(tmp_path):
    with zipfile.ZipFile(tmp_path / "old.zip", "w") as archive:
        archive.writestr("meta.npy", b"")
    assert "it is of an earlier version, which this one does not read" in refusal(tmp_path / "old.zip")


def test_the_folders_in_a_bundle_are_those_of_runs(good, tmp_path):
    with tarfile.open(good) as archive:
        archive.extractall(tmp_path, filter="data")
    run = load(tmp_path / "seed-1")
    assert same(run.trials, make_bundle().runs[1].trials)
    assert run.config["seed"] == 1
