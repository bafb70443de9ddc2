"""How well estimators recognise recorded presses that were trained on simulated ones, beside recorded ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.config import RunConfig
from tactsim.bench.experiment import perform
from tactsim.bench.score import wilson
from tactsim.bench.trials import Progress
from tactsim.core import Scan
from tactsim.core.scan import train_on

TOUCHES = (1, 2, 3, 5, 10)
_MOST_TOUCHES = 20
_RIGHT = 0.95


def recognised(
    train: Scan,
    recorded: Scan,
    estimator: str,
    options: Mapping[str, Any],
    trials: int,
    seed: int,
    progress: Progress,
) -> dict[str, Any]:
    """Train on one scan and recognise the test presses of a recorded one, or all if it has none.

    The same seed gives the same touches whatever was trained on.
    """
    scan = train_on(train.of_letters(recorded.letters), recorded)
    fewest = min(len(scan.where("test", letter)) for letter in scan.letters)
    config = RunConfig(
        estimator=estimator, set=dict(options), trials=trials, readings=min(_MOST_TOUCHES, fewest), seed=seed,
        given=scan.digest,
    )  # fmt: skip
    run = perform(config, scan=scan, progress=progress)
    right = run.trials.right
    accuracy = right.mean(axis=0)
    low, high = wilson(right.sum(axis=0), len(right))
    errors = run.summary["error_mm"]
    return {
        "trials": len(right),
        "touches": config.readings,
        "accuracy": accuracy.tolist(),
        "accuracy_low": low.tolist(),
        "accuracy_high": high.tolist(),
        "touches_to_95": touches_to(accuracy),
        "error_mm": errors[-1],
        "options": run.about["options"],
    }


def touches_to(accuracy: Sequence[float] | NDArray[np.float64]) -> int | None:
    """Count the touches from which on at least 95 % are right, (touches,) accuracy; None if that is never so."""
    below = np.flatnonzero(np.asarray(accuracy) < _RIGHT)
    first = int(below[-1]) + 2 if len(below) else 1
    return first if first <= len(accuracy) else None
