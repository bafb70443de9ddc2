"""Print how many touches a second environments give, beside a plain press of the same letters, in one run.

    OPENBLAS_NUM_THREADS=1 python tests/env/bench_env.py

CPU time of one core, environments made before, the median of rounds in which all rows take turns. Touches a second hold
for one machine; their ratios to the plain press hold more widely. Episodes end and begin as usual, after 20 touches.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import process_time

import gymnasium
import numpy as np

from tactsim.env.touch_spaces import touch_action
from tactsim.env.world import world
from tactsim.press.engine import press_at
from tactsim.press.scan_poses import random_poses
from tactsim.press.touches import Touches

TASK = "letters-offgrid-v1"
ROUNDS, LEAST = 7, 0.3  # s that a row takes in a round, at least
Row = tuple[str, Callable[[], int]]  # a name, and what touches some times and says how often


def plain_press(each: int) -> Row:
    """Press each letter `each` times in one batch, without noise or anything else."""
    pressed = world(TASK, None, {}, False)
    rng = np.random.default_rng(0)

    def act() -> int:
        for letter in pressed.letters:
            touches = Touches(letter, random_poses(rng, each), rng.normal(0, 0.0044, (each, 2)))
            press_at(touches, pressed.options).readings(pressed.options)
        return each * len(pressed.letters)

    return f"plain press, {each} of each letter at once", act


def environments(name: str, count: int, **options: object) -> Row:
    """Touch at random in `count` environments at once."""
    made = gymnasium.make_vec(f"tactsim/{TASK}", num_envs=count, **options)
    made.reset(seed=0)
    labels, rng = tuple("AEIOU"), np.random.default_rng(0)

    def act() -> int:
        made.step(np.stack([touch_action(pose, labels, 12.0) for pose in random_poses(rng, count)]))
        return count

    return name, act


def rates(rows: list[Row]) -> dict[str, float]:
    """Time all rows in turns: touches a second of CPU."""
    taken: dict[str, list[float]] = {name: [] for name, _ in rows}
    for number in range(ROUNDS + 1):  # the first only warms up
        for name, act in rows:
            start, touches = process_time(), 0
            while process_time() - start < LEAST:
                touches += act()
            if number:
                taken[name].append(touches / (process_time() - start))
    return {name: median(found) for name, found in taken.items()}


def main() -> None:
    """Print the table."""
    rows = [
        plain_press(51),
        environments("16 environments, Gymnasium's SyncVectorEnv", 16, vectorization_mode="sync"),
        *(environments(f"{count} environments", count) for count in (16, 64, 256, 1024)),
        *(environments(f"{count} environments, fast", count, fast=True) for count in (16, 256)),
        environments("16 environments, fast, belief of refined", 16, fast=True, belief="refined"),
    ]
    found = rates(rows)
    print("| | touches a second | / plain press |\n|---|---|---|")
    for name, rate in found.items():
        print(f"| {name} | {rate:,.0f} | {rate / found[rows[0][0]]:.2f} |")


if __name__ == "__main__":
    main()
