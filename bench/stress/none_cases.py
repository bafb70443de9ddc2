"""None of these: odd priors, odd readings, and letters that were learned in odd worlds."""

from __future__ import annotations

import numpy as np

from tactsim.bench.stress.case import Worst, case
from tactsim.bench.stress.case_data import few, fitted, hidden, pressed, see_sound


@case(
    "none.odd-readings",
    varied="prior of none 1e-12 to 1 - 1e-12; readings times 0 to 1e6, below 0, all alike",
    deviation="sum of the probabilities from 1, after each of 5 readings",
    limit=1e-9,
    because="odds are kept in logs, and every variance has a floor",
)
def odd_readings(worst: Worst) -> None:
    """Ask whether it is none of the letters, whatever is felt."""
    scan = few(pressed("AEI"), 5)
    readings, poses, _ = hidden(scan, "E", 5)
    for unknown in (1e-12, 0.5, 1 - 1e-12):
        estimator = fitted("refined", scan, bins=1000, unknown=unknown)
        for what, felt in (
            *((f"times {factor:g}", factor * readings) for factor in (0, 1e-3, 0.1, 10, 1e6)),
            ("below 0", -readings),
            ("all alike", np.full_like(readings, 40.0)),
        ):
            see_sound(worst, estimator, felt, poses, f"prior {unknown:g}, {what}")
