"""The gate: a planted slow-down and a planted error are caught by the real suites."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tactsim.bench import regression
from tactsim.bench.regression import check, least, measured, write_baseline

ROOT = Path(__file__).resolve().parents[2]
# What is compared is the gate, so one letter is enough: four fifths of the pressing and mapping are left out.
ONE_LETTER = """
import tactsim.press as module
every = module.scan_letters
module.scan_letters = lambda options, **words: every(options.model_copy(update={"letters": ("A",)}), **words)
"""
PLANTED_SLOWNESS = """
import tactsim.estimators.filters.histogram as module
once = module.HistogramFilter.fit
def twice(self, scan):
    once(self, scan)
    once(self, scan)
module.HistogramFilter.fit = twice
"""
PLANTED_ERROR = """
import tactsim.bench.score as module
right = module.placement_error
module.placement_error = lambda *words: 1.05 * right(*words)
"""


def result(tmp_path, name, which, planted=""):
    """Run one of the suites as `make bench-check` does, with something planted in it."""
    (tmp_path / f"planted_{name}.py").write_text(ONE_LETTER + planted)
    path = tmp_path / f"{name}.json"
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-m", "benchmark", "-p", f"planted_{name}", "-k", which,
         "tests/bench/bench_regression.py", "--benchmark-timer=time.process_time", f"--benchmark-json={path}"],
        cwd=ROOT, env=environment | {"PYTHONPATH": str(tmp_path)}, check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    return path


def verdicts(base, new):
    return {(finding.benchmark, finding.what): finding.verdict for finding in check(base, new)}


def test_a_planted_slow_down_is_caught(tmp_path):
    base = measured(result(tmp_path, "base", "test_map"))
    slow = measured(result(tmp_path, "slow", "test_map", PLANTED_SLOWNESS))
    found = verdicts(base, slow)
    assert found["test_map", "ratio"] == "slower"
    assert found["test_map", "mean_log_odds"] == "ok"


def test_a_planted_error_is_caught_and_an_equal_run_is_equal(tmp_path):
    base = measured(result(tmp_path, "base", "histogram"))
    again = measured(result(tmp_path, "again", "histogram"))
    wrong = measured(result(tmp_path, "wrong", "histogram", PLANTED_ERROR))
    assert verdicts(base, again)["test_trial[histogram]", "error_mm"] == "ok"
    assert verdicts(base, wrong)["test_trial[histogram]", "error_mm"] == "changed"
    assert verdicts(base, wrong)["test_trial[histogram]", "mean_p_truth"] == "ok"


def figures(ratio, error):
    return {"a": {"ratio": ratio, "figures": {"error_mm": error}}}


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (figures(1.24, 2.0), ["ok", "ok"]),
        (figures(1.26, 2.0), ["slower", "ok"]),
        (figures(0.5, 2.0 + 1e-6), ["ok", "changed"]),
        (figures(1.0, 2.0 - 1e-6), ["ok", "changed"]),
        (figures(1.0, 2.0 + 1e-10), ["ok", "ok"]),
        ({}, ["gone"]),
        ({"a": {"ratio": 1.0, "figures": {}}}, ["ok", "gone"]),
        (figures(1.0, 2.0) | {"b": {"ratio": 9.0, "figures": {}}}, ["ok", "ok", "new"]),
    ],
)
def test_the_gate_trips_where_it_says(new, expected):
    assert [finding.verdict for finding in check(figures(1.0, 2.0), new)] == expected


def test_the_least_of_repeated_ratios_counts():
    assert least([figures(2.0, 1.0), figures(1.0, 1.0), figures(3.0, 1.0)]) == figures(1.0, 1.0)


def test_the_command_ends_with_0_1_or_2(tmp_path, capsys):
    write_baseline(figures(1.0, 2.0), tmp_path / "base.json")
    for name, ratio in {"good": 1.1, "slow": 2.0}.items():
        entry = {"name": "a", "extra_info": {"ratio": ratio, "error_mm": 2.0}}
        (tmp_path / f"{name}.json").write_text(json.dumps({"benchmarks": [entry]}))
    base, good, slow = (str(tmp_path / f"{name}.json") for name in ("base", "good", "slow"))
    assert regression.main(["check", base, good]) == 0
    assert regression.main(["check", base, slow]) == 1
    assert regression.main(["check", base, slow, good]) == 0
    assert regression.main(["check", good, good]) == 2
    assert regression.main(["check", base, str(tmp_path / "none.json")]) == 2
    assert regression.main(["check", base, base]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_the_committed_baseline_can_be_read():
    assert regression.baseline(ROOT / "results" / "baseline.json")
