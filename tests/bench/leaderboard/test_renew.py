"""Bundles that are made anew with the code here."""

import shutil
from pathlib import Path

import pytest
from entered import entered
from renew_leaderboard import main, renew, submission

from tactsim.bench.leaderboard.bundle import read_bundle, read_record, write_bundle
from tactsim.bench.leaderboard.standings import read_folder
from tactsim.core import InputError
from tactsim.core.source_digest import git_commit

SHIPPED = Path(__file__).parents[3] / "results" / "leaderboard"


def test_a_bundle_is_submitted_with_the_words_that_made_it():
    bundle = read_bundle(SHIPPED / "open-set-v1--refined-unknown.zip")
    words = "open-set-v1 --estimator refined --set unknown=0.5 --title refined-unknown"
    assert submission(bundle) == words.split()


@pytest.mark.parametrize(
    ("bundle", "said"),
    [
        (None, "holds no bundle"),
        (entered("gone", "active-v1", status="out of memory"), "status out of memory and no runs"),
    ],
)
def test_what_cannot_be_renewed_is_said_and_stays(bundle, said, tmp_path):
    if bundle is not None:
        write_bundle(bundle, tmp_path / "a.zip")
    before = [path.read_bytes() for path in tmp_path.iterdir()]
    with pytest.raises(InputError, match=said):
        renew(tmp_path, tmp_path / "workshop", git_commit())
    assert [path.read_bytes() for path in tmp_path.iterdir()] == before


def test_files_that_no_commit_has_are_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("renew_leaderboard.git_commit", lambda: "a" * 40 + "-changed")
    assert main([str(tmp_path), str(tmp_path / "workshop")]) == 2
    said = "renew: files differ from the last commit, which bundles name; commit them first\n"
    assert capsys.readouterr().err == said


@pytest.mark.long
def test_a_renewed_bundle_is_of_this_commit_checked_and_of_the_same_method(tmp_path):
    path, workshop = tmp_path / "letters-offgrid-v1--nearest.zip", tmp_path / "workshop"
    shutil.copy(SHIPPED / path.name, path)
    before = read_bundle(path)
    workshop.mkdir()
    (workshop / path.name).write_bytes(path.read_bytes())  # of another commit
    assert renew(tmp_path, workshop, git_commit()) == 1
    after, record = read_bundle(path), read_record(path)
    assert (after.task, after.method, after.estimator) == (before.task, before.method, before.estimator)
    assert after.commit == git_commit() != before.commit
    assert (record.verified, record.exact) == (True, True)
    assert {one.name for one in tmp_path.iterdir()} == {path.name, path.stem + ".verified.json"}


def test_every_bundle_that_is_kept_has_a_score():
    """Also of a task whose pad is not the paper's: objects are hidden in a range that grows with the pad."""
    folder = read_folder(SHIPPED)
    assert not folder.unreadable
    assert [one.label for of in folder.standings for one in of.unranked] == []
