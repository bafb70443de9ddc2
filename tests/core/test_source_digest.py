"""What the hash of a result's source depends on: edits in a copy of the package."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tactsim
from tactsim.core.source_digest import git_commit, short_commit, source_digest, source_of

PRESS = "tactsim.press.engine"
TRIALS = ("tactsim.bench.trial_workers", "tactsim.estimators.filters.histogram")
# file, what is replaced by what; whether the press's source is another then, and that of trials.
EDITS = {
    "comment": ("tactsim/press/clip.py", "\nimport", "\n# a comment\n\n\nimport", False, False),
    "docstring": ("tactsim/press/clip.py", '"""', '"""Other words: ', False, False),
    "layout": ("tactsim/press/clip.py", "return ", "return  ", False, False),
    "formula": ("tactsim/press/clip.py", " - ", " + ", True, False),
    "formula of core": ("tactsim/core/poses.py", "np.cos", "np.sin", True, True),
    "a check of core": ("tactsim/core/finite.py", "1e9", "1e8", True, True),
    "model": ("models/convex.py", "1e-", "2e-", True, False),
    "filter": ("estimators/filters/histogram.py", "10_000", "10_001", False, True),
    "another filter": ("estimators/filters/tempered.py", "0.5", "0.6", False, False),
    "imported within a function": ("estimators/registry.py", "GROUP = ", "GROUP = 1 and ", False, True),
    "a likelihood that an option names": ("estimators/likelihoods/force.py", "0.01", "0.02", False, True),
    "report": ("bench/report/page.py", "9)", "8)", False, False),
    "command line": ("bench/cli/cmd_run.py", "jobs: ", "jobs_: ", False, False),
}


@pytest.fixture(scope="module")
def digests(tmp_path_factory):
    """Give both digests in a copy of the package, as it is and after each edit: {edit: [press, trials]}."""
    copy = tmp_path_factory.mktemp("copy")
    home = Path(tactsim.__file__).parents[1]
    for name in ("tactsim", "models", "estimators", "hardware", "bench"):
        shutil.copytree(home / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    script = f"""
import json, sys
from pathlib import Path
sys.path.insert(0, {str(copy)!r})
from tactsim.core import source_digest
assert source_digest.__file__.startswith({str(copy)!r})
def both():
    return [source_digest.source_digest({PRESS!r}), source_digest.source_digest(*{TRIALS!r})]
found = {{"as it is": both()}}
for name, (path, old, new, *_) in json.loads({json.dumps(EDITS)!r}).items():
    file = Path({str(copy)!r}) / path
    text = file.read_text()
    assert old in text, name
    file.write_text(text.replace(old, new, 1))
    found[name] = both()
    file.write_text(text)
print(json.dumps(found))
"""
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_counts_where_it_can_change_a_result(digests, edit):
    *_, press, trials = EDITS[edit]
    before, after = digests["as it is"], digests[edit]
    assert [after[0] != before[0], after[1] != before[1]] == [press, trials]


def test_the_press_does_not_depend_on_estimators_or_the_harness():
    reached = source_of(PRESS)
    assert {"tactsim.press.clip", "tactsim.models.letter", "tactsim.core.poses"} <= set(reached)
    assert not [name for name in reached if name.split(".")[1] in ("bench", "estimators", "hardware")]
    assert "tactsim.press.scanning" not in reached


def test_a_plug_ins_own_package_counts_whole(tmp_path, monkeypatch):
    package = tmp_path / "my_touch"
    (package / "inner").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "inner" / "__init__.py").write_text("from .deep import VALUE as PASSED_ON\n")
    (package / "inner" / "deep.py").write_text("VALUE = 1\n")
    (package / "beside.py").write_text("def used(): return 2\n")
    (package / "unused.py").write_text("VALUE = 3\n")
    (package / "main.py").write_text(
        "import numpy\nfrom .inner import PASSED_ON\n"
        "def call():\n    try:\n        from my_touch import beside\n    finally:\n        pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert set(source_of("my_touch.main")) == {"my_touch.main", "my_touch.inner.deep", "my_touch.beside"}
    before = source_digest("my_touch.main")
    (package / "unused.py").write_text("VALUE = 4\n")
    assert source_digest("my_touch.main") == before
    (package / "inner" / "deep.py").write_text("VALUE = 10\n")
    assert source_digest("my_touch.main") != before


def test_a_module_without_a_file_counts_by_its_name():
    assert source_of("no_such_module_anywhere") == {"no_such_module_anywhere": ""}
    assert source_digest("no_such_module_anywhere") != source_digest("nor_this_one")


def test_the_commit_is_that_of_the_checkout():
    def git(*words):
        return subprocess.run(["git", *words], cwd=Path(__file__).parent, capture_output=True, text=True)

    head = git("rev-parse", "HEAD")
    wanted = head.stdout.strip() if head.returncode == 0 else None
    commit = git_commit()
    assert (commit and commit.removesuffix("-changed")) == wanted


def test_what_was_found_in_files_is_kept_by_their_content(own_cache, tmp_path, monkeypatch):
    script = """
import ast, sys
from tactsim.core import source_digest
parsed, parse = [], ast.parse
ast.parse = lambda *given: parsed.append(1) or parse(*given)
print(source_digest.source_digest("tactsim.press.engine"), len(parsed))
"""

    def found():
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        digest, count = done.stdout.split()
        return digest, int(count)

    first, count = found()
    assert count > 10
    assert found() == (first, 0)
    kept = own_cache / "sources"
    kept.write_bytes(kept.read_bytes()[:-20])  # cut short, as by a full disk
    assert found() == (first, count)
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(kept / "below a file"))
    assert found() == (first, count)


def test_a_page_shows_a_commit_in_twelve_digits_or_that_it_is_unknown():
    assert short_commit("0123456789abcdef-changed") == "0123456789ab"
    assert short_commit(None) == "unknown"
