"""Count how many regions of 90 % hold the truth as often as they say, and how many would if they were exact.

    python tests/bench/measure_regions.py [SWEEP]

Of the runs of SWEEP (results/sweeps/robustness), after 3, 5, 10 and 20 readings each. A share of trials of a few scans
is known only as well as its bootstrap says: regions that are exact would be out of range by chance, too.
"""

import sys
from pathlib import Path
from statistics import NormalDist

import numpy as np

from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import pool

METHODS = ("refined", "force-mosaic", "graded")
READINGS = (3, 5, 10, 20)
NOMINAL, OFF = 0.9, 0.03
DIGITS = 3  # of a share, as the tables have it


def main(folder: Path) -> None:
    """Print a line for each method."""
    pools = pool(Run.load(one) for one in sorted((folder / "runs").iterdir()))
    for method in METHODS:
        shares, errors = [], []
        for one in pools:
            for k in READINGS if one.method == method else ():
                right = one.trials.right[:, k - 1]
                share = one.mean(one.trials.credibility[:, k - 1] <= NOMINAL, right)
                shares.append(share.value)
                errors.append((share.high - share.low) / (2 * NormalDist().inv_cdf(0.975)))
        found = np.array(shares).round(DIGITS)
        below = np.count_nonzero(found < round(NOMINAL - OFF, DIGITS))
        above = np.count_nonzero(found > round(NOMINAL + OFF, DIGITS))
        expected = sum(2 * NormalDist(0, error).cdf(OFF) - 1 for error in errors)
        print(
            f"{method}: of {len(found)} shares {len(found) - below - above} lie within {OFF} of {NOMINAL}, {below} "
            f"below and {above} above; mean {found.mean():.3f}; about {expected:.0f} would lie there if all regions "
            "were exact"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("results/sweeps/robustness"))
