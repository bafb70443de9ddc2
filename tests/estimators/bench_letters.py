"""How estimators grow with the number of letters.

`python tests/estimators/bench_letters.py` prints for 5, 36 and 200 letters the processor time of a reading (the mean of
a trial, of its first eight, and the first; the median of three rounds) and of the fit, and the peak of memory. 5 and 36
are compared in one process, a trial of one after a trial of the other; fits and memory are of processes of their own. 5
and 36 are pressed; 200 are these and more, stretched and slanted.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from synthetic import draw_trial

import tactsim
from tactsim import estimators
from tactsim.core import Scan, transform
from tactsim.estimators.likelihoods.mosaic import Grid, learn_mosaic

ESTIMATORS = ("histogram", "refined", "force-mosaic")
COUNTS = (5, 36, 200)
GLYPHS = "AEIOUBCDFGHJKLMNPQRSTVWXYZ0123456789"
READINGS, EARLY, TRIALS, ROUNDS = 60, 8, 6, 3


def enlarged(scan, count):
    """Add stretched and slanted copies of a scan's letters, until there are `count`."""
    rng = np.random.default_rng(0)
    parts = [(scan.readings, scan.poses, scan.labels.astype("U4"), scan.split)]
    for number in range(count - len(scan.letters)):
        label = scan.letters[number % len(scan.letters)]
        mine = scan.where(label=label)
        places = transform(mine.poses, mine.taxel_xy)
        grid = Grid(np.array([-24.0, -24.0]), 0.4, (121, 121), 1.0)
        felt = learn_mosaic(places.reshape(-1, 2), mine.readings.flatten(), np.ones(mine.readings.size), grid)
        warp = np.diag(rng.uniform(0.8, 1.2, 2)) @ np.array([[1, rng.uniform(-0.3, 0.3)], [0, 1]])
        readings = np.maximum(felt(places @ warp.T)[0], 0) + rng.normal(0, 2, mine.readings.shape)
        names = np.full(len(mine), f"{label}{number // len(scan.letters) + 1}")
        parts.append((readings, mine.poses, names, mine.split))
    return Scan(*(np.concatenate(column) for column in zip(*parts, strict=True)), scan.taxel_xy)


def follow(estimator, scan, trial):
    """Follow a sequence; give the milliseconds of each reading (READINGS,)."""
    rng, spent = np.random.default_rng(trial + 1), np.zeros(READINGS)
    readings, poses, _ = draw_trial(scan, scan.letters[7 * (trial + 1) % len(scan.letters)], READINGS, rng)
    estimator.reset(rng)
    for touch in range(READINGS):
        begin = time.process_time()
        estimator.update(readings[touch], poses[touch])
        estimator.estimate()
        spent[touch] = 1e3 * (time.process_time() - begin)
    return spent


def measure(name, *paths):
    """Fit to each scan and follow sequences in this process, in turns; print a line for each.

    It has milliseconds, seconds of the fit, and the peak of memory so far, GB.
    """
    made, fitted = [], []
    scans = [Scan.load(path) for path in paths]
    for scan in scans:
        begin = time.process_time()
        made.append(estimators.create(name))
        made[-1].fit(scan)
        fitted.append(time.process_time() - begin)
        follow(made[-1], scan, -1)  # warms up
    spent = np.zeros((len(scans), ROUNDS, TRIALS, READINGS))
    for number in range(ROUNDS):
        for trial in range(TRIALS):
            for k, scan in enumerate(scans):
                spent[k, number, trial] = follow(made[k], scan, trial)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    for k in range(len(scans)):
        parts = spent[k], spent[k, ..., :EARLY], spent[k, ..., :1]
        each = (float(np.median(part.mean(axis=(1, 2)))) for part in parts)
        print(*(f"{value:.3f}" for value in (*each, fitted[k], peak)))


def in_turns(name, folder, *counts):
    """Measure in a process of its own: a list of numbers for each number of letters."""
    paths = [str(folder / f"{count}.npz") for count in counts]
    done = subprocess.run(
        [sys.executable, __file__, name, *paths], stdout=subprocess.PIPE, text=True, check=True
    )
    return [list(map(float, line.split())) for line in done.stdout.splitlines()]


def main():
    """Make the scans, and print a row for each estimator and number of letters."""
    with tempfile.TemporaryDirectory() as name_of_folder:
        folder = Path(name_of_folder)
        pressed = tactsim.scan(letters=GLYPHS, test_poses="random")
        tactsim.scan(letters=GLYPHS[:5], test_poses="random").save(folder / "5.npz")
        pressed.save(folder / "36.npz")
        enlarged(pressed, 200).save(folder / "200.npz")
        print("asked: 36 letters at most 2 times 5; 200 letters at most 20 ms a reading and 1 GB")
        print(
            f"{'estimator':14} letters  ms a reading of {READINGS}  of {EARLY}  the first  fit s  peak GB"
            f"  times 5 letters: {READINGS}  {EARLY}"
        )
        for name in ESTIMATORS:
            alone = [in_turns(name, folder, count)[0] for count in COUNTS]
            times = [*in_turns(name, folder, *COUNTS[:2]), alone[2]]
            for count, (each, early, first, *_), (*_, fit, peak) in zip(COUNTS, times, alone, strict=True):
                row = f"{each:19.2f} {early:5.2f} {first:10.2f} {fit:6.1f} {peak:8.2f}"
                row += f" {each / times[0][0]:20.2f} {early / times[0][1]:5.2f}"
                print(f"{name:14} {count:7} {row}", flush=True)


if __name__ == "__main__":
    measure(*sys.argv[1:]) if len(sys.argv) > 1 else main()
