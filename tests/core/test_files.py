"""Files that are written whole or not at all, and which folder is the cache."""

import os
import stat
import tempfile
from pathlib import Path

import pytest

from tactsim.core.cache_folder import cache_folder, can_be_written
from tactsim.core.errors import InputError
from tactsim.core.files import KeptBeside, new_folder, replacing, write_text


def test_a_file_is_written_with_its_folders(tmp_path):
    write_text(tmp_path / "a" / "b" / "c.txt", "hello")
    assert (tmp_path / "a" / "b" / "c.txt").read_text() == "hello"


def test_an_interrupt_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as stream:
        stream.write(b"half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_place_that_cannot_be_written_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        write_text(tmp_path / "file" / "below.txt", "x")


def fill(path):
    with new_folder(path) as folder:
        (folder / "a.txt").write_text("a")
        (folder / "inner").mkdir()
        (folder / "inner" / "b.txt").write_text("b")


def names(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


WHOLE = ["a.txt", "inner", "inner/b.txt"]


def test_a_new_folder_is_made_and_an_empty_one_is_taken(tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("new", "below/new", "empty"):
        fill(tmp_path / name)
        assert names(tmp_path / name) == WHOLE
    assert sorted(path.name for path in tmp_path.iterdir()) == ["below", "empty", "new"]


@pytest.mark.parametrize("name", [".", "../here", "link", ""])
def test_the_working_folder_and_a_link_are_filled_where_they_are(tmp_path, monkeypatch, name):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    monkeypatch.chdir(here)
    if name == "link":
        (tmp_path / "link").symlink_to(there)
        name, here = tmp_path / "link", there
    before = here.stat().st_ino
    fill(name)
    assert names(here) == WHOLE
    assert here.stat().st_ino == before
    assert (tmp_path / "link").is_symlink() or here != there


@pytest.mark.parametrize("name", [".", "out"])
def test_what_fails_while_a_folder_is_filled_leaves_nothing(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyboardInterrupt), new_folder(name) as folder:
        (folder / "a.txt").write_text("a")
        raise KeyboardInterrupt
    assert names(tmp_path) == []


@pytest.mark.parametrize("what", ["folder", "file"])
def test_a_folder_whose_name_is_taken_meanwhile_is_kept_beside_it(tmp_path, what):
    out = tmp_path / "out"
    (tmp_path / "out-2").mkdir()
    with (
        pytest.raises(KeptBeside, match=r"out was taken meanwhile; the results are in .*out-3") as caught,
        new_folder(out) as folder,
    ):
        (folder / "a.txt").write_text("a")
        if what == "folder":
            out.mkdir()
        (out / "other" if what == "folder" else out).write_text("another's")
    assert caught.value.place == tmp_path / "out-3"
    assert names(tmp_path / "out-3") == ["a.txt"]
    assert (out / "other" if what == "folder" else out).read_text() == "another's"


def test_a_working_folder_that_is_taken_meanwhile_keeps_what_it_holds(tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    with pytest.raises(KeptBeside) as caught, new_folder(".") as folder:
        (folder / "a.txt").write_text("a")
        (here / "other").write_text("another's")
    assert names(here) == ["other"]
    assert names(caught.value.place) == ["a.txt"]


def test_a_name_that_is_no_text_is_written_as_an_escape(tmp_path):
    write_text(tmp_path / "page.html", os.fsdecode(b"scan-\xff.npz"))
    assert (tmp_path / "page.html").read_text("utf-8") == "scan-\\udcff.npz"


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
