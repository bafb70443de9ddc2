"""How many jumps can be found again in three readings, by filters that are told when the object jumped, or how far too.

    python tests/bench/measure_jumps.py [SEEDS]

In the world of `bench sweep slip` with a jump of 5 mm, `synthesis` follows the object until it jumps. An oracle then
moves its belief by 5 mm in every direction, and weighs it by presses at every state: what is left to find out is the
direction. Another is told when, and not how far: it draws states of jumps as long as `motion=auto` takes them to be,
thirty times as many as that does. Beside them stands `synthesis` with motion=auto, which has to notice the jump. A jump
counts as found again as in `score.recoveries`.
"""

import os
import sys
from dataclasses import replace

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

import tactsim
from tactsim.bench.placement import placement_error
from tactsim.bench.score import JUMP, RECOVERED
from tactsim.bench.trials import fit
from tactsim.core import compose, invert, transform
from tactsim.estimators import create
from tactsim.estimators.filters.clouds import Cloud, advance
from tactsim.estimators.filters.motion import parse_motion
from tactsim.estimators.filters.placement import mean_around
from tactsim.press import forward_model

READINGS, WITHIN, LENGTH, COPIES = 20, 3, 5.0, 4
STATES, LATER = 20_000, 3_000  # drawn at the touch after the jump, and at those after it
AT_REST = 1e-4  # mm^2; a density needs a width
WAYS = ("told when and how far", "told when", "motion=auto")


def jump_of(true_pose, centre):
    """Find the touch before which an object jumps, of poses (readings, 3); None if too few are left then."""
    middle = transform(invert(true_pose), np.array([centre]))[:, 0]
    found = np.flatnonzero(np.hypot(*np.diff(middle, axis=0).T) >= JUMP) + 1
    return int(found[0]) if len(found) and found[0] <= READINGS - WITHIN else None


def follow(synthesis, readings, poses, jumped, rng):
    """Follow the object until it jumps; returns what is believed of it then."""
    synthesis.reset(rng)
    for touch in range(jumped):
        synthesis.update(readings[touch], poses[touch])
    return synthesis.weighted_states()


def told_all(synthesis, belief, jumped, rng):
    """Estimate letter and pose after each of the first readings since a jump of known length: pairs (label, pose)."""
    letter, state = np.tile(belief.letter, COPIES), np.tile(belief.state, COPIES)
    log_p = np.tile(belief.weights.log, COPIES)
    direction = rng.uniform(-np.pi, np.pi, len(letter))
    placed = invert(np.ascontiguousarray(state.T))
    placed[:, :2] += LENGTH * np.column_stack([np.cos(direction), np.sin(direction)])
    state = np.ascontiguousarray(invert(placed).T)
    said = []
    for touch in range(jumped, jumped + WITHIN):
        for one in np.unique(letter):
            mine = letter == one
            log_p[mine] += synthesis.log_p(int(one), state[:, mine], touch)
        best = int(np.bincount(letter, np.exp(log_p - log_p.max())).argmax())
        mine = letter == best
        relative = np.exp(log_p[mine] - log_p[mine].max())
        pose = mean_around(np.ascontiguousarray(state[:, mine]), relative, int(relative.argmax()))
        said.append((synthesis.labels[best], pose))
    return said


def told_when(synthesis, belief, jumped, rng):
    """Estimate letter and pose after each of the first readings since a jump of unknown length: pairs (label, pose)."""
    auto = parse_motion("auto")
    jumps, rests = (
        replace(auto, variance=np.array([variance]), prior=np.ones(1), switch=0.0, jump=0.0)
        for variance in (auto.jump_variance, AT_REST)
    )
    clouds = {}
    for one in np.unique(belief.letter).tolist():
        mine = belief.letter == one
        log_weight = belief.weights.log[mine]
        mass = float(np.logaddexp.reduce(log_weight))
        clouds[one] = Cloud.of(jumps, belief.state[:, mine], np.zeros(mine.sum()), log_weight - mass, mass)
    said = []
    for touch in range(jumped, jumped + WITHIN):
        motion, count = (jumps, STATES) if touch == jumped else (rests, LATER)
        drawn = {}
        for one, cloud in clouds.items():

            def log_p(place, one=one, touch=touch, motion=motion):
                return synthesis.log_p(one, motion.state(place), touch)

            clouds[one], drawn[one] = advance(cloud, motion, log_p, count, rng)
        best = max(clouds, key=lambda one: clouds[one].log_evidence)
        state, weights, mode = drawn[best].heavy()
        said.append((synthesis.labels[best], mean_around(state, weights.relative, mode)))
    return said


def main(seeds):
    """Count the jumps and those that each of the three finds again, scan by scan and in all."""
    total = np.zeros(4, dtype=int)
    for seed in range(seeds):
        words = {"slip": {"jump_mm": LENGTH}, "trials": 4, "readings": READINGS, "seed": seed}
        run = tactsim.run(estimator="synthesis", set={"motion": "auto"}, **words)
        still = create("synthesis")
        fit(still, run.plan.scan, forward_model)
        counts = np.zeros(4, dtype=int)
        trials = run.trials
        for number, truth in enumerate(trials.truth.tolist()):
            of = run.objects[truth]
            jumped = jump_of(trials.true_pose[number], of.centre)
            if jumped is None:
                continue
            test, taken = run.plan.scan.where("test", truth), trials.reading[number]
            poses = compose(invert(trials.true_pose[number]), test.poses[taken])
            readings, rng = test.readings[taken], np.random.default_rng([seed, number])
            belief = follow(still, readings, poses, jumped, rng)
            here = range(jumped, jumped + WITHIN)
            for touch in here:
                still.take(readings[touch], poses[touch])

            def found(label, pose, touch, true_pose=trials.true_pose[number], truth=truth, of=of):
                return label == truth and placement_error(pose, true_pose[touch], of) <= RECOVERED

            of_each = (
                told_all(still, belief, jumped, rng),
                told_when(still, belief, jumped, rng),
                [(trials.label[number, touch], trials.pose[number, touch]) for touch in here],
            )
            again = [
                any(found(*one, touch) for one, touch in zip(said, here, strict=True)) for said in of_each
            ]
            counts += [1, *again]
        total += counts
        each = ", ".join(f"{way} {count}" for way, count in zip(WAYS, counts[1:], strict=True))
        print(f"seed {seed}: {counts[0]} jumps; found again: {each}", flush=True)
    each = ", ".join(f"{way} {share:.3f}" for way, share in zip(WAYS, total[1:] / total[0], strict=True))
    print(f"all: {total[0]} jumps; {each}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
