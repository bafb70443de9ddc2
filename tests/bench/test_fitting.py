"""An estimator that presses by itself is brought what presses, wherever the harness fits one."""

import numpy as np
import pytest

import tactsim
from tactsim.core import InputError, Scan

FEW = {"spacing": 2.0, "angles": 9, "modes": 200}


@pytest.fixture(scope="module")
def scan():
    return tactsim.scan(letters="IL")


@pytest.mark.long
def test_a_run_recognises_by_pressing_whatever_the_number_of_processes(scan):
    run = tactsim.run(scan, estimator="synthesis", set=FEW, trials=4, readings=6)
    assert run.accuracy[-1] == 1
    assert run.error_mm[-1] < 0.5
    assert np.isfinite(run.trials.pose).all()
    again = tactsim.run(scan, estimator="synthesis", set=FEW, trials=4, readings=6, jobs=2)
    np.testing.assert_array_equal(again.trials.pose, run.trials.pose)


def test_a_scan_that_does_not_say_how_it_was_pressed_is_refused_in_one_line(scan, tmp_path):
    bare = Scan(scan.readings, scan.poses, scan.labels, scan.split, scan.taxel_xy)
    with pytest.raises(InputError, match="does not say how its letters were pressed"):
        tactsim.run(bare, estimator="synthesis", trials=1, readings=2)


def test_a_world_without_noise_is_recognised_too():
    run = tactsim.run(letters="AEIOU", world="ideal", estimator="synthesis", trials=2, readings=6)
    assert run.accuracy[-1] == 1
    assert run.error_mm[-1] < 0.1
