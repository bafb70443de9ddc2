"""The figures of docs/results.md that whole runs have to reach; minutes each."""

import numpy as np
import pytest

from tactsim.bench.config import run_config
from tactsim.bench.runner import perform

pytestmark = pytest.mark.slow


def run(**words):
    return perform(run_config(trials=100, **words), jobs=2)


@pytest.mark.parametrize("estimator", ["refined", "force-mosaic"])
def test_chosen_readings_name_the_letter_within_five(estimator):
    summary = run(estimator=estimator, readings=8, explore="information").summary
    assert summary["accuracy"][2] >= 0.99
    assert summary["all_right_from"] <= 5


def test_letters_that_were_held_out_are_refused_within_ten_readings():
    runs = [
        run(estimator="refined", set={"unknown": 0.5}, hold_out=letter, readings=12) for letter in "AEIOU"
    ]
    assert np.mean([one.summary["refused_unknown"][9] for one in runs]) >= 0.95
    assert max(one.summary["refused_known"][9] for one in runs) <= 0.02


def test_tempered_particles_are_right_within_twelve_readings():
    summary = run(estimator="tempered", readings=20).summary
    assert summary["all_right_from"] <= 12
    assert summary["error_mm"][19] < 0.6
