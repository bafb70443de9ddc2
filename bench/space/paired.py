"""Compare two runs in space on the same hidden objects: two estimators, or touches that were chosen in another way."""

from __future__ import annotations

import numpy as np

from tactsim.bench.compare import Difference, mcnemar, paired, what_to_align
from tactsim.bench.score import settled_by
from tactsim.bench.space.space_config import SpaceConfig
from tactsim.bench.space.space_run import SpaceRun
from tactsim.bench.space.space_score import Scored
from tactsim.core.errors import InputError

_OF_TRIALS = ("seed", "objects", "shapes", "trials", "scan")  # what decides what is hidden, and where


def compare_in_space(base: SpaceRun, new: SpaceRun) -> list[Difference]:
    """Compare two runs trial by trial, over the touches that both have.

    Gated, with paired bootstrap intervals: the share of touches after which the object is right, and surface
    distance and angle after the last touch where both have named the object. Reported: accuracy with McNemar's exact
    test at some touches, touches to settle, time. The touches themselves may differ: chosen ones, or those of a hand.

    Raises InputError if the runs did not hide the same objects at the same poses.
    """
    for name in ("truth", "trial", "true_pose"):
        if not np.array_equal(getattr(base.trials, name), getattr(new.trials, name)):
            raise InputError(
                "the runs did not hide the same objects at the same poses; "
                + what_to_align(base.config, new.config, _OF_TRIALS, SpaceConfig)
            )
    rng = np.random.default_rng(0)
    touches = min(base.touches, new.touches)
    before, after = (Scored(run.trials, run.surfaces) for run in (base, new))
    right = [run.trials.right[:, :touches] for run in (base, new)]
    rows = [paired("share of touches right", right[0].mean(axis=1), right[1].mean(axis=1), rng, +1)]
    both = right[0][:, -1] & right[1][:, -1]
    if both.any():
        at = both, touches - 1
        rows.append(paired(f"surface mm @{touches}", before.error[at], after.error[at], rng, -1))
        angles = np.degrees(before.angle[at]), np.degrees(after.angle[at])
        rows.append(paired(f"angle deg @{touches}", angles[0], angles[1], rng, -1))
    for touch in sorted({k for k in (1, 3, 5, 10, 20, touches) if k <= touches}):
        pair = right[0][:, touch - 1], right[1][:, touch - 1]
        rows.append(
            Difference(f"accuracy @{touch}", float(pair[0].mean()), float(pair[1].mean()), p=mcnemar(*pair))
        )
    for share in (0.5, 0.95):
        first, then = (settled_by(one, share) for one in right)
        rows.append(Difference(f"settled {100 * share:.0f} %", first, then))
    seconds = [run.times["seconds"]["recognition"] / run.touches for run in (base, new)]
    rows.append(Difference("s a touch", seconds[0], seconds[1]))
    return rows
