"""How fast the particle filters are, beside their own likelihood and beside the plain gather.

`python -m pytest -m benchmark tests/estimators/bench_particles.py -s` prints the ratios, of processor time taken in
turns in one run. A reading is `update` and `estimate`; as in a run, what was believed at one reading is not kept until
the next.
"""

from time import process_time

import numpy as np
import pytest
from rivals import Gather
from synthetic import draw_trial, placement_error

from tactsim import estimators

pytestmark = pytest.mark.benchmark
READINGS = 20


def sequence(filter, scan, seed):
    """Run a trial; give seconds a reading, of the filter and of its likelihood evaluations alone, and how it ended."""
    rng = np.random.default_rng(seed)
    label = scan.letters[seed % len(scan.letters)]
    readings, poses, truth = draw_trial(scan, label, READINGS, rng)
    filter.reset(rng)
    seconds = np.zeros(2)
    for k, (reading, pose) in enumerate(zip(readings, poses, strict=True)):
        start = process_time()
        filter.update(reading, pose)
        got = filter.estimate()
        between = process_time()
        belief = filter.weighted_states()
        begin = process_time()
        filter.field.log_p(belief.letter, belief.state, k, k + 1)
        seconds += between - start, process_time() - begin
    info = scan.meta["objects"][label]
    off = placement_error(got.robot_in_object, truth, info["symmetry"], info["inertia_over_mass"])
    return seconds / READINGS, (readings[0], poses[0]), (got.label == label, off)


@pytest.mark.parametrize("name", ["particle", "augmented-mcl"])
@pytest.mark.parametrize("particles", [10_000, 50_000])
def test_a_reading_beside_the_plain_gather_and_the_likelihood(vowels, name, particles):
    filter = estimators.create(name, particles=particles)
    filter.fit(vowels)
    rng, gather = np.random.default_rng(0), []
    states = rng.uniform(-1, 1, (particles // 5, 3)) * [10, 10, np.pi]
    plain = Gather(filter.maps, states, vowels.taxel_xy)  # five letters at each of these
    seconds = []
    for seed in range(12):
        times, one, _ = sequence(filter, vowels, seed)
        seconds.append(times)
        start = process_time()
        plain.log_likelihood(*one)
        gather.append(process_time() - start)
    whole, likelihood = np.median(seconds, axis=0)
    print(
        f"\n{name}, {particles:,} particles: a reading takes {whole / likelihood:.2f} likelihood evaluations; "
        f"it is {np.median(gather) / whole:.1f} times faster than the plain gather"
    )


def test_adaptive_numbers_beside_fixed_ones(vowels):
    rows = [{"particles": n} for n in (1000, 3000, 10_000)]
    rows += [{"kld_error": error, "min_particles": 500} for error in (0.4, 0.2, 0.1, 0.05)]
    filters = [estimators.create("particle", **row) for row in rows]
    for filter in filters:
        filter.fit(vowels)
    seconds = np.zeros((len(rows), 40))
    ended = np.zeros((len(rows), 40, 2))
    for seed in range(40):
        for k, filter in enumerate(filters):
            times, _, ended[k, seed] = sequence(filter, vowels, seed)
            seconds[k, seed] = times[0]
    print()
    for k, row in enumerate(rows):
        mean = filters[k].work["likelihood_evaluations"] / 40 / READINGS
        words = ", ".join(f"{name}={value}" for name, value in row.items())
        print(
            f"{words}: {mean:.0f} particles a reading, {seconds[k].mean() / seconds[2].mean():.2f} of the time of "
            f"10,000, {ended[k, :, 0].mean():.2f} right and {np.median(ended[k, :, 1]):.2f} mm after {READINGS}"
        )
