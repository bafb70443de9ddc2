"""`make release-check` finds what a release would lack; a repository that is ready has no fault."""

import re
import shutil
import subprocess
import tomllib

import pytest
import yaml
from building import ROOT
from packaging.requirements import Requirement
from release_check import faults

TABLE = "*`bench sweep better`: 5 scans, 500 trials; commit {}.*\n"


def git(root, *words):
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    done = subprocess.run(["git", *identity, *words], cwd=root, text=True, capture_output=True, check=True)
    return done.stdout.strip()


def commit(root):
    git(root, "add", "--all")
    git(root, "commit", "--quiet", "--allow-empty", "--message", "x")
    return git(root, "rev-parse", "--short=12", "HEAD")


@pytest.fixture
def ready(tmp_path):
    """Make a repository with nothing but what is looked at, ready for version 1.2.0."""
    root = tmp_path / "repository"
    (root / "docs").mkdir(parents=True)
    (root / "recipe").mkdir()
    (root / "pyproject.toml").write_text('[project]\nname = "tactsim"\nversion = "1.2.0"\n')
    (root / "CITATION.cff").write_text(
        "cff-version: 1.2.0\nversion: 1.2.0\ndate-released: 2026-01-31\ndoi: 10.5281/zenodo.1\n"
    )
    (root / "recipe" / "recipe.yaml").write_text('context:\n  version: "1.2.0"\n')
    (root / "CHANGELOG.md").write_text("# Changelog\n\n## Unreleased\n\n## 1.2.0 - 2026-01-31\n\n- New.\n")
    git(tmp_path, "init", "--quiet", str(root))
    measured = commit(root)
    (root / "README.md").write_text(TABLE.format(measured))
    (root / "docs" / "results.md").write_text(TABLE.format(measured))
    commit(root)
    return root


def replace(root, name, old, new):
    text = (root / name).read_text(encoding="utf-8")
    assert old in text
    (root / name).write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("pyproject.toml", "1.2.0", "1.3.0", "CITATION.cff: version 1.2.0, and pyproject.toml says 1.3.0"),
        ("CHANGELOG.md", "2026-01-31", "2026-02-01", "date-released"),
        ("CITATION.cff", "doi: 10.5281/zenodo.1\n", "", "no doi"),
        ("README.md", "commit ", "commit 0", "the tables are of several commits"),
    ],
)
def test_a_fault_is_named(ready, name, old, new, said):
    replace(ready, name, old, new)
    commit(ready)
    found = list(faults(ready))
    assert any(said in fault for fault in found), found


def test_what_is_ready_has_no_fault_and_what_is_not_committed_or_tagged_already_is_named(ready):
    git(ready, "tag", "v1.2.0")
    assert list(faults(ready)) == []
    (ready / "docs" / "new.md").write_text("x")
    assert any("docs/new.md and perhaps more is not committed" in fault for fault in faults(ready))
    commit(ready)
    assert list(faults(ready)) == ["the tag v1.2.0 is another commit's: raise the version"]


def test_versions_of_this_repository_agree(tmp_path):
    """It need not be ready for a release, but what is looked at must be found in it."""
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "README.md"):
        shutil.copy2(ROOT / name, tmp_path / name)
    for name in ("recipe", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("_build"))
    assert not [fault for fault in faults(tmp_path) if "pyproject.toml says" in fault]


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
# What conda-forge calls otherwise: MuJoCo's Python package, and Matplotlib without Qt.
CONDA = {"mujoco": "mujoco-python", "matplotlib": "matplotlib-base"}


def test_the_dependencies_are_the_same():
    wanted = {
        (CONDA.get(one.name, one.name), str(one.specifier))
        for one in map(Requirement, PROJECT["dependencies"])
    }
    run = [line for line in RECIPE["requirements"]["run"] if not line.startswith(("python ", "__"))]
    assert {tuple(line.split(" ", 1)) for line in run} == wanted
    assert len(run) == len(wanted)


def test_version_python_commands_and_licence_are_the_same():
    context = RECIPE["context"]
    assert context["version"] == PROJECT["version"]
    assert f">={context['python_min']}" == PROJECT["requires-python"]
    commands = dict(re.split(r"\s*=\s*", line) for line in RECIPE["build"]["python"]["entry_points"])
    assert commands == PROJECT["scripts"]
    assert RECIPE["about"]["license"] == PROJECT["license"]
    assert [RECIPE["about"]["license_file"]] == PROJECT["license-files"]
    assert RECIPE["about"]["summary"] == PROJECT["description"]
