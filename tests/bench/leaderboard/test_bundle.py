"""The one file of a method and task: it travels to the bit, and what is damaged or hostile is refused in one line."""

import hashlib
import json
import zipfile
from dataclasses import fields, replace

import numpy as np
import pytest
from bundles import make_bundle, members_of, zipped

from tactsim.bench.leaderboard.bundle import read_bundle, write_bundle
from tactsim.bench.trials import Trials
from tactsim.core import InputError


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    path = tmp_path_factory.mktemp("bundle") / "good.zip"
    write_bundle(make_bundle(), path)
    return path


def sealed(members):
    """Give the members' checksums anew, as an editor with some patience would."""
    head = json.loads(members["bundle.json"])
    head["files"] = {
        name: hashlib.sha256(content).hexdigest()
        for name, content in members.items()
        if name != "bundle.json"
    }
    return members | {"bundle.json": json.dumps(head).encode()}


def refusal(path, content):
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_bundle(path)
    said = str(caught.value)
    assert said.startswith(f"bundle {path}: ")
    assert "\n" not in said
    assert "/tmp" not in said.removeprefix(f"bundle {path}"), "names no file that is gone"
    return said


def test_what_is_written_is_read_to_the_bit(good):
    bundle, again = make_bundle(), read_bundle(good)
    for field in fields(bundle):
        if field.name != "runs":
            assert getattr(again, field.name) == getattr(bundle, field.name)
    for field in fields(Trials):
        assert np.array_equal(getattr(again.trials, field.name), getattr(bundle.trials, field.name))
    assert again.ids == [(seed, letter, n) for seed in (0, 1) for letter, n in (("A", 0), ("E", 0), ("A", 1))]
    assert again.pooled.label == "histogram, 10,000 bins"
    assert len(again.pooled.trials.truth) == len(again.ids)


def test_the_same_content_gives_the_same_bytes_but_for_when_it_was_made(good, tmp_path):
    write_bundle(make_bundle(), tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == good.read_bytes()
    write_bundle(make_bundle(made="later"), tmp_path / "later.zip")
    first, later = members_of(good), members_of(tmp_path / "later.zip")
    assert [name for name in first if first[name] != later[name]] == ["bundle.json"]


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
        ({"seeds": ()}, "only a method that was done has runs"),
        ({"estimator": "particle"}, "seed-0 is a run of 'histogram', not of particle"),
        ({"method": "two\nlines"}, "cannot be printed"),
        ({"task_data": "short"}, "task_data"),
    ],
)
def test_what_would_be_refused_is_not_written(changes, said, tmp_path):
    with pytest.raises(InputError, match=said):
        write_bundle(make_bundle(**changes), tmp_path / "bad.zip")
    assert not list(tmp_path.iterdir())


def edited(name, change):
    def edit(members):
        return members | {name: change(members[name])}

    return edit


def head(**changes):
    return edited("bundle.json", lambda content: json.dumps(json.loads(content) | changes).encode())


def with_a_right_answer_more(table):
    """Give the first wrong row the label of the truth."""
    header, *rows = table.decode().splitlines()
    cells = [row.split(",") for row in rows]
    wrong = next(row for row in cells if row[0] != row[4])
    wrong[4] = wrong[0]
    return "\n".join([header, *map(",".join, cells), ""]).encode()


DAMAGES = {
    "rows": (edited("seed-1/trials.csv", with_a_right_answer_more), "edited: seed-1/trials.csv"),
    "rows, sealed": (
        lambda members: sealed(edited("seed-1/trials.csv", with_a_right_answer_more)(members)),
        "seed-1: it was edited|it was edited: summary.json",
    ),
    "summary, sealed": (
        lambda members: sealed(edited("seed-0/summary.json", lambda c: c.replace(b"0.", b"1.", 1))(members)),
        "summary.json is not what the rows",
    ),
    "no head": (lambda members: {k: v for k, v in members.items() if k != "bundle.json"}, "it has no bundle.json"),
    "no summary": (
        lambda members: sealed({k: v for k, v in members.items() if k != "seed-0/summary.json"}),
        "summary.json is missing",
    ),
    "no run": (lambda members: {k: v for k, v in members.items() if not k.startswith("seed-1/")}, "missing"),
    "one more": (lambda members: members | {"seed-2/run.json": b"{}"}, "not one of its files"),
    "stranger": (lambda members: members | {"readme.txt": b""}, "'readme.txt' is no file of a bundle"),
    "climbing": (lambda members: members | {"../seed-0/run.json": b""}, "is no file of a bundle"),
    "schema": (head(schema=2), "schema 2; this version of tactsim reads schema 1"),
    "status": (head(status="crashed: x"), "only a method that was done has runs"),
    "unknown entry": (head(score=1.0), "unknown option"),
    "options": (head(options=[1]), "options"),
    "boolean": (head(reproducible=1), "reproducible"),
    "other seed": (
        lambda members: sealed({k.replace("seed-1/", "seed-7/"): v for k, v in members.items()}), "its seed is 1",
    ),
    "no JSON": (lambda members: members | {"bundle.json": b"["}, "not whole JSON"),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGES)
def test_a_damaged_bundle_is_refused_in_one_line(kind, good, tmp_path):
    damage, said = DAMAGES[kind]
    assert any(
        part in refusal(tmp_path / "bad.zip", zipped(damage(members_of(good)))) for part in said.split("|")
    )


def test_a_truncated_bundle_is_refused_wherever_it_ends(good, tmp_path):
    content = good.read_bytes()
    for end in range(0, len(content), len(content) // 25):
        assert "it is cut short, damaged or no bundle" in refusal(tmp_path / "cut.zip", content[:end])


def test_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"bundle nowhere\.zip: No such file"):
        read_bundle("nowhere.zip")
    with pytest.raises(InputError, match="not a regular file"):
        read_bundle(tmp_path)


def test_a_bundle_that_claims_too_much_is_refused_before_it_is_unpacked(good, tmp_path):
    path = tmp_path / "bomb.zip"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("seed-0/trials.csv", "w") as member,
    ):
        for _ in range(300):
            member.write(bytes(1 << 20))
    assert "claims 314,572,800 bytes" in refusal(path, path.read_bytes())
    rows = members_of(good)["seed-0/trials.csv"] + b"\n" * 500_001
    assert "more than 500,000 rows" in refusal(path, zipped(members_of(good) | {"seed-0/trials.csv": rows}))
    twice = tmp_path / "twice.zip"
    with zipfile.ZipFile(twice, "w") as archive:
        archive.writestr("bundle.json", members_of(good)["bundle.json"])
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("bundle.json", members_of(good)["bundle.json"])
    assert "bundle.json is there twice" in refusal(twice, twice.read_bytes())


def test_runs_of_two_kinds_are_no_bundle(tmp_path):
    one, other = make_bundle().runs
    shorter = replace(other, trials=type(other.trials)(**{
        field.name: getattr(other.trials, field.name)[:, :2] if getattr(other.trials, field.name).ndim > 1
        else getattr(other.trials, field.name) for field in fields(Trials)
    }))  # fmt: skip
    with pytest.raises(InputError, match="different numbers of readings"):
        write_bundle(replace(make_bundle(), runs=(one, shorter)), tmp_path / "a.zip")
