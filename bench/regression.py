"""Notice when times or errors get worse: compare the benchmarks with the baseline.

`make bench-check` calls `python -m tactsim.bench.regression check BASELINE BENCHMARKS`, and
`make bench-baseline` the same with `write`. BENCHMARKS is tests/bench/bench_regression.py. The baseline names a
commit, and holds the errors that its code gave. Times are compared with the code of that commit, in turns on
this machine (see tactsim.bench.regression_timing). Errors have no noise: the same seed gives the same error,
within 1e-9.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from tactsim.bench.machine import machine, versions
from tactsim.bench.regression_timing import LEVEL, Side, Timing, commit_of, measure, tree_of
from tactsim.bench.results import to_json
from tactsim.core.checking import checked
from tactsim.core.documents import read_json
from tactsim.core.errors import InputError
from tactsim.core.files import write_text

SAME_ERROR = 1e-9  # how far a figure may move, relative to its size or to 1
SCHEMA = 2
TREES = Path(sys.prefix) / "benchmark"  # where the code of the baselines' commits is unpacked

Figures = dict[str, dict[str, float]]  # {benchmark: {name: value}}


class _Baseline(BaseModel):
    model_config = ConfigDict(strict=True)

    commit: str = Field(pattern=r"^[0-9a-f]{40}$")
    benchmarks: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Baseline:
    """The commit whose code is the reference of times, and the figures that its benchmarks gave."""

    commit: str
    figures: Figures


@dataclass(frozen=True)
class Finding:
    """One compared value; `verdict` is "ok", "slower", "changed", "gone" or "new"."""

    benchmark: str
    what: str
    base: float | None
    new: float | None
    verdict: str


def read_baseline(path: str | Path) -> Baseline:
    """Read a baseline. Raises InputError if it is none."""
    content = read_json(path, "baseline")
    if content.get("schema") != SCHEMA:
        raise InputError(f"{path} is no baseline of schema {SCHEMA}; make one with `make bench-baseline`")
    checked(_Baseline, content, str(path))
    return Baseline(content["commit"], content["benchmarks"])


def write_baseline(found: Baseline, path: str | Path) -> None:
    """Write a baseline, with the machine and the versions that its figures come from."""
    made = {"machine": machine(), "versions": versions()}
    content = {"schema": SCHEMA, "commit": found.commit, "benchmarks": found.figures}
    write_text(path, to_json(content | made))


def check(base: Figures, new: Figures, timings: Mapping[str, Timing]) -> list[Finding]:
    """Judge every ratio of times and every figure, also of benchmarks that are gone or new."""
    findings = []
    for name in sorted(base | new):
        if name not in new:
            findings.append(Finding(name, "", None, None, "gone"))
            continue
        if name in timings:
            verdict = "slower" if timings[name].slower else "ok"
            findings.append(Finding(name, "time", 1.0, timings[name].ratio, verdict))
        else:
            findings.append(Finding(name, "time", None, None, "new"))
        findings += _figures(name, base.get(name, {}), new[name])
    return findings


def _figures(name: str, base: Mapping[str, float], new: Mapping[str, float]) -> list[Finding]:
    findings = []
    for what in sorted({*base, *new}):
        before, after = base.get(what), new.get(what)
        if before is None or after is None:
            verdict = "new" if before is None else "gone"
        else:
            same = abs(after - before) <= SAME_ERROR * max(1.0, abs(before))
            verdict = "ok" if same else "changed"
        findings.append(Finding(name, what, before, after, verdict))
    return findings


def print_timing(name: str, timing: Timing) -> None:
    """Print what the rounds of a benchmark gave, to standard error."""
    said = "slower" if timing.slower else "ok"
    print(
        f"{name:28} {timing.ratio:.2f} of the base's time, rounds {min(timing.ratios):.2f} to "
        f"{max(timing.ratios):.2f} ({len(timing.ratios)}): {said}",
        file=sys.stderr,
    )


def _check(path: Path, benchmarks: Path) -> int:
    base = read_baseline(path)
    root = Path.cwd()
    found = measure(root, tree_of(base.commit, root, TREES), benchmarks, progress=print_timing)
    findings = check(base.figures, found.figures, found.timings)
    for finding in findings:
        values = " -> ".join(
            "-" if value is None else f"{value:.6g}" for value in (finding.base, finding.new)
        )
        print(f"{finding.verdict:8} {finding.benchmark:28} {finding.what:16} {values}")
    bad = [finding for finding in findings if finding.verdict not in ("ok", "new")]
    print(
        f"Times are in units of the code of {base.commit[:12]}. Unchanged code is called slower in at most "
        f"{LEVEL:.0%} of checks."
    )
    print(
        f"{len(bad)} of {len(findings)} figures are worse than the baseline" if bad else "no figure is worse"
    )
    return 1 if bad else 0


def _write(path: Path, benchmarks: Path) -> int:
    root = Path.cwd()
    commit = commit_of(root, but=path)
    tree = tree_of(commit, root, TREES)
    with Side(tree, benchmarks) as side:
        figures = {name: side.figures(name) for name in side.names()}
    write_baseline(Baseline(commit, figures), path)
    return 0


def main(words: list[str]) -> int:
    """Run `check BASELINE BENCHMARKS` or `write BASELINE BENCHMARKS`; returns the exit status."""
    commands: dict[str, Any] = {"check": _check, "write": _write}
    if len(words) != 3 or words[0] not in commands:
        print("usage: python -m tactsim.bench.regression check|write BASELINE BENCHMARKS", file=sys.stderr)
        return 2
    try:
        return int(commands[words[0]](Path(words[1]), Path(words[2])))
    except InputError as error:
        print(f"tactsim.bench.regression: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
