"""What the hash of a result's source depends on."""

import subprocess
import sys
from pathlib import Path

import pytest

import tactsim
from tactsim.core.source_digest import git_commit, source_digest


@pytest.fixture
def digest_of(tmp_path):
    """Hash the source of a module in a process that sees a copy of tactsim and, before it, a plug-in's package."""
    rooms = Path(tactsim.__file__).parent
    copy = tmp_path / "tactsim"
    copy.mkdir()
    for name in ("core", "models"):
        (copy / name).symlink_to((rooms / name).resolve())
    (copy / "__init__.py").write_text("")
    plug_in = tmp_path / "my_touch"
    (plug_in / "inner").mkdir(parents=True)
    for name in ("__init__", "main", "inner/__init__", "inner/deep"):
        (plug_in / f"{name}.py").write_text("VALUE = 1\n")
    code = "import sys; from tactsim.core.source_digest import source_digest; print(source_digest(*sys.argv[1:]))"

    def digest(*modules):
        words = [sys.executable, "-c", code, *modules]
        environment = {"PYTHONPATH": str(tmp_path)}
        done = subprocess.run(
            words, capture_output=True, text=True, check=True, env=environment, cwd=tmp_path
        )
        return done.stdout

    return digest


def test_any_edit_of_the_package_counts_and_undoing_it_too(digest_of, tmp_path):
    before = digest_of()
    assert digest_of() == before
    path = tmp_path / "tactsim" / "__init__.py"
    path.write_text("# a comment\n")
    after = digest_of()
    assert after != before
    path.rename(path.with_name("other.py"))  # the same bytes under another name
    path.write_text("")
    assert digest_of() not in (before, after)
    path.with_name("other.py").unlink()
    assert digest_of() == before


def test_files_of_a_linked_room_count(digest_of, tmp_path):
    before = digest_of()
    (tmp_path / "tactsim" / "models").unlink()
    assert digest_of() != before


def test_a_plug_ins_whole_package_counts_for_what_it_makes(digest_of, tmp_path):
    before, others = digest_of("my_touch.main"), digest_of()
    (tmp_path / "my_touch" / "inner" / "deep.py").write_text("VALUE = 10\n")
    assert digest_of("my_touch.main") != before
    assert digest_of() == others


def test_the_commit_is_that_of_the_checkout():
    def git(*words):
        return subprocess.run(["git", *words], cwd=Path(__file__).parent, capture_output=True, text=True)

    head = git("rev-parse", "HEAD")
    wanted = head.stdout.strip() if head.returncode == 0 else None
    commit = git_commit()
    assert (commit and commit.removesuffix("-changed")) == wanted


def test_a_module_without_a_file_counts_by_its_name():
    assert source_digest("no_such_module_anywhere") != source_digest("nor_this_one")
