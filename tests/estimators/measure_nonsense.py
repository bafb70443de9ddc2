"""Count how often filters find back from readings that no letter gives.

    OPENBLAS_NUM_THREADS=1 python tests/estimators/measure_nonsense.py [TRIALS]

Three letters, TRIALS (20) of each. A sequence begins with three readings of taxels that are 0 or 60 kPa at random, and
goes on with thirty readings of the letter. `bench stress --case filters.after-nonsense` does the same with a few
sequences for every filter that draws no random numbers; here are those that draw, and `refined` beside them.
"""

import argparse

import numpy as np
from synthetic import draw_trial

import tactsim
from tactsim import estimators

LETTERS = "AEI"
FILTERS = {
    "refined": {},
    "tempered": {"particles": 10_000},
    "particle": {"particles": 10_000},
    "augmented-mcl": {"particles": 10_000},
}
NONSENSE, GOOD = 3, 30


def main(trials: int) -> None:
    """Print for each filter in how many sequences it names a wrong letter at the end."""
    scan = tactsim.scan(letters=LETTERS)
    for name, options in FILTERS.items():
        estimator = estimators.create(name, **options)
        estimator.fit(scan)
        wrong = 0
        for seed in range(trials):
            for number, label in enumerate(LETTERS):
                rng = np.random.default_rng([seed, number])
                readings, poses, _ = draw_trial(scan, label, NONSENSE + GOOD, rng)
                readings[:NONSENSE] = rng.choice([0.0, 60.0], (NONSENSE, readings.shape[1]))
                estimator.reset(rng)
                for reading, pose in zip(readings, poses, strict=True):
                    estimator.update(reading, pose)
                wrong += estimator.estimate().label != label
        print(f"{name}: a wrong letter in {wrong} of {trials * len(LETTERS)} sequences", flush=True)


if __name__ == "__main__":
    options = argparse.ArgumentParser()
    options.add_argument("trials", metavar="TRIALS", type=int, nargs="?", default=20, help="a whole number")
    main(options.parse_args().trials)
