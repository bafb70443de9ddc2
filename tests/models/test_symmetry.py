import math

import numpy as np
import pytest
from manifold3d import CrossSection

from tactsim import models
from tactsim.models.letter import TOLERANCE, rotational_order


def regular(sides, radius=12.0, phase=0.0):
    angle = phase + np.arange(sides) * 2 * math.pi / sides
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


EXPECTED = dict.fromkeys("HINSXZ0", 2) | {"O": math.inf}


def test_the_order_of_each_glyph():
    orders = {name: models.letter(name).symmetry for name in models.names()}
    assert {name: order for name, order in orders.items() if order != 1} == EXPECTED


@pytest.mark.parametrize("sides", [3, 4, 6, 15, 24, 30])
def test_regular_polygons_have_the_order_of_their_sides(sides):
    assert rotational_order([regular(sides, phase=0.123)]) == sides


@pytest.mark.parametrize("sides", [36, 97, 400])
def test_a_fine_regular_polygon_is_a_circle(sides):
    assert 12 * (1 - math.cos(math.pi / sides)) < TOLERANCE
    assert rotational_order([regular(sides)]) == math.inf


def test_a_ring_is_a_circle_unless_its_hole_is_off_the_centre():
    outer, inner = regular(64), regular(64, 8.0)[::-1]
    assert rotational_order([outer, inner]) == math.inf
    assert rotational_order([outer, inner + [0.2, 0]]) == 1


def test_a_small_notch_breaks_the_symmetry():
    ring = CrossSection.circle(12, 64) - CrossSection.circle(8, 64)
    notch = CrossSection.square((0.5, 0.5)).translate((11.7, 0))
    assert rotational_order((ring - notch).to_polygons()) == 1
    assert rotational_order((ring - notch - notch.rotate(120) - notch.rotate(240)).to_polygons()) == 3


def test_the_order_does_not_depend_on_the_orientation():
    for name, order in (("S", 2), ("A", 1)):
        turned = models.letter(name).footprint.rotate(201.3)
        assert rotational_order(turned.to_polygons()) == order


def test_deviations_below_the_tolerance_do_not_count_and_above_do():
    box = np.array([[-10, -3], [10, -3], [10, 3], [-10, 3]], dtype=float)
    for shift, order in ((0.8 * TOLERANCE, 2), (2.2 * TOLERANCE, 1)):
        dented = box.copy()
        dented[2, 0] += shift
        assert rotational_order([dented]) == order
