"""How estimators grow with the number of letters.

`python tests/estimators/bench_letters.py` prints for 5, 36 and 200 letters the processor time of a reading (the mean of
a trial, of its first eight, and the first) and of the fit, and the peak of memory. Each row is a process of its own. 5
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
READINGS, EARLY, TRIALS = 60, 8, 6


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


def measure(name, path):
    """Fit and follow some sequences in this process; print milliseconds a reading, seconds and GB."""
    scan = Scan.load(path)
    begin = time.process_time()
    estimator = estimators.create(name)
    estimator.fit(scan)
    fitted = time.process_time() - begin
    spent = np.zeros((TRIALS, READINGS))
    for trial in range(-1, TRIALS):  # the first warms up
        rng = np.random.default_rng(trial + 1)
        label = scan.letters[7 * (trial + 1) % len(scan.letters)]
        readings, poses, _ = draw_trial(scan, label, READINGS, rng)
        estimator.reset(rng)
        for touch in range(READINGS):
            begin = time.process_time()
            estimator.update(readings[touch], poses[touch])
            estimator.estimate()
            spent[trial, touch] = time.process_time() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    each, early, first = (1e3 * part.mean() for part in (spent, spent[:, :EARLY], spent[:, 0]))
    print(f"{each:.2f} {early:.2f} {first:.2f} {fitted:.1f} {peak:.2f}")


def main():
    """Make the scans, and print a row for each estimator and number of letters."""
    with tempfile.TemporaryDirectory() as folder:
        pressed = tactsim.scan(letters=GLYPHS, test_poses="random")
        scans = {5: tactsim.scan(letters=GLYPHS[:5], test_poses="random"), 36: pressed}
        scans[200] = enlarged(pressed, 200)
        print("asked: 36 letters at most 2 times 5; 200 letters at most 20 ms a reading and 1 GB")
        print(
            f"{'estimator':14} letters  ms a reading of {READINGS}  of {EARLY}  the first  fit s  peak GB"
            f"  times 5 letters: {READINGS}  {EARLY}"
        )
        for name in ESTIMATORS:
            of_five = None
            for count in COUNTS:
                path = Path(folder) / f"{count}.npz"
                scans[count].save(path)
                done = subprocess.run(
                    [sys.executable, __file__, name, str(path)], stdout=subprocess.PIPE, text=True, check=True
                )
                each, early, first, fit, peak = map(float, done.stdout.split())
                of_five = of_five or (each, early)
                row = f"{each:19.2f} {early:5.2f} {first:10.2f} {fit:6.1f} {peak:8.2f}"
                row += f" {each / of_five[0]:20.1f} {early / of_five[1]:4.1f}"
                print(f"{name:14} {count:7} {row}", flush=True)


if __name__ == "__main__":
    measure(*sys.argv[1:]) if len(sys.argv) > 1 else main()
