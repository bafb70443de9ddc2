"""Make the goldens: what the command line gave, kept small, to compare with what it gives after a change.

    python tests/goldens/make.py FOLDER [NAME ...]     # of the tactsim that is imported; all: four minutes

`tests/goldens/0.1` is what commit 95d8bf5 gave; the world `resistive` came later. It is renewed only in a commit of its
own that says why. Each golden calls verbs as a user does, and reads nothing but the files that they write.

    run-ESTIMATOR.csv     five letters, 5 trials, 20 readings, seed 0: label, its probability, placement error
    scan-WORLD.json       hashes of the arrays, and every sixtieth reading in full
    recording.csv         a plan that the emulator records, `bench replay --scan`, and a run on that scan
    solids-ESTIMATOR.csv  two objects in space, 3 trials, 8 touches; and their scan, scan-solids.json
    stress.csv            the quick cases: verdict, limit and worst deviation
    tasks.json            the hashes that the tasks state
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable
from functools import partial
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

ESTIMATORS = (
    *("histogram", "particle", "augmented-mcl", "refined", "force-mosaic", "synthesis", "graded"),
    *("nearest", "bag-of-features"),
)
SPACE_ESTIMATORS = ("space-refined",)
WORLDS = (  # slip's scan is that of default
    *("default", "level", "paper-like", "rough", "handheld", "ideal"),
    "resistive",
)
EMULATED = ("--rate", "20", "--hold", "0.3", "--lift", "0.3")
STEP = 0.7  # kPa, the resolution of the sensor in every world but ideal, whose readings have no steps
EVERY = 60  # which readings of a scan are kept in full


def bench(folder: Path, *words: str) -> str:
    """Call a verb in `folder` and return its standard output. Raises CalledProcessError if it fails."""
    call = [sys.executable, "-c", "from tactsim.bench.cli import main; main()", *words]
    environment = os.environ | {"NO_COLOR": "1", "COLUMNS": "200"}
    done = subprocess.run(call, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout


def rows_of(path: Path) -> list[dict[str, str]]:
    """Read a table of a run's folder."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def pose(row: dict[str, str], prefix: str = "") -> np.ndarray:
    """Return the estimated or (prefix "true_") true robot_in_object of a row, (3,) mm and rad."""
    return np.array([float(row[prefix + name]) for name in ("x", "y", "theta")])


def placement_error(estimated: np.ndarray, true: np.ndarray, facts: dict[str, Any]) -> float:
    """Return the paper's error (ref. 24) of an object in the robot frame, mm, from two robot_in_object (3,).

    facts: symmetry (order, 0: a disc), centre (2,) mm and inertia_over_mass mm^2 of the true object.
    """

    def placed(robot: np.ndarray) -> np.ndarray:  # where the object's centre lies in the robot frame
        cosine, sine = np.cos(robot[2]), np.sin(robot[2])
        return (np.asarray(facts["centre"]) - robot[:2]) @ np.array([[cosine, -sine], [sine, cosine]])

    away = placed(estimated) - placed(true)
    order = facts["symmetry"]
    turn = np.angle(np.exp(1j * order * (estimated[2] - true[2]))) / order if order else 0.0
    return float(np.sqrt(away @ away + facts["inertia_over_mass"] * 2 * (1 - np.cos(turn))))


def table(names: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Write lines of a CSV; numbers with six digits."""
    lines = [
        ",".join(f"{value:.6g}" if isinstance(value, float) else str(value) for value in row) for row in rows
    ]
    return "\n".join([",".join(names), *lines]) + "\n"


def trials_of(run: Path) -> str:
    """Write what a run in the plane said: a row a trial and reading."""
    objects = json.loads((run / "run.json").read_text())["objects"]
    kept = ("truth", "trial", "reading_number", "reading", "label")
    rows = (
        (*(row["touch_index" if name == "reading" else name] for name in kept), float(row["p_label"]),
         placement_error(pose(row), pose(row, "true_"), objects[row["truth"]]))
        for row in rows_of(run / "trials.csv")
    )  # fmt: skip
    return table((*kept, "p_label", "error_mm"), rows)


def hash_of(array: np.ndarray, step: float) -> str:
    """Hash an array in whole steps (SHA-256, hex), so that its last bits say nothing."""
    return hashlib.sha256(np.rint(array / step).astype("<i8").tobytes()).hexdigest()


def scan_facts(path: Path) -> str:
    """Write hashes of a scan's arrays, and some of its readings (kPa) in full."""
    with np.load(path, allow_pickle=False) as arrays:
        names = set(arrays.files) & {"readings", "poses", "sensor_in_object", "labels", "split", "taxel_xy"}
        scan = {name: arrays[name] for name in sorted(names)}
    facts: dict[str, Any] = {"shape": list(scan["readings"].shape)}
    for name, array in scan.items():
        if array.dtype.kind == "U":
            facts[name] = hashlib.sha256("\n".join(array.tolist()).encode()).hexdigest()
        else:
            facts[name] = hash_of(array, 1e-6)
    facts["readings"] = hashlib.sha256(scan["readings"].astype("<f8").tobytes()).hexdigest()
    facts["readings_in_steps"] = hash_of(scan["readings"], STEP)
    facts["sample"] = [
        " ".join(f"{value:.6g}" for value in row) for row in scan["readings"][::EVERY].tolist()
    ]
    return json.dumps(facts, indent=1) + "\n"


def run(estimator: str, folder: Path) -> str:
    """Run an estimator in the plane."""
    bench(folder, "run", "--estimator", estimator, "--trials", "5", "--readings", "20", "--out", "run")
    return trials_of(folder / "run")


def scan(world: str, folder: Path) -> str:
    """Press the letters in a world."""
    bench(folder, "scan", "--world", world, "--no-cache", "--out", "scan.npz")
    return scan_facts(folder / "scan.npz")


def plan() -> str:
    """Write a plan for the emulator: three letters at 32 poses of a grid for training, and at 8 for tests."""
    rng = np.random.default_rng(0)
    lines = ["label,split,x_mm,y_mm,theta_rad"]
    for letter in "AIO":
        for turn in (0, 1.57):
            for place in range(16):
                x, y = (round(-10.2 + 6.8 * step, 1) for step in (place % 4, place // 4))
                lines.append(f"{letter},train,{x},{y},{turn}")
        for x, y, turn in rng.uniform((-10, -10, 0), (10, 10, 6.28), (8, 3)).round(2).tolist():
            lines.append(f"{letter},test,{x},{y},{turn}")
    return "\n".join(lines)


def recording(folder: Path) -> str:
    """Record the emulated pad, make a scan of the recording, and run on it."""
    (folder / "plan.csv").write_text(plan())
    bench(folder, "emulate", "--plan", "plan.csv", "--out", "pad.tactrec", "--marks", "marks.csv", *EMULATED)
    whole = ("--moments", "off")  # commit 95d8bf5 took none unless it was asked
    bench(
        folder, "replay", "pad.tactrec", "--marks", "marks.csv", "--letters", "AIO", "--scan", "pad.npz",
        *whole,
    )  # fmt: skip
    words = ("--estimator", "histogram", "--bins", "1000", "--trials", "4", "--readings", "8", "--out", "run")
    bench(folder, "run", "--scan", "pad.npz", *words)
    return trials_of(folder / "run")


def solids(estimator: str, folder: Path) -> str:
    """Recognise two objects in space: label, its probability, whether the touch met, distance of the position, mm."""
    words = ("--task", "solids", "--objects", "key,mug", "--trials", "3", "--touches", "8", "--out", "run")
    bench(folder, "run", "--estimator", estimator, *words)
    kept = ("truth", "trial", "touch_number", "label", "met")
    rows = []
    for row in rows_of(folder / "run" / "trials.csv"):
        away = [float(row[axis]) - float(row[f"true_{axis}"]) for axis in "xyz"]
        rows.append((*(row[name] for name in kept), float(row["p_label"]), float(np.linalg.norm(away))))
    return table((*kept, "p_label", "away_mm"), rows)


def scan_solids(folder: Path) -> str:
    """Touch two objects in space."""
    bench(folder, "scan", "--task", "solids", "--objects", "key,mug", "--no-cache", "--out", "scan.npz")
    return scan_facts(folder / "scan.npz")


def stress(folder: Path) -> str:
    """Do the quick stress cases: each one's verdict, limit and worst deviation."""
    cases = json.loads(bench(folder, "stress", "--tag", "quick", "--json"))["cases"]
    kept = ("name", "verdict", "limit_is", "limit", "worst")
    return table(kept, ([case[name] for name in kept] for case in cases))


def tasks(folder: Path) -> str:
    """Read the hashes that the tasks state."""
    homes = files("tactsim.bench") / "tasks"
    named = {home.name.removesuffix(".toml"): home for home in homes.iterdir() if home.name.endswith(".toml")}
    stated = {name: tomllib.loads(named[name].read_text())["hashes"] for name in sorted(named)}
    return json.dumps(stated, indent=1) + "\n"


GOLDENS: dict[str, Callable[[Path], str]] = {
    "tasks.json": tasks,
    **{f"scan-{world}.json": partial(scan, world) for world in WORLDS},
    "scan-solids.json": scan_solids,
    **{f"run-{name}.csv": partial(run, name) for name in ESTIMATORS},
    **{f"solids-{name}.csv": partial(solids, name) for name in SPACE_ESTIMATORS},
    "recording.csv": recording,
    "stress.csv": stress,
}


def make(name: str) -> str:
    """Make one of `GOLDENS` with the tactsim that is imported."""
    with TemporaryDirectory() as folder:
        return GOLDENS[name](Path(folder))


if __name__ == "__main__":
    out, *wanted = sys.argv[1:]
    Path(out).mkdir(parents=True, exist_ok=True)
    for golden in wanted or GOLDENS:
        (Path(out) / golden).write_text(make(golden))
