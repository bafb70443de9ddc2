"""The figures that a task is scored by: their names, their values, and which of two values is better."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from tactsim.bench.config import whole_number
from tactsim.bench.placement_error import Properties
from tactsim.bench.score import CURVES, HEADLINES
from tactsim.bench.trials import Trials
from tactsim.core import InputError
from tactsim.core.errors import short, unknown

# How bad a value is, of every metric that methods can be ranked by: 0 or less is best, and more is worse.
_BADNESS: dict[str, Callable[[float], float]] = {
    "accuracy": lambda value: 1 - value,
    "refused_unknown": lambda value: 1 - value,
    "recovered_within_3": lambda value: 1 - value,
    "coverage_50": lambda value: abs(value - 0.5),
    "coverage_90": lambda value: abs(value - 0.9),
    "calibration_gap": abs,
    **dict.fromkeys(
        (
            "error_mm", "error_all_mm", "negative_log_likelihood", "sharpness_mm", "refused_known",
            "settled_50", "settled_95", "all_right_from",
        ),
        float,
    ),
}  # fmt: skip


def check_figure(figure: str, readings: int, where: str) -> None:
    """Check that trials of so many readings have this figure: METRIC@READING of a curve, or METRIC of a whole run.

    Raises InputError that begins with `where`.
    """
    metric, at, reading = figure.partition("@")
    if metric not in _BADNESS:
        raise unknown(f"figure of {where}", metric, _BADNESS)
    if metric in CURVES and not 1 <= (whole_number(reading) or 0) <= readings:
        raise InputError(
            f"{where}: {short(figure)} says no reading from 1 to {readings}; write {metric}@{readings}"
        )
    if metric in HEADLINES and at:
        raise InputError(f"{where}: {short(figure)} is of a whole trial; write {metric}")


def value_of(figure: str, trials: Trials, objects: Mapping[str, Properties]) -> float | None:
    """Compute a figure such as accuracy@5 or settled_95; None where it is undefined, or never reached."""
    metric, _, reading = figure.partition("@")
    value = (CURVES | HEADLINES)[metric](trials, objects)
    if metric in CURVES:
        value = value[int(reading) - 1]
    return None if value is None or np.isnan(value) else float(value)


def badness(figure: str, value: float | None) -> float:
    """Say how bad a figure's value is, for sorting, the best first; infinite if there is none."""
    return math.inf if value is None else _BADNESS[figure.partition("@")[0]](value)
