"""The raw result of a run with objects in space, and its metrics beside those of every run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.intervals import FEWEST_PAIRS
from tactsim.bench.score import Curve, Metric, Scored, errors, mean_where, nones
from tactsim.bench.trials import Trials
from tactsim.core.poses import FloatArray

_DRAWS = 1000  # of a bootstrap


@dataclass(frozen=True, eq=False)
class SpaceTrials(Trials):
    """Trials with objects in space: poses are (7,), and touches, which are drawn as they come, are numbered from 0.

    start: (n, r, 7) where each touch began, sensor_in_robot (of a hand: hand_in_robot). met: (n, r) how many pads met
    the object.
    """

    kind: ClassVar[str] = "solids"
    start: FloatArray
    met: NDArray[np.int64]


def angle(scored: Scored) -> FloatArray:
    """Compute the angle (n, r) in degrees between estimated and true rotation, the least over the symmetry."""
    return np.degrees(errors(scored.trials, scored.objects, "angle"))


def by_object(scored: Scored) -> dict[str, dict[str, float | None]]:
    """Give accuracy, mean surface distance and angle of each object in space after the last touch."""
    trials = scored.trials
    figures = {
        "accuracy": (trials.right.astype(float), np.ones_like(trials.right)),
        "error_mm": (scored.error, trials.named),
        "angle_deg": (angle(scored), trials.named),
    }
    rows: dict[str, dict[str, float | None]] = {}
    for truth in dict.fromkeys(trials.truth.tolist()):
        own = trials.truth == truth
        means = {
            name: mean_where(values[own][:, -1:], chosen[own][:, -1:])[0]
            for name, (values, chosen) in figures.items()
        }
        rows[truth] = {name: None if mean is None else float(mean) for name, mean in means.items()}
    return rows


def met(scored: Scored) -> FloatArray:
    """Give the share of the touches in space (r,) that met the object."""
    assert isinstance(scored.trials, SpaceTrials)
    return (scored.trials.met > 0).mean(axis=0)


# Beside those of every run: the objects have no shape in common, so a few poses may be far off.
METRICS: dict[str, Metric] = {
    "error_low_mm": Metric(
        "Lower end of the 95 % interval of `error_mm`, by a bootstrap over trials.",
        lambda scored: _bootstrap(scored.error, scored.trials.named)[0],
    ),
    "error_high_mm": Metric(
        "Upper end of the 95 % interval of `error_mm`, by a bootstrap over trials.",
        lambda scored: _bootstrap(scored.error, scored.trials.named)[1],
    ),
    "error_median_mm": Metric(
        "Median surface distance of the trials whose object is right: a few poses that are far off do not move it.",
        lambda scored: _median(scored.error, scored.trials.named),
    ),
    "angle_deg": Metric(
        "Mean angle between estimated and true rotation where the object is right, the least over its symmetry.",
        lambda scored: mean_where(angle(scored), scored.trials.named),
    ),
    "angle_low_deg": Metric(
        "Lower end of the 95 % interval of `angle_deg`, by a bootstrap over trials.",
        lambda scored: _bootstrap(angle(scored), scored.trials.named)[0],
    ),
    "angle_high_deg": Metric(
        "Upper end of the 95 % interval of `angle_deg`, by a bootstrap over trials.",
        lambda scored: _bootstrap(angle(scored), scored.trials.named)[1],
    ),
    "angle_median_deg": Metric(
        "Median angle where the object is right.",
        lambda scored: _median(angle(scored), scored.trials.named),
    ),
    "met": Metric("Share of the touches that met the object with one pad at least.", met),
    "by_object": Metric(
        "Give accuracy, mean surface distance and angle of each object after the last touch.", by_object
    ),
}


def _median(values: FloatArray, chosen: NDArray[np.bool_]) -> Curve:
    """Take the median of the chosen entries of each column; None where there is none."""
    columns = zip(values.T, chosen.T, strict=True)
    return nones(np.array([np.median(column[some]) if some.any() else np.nan for column, some in columns]))


def _bootstrap(values: FloatArray, chosen: NDArray[np.bool_]) -> tuple[Curve, Curve]:
    """Bound the mean of the chosen entries of each column: percentiles of a bootstrap over rows, (r,) each.

    None where fewer than `FEWEST_PAIRS` are chosen: draws of so few are too much alike.
    """
    drawn = np.random.default_rng(0).multinomial(len(values), np.full(len(values), 1 / len(values)), _DRAWS)
    chosen = chosen & (chosen.sum(axis=0) >= FEWEST_PAIRS)
    count = drawn @ chosen.astype(float)
    with np.errstate(invalid="ignore"):
        means = drawn @ np.where(chosen, values, 0.0) / np.where(count > 0, count, np.nan)
    bounds = np.full((2, values.shape[1]), np.nan)
    some = ~np.isnan(means).all(axis=0)
    bounds[:, some] = np.nanpercentile(means[:, some], (2.5, 97.5), axis=0)
    return nones(bounds[0]), nones(bounds[1])
