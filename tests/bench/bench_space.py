"""What recognising objects in space costs and how good it is, with 12 to 50 objects, and what 1,000 touches cost.

`python tests/bench/bench_space.py` prints two tables: seconds of processor time of 1,000 touches of the twelve objects,
and for each number of objects the seconds of fitting and of a recognition, how many were right by touch 10 and 20, and
surface distance and angle at 20. `--trials 200` as in the documentation takes hours; 50 are enough to see the growth.
"""

import argparse
from time import process_time

import numpy as np

from tactsim.bench.space.space_config import space_config
from tactsim.bench.space.space_runner import perform_in_space
from tactsim.bench.space.touching import draw_pose_in_space, draw_starts, outside_of
from tactsim.core import rigid
from tactsim.models import solid, solid_names
from tactsim.press.space import SpaceOptions, SpacePress

TOUCHES = 1000


def seconds_of_touches():
    """Touch the twelve objects in turns, as trials do: seconds of 1,000 touches, and the share that met something."""
    solids = [solid(name) for name in solid_names()]
    press, rng = SpacePress(solids, SpaceOptions()), np.random.default_rng(0)
    outside = outside_of(max(one.radius for one in solids))
    press.touch(solids[0].name, draw_starts(1, outside, rng))  # compiles
    met, start = 0, process_time()
    for number in range(TOUCHES):
        label = solids[number % len(solids)].name
        begin = rigid.compose(draw_pose_in_space(rng), draw_starts(1, outside, rng))
        met += int(press.sensed(press.touch(label, begin, rng), rng).met.sum())
    return process_time() - start, met / TOUCHES


def row(count, trials, touches, words):
    """Do one run with the first `count` solids: a row of the table."""
    config = space_config(objects=solid_names(count), trials=trials, touches=touches, **words)
    start = process_time()
    run = perform_in_space(config)
    spent = process_time() - start
    summary, seconds = run.summary, run.times["seconds"]
    recognition = run.trials.seconds.sum(axis=1).mean()

    def at(name, touch):
        value = summary[name][min(touch, touches) - 1]
        return "-" if value is None else f"{value:.3g}"

    return (
        f"{count:7d}  {seconds['fit']:6.1f}  {recognition:11.2f}  {at('accuracy', 10):>8}  "
        f"{at('accuracy', 20):>8}  {at('error_mm', 20):>5}  {at('error_median_mm', 20):>6}  {at('angle_deg', 20):>7}  "
        f"{spent:7.0f}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--counts", default="12,25,50")
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--touches", type=int, default=20)
    parser.add_argument("--estimator", default="space-refined")
    given = parser.parse_args()
    spent, met = seconds_of_touches()
    print(f"{TOUCHES:,} touches: {spent:.2f} s of processor time; {met:.0%} met the object")
    print(f"{given.estimator}, {given.trials} trials of {given.touches} touches")
    print("objects   fit s  s a recogn.  right@10  right@20     mm  median  degrees  s in all")
    for number in map(int, given.counts.split(",")):
        print(row(number, given.trials, given.touches, {"estimator": given.estimator}), flush=True)
