"""Where results go: a name that no other run takes, and nothing left of a run that came to nothing."""

import os

import pytest

from tactsim.bench.places import RUNS, results_folder
from tactsim.core import InputError
from tactsim.core.files import new_folder


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_runs_that_begin_together_have_folders_of_their_own():
    with results_folder(None, "refined") as first, results_folder(None, "refined") as second:
        assert first != second
        for place in (first, second):
            with new_folder(place) as folder:
                (folder / "run.json").write_text(place.name)
    assert [(place / "run.json").read_text() for place in (first, second)] == [first.name, second.name]
    assert {first.parent, second.parent} == {RUNS}


def test_nothing_is_left_of_a_run_that_failed():
    with pytest.raises(KeyboardInterrupt), results_folder(None, "refined"):
        assert any(RUNS.iterdir())
        raise KeyboardInterrupt
    assert not RUNS.parent.exists()


def test_a_folder_that_was_named_is_not_made_before_it_is_filled(tmp_path):
    with results_folder(tmp_path / "here", "refined") as folder:
        assert folder == tmp_path / "here"
        assert not folder.exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"), results_folder(None, "refined"):
        pass


def test_a_file_in_the_way_is_refused_before_the_work(tmp_path):
    (tmp_path / "results").write_text("")
    with pytest.raises(InputError, match=r"results is a file|no folder"), results_folder(None, "refined"):
        pass
