"""The catalogue: each solid is one watertight body of the size, symmetry and mesh that are promised."""

import math

import numpy as np
import pytest

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.solids.symmetry import crossings

TWELVE = (
    "bolt", "nut", "key", "mug", "gear", "spool", "bracket", "egg", "cone", "star-knob", "ring", "tetrapod",
)  # fmt: skip
# How many turns leave each as it is, as one sees on the object itself.
ORDERS = {"nut": 12, "key": 1, "gear": 24, "spool": math.inf, "egg": math.inf, "star-knob": 5, "tetrapod": 12}


@pytest.mark.parametrize(
    "name", [*TWELVE, *(pytest.param(name, marks=pytest.mark.long) for name in models.solid_names(50)[12:])]
)
def test_each_is_one_body_of_20_to_60_mm_that_cuts_nowhere_through_itself(name):
    solid = models.solid(name)
    assert 20 <= np.ptp(solid.vertices, axis=0).max() <= 60
    assert len(solid.faces) <= 5000
    assert len(solid.manifold.decompose()) == 1
    assert solid.areas.min() > 1e-5
    assert len(crossings(solid.corners)) == 0


@pytest.mark.parametrize("name", ORDERS)
def test_symmetry_is_that_of_the_object(name):
    symmetry = models.solid(name).symmetry
    assert symmetry.order == ORDERS[name]
    if math.isinf(symmetry.order):
        assert len(symmetry.rotations) == (2 if name == "spool" else 1)  # whose ends are alike
        assert np.abs(symmetry.axis) == pytest.approx([0, 0, 1], abs=1e-6)


def test_names_are_the_twelve_then_variants():
    assert models.solid_names() == TWELVE
    fifty = models.solid_names(50)
    assert fifty[:12] == TWELVE
    assert fifty[12] == "bolt-2"
    for count in (0, 51):
        with pytest.raises(InputError, match="1 to 50 solids"):
            models.solid_names(count)


@pytest.mark.long
def test_no_two_of_fifty_are_the_same():
    assert len({models.solid(name).digest for name in models.solid_names(50)}) == 50


def test_an_unknown_name_is_told_the_nearest():
    with pytest.raises(InputError, match="unknown solid 'star knob': did you mean 'star-knob'"):
        models.solid("star knob")
