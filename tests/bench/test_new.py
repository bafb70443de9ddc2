"""What `bench new` makes is used as its README and its workflow say: installed, linted, tested, run."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from command_line import refused

from tactsim.bench.cli.app import VERBS, load
from tactsim.bench.new import FILES, KINDS, contents, make
from tactsim.core import InputError

PYTHON = Path(sys.executable).parent
SHORTEST, LONGEST = "q", "a-name-that-is-as-long-as-one-may-be-xyz"


def run(*words, folder, site):
    """Run a command as somebody does who has installed what is in `site`; gives what it prints."""
    program, *rest = map(str, words)
    done = subprocess.run(
        [PYTHON / program, *rest], cwd=folder, text=True, stdin=subprocess.DEVNULL, capture_output=True, timeout=240,
        env=os.environ | {"PYTHONPATH": str(site), "COLUMNS": "120"}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module", params=KINDS)
def made(request, tmp_path_factory):
    """Make a repository `my-KIND` and install it; gives its kind, its folder and where it is installed."""
    kind, site = request.param, tmp_path_factory.mktemp("site")
    folder = make(kind, f"my-{kind}", tmp_path_factory.mktemp("made") / kind)
    # Built from a copy, since setuptools writes beside what it builds.
    copy = tmp_path_factory.mktemp("copy") / kind
    shutil.copytree(folder, copy)
    pip = ["pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target"]
    subprocess.run([sys.executable, "-m", *pip, site, copy], check=True, timeout=120)
    return kind, folder, site


@pytest.fixture
def installed(made, monkeypatch):
    """Let this process find what was installed, for one test."""
    kind, _, site = made
    monkeypatch.syspath_prepend(str(site))
    yield kind
    sys.modules.pop(f"my_{kind}", None)  # it is installed no longer


def steps(folder):
    """List the shell commands of the workflow, job by job."""
    workflow = yaml.safe_load((folder / ".github" / "workflows" / "test.yml").read_text(encoding="utf-8"))
    return [step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step]


@pytest.mark.long
def test_its_tests_pass_and_its_workflow_is_understood(made):
    """Run the tests as the workflow does; `ruff` is run by another test, and `pip` asks a package index."""
    _, folder, site = made
    commands = [step.split() for step in steps(folder)]
    assert {program for program, *_ in commands} == {"python", "ruff", "pytest", "bench"}
    assert ["pytest"] in commands
    run("pytest", "-q", folder=folder, site=site)
    for program, *words in commands:
        if program == "bench":
            load(words[0]).make_context(f"bench {words[0]}", words[1:])
            assert words[0] in VERBS


@pytest.mark.slow
def test_every_command_of_its_workflow_succeeds(made):
    _, folder, site = made
    for program, *words in [step.split() for step in steps(folder)]:
        if program == "bench":
            run(program, *words, folder=folder, site=site)


@pytest.mark.long
def test_an_estimator_runs_by_its_name(installed, here, scan_file):
    if installed == "estimator":
        words = ["--estimator", "my-estimator", "--set", "noise=6", "--trials", "1", "--readings", "2"]
        assert here("run", "--scan", scan_file, *words).returncode == 0


@pytest.mark.long
def test_it_stands_in_the_lists(installed, here):
    kind = installed
    words = {
        "estimator": ["list", "estimators"], "likelihood": ["list", "likelihoods"], "source": ["devices"],
    }[kind]  # fmt: skip
    (line,) = [line for line in here(*words).stdout.splitlines() if f"my-{kind} " in line]
    assert f"from my-{kind}" in line
    refused(here("new", kind, f"my-{kind}"), "there is one of that name already")


@pytest.mark.parametrize("name", [SHORTEST, LONGEST])
@pytest.mark.parametrize("kind", KINDS)
def test_a_repository_of_any_name_is_clean(kind, name, tmp_path):
    """The linter and the formatter are content however long the name is, and nothing of the model's name is left."""
    folder = make(kind, name, tmp_path / name)
    for words in (["check", "--no-cache", "."], ["format", "--no-cache", "--check", "."]):
        run("ruff", *words, folder=folder, site="")
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    assert len(found) == len(FILES[kind])
    for path, file in found.items():
        text = file.read_text(encoding="utf-8")
        for placeholder in ("your-name", "your_name", "YourName", "TACTSIM_VERSION"):
            assert placeholder not in path + text, path


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_readme_names_is_there(kind):
    made = contents(kind, "my-own")
    named = {line.split("`")[1] for line in made["README.md"].splitlines() if line.startswith("| `")}
    assert named
    assert named <= set(made)


def test_the_dependencies_are_named_with_what_this_project_asks_for():
    """A version that the made repository allows and tactsim does not would never be installed."""
    root = Path(__file__).parents[2]
    ours = set(
        tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    )
    for kind in KINDS:
        theirs = tomllib.loads(contents(kind, "my-own")["pyproject.toml"])["project"]
        assert {one for one in theirs["dependencies"] if not one.startswith("tactsim")} <= ours


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("estimater", "x", "did you mean 'estimator'"),
        ("estimator", "nearest", "there is one of that name already"),
        ("task", "own", "a task is one TOML file"),
        ("estimator", "numpy", "a Python package numpy is installed already"),
        ("estimator", "class", "a word of Python"),
    ],
)
def test_a_name_that_cannot_be_used_is_one_line(here, kind, name, said):
    refused(here("new", "--out", "made", "--", kind, name), said)
    assert not Path("made").exists()


def test_a_folder_that_holds_something_is_left_alone(here):
    Path("my-own").mkdir()
    Path("my-own", "kept").write_text("mine")
    refused(here("new", "estimator", "my-own"), "my-own", "holds something already")
    assert [path.name for path in Path().iterdir()] == ["my-own"]
    assert [path.name for path in Path("my-own").iterdir()] == ["kept"]


def test_nothing_is_left_of_a_repository_that_could_not_be_written(tmp_path, monkeypatch):
    """A disk that fills up while the files are written leaves no folder."""
    written = Path.write_text

    def full(path, text, **words):
        if path.name == "README.md":
            raise OSError(28, "No space left on device")
        return written(path, text, **words)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match="No space left"):
        make("estimator", "my-own", tmp_path / "made")
    assert list(tmp_path.iterdir()) == []
