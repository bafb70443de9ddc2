"""The gate: a planted slow-down and a planted error are caught, and unchanged code is not."""

import json
import os
import runpy
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tactsim.bench import regression, score
from tactsim.bench.regression import Baseline, check, read_baseline, write_baseline
from tactsim.bench.regression_rate import at_most
from tactsim.bench.regression_timing import (
    LEVEL,
    MOST_ROUNDS,
    SHARE_ABOVE,
    SLOWER,
    Measured,
    Side,
    Timing,
    commit_of,
    decide,
    measure,
)
from tactsim.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
COUNT = len(runpy.run_path(str(ROOT / "tests/bench/bench_regression.py"))["BENCHMARKS"])

# Rounds of `make bench-rate` on two cores with eight further processes: of unchanged code the three benchmarks
# that scattered most, and of code with a quarter more calls.
UNCHANGED = {
    "occupancy maps": [1.007, 1.134, 0.983, 0.956, 1.023, 0.939],
    "trial of histogram": [1.069, 1.051, 0.898, 0.907, 0.884, 0.968],
    "trial of refined": [1.004, 0.997, 0.921, 0.98, 1.092, 0.961],
}
SLOWED = {
    "press": [1.265, 1.229, 1.218, 1.259, 1.218, 1.268, 1.211, 1.236, 1.267, 1.334],
    "occupancy maps": [1.294, 1.297, 1.273, 1.321, 1.261, 1.284, 1.279, 1.233, 1.282, 1.273],
    "trial of histogram": [1.213, 1.296, 1.334, 1.271, 1.221, 1.336, 1.14, 1.232, 1.274, 1.278],
}

# --- the decision ---


def decided(ratios, benchmarks=12):
    """Decide from given rounds; any after the last of them would be a fault."""
    return decide(iter(ratios).__next__, benchmarks)


@pytest.mark.parametrize("rounds", UNCHANGED.values(), ids=UNCHANGED)
def test_rounds_of_unchanged_code_raise_no_alarm_in_any_order(rounds):
    for first in range(len(rounds)):
        assert not decided(rounds[first:] + rounds[:first]).slower


@pytest.mark.parametrize("rounds", SLOWED.values(), ids=SLOWED)
def test_rounds_of_a_quarter_more_work_raise_an_alarm(rounds):
    assert decided(rounds).slower


@pytest.mark.parametrize("ratio", [0.5, 1.0, 1.1])
def test_two_rounds_below_the_threshold_are_enough(ratio):
    assert decided([ratio] * 2) == Timing((ratio, ratio), slower=False)


def test_ten_rounds_above_the_threshold_raise_an_alarm():
    timing = decided([SLOWER] * 10)
    assert timing.slower
    assert timing.ratio == SLOWER
    assert len(timing.ratios) == 10


def test_more_benchmarks_ask_for_more_rounds():
    rounds = [len(decided([SLOWER] * MOST_ROUNDS, benchmarks).ratios) for benchmarks in (1, 12, 10_000)]
    assert rounds == sorted(set(rounds))


def test_rounds_that_never_agree_end_without_an_alarm():
    up, down = np.log(2 * SHARE_ABOVE), -np.log(2 * (1 - SHARE_ABOVE))
    ratios, evidence = [], 0.0
    while len(ratios) < MOST_ROUNDS:  # back and forth between the two limits
        above = evidence <= 0
        ratios.append(2.0 if above else 1.0)
        evidence += up if above else -down
    assert decided(ratios) == Timing(tuple(ratios), slower=False)


@pytest.mark.parametrize(("above", "least", "most"), [(0.5, 0.0, LEVEL / COUNT), (SHARE_ABOVE, 0.93, 1.0)])
def test_the_test_is_wrong_as_rarely_as_it_says(above, least, most):
    """Independent rounds, of which half, and a share of SHARE_ABOVE, speak for slower."""
    rng = np.random.default_rng(0)
    alarms = [decide(lambda: 2.0 if rng.random() < above else 1.0, COUNT).slower for _ in range(20_000)]
    share, error = np.mean(alarms), 4 * np.sqrt(0.25 / 20_000) * (above != 0.5)
    assert least - error <= share <= most + 4 * np.sqrt(most / 20_000)


def test_the_limit_of_a_share_is_that_of_the_binomial_distribution():
    assert at_most(0, 20) == pytest.approx(1 - 0.05 ** (1 / 20))
    assert at_most(20, 20) == 1.0
    assert at_most(1, 20) > at_most(0, 20)


# --- processes, with a clock that counts work instead of time ---

BENCHMARKS = """
import time, tactsim.thing

clock = 0.0
time.process_time = lambda: clock

def prepare(name):
    def work():
        global clock
        clock += tactsim.thing.WORK[name]
        return tactsim.thing.WORK[name]
    return work, lambda result: {"error_mm": tactsim.thing.ERROR[name]}

BENCHMARKS = {name: (lambda name=name: prepare(name)) for name in tactsim.thing.WORK}
"""
THING = {"quick": (0.004, 0.5), "long": (3.0, 2.0)}  # {benchmark: (seconds, error)}


def write_thing(root, thing):
    work, error = ({name: values[k] for name, values in thing.items()} for k in (0, 1))
    (root / "tactsim/thing.py").write_text(f"WORK = {work}\nERROR = {error}\n")


def git(root, *words):
    identity = ["-c", "user.name=x", "-c", "user.email=x@y", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", *identity, *words], cwd=root, check=True, capture_output=True)


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project with benchmarks in one commit, and its baseline."""
    root = tmp_path / "project"
    (root / "tactsim").mkdir(parents=True)
    (root / "tactsim/__init__.py").touch()
    (root / ".gitignore").write_text("__pycache__\nbaseline.json\n")
    (root / "bench_things.py").write_text(BENCHMARKS)
    write_thing(root, THING)
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "x"]):
        git(root, *words)
    monkeypatch.chdir(root)
    # Python takes a file that is as long as before and of the same second for the same.
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setattr(regression, "TREES", tmp_path / "trees")
    assert gate("write") == 0
    return root


def gate(command):
    return regression.main([command, "baseline.json", "bench_things.py"])


def test_unchanged_code_passes(project, capsys):
    assert gate("check") == 0
    assert "no figure is worse" in capsys.readouterr().out


@pytest.mark.parametrize("name", THING)
def test_a_quarter_more_time_is_found(project, capsys, name):
    seconds, error = THING[name]
    write_thing(project, THING | {name: (SLOWER * seconds, error)})
    assert gate("check") == 1
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[1] for line in lines if line[0] == "slower"] == [name]


def test_a_little_more_time_passes(project):
    write_thing(project, {name: (1.1 * seconds, error) for name, (seconds, error) in THING.items()})
    assert gate("check") == 0


def test_another_error_is_found_also_a_smaller_one(project, capsys):
    write_thing(project, THING | {"quick": (0.004, 0.5 - 1e-6)})
    assert gate("check") == 1
    assert "changed  quick" in capsys.readouterr().out


def test_another_machine_or_package_is_told_from_another_code(project, capsys):
    """The baseline's code, run here, gives what the new code gives, and not what the baseline says."""
    baseline = json.loads(Path("baseline.json").read_text())
    baseline["benchmarks"]["long"]["error_mm"] += 0.1
    Path("baseline.json").write_text(json.dumps(baseline))
    assert gate("check") == 0
    assert "moved    long" in capsys.readouterr().out
    write_thing(project, THING | {"long": (3.0, 1.9)})
    assert gate("check") == 1
    assert "changed  long" in capsys.readouterr().out


def test_a_benchmark_may_be_new_but_not_gone(project, capsys):
    write_thing(project, THING | {"another": (1.0, 1.0)})
    assert gate("check") == 0
    assert "new      another" in capsys.readouterr().out
    write_thing(project, {"quick": THING["quick"]})
    assert gate("check") == 1
    assert "gone     long" in capsys.readouterr().out


def test_more_calls_count_as_slower(project):
    timings = measure(project, project, Path("bench_things.py"), slowed=True).timings
    assert {name: timing.slower for name, timing in timings.items()} == dict.fromkeys(THING, True)
    for timing in timings.values():
        assert timing.ratios == pytest.approx([SLOWER] * len(timing.ratios))


def test_what_looks_slower_is_timed_again_in_new_processes(project):
    write_thing(project, THING | {"long": (9.0, 2.0)})
    base = next((project.parent / "trees").iterdir())
    heard = []
    measure(project, base, Path("bench_things.py"), progress=lambda name, _: heard.append(name))
    assert heard == [*THING, "long"]


def test_a_baseline_is_of_a_commit(project, capsys):
    (project / "forgotten.py").touch()
    assert gate("write") == 2
    assert "forgotten.py has changes that are in no commit" in capsys.readouterr().err
    assert commit_of(project, but=Path("forgotten.py")) == read_baseline("baseline.json").commit


@pytest.mark.parametrize("commit", ["0" * 40, "HEAD", "--output=x"])
def test_a_commit_that_is_not_here_is_said(project, capsys, commit):
    baseline = json.loads(Path("baseline.json").read_text()) | {"commit": commit}
    Path("baseline.json").write_text(json.dumps(baseline))
    assert gate("check") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert ("make bench-baseline" if commit == "0" * 40 else "commit") in error
    assert not Path("x").exists()


def test_a_benchmark_that_fails_is_said(project, capfd):
    (project / "tactsim/thing.py").write_text("WORK = {'quick': 0.1}\nERROR = {}\n")
    assert gate("check") == 2
    assert "a benchmark failed with the code in" in capfd.readouterr().err


def test_code_of_another_version_is_never_timed(tmp_path):
    """A tree without the package would find the installed one, and compare that with itself."""
    (tmp_path / "bench_things.py").write_text("import tactsim\nBENCHMARKS = {}\n")
    with Side(tmp_path, Path("bench_things.py")) as side, pytest.raises(RuntimeError, match="was imported"):
        side.names()


def test_no_process_is_left(project):
    with Side(project, Path("bench_things.py")) as side:
        process = side._process
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


# --- figures ---


def verdicts(base, new):
    found = Measured(new, base, {"a": Timing((1.0,), slower=False)})
    return [finding.verdict for finding in check(base, found)]


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        ({"a": {"error_mm": 2.0}}, ["ok", "ok"]),
        ({"a": {"error_mm": 2.0 + 1e-6}}, ["ok", "changed"]),
        ({"a": {"error_mm": 2.0 + 1e-10}}, ["ok", "ok"]),
        ({}, ["gone"]),
        ({"a": {}}, ["ok", "gone"]),
        ({"a": {"error_mm": 2.0}, "b": {}}, ["ok", "ok", "new"]),
    ],
)
def test_a_figure_is_the_same_within_1e_9(new, expected):
    assert verdicts({"a": {"error_mm": 2.0}}, new) == expected


def test_a_planted_error_changes_a_figure_of_the_real_benchmarks(monkeypatch):
    prepare = runpy.run_path(str(ROOT / "tests/bench/bench_regression.py"))["BENCHMARKS"]
    work, figures = prepare["trial of histogram"]()
    right, again = figures(work()), figures(work())
    once = score.placement_error
    monkeypatch.setattr(score, "placement_error", lambda *words: 1.05 * once(*words))
    wrong = figures(work())
    assert right == again
    assert wrong["error_mm"] == pytest.approx(1.05 * right["error_mm"])
    assert wrong["mean_p_truth"] == right["mean_p_truth"]


# --- the command ---


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    baseline = Baseline("0123456789" * 4, {"a": {"error_mm": 2.0}})
    write_baseline(baseline, tmp_path / "baseline.json")
    assert read_baseline(tmp_path / "baseline.json") == baseline


def test_a_baseline_of_an_earlier_schema_is_refused(tmp_path):
    (tmp_path / "baseline.json").write_text(json.dumps({"schema": 1, "benchmarks": {}}))
    with pytest.raises(InputError, match="make bench-baseline"):
        read_baseline(tmp_path / "baseline.json")


@pytest.mark.parametrize("words", [[], ["check"], ["guess", "a", "b"], ["check", "none.json", "b.py"]])
def test_wrong_words_end_with_2(words, capsys):
    assert regression.main(words) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_the_committed_baseline_is_of_the_benchmarks():
    assert len(read_baseline(ROOT / "results" / "baseline.json").figures) == COUNT
