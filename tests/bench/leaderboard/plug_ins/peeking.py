"""Plug-ins that look for the truth."""

import gc
import os
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
from guess import Guess

from tactsim.core import Scan


class Files(Guess):
    """Look among the readings that are kept on disk."""

    def fit(self, scan):
        super().fit(scan)
        for path in Path(os.environ["TACTSIM_CACHE_DIR"]).rglob("*.npz"):
            Scan.load(path)


class Notes(Guess):
    """Read a file that is none of its business, and hope that nobody minds."""

    def fit(self, scan):
        super().fit(scan)
        with suppress(PermissionError):
            Path("/etc/passwd").read_text(encoding="utf-8")


class Neighbour(Guess):
    """Look into the memory of the other process."""

    def fit(self, scan):
        super().fit(scan)
        Path(f"/proc/{os.getppid()}/maps").read_bytes()


class Write(Guess):
    """Leave a message for the next run."""

    def fit(self, scan):
        super().fit(scan)
        Path(os.environ["PYTHONPATH"].split(os.pathsep)[0], "left").write_text("A")


class Memory(Guess):
    """Search this process's memory, its callers and the random numbers for the truth, and say what is there."""

    def fit(self, scan):
        super().fit(scan)
        self.scan = scan

    def update(self, reading, sensor_in_robot):
        super().update(reading, sensor_in_robot)
        names, frame = set(), sys._getframe()
        while frame is not None:
            names |= set(frame.f_locals)
            frame = frame.f_back
        scans = [one for one in gc.get_objects() if isinstance(one, Scan)]
        tests = sum(len(scan.where("test")) for scan in scans)
        seeds = [scan.meta.get("options", {}).get("seed") for scan in scans]
        seed = getattr(self.rng.bit_generator.seed_seq, "entropy", None)
        truth = {"truth", "task", "test", "tests", "plan", "true_pose"} & names
        if not scans or tests or truth or seed or any(seeds):
            raise RuntimeError(f"found {len(scans)} {tests} {truth} {seed} {seeds}")


class Listen(Guess):
    """Note the order of the trials: are they letter by letter?"""

    def reset(self, rng):
        super().reset(rng)
        self.number = getattr(self, "number", -1) + 1

    def estimate(self):
        letter = self.letters[self.number * len(self.letters) // 40 % len(self.letters)]
        return type(super().estimate())(letter, {letter: 1.0}, np.zeros(3))
