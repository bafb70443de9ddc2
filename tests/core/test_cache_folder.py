"""Which folder is the cache: the one named, the user's, or a temporary one that is nobody else's."""

import stat
import tempfile
from pathlib import Path

import pytest

from tactsim.core.cache_folder import cache_folder, can_be_written


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    """Leave no folder for the user's cache, and `tmp_path / "temporary"` for temporary files."""
    (tmp_path / "home").write_text("a file\n")
    (tmp_path / "temporary").mkdir()
    monkeypatch.delenv("TACTSIM_CACHE_DIR")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "temporary"


def test_the_folder_that_is_named_is_taken_though_it_is_not_there(monkeypatch):
    monkeypatch.setenv("TACTSIM_CACHE_DIR", "/nowhere/at/all")
    assert cache_folder() == Path("/nowhere/at/all")


def test_the_users_folder_is_taken_if_it_can_be_made(tmp_path, nowhere, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "not" / "yet"))
    assert cache_folder() == tmp_path / "not" / "yet" / "tactsim"


def test_else_a_temporary_one_that_only_this_user_may_use(nowhere):
    folder = cache_folder()
    assert folder.parent == nowhere
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert cache_folder() == folder


@pytest.mark.parametrize("foreign", ["open to others", "link", "file"])
def test_a_temporary_one_that_others_may_have_filled_is_left_alone(nowhere, foreign):
    mine = cache_folder()
    if foreign == "open to others":
        mine.chmod(0o777)
    else:
        mine.rmdir()
        mine.write_text("") if foreign == "file" else mine.symlink_to(nowhere)
    assert not can_be_written(cache_folder())
