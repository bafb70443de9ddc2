"""Compare two runs on the same trials: which is right more often or more exact, beyond chance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactsim.bench.config import flags_of, flat
from tactsim.bench.intervals import FEWEST_PAIRS, percentiles, resampled
from tactsim.bench.results import Run
from tactsim.bench.score import figures, settled_by
from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import shape_digest

_DRAWS = 4000
# So many pairs a bootstrap can draw from; of fewer its percentiles lie too near to each other.
_ENOUGH_PAIRS = 30
LEVEL = 0.975  # of each of the two gated intervals, so that both hold together at 95 %


@dataclass(frozen=True)
class Difference:
    """One compared figure: both values, new minus base with its interval, and what that means.

    verdict: "worse", "better", "not told apart" (the interval holds 0) or "too few" (pairs to decide by) for a gated
    figure, "" for one that is only reported. p: exact McNemar test, where there is one.
    """

    name: str
    base: float | None
    new: float | None
    low: float | None = None
    high: float | None = None
    p: float | None = None
    verdict: str = ""


def compare(base: Run, new: Run, level: float = LEVEL) -> list[Difference]:
    """Compare two runs of one protocol trial by trial.

    Gated, with paired bootstrap intervals of `level` each: the share of readings after which the letter
    is right, over all trials, and the placement error after the last reading where both have named
    the letter and its place is known; without such trials it is left out. Reported: accuracy with McNemar's
    exact test at some readings, readings to settle, time.
    Where touches are of each trial alone (`Kind.own_touches`), they may differ: chosen ones, or more of them; those
    that both have are compared.

    Raises InputError if the runs do not have the same trials.
    """
    check_same_trials(base, new)
    rng = np.random.default_rng(0)
    scored = [run.scored for run in (base, new)]
    kind, known = base.kind, figures(base.kind.name)
    readings = min(base.readings, new.readings)
    right = [run.trials.right[:, :readings] for run in (base, new)]
    shares = [each.mean(axis=1) for each in right]
    rows = [paired(f"share of {kind.touches} right", shares[0], shares[1], rng, +1, level)]
    both = np.logical_and(*(run.trials.named[:, readings - 1] for run in (base, new)))
    for one in scored:  # of an object whose place nobody knows there is no error
        both &= np.isfinite(one.error[:, readings - 1])
    if both.any():
        for name, measure in kind.errors.items():
            pair = [measure(one)[both, readings - 1] for one in scored]
            words = f"{known[name].heading.format(readings)}, both right"
            rows.append(paired(words, pair[0], pair[1], rng, known[name].better, level))
    for reading in sorted({k for k in (1, 3, 5, 10, 20, readings) if k <= readings}):
        pair = [each[:, reading - 1] for each in right]
        before, after = (float(each.mean()) for each in pair)
        words = known["accuracy"].heading.format(reading)
        rows.append(Difference(words, before, after, p=mcnemar(*pair)))
    for name, share in (("all_right_from", 1.0), ("settled_95", 0.95)):
        rows.append(Difference(known[name].heading, settled_by(right[0], share), settled_by(right[1], share)))
    before, after = (1e3 * float(run.trials.seconds[run.trials.taken].mean()) for run in (base, new))
    rows.append(Difference(f"ms a {kind.touch}", before, after))
    return rows


def mcnemar(base: np.ndarray, new: np.ndarray) -> float:
    """Compute McNemar's exact two-sided p of two paired boolean arrays (n,)."""
    from scipy.stats import binomtest

    lost, won = int((base & ~new).sum()), int((~base & new).sum())
    return float(binomtest(won, lost + won).pvalue) if lost + won else 1.0


def paired(
    name: str, base: FloatArray, new: FloatArray, rng: np.random.Generator, good: int, level: float = LEVEL
) -> Difference:
    """Compare a figure trial by trial, (n,) each; good: +1 if more is better, -1 if less is."""
    low, high = paired_interval(new - base, rng, level)
    worse, better = (high < 0, low > 0) if good > 0 else (low > 0, high < 0)
    alike = "not told apart" if len(base) >= FEWEST_PAIRS else "too few"
    verdict = "worse" if worse else "better" if better else alike
    return Difference(name, float(base.mean()), float(new.mean()), low, high, verdict=verdict)


def what_to_align(base: Run, new: Run) -> str:
    """Say which options two runs of a kind must share and do not: all but the method's, or those of their scans."""
    fields = base.kind.config.model_fields
    asked = [flat(run.config | {"letters": run.about.get("letters")}) for run in (base, new)]
    words = []
    for name in _unlike(*asked):
        field, _, inner = name.partition(".")
        if field in fields and field not in base.kind.of_method and (flags := flags_of(field, fields[field])):
            words.append(f"{flags[0]} {inner}".strip())
    if not words:
        scans = (flat(run.about.get("scan", {}).get("options", {})) for run in (base, new))
        words = [f"--scan-set {name}" for name in _unlike(*scans)]
    if not words:
        return "their options are the same: do both again with one version of tactsim and the same readings"
    return f"give both the same {', '.join(words)}"


def _unlike(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    return [name for name in {**one, **other} if one.get(name) != other.get(name)]


def check_same_trials(base: Run, new: Run) -> None:
    """Raise InputError, which says what to align, unless two runs have the same trials."""
    kind = base.kind
    if kind.name != new.kind.name:
        raise InputError(f"one run is of kind {kind.name}, the other {new.kind.name}; give two of one kind")
    pairs = [(getattr(base.trials, name), getattr(new.trials, name)) for name in ("truth", "trial")]
    pairs.append((base.trials.true_pose[:, 0], new.trials.true_pose[:, 0]))
    alike = all(np.array_equal(a, b) for a, b in pairs)
    if alike and (base.config.get("shapes") or new.config.get("shapes")):
        for name in base.letters:
            stated = [shape_digest(run.about["scan"], name) for run in (base, new)]
            if None not in stated and stated[0] != stated[1]:
                raise InputError(f"{name} is of another shape in each run; give both the same --shape")
    align = what_to_align(base, new)
    if kind.own_touches:
        if not alike:
            raise InputError(f"the runs did not hide the same objects at the same poses; {align}")
        return
    if base.about["protocol"] != new.about["protocol"]:
        raise InputError(
            f"the runs follow different protocols ({base.about['protocol']}; {new.about['protocol']}) "
            f"and cannot be compared; {align}"
        )
    if not alike:
        raise InputError(f"the runs do not have the same trials; {align}")
    if base.trials.touch_index.shape != new.trials.touch_index.shape:
        raise InputError(f"the runs saw different numbers of readings; {align}")
    if not np.array_equal(base.trials.true_pose, new.trials.true_pose):
        raise InputError(f"the objects do not move alike in both runs; {align}")


def paired_interval(difference: FloatArray, rng: np.random.Generator, level: float) -> tuple[float, float]:
    """Bound the mean of paired differences (n,): percentile bootstrap over pairs; of fewer than 30 Student's t.

    The interval of fewer than `FEWEST_PAIRS` holds 0 in any case.
    """
    n = len(difference)
    if n < _ENOUGH_PAIRS:
        from scipy.special import stdtrit

        middle, half = float(difference.mean()), 0.0
        if n > 1:
            half = float(stdtrit(n - 1, (1 + level) / 2) * difference.std(ddof=1) / math.sqrt(n))
        low, high = middle - half, middle + half
        return (min(low, 0.0), max(high, 0.0)) if n < FEWEST_PAIRS else (low, high)
    low, high = percentiles(resampled([n], rng, _DRAWS) @ difference / n, level)
    return float(low), float(high)
