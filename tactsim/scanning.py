"""Press letters at every pose of a scan: training and test readings, the same for the same seed."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import models
from tactsim.options import ScanOptions
from tactsim.poses import compose
from tactsim.pressing import ideal_readings
from tactsim.protocol import grid_poses, random_poses
from tactsim.scan import SPLITS, Scan
from tactsim.sensor import gains, sense

Progress = Callable[[int, int], None]


def scan_letters(
    options: ScanOptions,
    *,
    jobs: int = 1,
    cache: bool = True,
    progress: Progress | None = None,
) -> tuple[Scan, dict[str, Any]]:
    """Press every letter at 192 training and 192 test poses.

    Returns the scan and its work: `presses` and `skipped` {reason: count}. `progress(done, total)`
    is called as presses are done. The same options give the same bits.
    """
    letters = [models.letter(name) for name in options.letters]
    gain = gains(options.pad.taxels, options.sensor, _rng(options.seed, "pad", "gain"))
    readings, poses, labels, split = [], [], [], []
    work: Counter[str] = Counter()
    total = len(letters) * len(SPLITS) * len(grid_poses())
    for letter in letters:
        for name in SPLITS:
            stated = grid_poses()
            if name == "test" and options.test_poses == "random":
                stated = random_poses(_rng(options.seed, letter.name, name, "poses"))
            error = _rng(options.seed, letter.name, name, "placement").standard_normal((len(stated), 3))
            error *= (options.placement_mm, options.placement_mm, options.placement_rad)
            ideal, skipped = ideal_readings(letter, compose(stated, error), options)
            work.update(skipped)
            readings.append(
                sense(ideal, options.sensor, gain, _rng(options.seed, letter.name, name, "sense"))
            )
            poses.append(stated)
            labels += [letter.name] * len(stated)
            split += [name] * len(stated)
            if progress is not None:
                progress(len(labels), total)
    scan = Scan(
        np.concatenate(readings), np.concatenate(poses), np.array(labels), np.array(split),
        options.pad.taxel_xy, _meta(options, letters),
    )  # fmt: skip
    return scan, {"presses": total - work["no_contact"], "skipped": dict(work)}


def _meta(options: ScanOptions, letters: Sequence[models.Letter]) -> dict[str, Any]:
    return {
        "options": options.model_dump(mode="json"),
        "objects": {letter.name: _object(letter) for letter in letters},
    }


def _object(letter: models.Letter) -> dict[str, Any]:
    """Say of a letter what scores need: symmetry (0 for a disc), centre mm, inertia over mass mm^2."""
    return {
        "symmetry": 0 if math.isinf(letter.symmetry) else int(letter.symmetry),
        "centre": [0.0, 0.0],  # the footprint's centre of area is the origin of the object frame
        "inertia_over_mass": letter.inertia_over_mass,
        "mass": letter.mass,
        "area": letter.area,
    }


def _rng(seed: int, *purpose: str) -> np.random.Generator:
    """Make the generator for one purpose: it depends on nothing else that is drawn."""
    key = hashlib.sha256("\0".join(purpose).encode()).digest()
    words = np.frombuffer(key, dtype="<u4").tolist()
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))
