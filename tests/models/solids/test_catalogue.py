"""The catalogue: each solid is one watertight body of the size, symmetry and mesh that are promised."""

import math

import numpy as np
import pytest

from tactsim import models
from tactsim.core.errors import InputError

TWELVE = (
    "bolt", "nut", "key", "mug", "gear", "spool", "bracket", "egg", "cone", "star-knob", "ring", "tetrapod",
)  # fmt: skip
# How many turns leave each as it is, as one sees on the object itself.
ORDERS = {
    "bolt": 6, "nut": 12, "key": 1, "mug": math.inf, "gear": 24, "spool": math.inf, "bracket": 1, "egg": math.inf,
    "cone": math.inf, "star-knob": 5, "ring": math.inf, "tetrapod": 12,
}  # fmt: skip
TWO_ENDS_ALIKE = ("spool", "ring")


@pytest.mark.parametrize("name", models.solid_names(50))
def test_each_is_one_watertight_body_of_20_to_60_mm(name):
    solid = models.solid(name)
    longest = np.ptp(solid.vertices, axis=0).max()
    assert 20 <= longest <= 60
    assert len(solid.faces) <= 5000
    assert len(solid.manifold.decompose()) == 1
    # Every edge joins two faces, which run along it in opposite directions.
    edges = {(a, b) for face in solid.faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)}
    assert len(edges) == 3 * len(solid.faces)
    assert all((b, a) in edges for a, b in edges)
    assert solid.areas.min() > 1e-5


@pytest.mark.parametrize("name", TWELVE)
def test_symmetry_is_that_of_the_object(name):
    symmetry = models.solid(name).symmetry
    assert symmetry.order == ORDERS[name]
    if math.isinf(symmetry.order):
        assert len(symmetry.rotations) == (2 if name in TWO_ENDS_ALIKE else 1)
        assert np.abs(symmetry.axis) == pytest.approx([0, 0, 1], abs=1e-6)


def test_names_are_the_twelve_then_variants():
    assert models.solid_names() == TWELVE
    fifty = models.solid_names(50)
    assert fifty[:12] == TWELVE
    assert fifty[12] == "bolt-2"
    assert len({models.solid(name).digest for name in fifty}) == 50
    for count in (0, 51):
        with pytest.raises(InputError, match="1 to 50 solids"):
            models.solid_names(count)


def test_an_unknown_name_is_told_the_nearest():
    with pytest.raises(InputError, match="unknown solid 'star knob': did you mean 'star-knob'"):
        models.solid("star knob")
    with pytest.raises(InputError, match="unknown solid 'bolt-9'"):
        models.solid("bolt-9")
