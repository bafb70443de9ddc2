"""The figures of docs/results.md that whole runs have to reach; minutes each."""

import numpy as np
import pytest

from tactsim.bench.config import run_config
from tactsim.bench.experiment import perform

pytestmark = pytest.mark.slow


def run(**words):
    return perform(run_config(trials=100, **words), jobs=2)


# Touches on demand, some of which miss the object: as docs/results.md has it, "Active touch".
@pytest.mark.parametrize(
    ("estimator", "after_three", "after_five", "all_right_from"),
    [("refined", 0.90, 0.96, None), ("force-mosaic", 0.97, 0.99, 5)],
)
def test_chosen_touches_name_the_letter_within_five(estimator, after_three, after_five, all_right_from):
    summary = run(estimator=estimator, readings=8, explore="information").summary
    assert summary["accuracy"][2] >= after_three
    assert summary["accuracy"][4] >= after_five
    if all_right_from is not None:
        assert summary["all_right_from"] <= all_right_from


def test_letters_that_were_held_out_are_refused_within_ten_readings():
    runs = [
        run(estimator="refined", set={"unknown": 0.5}, hold_out=letter, readings=12) for letter in "AEIOU"
    ]
    assert np.mean([one.summary["refused_unknown"][9] for one in runs]) >= 0.95
    assert max(one.summary["refused_known"][9] for one in runs) <= 0.02
