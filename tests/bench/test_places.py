"""Where results go: a name that no other run takes, and nothing left of a run that came to nothing."""

import os

import pytest

from tactsim.bench.places import RUNS, results_folder, save_beside
from tactsim.core import InputError
from tactsim.core.files import new_folder


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def save(place):
    with new_folder(place) as folder:
        (folder / "run.json").write_text("a run")
    return place


def test_runs_that_begin_together_have_folders_of_their_own(capsys):
    chosen = results_folder(None, "refined")
    assert chosen.parent == RUNS
    first, second = save_beside(save, chosen), save_beside(save, chosen)
    assert first == chosen
    assert second.parent == RUNS
    assert second != chosen
    assert all((place / "run.json").is_file() for place in (first, second))
    assert str(second) in capsys.readouterr().err.replace("\n", "")


def test_nothing_is_made_before_there_are_results(tmp_path):
    results_folder(None, "refined")
    assert results_folder(tmp_path / "here", "refined") == tmp_path / "here"
    assert not any(tmp_path.iterdir())


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"):
        results_folder(None, "refined")


def test_a_file_in_the_way_is_refused_before_the_work(tmp_path):
    (tmp_path / "results").write_text("")
    with pytest.raises(InputError, match=r"results is a file|no folder"):
        results_folder(None, "refined")
