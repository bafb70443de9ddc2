"""Figures of certainty by other means than the project's: it reads the folders of runs with NumPy alone.

`python tests/support/independent_coverage.py RUN...` prints of the trials of all runs together, in the plane or in
space, what docs/method.md shows: after each reading coverage, that of the worst quarter, the test of ranks, width and
NEES.
"""

import csv
import math
import sys
from pathlib import Path

import numpy as np

SHOWN = "coverage_90", "coverage_90_worst", "rank_p", "sharpness_mm", "nees"
SURE = 2.497705474412  # standard normal quantile of a two-sided interval of 98.75 %, from a table


def independent(*folders):
    """Compute the figures of runs' folders, pooled, by reading: a list of dicts."""
    rows = []
    for folder in folders:
        with (folder / "trials.csv").open(newline="") as file:
            rows += csv.DictReader(file)
    found = []
    number = next(name for name in rows[0] if name.endswith("_number"))
    for k in sorted({int(row[number]) for row in rows}):
        at = [row for row in rows if int(row[number]) == k]
        right = np.array([row["label"] == row["truth"] for row in at])
        p, p_truth, rank, radius, nees = (
            np.array([float(row[name]) for row in at])
            for name in ("p_label", "p_truth", "credibility", "radius_90", "nees")
        )
        sure = right & ~np.isnan(rank)
        rank, radius, nees = rank[sure], radius[sure], nees[sure & ~np.isnan(nees)]
        n = len(rank)
        quarters = [rank[part] < 0.9 for part in np.array_split(np.argsort(radius, kind="stable"), 4)]
        ends = [interval(part.sum(), len(part)) for part in quarters] if n >= 4 else [(None, None)]
        ordered = sorted(rank.tolist())
        away = max((max(abs(r - i / n), abs(r - (i + 1) / n)) for i, r in enumerate(ordered)), default=None)
        away = away and away * (math.sqrt(n) + 0.12 + 0.11 / math.sqrt(n))
        # The other series of the same function, by a theta identity; it converges where the first does not.
        p_value = away and 1 - math.sqrt(2 * math.pi) / away * sum(
            math.exp(-((2 * j - 1) ** 2) * math.pi**2 / (8 * away**2)) for j in range(1, 200)
        )
        found.append(
            {"brier": float(np.mean((p - right) ** 2)),
             "negative_log_likelihood": float(np.mean(-np.log(p_truth))),
             "coverage_90": float(np.mean(rank < 0.9)) if n else None,
             "sharpness_mm": float(np.mean(radius)) if n else None,
             "nees": float(np.mean(nees)) if len(nees) else None,
             "coverage_90_worst": float(min(part.mean() for part in quarters)) if n >= 4 else None,
             "coverage_90_worst_low": min(low for low, _ in ends),
             "coverage_90_worst_high": min(high for _, high in ends), "rank_p": p_value}
        )  # fmt: skip
    return found


def interval(successes, n):
    """Wilson's interval by its definition: all p with |share - p| <= z sqrt(p (1 - p) / n)."""
    a, b, c = 1 + SURE**2 / n, -(2 * successes / n + SURE**2 / n), (successes / n) ** 2
    root = math.sqrt(max(0.0, b * b - 4 * a * c))
    return (-b - root) / (2 * a), (-b + root) / (2 * a)


if __name__ == "__main__":
    for reading, row in enumerate(independent(*map(Path, sys.argv[1:])), start=1):
        print(reading, *(f"{name} {row[name]:.3f}" for name in SHOWN))
