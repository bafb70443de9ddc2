"""Time the press against a plain MuJoCo scene with the same bed, both in one run.

    python tests/press/bench_press.py

CPU time of one core, building of models apart. The plain scene is given its springs, so the press is timed
twice: from its springs to contact forces, as the plain scene is, and from an outline to a reading.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np
from plain_press import compile_plain, press_plain

from tactsim import models
from tactsim.core.poses import FloatArray
from tactsim.press import PressOptions, ScanOptions, balance, scan_letters
from tactsim.press.bed import lay_bed
from tactsim.press.engine import ideal_readings
from tactsim.press.levels import levels
from tactsim.press.scan_options import Skips
from tactsim.press.scan_poses import grid_poses
from tactsim.press.touches import Touches

LETTERS = "AEIOU"
FEW_POSES = grid_poses()[5::37]
WHOLE = PressOptions(skip=Skips(parts=False, cells=False, no_contact=False))
COVERED = PressOptions(skip=Skips(parts=False))


def ways_to_press(name: str) -> dict[str, tuple[Callable[[], object], int]]:
    """List what presses one letter, and how many presses that are."""
    options, letter = ScanOptions(), models.letter(name)
    lines = options.pad.grid_lines(options.press.cells_per_taxel)

    def touching(poses: FloatArray) -> FloatArray:
        bed = lay_bed(levels(letter, options.press), poses, *lines)
        return poses[np.diff(bed.start) > 0]

    many, few = touching(grid_poses()), touching(FEW_POSES)
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "press, springs to forces": (lambda: balance.press(Touches.of(letter, many), options), len(many)),
        "press, outline to reading": (lambda: ideal_readings(Touches.of(letter, many), options), len(many)),
    }
    for way, press in (("plain scene, whole", WHOLE), ("plain scene, only what touches", COVERED)):
        plain = lay_bed(levels(letter, press), few, *lines, skip_empty=press.skip.cells)
        scenes = [
            (compile_plain(letter, pose, springs), len(springs.share))
            for pose, springs in zip(few, plain.springs, strict=True)
        ]
        ways[way] = (
            lambda scenes=scenes: [press_plain(*scene, options.press.force) for scene in scenes],
            len(few),
        )
    return ways


def time_presses(rounds: int = 5) -> dict[str, float]:
    """Time every way to press the vowels: seconds of CPU per press, the median of rounds taken in turns."""
    letters = [ways_to_press(name) for name in LETTERS]
    times = {way: np.zeros((rounds, len(letters))) for way in letters[0]}
    for index in range(rounds):
        for column, ways in enumerate(letters):
            for way, (run, presses) in ways.items():
                start = process_time()
                run()
                times[way][index, column] = (process_time() - start) / presses
    return {way: float(np.median(values, axis=0).mean()) for way, values in times.items()}


def time_scan() -> float:
    """Time the training and test readings of the vowels, 1,920 presses, scenes compiled: seconds of CPU."""
    scan_letters(ScanOptions(letters=("A",)), cache=False)
    start = process_time()
    scan_letters(ScanOptions(), cache=False)
    return process_time() - start


def main() -> None:
    """Print the table."""
    seconds = time_presses()
    forces, reading = seconds["press, springs to forces"], seconds["press, outline to reading"]
    print(f"{'CPU per press':<34}{'us':>10}{'/ forces':>10}{'/ reading':>10}")
    for way, value in seconds.items():
        print(f"{way:<34}{value * 1e6:>10.1f}{value / forces:>10.0f}{value / reading:>10.0f}")
    print(f"1,920 presses of five letters, all told: {time_scan():.3f} s of CPU")


if __name__ == "__main__":
    main()
