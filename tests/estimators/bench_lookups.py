"""How fast states are looked up sixteen at a time, beside one by one, and squares of states, beside states.

`python -m pytest -m benchmark tests/estimators/bench_lookups.py -s` prints nanoseconds a look-up, one term of a reading
at one state, and the ratio, of processor time taken in turns in one run. The sums must be equal, bit by bit where they
are summed in one order.
"""

from time import process_time_ns

import numpy as np
import pytest
from numba import njit, uint32, uint64
from synthetic import make_scan, paper_poses, square_pad

from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.replay import replay
from tactsim.estimators.field.series import cos_sin
from tactsim.estimators.field.squares import replay_squares
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions

pytestmark = pytest.mark.benchmark
REPEATS = 60


@njit(error_model="numpy", fastmath={"contract"})
def one_by_one(log_p, state, letter, terms, first, last, sampled):
    """Do what `replay` does, in plain loops of which a compiler makes what it can."""
    nodes, unit, lattice = sampled.nodes, np.float32(sampled.unit), sampled.lattice
    _, letters, rows, columns = nodes.shape
    flat, plane = nodes.reshape(nodes.size), rows * columns
    right, above = np.empty(128, dtype=np.float32), np.empty(128, dtype=np.float32)
    cos, sin = np.empty((2, 128), dtype=np.float32), np.empty((2, 128), dtype=np.float32)
    place, total = np.empty((2, 128), dtype=np.float32), np.empty(128, dtype=np.float32)
    base, at = np.empty(128, dtype=np.int32), np.empty(128, dtype=np.int32)
    width, most = np.int32(columns), np.array([columns - 2, rows - 2], dtype=np.int32)
    rim = np.array([columns - 1, rows - 1], dtype=np.float32)
    for begin in range(0, len(log_p), 128):
        count = min(128, len(log_p) - begin)
        for k in range(count):
            of_cos, of_sin = cos_sin(state[2, begin + k])
            for axis in range(2):
                cos[axis, k], sin[axis, k] = of_cos / lattice[2 + axis], of_sin / lattice[2 + axis]
                place[axis, k] = (state[axis, begin + k] - lattice[axis]) / lattice[2 + axis]
            base[k] = letter[begin + k] * plane
        for reading in range(first, last):
            total[:count] = 0
            for i in range(terms.start[reading], terms.start[reading + 1]):
                factor, tables = terms.weight[i] * unit, uint64(terms.kind[i] * letters * plane)
                x, y = np.float32(terms.xy[i, 0]), np.float32(terms.xy[i, 1])
                for k in range(uint64(count)):
                    u = place[0, k] + cos[0, k] * x - sin[0, k] * y
                    v = place[1, k] + sin[1, k] * x + cos[1, k] * y
                    u, v = min(max(u, np.float32(0)), rim[0]), min(max(v, np.float32(0)), rim[1])
                    column, row = min(np.int32(u), most[0]), min(np.int32(v), most[1])
                    right[k], above[k] = u - np.float32(column), v - np.float32(row)
                    at[k] = base[k] + row * width + column
                for k in range(uint64(count)):
                    corner = tables + uint64(uint32(at[k]))
                    next_row = corner + uint64(columns)
                    here, there = np.float32(flat[corner]), np.float32(flat[corner + uint64(1)])
                    lower = here + right[k] * (there - here)
                    here, there = np.float32(flat[next_row]), np.float32(flat[next_row + uint64(1)])
                    upper = here + right[k] * (there - here)
                    total[k] += factor * (lower + above[k] * (upper - lower))
            for k in range(count):
                log_p[begin + k] += terms.constant[reading, letter[begin + k]] + total[k]


@pytest.mark.parametrize("model", ["calibrated", "force"])
def test_states_looked_up_together_beside_one_by_one(vowels, model):
    made = likelihood.create(LikelihoodOptions(likelihood=model))
    made.fit(vowels, learn_maps(vowels))
    field = LikelihoodField(made, vowels.letters, vowels.taxel_xy, (1.667, 1.667), 0.4)
    for k in range(6):
        field.append(made.evidence(vowels.readings[k]), np.array(vowels.poses[k]))
    print()
    for states, spread in (
        (800, 0.2),
        (4096, 1.0),
        (10_000, 6.0),
    ):  # halved cells, left-out readings, particles
        rng = np.random.default_rng(0)
        state = np.ascontiguousarray(rng.normal(0, [spread, spread, spread / 9], (states, 3)).T)
        letter = np.sort(rng.integers(5, size=states))
        asked = state, letter, field.terms, 0, 6, field.tables.sampled
        spent, sums = np.zeros((2, REPEATS), dtype=np.int64), np.zeros((2, states))
        for repeat in range(-1, REPEATS):  # the first compiles
            for which, work in enumerate((one_by_one, replay)):
                sums[which] = 0
                begin = process_time_ns()
                work(sums[which], *asked)
                spent[which, max(repeat, 0)] = process_time_ns() - begin
        assert np.array_equal(*sums)
        each = np.median(spent, axis=1) / (states * int(field.terms.start[6]))
        print(
            f"{model}, {states:,} states: {each[1]:.2f} ns a look-up, one by one {each[0]:.2f}: "
            f"{each[1] / each[0]:.2f} of the time"
        )


@pytest.mark.parametrize("side", [6, 32])
@pytest.mark.parametrize("model", ["calibrated", "force"])
def test_squares_beside_their_states(model, side):
    scan = make_scan("EILT", square_pad(side, side, 11.4 / side), paper_poses(4, 4))
    made = likelihood.create(LikelihoodOptions(likelihood=model))
    made.fit(scan, learn_maps(scan))
    field = LikelihoodField(made, scan.letters, scan.taxel_xy, (1.667, 1.667), 0.4)
    for k in range(6):
        field.append(made.evidence(scan.readings[k]), np.array(scan.poses[k]))
    rng, count, step = np.random.default_rng(0), 100, float(field.tables.step[0])
    letter, angle = np.sort(rng.integers(4, size=count)), rng.normal(0, 0.05, count)
    print()
    for apart in (1.25, 0.3):  # steps of the lattice: cells that were halved twice, and four times
        corner = rng.normal(0, 0.5, (2, count, 1))
        x, y = corner + np.array([0, apart * step])
        states = np.stack([np.tile(x, 2).ravel(), np.repeat(y, 2, axis=1).ravel(), np.repeat(angle, 4)])
        spent, of_states, of_squares = np.zeros((2, REPEATS)), np.zeros(4 * count), np.zeros((count, 4))
        for repeat in range(REPEATS):
            of_states[:] = of_squares[:] = 0
            begin = process_time_ns()
            replay(of_states, states, np.repeat(letter, 4), field.terms, 0, 6, field.tables.sampled)
            between = process_time_ns()
            replay_squares(
                of_squares, x, y, angle, letter, apart * step, apart * step, field.terms, field.vectors, 0, 6,
                field.tables.sampled,
            )  # fmt: skip
            spent[:, repeat] = between - begin, process_time_ns() - between
        assert np.abs(of_squares.ravel() - of_states).max() <= 2 * field.terms.slack[:6].sum()
        each = np.median(spent, axis=1) / (4 * count * int(field.terms.start[6]))
        print(
            f"{model}, {side**2:,} taxels, {count} squares {apart} steps wide: {each[1]:.2f} ns a look-up, "
            f"their states {each[0]:.2f}: {each[1] / each[0]:.2f} of the time"
        )
