"""Print what bounds a press and where a sweep's time goes: `python tests/profile/bench_sweep.py`, a minute.

All times are processor time of one core. What is compared takes turns in one run, and the least time of each counts.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any
from unittest import mock

import numpy as np
from flame_graphs import press

from tactsim.bench import results
from tactsim.bench.config import RunConfig, run_config
from tactsim.bench.experiment import finished_run, gather, plan_of, silent
from tactsim.bench.placement import Properties, fold_angle, placement_error
from tactsim.bench.trials import OneTrial, run_trials
from tactsim.core import invert, transform
from tactsim.press import balance, bed

ESTIMATORS: dict[str, dict[str, int]] = {
    "histogram": {"bins": 10000},
    "particle": {"particles": 10000},
    "refined": {},
    "force-mosaic": {},
    "graded": {},
    "synthesis": {},
    "nearest": {},
}
SWEEP = """
[defaults]
seed = [0, 1]
trials = 4
readings = 20
[[run]]
estimator = ["refined", "force-mosaic", "graded", "histogram"]
"""


def seconds(*works: Callable[[], object], turns: int = 5) -> list[float]:
    """Take turns with some works; the least processor time of each, s."""
    found = np.full((turns, len(works)), np.inf)
    for turn in range(turns):
        for number, work in enumerate(works):
            start = process_time()
            work()
            found[turn, number] = process_time() - start
    return [float(least) for least in found.min(axis=0)]


def print_ceilings() -> float:
    """Measure what this machine can do at most on one core; returns its bandwidth from memory, bytes/s."""
    large, small = np.ones((2, 1 << 25)), np.ones((2, 1 << 14))
    square, many = np.ones((1200, 1200)), np.linspace(0, 6, 1 << 14)

    def small_copies() -> None:
        for _ in range(1000):
            np.copyto(small[1], small[0])

    memory, cache, product, cosine = seconds(
        lambda: np.copyto(large[1], large[0]), small_copies, lambda: square @ square, lambda: np.cos(many)
    )
    bandwidth = 2 * large[0].nbytes / memory
    print("What one core of this machine can do")
    print(f"  copy in memory    {bandwidth / 1e9:6.1f} GB/s, read and written")
    print(f"  copy in the cache {2000 * small[0].nbytes / cache / 1e9:6.1f} GB/s")
    print(f"  matrix product    {2 * len(square) ** 3 / product / 1e9:6.1f} GFLOP/s")
    print(f"  cosines           {len(many) / cosine / 1e6:6.0f} million/s")
    return bandwidth


def print_presses(bandwidth: float) -> None:
    """Print the time of a press by the number of taxels, and what the moments of its cells cost at the least."""
    print("\nA press of an A, tilted, on a pad as large as the default one, 64 poses at a time")
    print("  taxels  ms a press  in lay_bed  bytes of moments  at the bandwidth  all at once / in blocks")
    for side in (6, 32, 64):
        work = press(side)
        counted = {"bytes": 0, "seconds": 0.0}

        def lay(*given: Any, counted: dict[str, Any] = counted, **words: Any) -> bed.Bed:
            start = process_time()
            laid = bed.lay_bed(*given, **words)
            counted["seconds"] += process_time() - start
            _, poses, x_lines, y_lines = given
            counted["bytes"] += 8 * words["moments"] * len(poses) * (len(x_lines) - 1) * (len(y_lines) - 1)
            return laid

        with mock.patch.object(balance, "lay_bed", lay):
            work()
            counted.update(bytes=0, seconds=0.0)
            start = process_time()
            work()
            whole = process_time() - start

        def at_once(work: Callable[[], object] = work) -> None:
            with mock.patch.object(bed, "_BLOCK", 1 << 60):
                work()

        once, blocks = seconds(at_once, work, turns=3)
        least = 2 * counted["bytes"] / bandwidth  # each is written and read once
        print(
            f"  {side}x{side:<4} {1e3 * blocks / 64:10.2f} {counted['seconds'] / whole:10.0%} "
            f"{counted['bytes'] / 64 / 1e6:14.2f} MB {1e3 * least / 64:13.2f} ms {once / blocks:18.2f}"
        )


def print_stages() -> None:
    """Print the time of each stage of runs in the default world, 4 trials of 20 readings a letter."""
    print("\nRuns on one scan of five letters, s; the first pays for the scan and for its bounds")
    print("  estimator       scan    fit  readings  other trial  score  save")
    gathered = None
    for name, options in ESTIMATORS.items():
        config: RunConfig = run_config(estimator=name, seed=100, trials=4, readings=20, **options)
        start = process_time()
        gathered = gathered or gather(config, jobs=1, cache=False, progress=silent)
        times = [process_time() - start]
        plan = plan_of(config, gathered.scan)
        plan.fitted()  # imports and compiled loops
        start = process_time()
        fitted = plan.fitted()
        times.append(process_time() - start)
        tasks = [OneTrial(letter, trial) for letter in gathered.letters for trial in range(4)]
        start = process_time()
        trials, work = run_trials(plan, fitted, tasks, progress=silent)
        within = float(trials.seconds.sum())
        times += [within, process_time() - start - within]
        start = process_time()
        run = finished_run(config, gathered, trials, work)
        times.append(process_time() - start)
        start = process_time()
        with tempfile.TemporaryDirectory() as folder:
            results.save(run, Path(folder) / "run")
        times.append(process_time() - start)
        scan, fit, readings, other, score, save = times
        print(f"  {name:14} {scan:5.2f} {fit:6.2f} {readings:9.2f} {other:12.2f} {score:6.2f} {save:5.2f}")


def print_errors() -> None:
    """Print the time of the placement errors of 4,000 samples against that of the formula as it is printed."""
    rng = np.random.default_rng(0)
    poses, at, of = rng.normal(size=(4000, 3)), rng.normal(size=3), Properties(1, (0.0, 0.0), 80.0)

    def printed() -> np.ndarray:
        placed, other, centre = invert(poses), invert(at), np.array([of.centre])
        shift = transform(placed, centre)[..., 0, :] - transform(other, centre)[..., 0, :]
        turn = fold_angle(placed[..., 2] - other[2], 1)
        return np.sqrt((shift**2).sum(axis=-1) + of.inertia_over_mass * 2 * (1 - np.cos(turn)))

    literal, ours = seconds(printed, lambda: placement_error(poses, at, of), turns=50)
    same = np.abs(printed() - placement_error(poses, at, of)).max()
    print(
        f"\nPlacement errors of 4,000 samples: printed formula / ours {literal / ours:.1f}, apart {same:.0e} mm"
    )


def print_sweep() -> None:
    """Print what two workers cost more than one: the processor time of `bench sweep` in both."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "some.toml").write_text(SWEEP)
        for seed in (0, 1):  # both sweeps then find the readings in the cache
            gather(run_config(estimator="nearest", seed=seed), jobs=1, cache=True, progress=silent)
        for jobs in (1, 2):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(
                [Path(sys.executable).parent / "bench", "sweep", "some.toml", "--jobs", str(jobs), "--out",
                 f"{len(times)}"],
                cwd=folder, check=True, capture_output=True,
            )  # fmt: skip
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    print(f"\nA sweep of 8 runs: processor time with two workers / with one {times[1] / times[0]:.2f}")


if __name__ == "__main__":
    print_presses(print_ceilings())
    print_stages()
    print_errors()
    print_sweep()
