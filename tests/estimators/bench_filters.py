"""How fast the filters are, beside what one would write or install instead.

`python -m pytest -m benchmark tests/estimators/bench_filters.py -s` prints the ratios. All are ratios of
processor time within one run, taken in turns, because absolute times say nothing about another machine.
"""

from time import thread_time

import numpy as np
import pytest
from rivals import Gather, GatherTables, MapCoordinates
from synthetic import draw_trial

from tactsim import estimators
from tactsim.estimators.filters.grid import state_grid

pytestmark = pytest.mark.benchmark
READINGS = 30


def seconds(work, *args):
    start = thread_time()
    work(*args)
    return thread_time() - start


def all_states(bins):
    x, y, angle = state_grid(bins).centres
    return np.stack(np.meshgrid(x, y, angle, indexing="ij"), axis=-1).reshape(-1, 3)


def trials(scan, count, seed=0):
    for k in range(count):
        rng = np.random.default_rng((seed, k))
        yield rng, *draw_trial(scan, scan.letters[k % len(scan.letters)], READINGS, rng)[:2]


def update_times(filter, scan, count):
    """Seconds of each update (trials, readings)."""
    times = np.zeros((count, READINGS))
    for k, (rng, readings, poses) in enumerate(trials(scan, count)):
        filter.reset(rng)
        for j in range(READINGS):
            times[k, j] = seconds(filter.update, readings[j], poses[j])
    return times


def test_cost_of_ten_times_the_bins(vowels, benchmark):
    filters = [estimators.create("histogram", bins=bins) for bins in (10_000, 100_000)]
    for filter in filters:
        filter.fit(vowels)
    small, large = (update_times(filter, vowels, 10) for filter in filters)
    benchmark.extra_info["ratio"] = large.mean() / small.mean()
    print(f"\n10,000 to 100,000 bins: {large.mean() / small.mean():.1f} times the cost of an update")
    benchmark.pedantic(update_times, (filters[1], vowels, 1), rounds=3)


def with_particles(gather, letters):
    """One step of the package `particles` (0.4): bootstrap filter on the same states and likelihood."""
    package = pytest.importorskip("particles")

    class Model(package.FeynmanKac):
        shown = None

        def M0(self, N):
            return np.tile(gather.states, (letters, 1))

        def M(self, t, xp):
            return xp + np.random.default_rng(t).normal(0, (1, 1, 0.1), xp.shape)

        def logG(self, t, xp, x):
            return gather.log_likelihood(*self.shown).ravel()

    model = Model(T=10**6)
    smc = package.SMC(fk=model, N=letters * len(gather.states), resampling="multinomial", ESSrmin=1.0)

    def step(reading, pose):
        model.shown = reading, pose
        next(smc)

    return step


def with_filterpy(gather, letters):
    """One update of the package `filterpy` (2.0): its discrete Bayes filter on the same bins."""
    update = pytest.importorskip("filterpy.discrete_bayes").update
    belief = np.full(letters * len(gather.states), 1.0)

    def step(reading, pose):
        log_p = gather.log_likelihood(reading, pose).ravel()
        belief[:] = update(np.exp(log_p - log_p.max()), np.maximum(belief, 1e-300))

    return step


@pytest.mark.parametrize(
    "rival",
    [
        "plain gather",
        "gather of tables",
        "map_coordinates",
        "particles",
        "filterpy",
        "histogram first",
        "histogram mean",
    ],
)
@pytest.mark.benchmark(group="one reading, 5 letters x 10,000 states")
def test_side_by_side(vowels, benchmark, rival):
    filter = estimators.create("histogram", bins=10_000)
    filter.fit(vowels)
    states = all_states(10_000)
    plain = Gather(filter.maps, states, vowels.taxel_xy)
    rng, readings, poses = next(trials(vowels, 1))

    def thirty(*_):
        filter.reset(rng)
        for reading, pose in zip(readings, poses, strict=True):
            filter.update(reading, pose)

    def first(*one):
        filter.reset(rng)
        filter.update(*one)

    work, share = {
        "plain gather": lambda: (plain.log_likelihood, 1),
        "gather of tables": lambda: (GatherTables(*plain.made_of).log_likelihood, 1),
        "map_coordinates": lambda: (MapCoordinates(*plain.made_of).log_likelihood, 1),
        "particles": lambda: (with_particles(plain, 5), 1),
        "filterpy": lambda: (with_filterpy(plain, 5), 1),
        "histogram first": lambda: (first, 1),
        "histogram mean": lambda: (thirty, READINGS),
    }[rival]()
    one = readings[0], poses[0]
    work(*one)
    ours, theirs = [], []
    for _ in range(15):
        ours.append(seconds(work, *one) / share)
        theirs.append(seconds(plain.log_likelihood, *one))
    ratio = float(np.median(theirs) / np.median(ours))
    benchmark.extra_info["times faster than the plain gather"] = ratio
    print(f"\n{rival}: {ratio:.2f} x")
    benchmark.pedantic(work, one, rounds=5)


def test_rivals_compute_the_same(vowels):
    # Otherwise the comparison would say nothing. What remains is the place of the interpolation: in
    # log-odds, or in log p.
    filter = estimators.create("histogram", split="25x25x4", skip=False)
    filter.fit(vowels)
    rng, readings, poses = next(trials(vowels, 1))
    filter.reset(rng)
    filter.update(readings[0], poses[0])
    ours = filter.log_belief().ravel()
    x, y, angle = filter.grid.centres
    states = np.stack(np.meshgrid(angle, y, x, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    for kind, most in ((GatherTables, 0.02), (Gather, 1.0), (MapCoordinates, 1.0)):
        theirs = kind(filter.maps, states, vowels.taxel_xy).log_likelihood(readings[0], poses[0]).ravel()
        assert np.sqrt(np.mean((theirs - ours) ** 2)) < most
