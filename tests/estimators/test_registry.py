import pytest

import estimators
from tactsim import InputError


def test_an_unknown_estimator_is_named_with_the_known_ones():
    with pytest.raises(InputError, match="unknown estimator 'kalmann'"):
        estimators.create("kalmann")
