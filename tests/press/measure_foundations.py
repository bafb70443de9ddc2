"""Print how near the foundations are to a fine grid, and how far springs are from them.

python tests/press/measure_foundations.py

Errors are over the taxels of a press, relative to the highest one, after a point spread of 1 mm unless there is none:
five vowels at eight poses, presses of 4 mm^2 or more. Time is CPU of one core from covered cells to pressure.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # two threads cost more than they save at this size

from time import process_time

import numpy as np
from test_elastic import compare, press, solid

from tactsim.press.scan_poses import grid_poses

SOLIDS = (
    ("layer", 0.5, 0.45),
    ("layer", 1.0, 0.45),
    ("layer", 1.0, 0.49),
    ("layer", 2.0, 0.45),
    ("half-space", 1.0, 0.45),
)


def errors(options, tilt=(0.0, 0.0), springs=False):
    """Give mean and largest rms, and mean and largest worst taxel, in % of the highest taxel."""
    every = [compare(name, grid_poses()[5::24], options, tilt, springs=springs) for name in "AEIOU"]
    rms, worst = 100 * np.concatenate(every).T
    return f"{rms.mean():.1f} / {rms.max():.1f} | {worst.mean():.1f} / {worst.max():.1f}"


def microseconds(options, rounds=5):
    """Time presses of the vowels at 192 poses, per press: the median of rounds."""
    times = []
    for _ in range(rounds):
        start, presses = process_time(), 0
        for name in "AEIOU":
            bed, _ = press(name, grid_poses(), options)
            presses += np.count_nonzero(np.diff(bed.start))
        times.append((process_time() - start) / presses)
    return 1e6 * float(np.median(times))


def main() -> None:
    """Print the tables."""
    print("solid | cells | rms mean / largest | worst taxel mean / largest | springs: rms | worst taxel | us")
    for foundation, thickness, poisson in SOLIDS:
        for cells in (2, 3):
            options = solid(foundation, thickness=thickness, poisson=poisson, cells_per_taxel=cells)
            print(
                f"{foundation} {thickness:g} mm, nu {poisson} | {cells} | {errors(options)} "
                f"| {errors(options, springs=True)} | {microseconds(options):.0f}",
                flush=True,
            )
    for foundation in ("layer", "half-space"):
        print(f"{foundation}, no point spread | 2 | {errors(solid(foundation, sigma=0.0))}", flush=True)
    for tilt in ((0.003, 0.0), (0.01, -0.01), (0.03, 0.02), (0.1, 0.0)):
        for foundation in ("layer", "half-space"):
            print(f"{foundation}, tilt {tilt} rad | 2 | {errors(solid(foundation), tilt)}", flush=True)


if __name__ == "__main__":
    main()
