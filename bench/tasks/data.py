"""Hash the data that a task gives to a method, and compare it with what the task states.

Whoever changes what is pressed, sensed or drawn changes the hash; who changes an estimator or a scan's `meta` does not.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import ArrayLike

from tactsim.bench import kinds
from tactsim.bench.config import run_config
from tactsim.bench.experiment import gather, silent
from tactsim.bench.tasks import Task
from tactsim.bench.trials import Progress, check_readings, run_trials
from tactsim.core import InputError, Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE, Estimate, Estimator, Options

STEP = 1e-6  # mm, rad, mm^2 and, where readings have no steps of their own, kPa: what differs by less is the same


def check_data(
    task: Task,
    seeds: Collection[int] | None = None,
    *,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress = silent,
) -> tuple[str, ...]:
    """Make the data of a task's seeds, or of some of them, and return their hashes, in the order of the task.

    seeds: those to look at; all if None. jobs: processes for the presses. cache: whether pressed readings may be read
    from the cache and kept there.
    Raises InputError if a hash is not the one that the task states.
    """
    found = []
    for number, seed in enumerate(task.seeds):
        if seeds is not None and seed not in seeds:
            continue
        found.append(hash_data(task, seed, jobs=jobs, cache=cache, progress=progress))
        if task.hashes and found[-1] != task.hashes[number]:
            raise InputError(
                f"task {task.name}: the data of seed {seed} have the hash {found[-1][:12]}..., and the task states "
                f"{task.hashes[number][:12]}...; results on other data cannot be compared: use a version of "
                "tactsim that gives the task's, or give the changed task a new version"
            )
    return tuple(found)


def hash_data(
    task: Task, seed: int, *, jobs: int = 1, cache: bool = True, progress: Progress = silent
) -> str:
    """Hash all that a method is given on one seed of a task, and all that it is judged by (SHA-256, hex).

    These are the scan (readings, poses, labels, split, taxels' places, the objects' properties of the error metric) and
    every trial (letter, the object's pose at each touch, which readings come in which order, the sensor's poses in the
    robot's frame, readings pressed on demand, the touches that are offered, the random numbers that the estimator
    gets). They are taken from real trials of an estimator that writes down what it is told, and always chooses the
    first touch. Not in the hash: a scan's `meta`, the versions, any estimator.

    Readings are counted in steps of the sensor's resolution, all else in steps of 1e-6 of its unit. So the last bits of
    a sine or of a solver, which differ between processors and libraries, do not matter, unless a value lies within
    that difference of the middle between two steps. This is possible but rare: if readings of 0.7 kPa a step differ by
    1e-9 kPa, it happens in one of 10,000 scans of 69,120 readings. Promised is the same hash on one machine with the
    same versions of NumPy and MuJoCo; on others it is to be expected, and `check_data` says whether it is so.
    """
    config = run_config(task=task.name, seed=seed)
    gathered = gather(config, jobs=jobs, cache=cache, progress=progress)
    check_readings(gathered.scan, gathered.letters, config.readings, config.hold_out)
    scan, witness = gathered.scan, Witness()
    kind = kinds.load(config.kind)
    plan = kind.plan(config, scan, witness, gathered.objects)
    trials, _ = run_trials(plan, witness, kind.tasks(config, gathered), progress=progress)

    step = (config.scan_options.sensor.resolution if config.pressed else 0) or STEP
    names = [gathered.letters, scan.labels.tolist(), scan.split.tolist(), trials.truth.tolist()]
    objects = [gathered.objects[letter] for letter in gathered.letters]
    facts = [[of.symmetry, *of.centre, of.inertia_over_mass] for of in objects]
    content = hashlib.sha256(json.dumps([*names, trials.known.tolist(), witness.drawn]).encode())
    for values, unit in (
        (scan.taxel_xy, STEP),
        (scan.readings, step),
        (scan.poses, STEP),
        (facts, STEP),
        (trials.true_pose, STEP),
        (trials.touch_index, 1),
        (witness.sensor_in_robot, STEP),
        (witness.felt, step),
        (witness.offered, STEP),
    ):
        counted = np.rint(np.asarray(values, dtype=float) / unit).astype("<i8")
        content.update(str(counted.shape).encode() + counted.tobytes())
    return content.hexdigest()


class Witness(Estimator):
    """Write down all that an estimator is told in its trials; it says "none of them", and takes the first touch."""

    def __init__(self) -> None:
        super().__init__(Options())
        self.drawn: list[int] = []
        self.felt: list[FloatArray] = []
        self.sensor_in_robot: list[FloatArray] = []
        self.offered: list[FloatArray] = []

    def fit(self, scan: Scan) -> None:
        """Learn nothing."""

    def without(self, letter: str, scan: Scan) -> Estimator:
        """Give this one: it has learned no letter."""
        return self

    def reset(self, rng: np.random.Generator) -> None:
        """Write down the random numbers that a trial's estimator would draw, by the first of them."""
        self.drawn.append(int(rng.integers(2**62)))

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Write down the touches that are offered, and take the first."""
        self.offered.extend(np.asarray(candidates))
        return 0

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Write down a reading, kPa, and its pose."""
        self.felt.append(np.array(reading))
        self.sensor_in_robot.append(np.array(sensor_in_robot))

    def estimate(self) -> Estimate:
        """Say that it is none of the letters."""
        return Estimate(NONE, {NONE: 1.0}, np.zeros(3))
