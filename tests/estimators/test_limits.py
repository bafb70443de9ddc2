"""What is refused before it costs memory, hours or a NaN."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.likelihoods.occupancy import learn_maps


@pytest.mark.parametrize(
    "option",
    [
        {"gamma": 1e-320}, {"prior": 1.0}, {"peak": 0.0}, {"threshold": 1e300}, {"sigma": 10.0, "cell": 0.3},
        {"reach": float("nan")}, {"gamma": float("inf")},
    ],
)  # fmt: skip
def test_options_without_a_finite_answer_are_refused(option):
    with pytest.raises(InputError, match="estimator histogram") as caught:
        estimators.create("histogram", **option)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("far", [1e4, 1e9])
def test_poses_that_would_need_an_enormous_map_are_refused(far):
    scan = make_scan("EI", poses=paper_poses(positions=2, angles=2))
    poses = scan.poses.copy()
    poses[0, :2] = far
    tracemalloc.start()
    with pytest.raises(InputError, match=r"training poses span .* more than 50,000,000 cells"):
        learn_maps(replace(scan, poses=poses))
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()


def test_maps_of_many_readings_are_learned_in_pieces_that_fit_memory():
    scan = make_scan("I", poses=paper_poses(4, 3))
    once = learn_maps(scan, sigma=5.0)["I"].log_odds
    times = 4  # an array with all that 6912 taxels stamp would take 500 MB
    many = scan.chosen(np.tile(np.arange(len(scan)), times))
    start = np.log(0.2 / 0.8)
    tracemalloc.start()
    again = learn_maps(many, sigma=5.0)["I"].log_odds
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()
    assert np.allclose(again - start, times * (once - start), rtol=1e-10, atol=1e-9)
