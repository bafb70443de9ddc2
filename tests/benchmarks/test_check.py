"""The check of speed: a planted slow-down and a planted error are found, unchanged code is not called slower."""

import subprocess

import check
import pytest

# A clock that counts work instead of time.
BENCHMARKS = """
import pytest
from thing import ERROR, SECONDS

passed = 0.0

def clock():
    global passed
    passed += 1e-9
    return passed

def work(seconds):
    global passed
    passed += seconds

pytestmark = [pytest.mark.benchmark(timer=clock)]

@pytest.mark.parametrize("name", list(SECONDS))
def test_work(benchmark, name):
    benchmark.pedantic(work, (SECONDS[name],), rounds=2)
    benchmark.extra_info |= {"error_mm": ERROR[name], "machine": "any"}
"""
THING = {"quick": (0.004, 0.5), "long": (3.0, 2.0)}  # {benchmark: (seconds, error)}


def write_thing(root, changes):
    thing = THING | changes
    seconds, error = ({name: values[k] for name, values in thing.items()} for k in (0, 1))
    (root / "thing.py").write_text(f"SECONDS = {seconds}\nERROR = {error}\n")


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project with benchmarks in one commit."""
    root = tmp_path / "project"
    (root / "tests/benchmarks").mkdir(parents=True)
    (root / check.BENCHMARKS).write_text(BENCHMARKS)
    (root / "pytest.ini").write_text("[pytest]\n")
    write_thing(root, {})
    identity = ["-c", "user.name=x", "-c", "user.email=x@y", "-c", "commit.gpgsign=false"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "x"]):
        subprocess.run(["git", *identity, *words], cwd=root, check=True)
    monkeypatch.setattr(check, "ROOT", root)
    monkeypatch.setattr(check, "TREES", tmp_path / "trees")
    # Python takes a file that is as long as before and of the same second for the same.
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    return root


@pytest.mark.long
def test_what_became_worse_is_said(project, capsys, monkeypatch):
    monkeypatch.setattr(check, "MOST", 3)
    write_thing(project, {"quick": (0.0051, 0.5), "long": (3.4, 2.0 + 1e-6), "another": (1.0, 1.0)})
    assert check.main(["HEAD"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        " 1.27  test_work[quick]", " 1.13  test_work[long]", "  new  test_work[another]",
        "slower   test_work[quick]: 1.27 times", "changed  test_work[long] error_mm: 2 -> 2.000001",
    ]  # fmt: skip


@pytest.mark.long
def test_a_benchmark_that_fails_is_said(project, capsys):
    (project / "thing.py").write_text("SECONDS = {'quick': 0.1}\nERROR = {}\n")
    with pytest.raises(SystemExit, match="2"):
        check.main(["HEAD"])
    assert "KeyError" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("new", "said"),
    [({"a": (1.2, {"error_mm": 2.0})}, []), ({"a": (1.0, {"error_mm": 2.0 + 1e-10}), "b": (1.0, {})}, []),
     ({"a": (1.0, {"error_mm": 2.0 - 1e-6})}, ["changed  a error_mm: 2 -> 1.999999"]),
     ({"a": (1.0, {"error_mm": float("nan")})}, ["changed  a error_mm: 2 -> nan"]),
     ({"a": (1.0, {})}, ["changed  a error_mm: 2 -> None"]), ({}, ["gone     a"])],
)  # fmt: skip
def test_figures_are_the_same_within_1e_9(new, said):
    assert check.judge({"a": (1.0, {"error_mm": 2.0})}, new) == said
