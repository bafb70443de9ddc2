"""Notice when times or errors get worse: compare a benchmark's results with the baseline.

`make bench-check` runs tests/bench/bench_regression.py under pytest-benchmark and calls
`python -m tactsim.bench.regression check BASELINE RESULTS...`; `make bench-baseline` renews the baseline.
Machines are noisy and differ, so a time is kept as its ratio to a fixed NumPy reference that was
measured in the same rounds. A ratio may rise by a quarter; of several results the smallest ratio counts.
Errors have no noise: the same seed gives the same error, within 1e-9.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from tactsim.bench.machine import machine, versions
from tactsim.bench.results import to_json
from tactsim.core.checking import checked
from tactsim.core.documents import read_json
from tactsim.core.errors import InputError
from tactsim.core.files import write_text

TRIP_WIRE = 1.25  # how far a ratio of times may rise
SAME_ERROR = 1e-9  # how far a figure may move, relative to its size or to 1
SCHEMA = 1

Figures = dict[str, dict[str, Any]]  # benchmark: {"ratio": ..., "figures": {name: value}}


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Benchmark(_Strict):
    ratio: float
    figures: dict[str, float]


class _Baseline(_Strict):
    benchmarks: dict[str, _Benchmark]


class _Entry(_Strict):
    name: str
    extra_info: dict[str, float]


class _Measured(_Strict):
    benchmarks: list[_Entry]


@dataclass(frozen=True)
class Finding:
    """One compared value; `verdict` is "ok", "slower", "changed", "gone" or "new"."""

    benchmark: str
    what: str
    base: float | None
    new: float | None
    verdict: str


def measured(path: str | Path) -> Figures:
    """Read what the suites wrote with --benchmark-json. Raises InputError if it is no such file."""
    content = read_json(path, "benchmark result")
    checked(_Measured, content, str(path))
    found: Figures = {}
    for entry in content["benchmarks"]:
        figures = dict(entry["extra_info"])
        if "ratio" not in figures:
            raise InputError(f"{path} is no result of the benchmark suites: {entry['name']} has no ratio")
        found[entry["name"]] = {"ratio": float(figures.pop("ratio")), "figures": figures}
    return found


def least(results: Iterable[Figures]) -> Figures:
    """Join repeated results: the least ratio of each benchmark, the figures of the last."""
    joined: Figures = {}
    for result in results:
        for name, found in result.items():
            ratio = min(found["ratio"], joined.get(name, found)["ratio"])
            joined[name] = {"ratio": ratio, "figures": found["figures"]}
    return joined


def baseline(path: str | Path) -> Figures:
    """Read a baseline. Raises InputError if it is none."""
    content = read_json(path, "baseline")
    if content.get("schema") != SCHEMA:
        raise InputError(f"{path} is no baseline of schema {SCHEMA}; make one with `make bench-baseline`")
    checked(_Baseline, content, str(path))
    return content["benchmarks"]


def write_baseline(found: Figures, path: str | Path) -> None:
    """Write a baseline, with the machine and the versions that it was measured with."""
    content = {"schema": SCHEMA, "machine": machine(), "versions": versions(), "benchmarks": found}
    write_text(path, to_json(content))


def check(base: Figures, new: Figures) -> list[Finding]:
    """Compare every ratio and every figure, also of benchmarks that are gone or new."""
    findings = []
    for name in sorted(base | new):
        if name not in new:
            findings.append(Finding(name, "", None, None, "gone"))
        elif name not in base:
            findings.append(Finding(name, "ratio", None, new[name]["ratio"], "new"))
        else:
            before, after = base[name]["ratio"], new[name]["ratio"]
            verdict = "slower" if after > TRIP_WIRE * before else "ok"
            findings.append(Finding(name, "ratio", before, after, verdict))
            findings += _figures(name, base[name]["figures"], new[name]["figures"])
    return findings


def _figures(name: str, base: Mapping[str, Any], new: Mapping[str, Any]) -> list[Finding]:
    findings = []
    for what in sorted({*base, *new}):
        if what not in base or what not in new:
            findings.append(
                Finding(name, what, base.get(what), new.get(what), "gone" if what in base else "new")
            )
            continue
        before, after = float(base[what]), float(new[what])
        same = abs(after - before) <= SAME_ERROR * max(1.0, abs(before))
        findings.append(Finding(name, what, before, after, "ok" if same else "changed"))
    return findings


def main(words: list[str]) -> int:
    """Run `check BASELINE RESULTS...` or `write BASELINE RESULTS...`; returns the exit status."""
    if len(words) < 3 or words[0] not in ("check", "write"):
        print("usage: python -m tactsim.bench.regression check|write BASELINE RESULTS...", file=sys.stderr)
        return 2
    try:
        found = least(measured(path) for path in words[2:])
        if words[0] == "write":
            write_baseline(found, words[1])
            return 0
        findings = check(baseline(words[1]), found)
    except InputError as error:
        print(f"tactsim.bench.regression: {error}", file=sys.stderr)
        return 2
    for finding in findings:
        values = " -> ".join(
            "-" if value is None else f"{value:.6g}" for value in (finding.base, finding.new)
        )
        print(f"{finding.verdict:8} {finding.benchmark:50} {finding.what:24} {values}")
    bad = [finding for finding in findings if finding.verdict not in ("ok", "new")]
    print(
        f"{len(bad)} of {len(findings)} figures are worse than the baseline" if bad else "no figure is worse"
    )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
