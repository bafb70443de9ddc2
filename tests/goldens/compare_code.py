"""Compare two versions of the code, one estimator, on the same scans: is a kernel that was replaced as good?

    python tests/goldens/compare_code.py BASE_CHECKOUT particle --particles 1000
    python tests/goldens/compare_code.py BASE_CHECKOUT refined --scans 20 --trials 2 --readings 20 --set halvings=4

BASE_CHECKOUT is another checkout of the project, with the old code. Its own `.venv/bin/python` is used where it has one
(or --base-python); the new code is the tactsim beside this file, with the Python that runs this script. Each scan is
pressed once, by the old code, and given to both as arrays; with the same seed both draw the same poses and readings.
All but --scans, --base-python and --keep goes to `bench run` of both. Use few trials and 20 scans: trials of one scan
share its maps, so that scans are what says something.

Printed: the share of equal labels; of both codes the share of right labels after 1, 5 and 20 readings and the mean
error, each with the difference and its 95 % interval, a bootstrap over the scans; errors are paired (both labels
right). Accept a method without random numbers if at least 99.5 % of labels are equal and the mean paired error differs
by less than 1 %; one with random numbers if the intervals hold 0 and are narrow enough to say so.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from make import rows_of, trials_of

HERE = Path(__file__).resolve().parents[2]


def bench(checkout: Path, python: Path, folder: Path, *words: str) -> None:
    """Call a verb of one version; its cache lies in `folder`, apart from the other's. Ends the script if it fails."""
    environment = os.environ | {
        "PYTHONPATH": str(checkout),
        "TACTSIM_CACHE_DIR": str(folder / f"cache-{checkout.name}"),
    }
    call = [python, "-c", "from tactsim.bench.cli import main; main()", *words]
    done = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{checkout}: bench {' '.join(words)}\n{done.stderr}")


def columns(run: Path) -> dict[str, np.ndarray]:
    """Read label, truth, reading and error of a run: (trials, readings) each."""
    lines = [line.split(",") for line in trials_of(run).splitlines()]
    names, rows = lines[0], lines[1:]
    readings = max(int(row["reading_number"]) for row in rows_of(run / "trials.csv"))
    table = {name: np.array([row[at] for row in rows]).reshape(-1, readings) for at, name in enumerate(names)}
    return table | {"error_mm": table["error_mm"].astype(float)}


def interval(of_scans: list[np.ndarray]) -> str:
    """Write mean and 95 % interval of differences, listed scan by scan; scans are drawn with replacement."""
    sums, counts = (np.array([part(of) for of in of_scans], dtype=float) for part in (np.sum, np.size))
    drawn = np.random.default_rng(0).integers(len(sums), size=(2000, len(sums)))
    means = sums[drawn].sum(axis=1) / np.maximum(counts[drawn].sum(axis=1), 1)
    low, high = np.quantile(means, [0.025, 0.975])
    return f"{sums.sum() / max(counts.sum(), 1):+.4f} ({low:+.4f} to {high:+.4f})"


def main() -> None:
    """Run both versions on every scan, and print the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("base", type=Path, help="the other checkout")
    parser.add_argument("estimator")
    parser.add_argument("--scans", type=int, default=20, help="seeds 0, 1 ...")
    parser.add_argument("--trials", default="2", help="of each of the five letters")
    parser.add_argument("--readings", default="20")
    parser.add_argument(
        "--base-python", type=Path, help="default: .venv/bin/python of the base, else this one"
    )
    parser.add_argument("--keep", type=Path, help="a folder for scans and runs; default: they are removed")
    asked, options = parser.parse_known_args()
    base, own = asked.base.resolve(), asked.base.resolve() / ".venv" / "bin" / "python"
    python = asked.base_python or (own if own.exists() else Path(sys.executable))
    sides = {"base": (base, python), "new": (HERE, Path(sys.executable))}
    common = [
        "--estimator",
        asked.estimator,
        "--trials",
        asked.trials,
        "--readings",
        asked.readings,
        *options,
    ]
    pairs = []
    with TemporaryDirectory() as temporary:
        folder = (asked.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for seed in map(str, range(asked.scans)):
            bench(base, python, folder, "scan", "--seed", seed, "--out", f"scan-{seed}.npz")
            for side, (checkout, its_python) in sides.items():
                words = ("--scan", f"scan-{seed}.npz", "--seed", seed, "--out", f"{side}-{seed}")
                bench(checkout, its_python, folder, "run", *common, *words)
            old, new = (columns(folder / f"{side}-{seed}") for side in sides)
            if not np.array_equal(old["reading"], new["reading"]):
                sys.exit(f"seed {seed}: the two versions draw other readings; their trials are no pairs")
            pairs.append((old, new))

    equal = np.concatenate([old["label"] == new["label"] for old, new in pairs])
    print(
        f"{asked.estimator}: {asked.scans} scans, {len(equal)} trials; labels equal {equal.mean():.4f} of {equal.size}"
    )
    right = [[side["label"] == side["truth"] for side in pair] for pair in pairs]
    for reading in (1, 5, 20):
        if reading <= equal.shape[1]:
            old, new = (np.concatenate([of[at][:, reading - 1] for of in right]).mean() for at in (0, 1))
            away = interval([after[:, reading - 1] * 1.0 - before[:, reading - 1] for before, after in right])
            print(f"right@{reading}: base {old:.4f}, new {new:.4f}, new - base {away}")
    for title, chosen in (("all readings", slice(None)), (f"reading {equal.shape[1]}", slice(-1, None))):
        both = [
            [side["error_mm"][:, chosen][(a & b)[:, chosen]] for side in pair]
            for pair, (a, b) in zip(pairs, right, strict=True)
        ]
        old, new = (np.concatenate([of[at] for of in both]).mean() for at in (0, 1))
        away = interval([after - before for before, after in both])
        share = f"{100 * (new - old) / old:+.2f} %"
        print(f"paired error, {title}: base {old:.4f} mm, new {new:.4f} mm ({share}), new - base {away} mm")


if __name__ == "__main__":
    main()
