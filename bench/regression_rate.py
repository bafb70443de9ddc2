"""How often the regression gate is wrong: false alarms of unchanged code, and slow-downs that it misses.

`python -m tactsim.bench.regression_rate BENCHMARKS RUNS SLOWED` does RUNS checks of the working tree against
its own commit, where any alarm is false. Then it does SLOWED checks in which every benchmark does a quarter
more work, where each that raises no alarm is missed. `make bench-rate` calls it.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from scipy.stats import beta

from tactsim.bench.regression import TREES
from tactsim.bench.regression_timing import LEVEL, SLOWER, Measured, commit_of, measure, tree_of
from tactsim.core.errors import InputError

CONFIDENCE = 0.95


def at_most(seen: int, of: int) -> float:
    """Give the upper limit of a share at CONFIDENCE (Clopper and Pearson 1934)."""
    return 1.0 if seen == of else float(beta.ppf(CONFIDENCE, seen + 1, of - seen))


def _checks(count: int, root: Path, benchmarks: Path, *, slowed: bool) -> list[Measured]:
    base = tree_of(commit_of(root), root, TREES)
    found = []
    for number in range(count):
        start = time.monotonic()
        found.append(measure(root, base, benchmarks, slowed=slowed))
        timings = found[-1].timings
        alarms = [f"{name} ({timing.ratio:.2f})" for name, timing in timings.items() if timing.slower]
        misses = [f"{name} ({timing.ratio:.2f})" for name, timing in timings.items() if not timing.slower]
        ratios = sorted(timing.ratio for timing in timings.values())
        print(
            f"check {number + 1}: {time.monotonic() - start:.0f} s, ratios {ratios[0]:.2f} to {ratios[-1]:.2f}, "
            + (f"missed: {misses}" if slowed else f"alarms: {alarms}"),
            flush=True,
        )
    return found


def main(words: list[str]) -> int:
    """Measure both rates and print them; returns the exit status."""
    if len(words) != 3 or not all(word.isdecimal() for word in words[1:]):
        print("usage: python -m tactsim.bench.regression_rate BENCHMARKS RUNS SLOWED", file=sys.stderr)
        return 2
    benchmarks, root = Path(words[0]), Path.cwd()
    try:
        same = _checks(int(words[1]), root, benchmarks, slowed=False)
        slow = _checks(int(words[2]), root, benchmarks, slowed=True)
    except InputError as error:
        print(f"tactsim.bench.regression_rate: {error}", file=sys.stderr)
        return 2
    alarms = sum(any(timing.slower for timing in check.timings.values()) for check in same)
    found = [timing.slower for check in slow for timing in check.timings.values()]
    print(
        f"checks of one commit with a false alarm: asked at most {LEVEL:.2f}, measured {alarms} of {len(same)} "
        f"(below {at_most(alarms, len(same)):.2f} at {CONFIDENCE:.0%})"
    )
    missed = len(found) - sum(found)
    print(
        f"benchmarks {SLOWER:.2f} x slower that were missed: measured {missed} of {len(found)} "
        f"(below {at_most(missed, len(found)):.2f} at {CONFIDENCE:.0%})"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
