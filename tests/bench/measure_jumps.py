"""How many jumps can be found again in three readings, by a filter that is told when and how far the object jumped.

    python tests/bench/measure_jumps.py [SEEDS]

In the world of `bench sweep slip` with a jump of 5 mm, `synthesis` follows the object until it jumps. An oracle then
moves its belief by 5 mm in every direction, and weighs it by presses at every state: what is left to find out is the
direction. Beside it stands `synthesis` with motion=auto, which has to notice the jump. A jump counts as found again
as in `score.recoveries`.
"""

import os
import sys

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

import tactsim
from tactsim.bench.fitting import fit
from tactsim.bench.placement_error import placement_error
from tactsim.bench.score import JUMP, RECOVERED
from tactsim.core import compose, invert, transform
from tactsim.estimators import create
from tactsim.estimators.filters.placement import mean_around
from tactsim.press import forward_model

READINGS, WITHIN, LENGTH, COPIES = 20, 3, 5.0, 4


def jump_of(true_pose, centre):
    """Find the touch before which an object jumps, of poses (readings, 3); None if too few are left then."""
    middle = transform(invert(true_pose), np.array([centre]))[:, 0]
    found = np.flatnonzero(np.hypot(*np.diff(middle, axis=0).T) >= JUMP) + 1
    return int(found[0]) if len(found) and found[0] <= READINGS - WITHIN else None


def oracle(synthesis, readings, poses, jumped, rng):
    """Estimate letter and pose after each of the first readings since the jump: pairs (label, pose)."""
    synthesis.reset(rng)
    for touch in range(jumped):
        synthesis.update(readings[touch], poses[touch])
    belief = synthesis.weighted_states()
    letter, state = np.tile(belief.letter, COPIES), np.tile(belief.state, COPIES)
    log_p = np.tile(belief.weights.log, COPIES)
    direction = rng.uniform(-np.pi, np.pi, len(letter))
    placed = invert(np.ascontiguousarray(state.T))
    placed[:, :2] += LENGTH * np.column_stack([np.cos(direction), np.sin(direction)])
    state = np.ascontiguousarray(invert(placed).T)
    said = []
    for touch in range(jumped, jumped + WITHIN):
        synthesis.take(readings[touch], poses[touch])
        for one in np.unique(letter):
            mine = letter == one
            log_p[mine] += synthesis.log_p(int(one), state[:, mine], touch)
        best = int(np.bincount(letter, np.exp(log_p - log_p.max())).argmax())
        mine = letter == best
        relative = np.exp(log_p[mine] - log_p[mine].max())
        pose = mean_around(np.ascontiguousarray(state[:, mine]), relative, int(relative.argmax()))
        said.append((synthesis.labels[best], pose))
    return said


def main(seeds):
    """Count the jumps and those that each of the two finds again, scan by scan and in all."""
    total = np.zeros(3, dtype=int)
    for seed in range(seeds):
        words = {"slip": {"jump_mm": LENGTH}, "trials": 4, "readings": READINGS, "seed": seed}
        run = tactsim.run(estimator="synthesis", set={"motion": "auto"}, **words)
        still = create("synthesis")
        fit(still, run.plan.scan, forward_model)
        counts = np.zeros(3, dtype=int)
        trials = run.trials
        for number, truth in enumerate(trials.truth.tolist()):
            of = run.objects[truth]
            jumped = jump_of(trials.true_pose[number], of.centre)
            if jumped is None:
                continue
            test, taken = run.plan.scan.where("test", truth), trials.reading[number]
            poses = compose(invert(trials.true_pose[number]), test.poses[taken])
            said = oracle(still, test.readings[taken], poses, jumped, np.random.default_rng([seed, number]))
            here = range(jumped, jumped + WITHIN)

            def found(label, pose, touch, true_pose=trials.true_pose[number], truth=truth, of=of):
                return label == truth and placement_error(pose, true_pose[touch], of) <= RECOVERED

            known = any(found(*one, touch) for one, touch in zip(said, here, strict=True))
            noticed = any(found(trials.label[number, k], trials.pose[number, k], k) for k in here)
            counts += [1, known, noticed]
            if not known:
                print(f"seed {seed}: {truth}, jump before touch {jumped + 1}: the oracle fails")
        total += counts
        print(f"seed {seed}: {counts[0]} jumps; found again: oracle {counts[1]}, motion=auto {counts[2]}")
    jumps, known, noticed = total
    print(f"all: {jumps} jumps; oracle {known / jumps:.3f}, motion=auto {noticed / jumps:.3f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
