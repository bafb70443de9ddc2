"""What is checked of every estimate and every candidate, whoever made it."""

import numpy as np
import pytest

from tactsim.core import InputError
from tactsim.estimators import NONE, Estimate
from tactsim.estimators.estimator import check_candidates, check_estimate, no_exit

LETTERS = ("E", "I")
POSE = np.array([1.0, -2.0, 0.3])


@pytest.mark.parametrize(
    "p", [{"E": 0.75, "I": 0.25}, {"E": 1.0}, {"E": 1.0, "I": 0.0}, {"I": 0.5, "E": 0.5}]
)
def test_an_estimate_is_let_through(p):
    check_estimate(Estimate("E", p, POSE), None, LETTERS)


def test_none_may_be_said_though_a_letter_is_more_probable():
    check_estimate(Estimate(NONE, {"E": 0.75, NONE: 0.25}, POSE), None, (*LETTERS, NONE))


@pytest.mark.parametrize(
    ("estimate", "said"),
    [
        (None, "no Estimate"),
        (Estimate("E", [0.5, 0.5], POSE), "table of probabilities"),
        (Estimate("O", {"O": 1.0}, POSE), "no letter"),
        (Estimate("E", {"I": 1.0}, POSE), "no probability"),
        (Estimate("E", {"E": 1.5, "I": -0.5}, POSE), "negative or do not sum to 1"),
        (Estimate("E", {"E": 0.5, "I": 0.4}, POSE), "negative or do not sum to 1"),
        (Estimate("E", {"E": np.nan}, POSE), "negative or do not sum to 1"),
        (Estimate("E", {"E": "much"}, POSE), "no number"),
        (Estimate("E", {"E": 0.25, "I": 0.75}, POSE), "I is more probable"),
        (Estimate("E", {"E": 1.0}, None), "has no pose"),
        (Estimate("E", {"E": 1.0}, POSE[:2]), "no finite"),
        (Estimate("E", {"E": 1.0}, [0.0, np.nan, 0.0]), "no finite"),
    ],
)
def test_what_is_no_estimate_is_refused_with_the_estimators_name(estimate, said):
    with pytest.raises(InputError, match=rf"NoneType is broken.*{said}"):
        check_estimate(estimate, None, LETTERS)


def test_candidates_are_poses():
    assert check_candidates([POSE, POSE]).shape == (2, 3)
    for wrong in ([], [[]], POSE, [POSE[:2]], np.zeros((2, 2, 3)), [[0.0, np.inf, 0.0]]):
        with pytest.raises(InputError, match="candidates"):
            check_candidates(wrong)


def test_an_interrupt_within_a_compiled_function_is_an_interrupt():
    """Numba makes a result all the same, and Python makes a SystemError of both."""
    inner = SystemError("returned a result with an exception set")
    inner.__cause__ = KeyboardInterrupt()
    for cause in (KeyboardInterrupt(), inner):
        with pytest.raises(KeyboardInterrupt), no_exit("refined"):
            raise SystemError("returned a result with an exception set") from cause
    with pytest.raises(SystemError, match="another"), no_exit("refined"):
        raise SystemError("another fault") from ValueError()
