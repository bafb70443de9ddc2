"""How the time of a reading grows with the sequence and with the taxels, and what share of it is Python.

`OPENBLAS_NUM_THREADS=1 python tests/estimators/bench_growth.py` prints a table, in about a minute and a half.
`--beside PATH` also measures the histogram of another checkout, in turns, and prints the ratio. Times are processor
time; what counts are their ratios, measured in turns in one run.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from synthetic import draw_trial, make_scan, paper_poses, square_pad

import tactsim
from tactsim import Scan, estimators
from tactsim.estimators import Estimator

CHECKPOINTS = (10, 100, 1_000, 10_000)
SIDES = (6, 16, 32)
# How many of the readings around a checkpoint are averaged: single ones differ by what they make matter.
AROUND = 0.2


def clock(work: Callable[..., object], *args: object) -> float:
    start = time.process_time_ns()
    work(*args)
    return (time.process_time_ns() - start) / 1e6


def one_reading(estimator: Estimator, reading: np.ndarray, pose: np.ndarray) -> None:
    estimator.update(reading, pose)
    estimator.estimate()


def long_trial(scan: Scan, letter: str, readings: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a trial that is longer than the test split: its readings come again and again, at random."""
    shown, poses, _ = draw_trial(scan, letter, readings, np.random.default_rng(seed))
    order = np.random.default_rng(seed).integers(len(shown), size=readings)
    return shown[order], poses[order]


def of_sequence(name: str, scan: Scan, checkpoints: tuple[int, ...], trials: int, **options: object) -> None:
    """Print ms a reading around each checkpoint, and the last as a multiple of that at 100."""
    estimator = estimators.create(name, **options)
    estimator.fit(scan)
    found: dict[int, list[float]] = {point: [] for point in checkpoints}
    for seed in range(trials):
        readings, poses = long_trial(scan, scan.letters[seed % len(scan.letters)], checkpoints[-1], seed)
        estimator.reset(np.random.default_rng(seed))
        took = np.array([clock(one_reading, estimator, *one) for one in zip(readings, poses, strict=True)])
        for point in checkpoints:
            found[point].append(float(took[int(point * (1 - AROUND)) : point].mean()))
    means = {point: float(np.mean(times)) for point, times in found.items()}
    print(f"{name}: " + ", ".join(f"{mean:.3f} ms at reading {point:,}" for point, mean in means.items()))
    asked = "asked at most 2" if name == "histogram" else "no figure is asked"
    print(f"  {checkpoints[-1]:,} beside 100: {means[checkpoints[-1]] / means[100]:.2f} x; {asked}")


def of_taxels(names: tuple[str, ...], readings: int, trials: int) -> None:
    """Print ms a reading for pads of equal size with more and more taxels."""
    made = {}
    for side in SIDES:
        scan = make_scan("EILT", square_pad(side, side, 11.4 / side), paper_poses(4, 4))
        for name in names:
            made[name, side] = estimators.create(name), scan
            made[name, side][0].fit(scan)
    times: dict[tuple[str, int], list[float]] = {key: [] for key in made}
    for seed in range(trials):
        for key, (estimator, scan) in made.items():
            rng = np.random.default_rng(seed)
            shown, poses, _ = draw_trial(scan, scan.letters[seed % 4], readings, rng)
            estimator.reset(rng)
            took = [clock(one_reading, estimator, *one) for one in zip(shown, poses, strict=True)]
            times[key].append(sum(took) / readings)
    for name in names:
        typical = {side: median(times[name, side]) for side in SIDES}
        print(f"{name}: " + ", ".join(f"{ms:.2f} ms with {side**2:,} taxels" for side, ms in typical.items()))
        print(f"  1,024 beside 36: {typical[32] / typical[6]:.1f} x; asked at most 10")


def share_of_python(scan: Scan, trials: int) -> None:
    """Print what share of a reading of the histogram with 10,000 bins each kernel takes; the rest is Python."""
    from tactsim.estimators.field import field
    from tactsim.estimators.filters import binned

    estimator = estimators.create("histogram", bins=10_000)
    estimator.fit(scan)
    kernels = ((field, "record"), (binned, "advance"), (binned, "summarise"), (binned, "bins_from"))
    plain = [getattr(module, name) for module, name in kernels]
    inside = {name: 0.0 for _, name in kernels}

    def timed(name: str, kernel: Callable[..., object], *args: object) -> object:
        start = time.process_time_ns()
        result = kernel(*args)
        inside[name] += (time.process_time_ns() - start) / 1e6
        return result

    for (module, name), kernel in zip(kernels, plain, strict=True):
        setattr(module, name, partial(timed, name, kernel))
    histogram_times(estimator, scan, 2)
    inside.update(dict.fromkeys(inside, 0.0))
    whole = sum(histogram_times(estimator, scan, trials))
    for (module, name), kernel in zip(kernels, plain, strict=True):
        setattr(module, name, kernel)
    shares = ", ".join(f"{name} {spent / whole:.0%}" for name, spent in inside.items())
    print(f"histogram, 5 letters x 10,000 bins: {shares}, Python {1 - sum(inside.values()) / whole:.0%}")


def histogram_times(estimator: Estimator, scan: Scan, trials: int, readings: int = 20) -> list[float]:
    times = []
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        shown, poses, _ = draw_trial(scan, scan.letters[seed % len(scan.letters)], readings, rng)
        estimator.reset(rng)
        times += [clock(one_reading, estimator, *one) for one in zip(shown, poses, strict=True)]
    return times


def vowels() -> Scan:
    return tactsim.scan(letters="AEIOU")


def ms_a_reading(trials: int = 25) -> float:
    """Measure the histogram, mean over trials of 20 readings: the least of three rounds."""
    estimator, scan = estimators.create("histogram", bins=10_000), vowels()
    estimator.fit(scan)
    histogram_times(estimator, scan, 2)
    return min(float(np.mean(histogram_times(estimator, scan, trials))) for _ in range(3))


def beside(other: Path) -> None:
    """Print ms a reading of the histogram of this checkout and of another one, by turns."""
    ours, theirs = [], []
    for _ in range(3):
        for root, found in ((Path(tactsim.__file__).parents[1], ours), (other, theirs)):
            ran = subprocess.run(
                [root / ".venv/bin/python", __file__, "--one"],
                cwd=root,
                check=True,
                capture_output=True,
                text=True,
            )
            found.append(float(ran.stdout))
    print(f"histogram: {median(ours):.3f} ms a reading here, {median(theirs):.3f} ms in {other}")
    print(f"  ratio {median(a / b for a, b in zip(ours, theirs, strict=True)):.2f}; asked at most 0.6")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--beside", type=Path, help="another checkout, with its own .venv")
    parser.add_argument(
        "--one", action="store_true", help="print ms a reading of the histogram and nothing else"
    )
    chosen = parser.parse_args()
    if chosen.one:
        print(ms_a_reading())
        return
    if chosen.beside:
        beside(chosen.beside.resolve())
    scan = vowels()
    of_sequence("histogram", scan, CHECKPOINTS, 2, bins=10_000)
    for name in ("refined", "force-mosaic", "tempered"):
        of_sequence(name, scan, CHECKPOINTS[:3], 1)
    share_of_python(scan, 25)
    of_taxels(("histogram", "refined", "force-mosaic"), 8, 3)


if __name__ == "__main__":
    sys.exit(main())
