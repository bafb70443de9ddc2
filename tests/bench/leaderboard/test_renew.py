"""Bundles that are made anew with the code here."""

import shutil
from pathlib import Path

import pytest
from renew_leaderboard import renew, submission

from tactsim.bench.leaderboard.bundle import read_bundle, read_record
from tactsim.bench.leaderboard.standings import read_folder
from tactsim.core.source_digest import git_commit

SHIPPED = Path(__file__).parents[3] / "results" / "leaderboard"


def test_a_bundle_is_submitted_with_the_words_that_made_it():
    bundle = read_bundle(SHIPPED / "open-set-v1--refined-unknown.zip")
    words = "open-set-v1 --estimator refined --set unknown=0.5 --title refined-unknown"
    assert submission(bundle) == words.split()


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
