import math
import pickle

import numpy as np
import pytest

import models
from models.errors import InputError


def polygon_area(outline):
    x, y = outline.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@pytest.fixture(params=models.names())
def letter(request):
    return models.letter(request.param)


def test_the_solid_is_watertight_and_prismatic(letter):
    assert letter.solid.status().name == "NoError"
    assert letter.volume == pytest.approx(letter.area * letter.height, rel=1e-9)


def test_the_centre_of_area_is_the_origin(letter):
    assert np.linalg.norm(models.letter(letter.name).footprint.area() - letter.area) < 1e-9
    whole = sum(polygon_area(part.outline) * _centroid(part.outline) for part in letter.parts)
    assert np.linalg.norm(whole) / letter.area < 1e-7


def _centroid(outline):
    x, y = outline.T
    cross = x * np.roll(y, -1) - y * np.roll(x, -1)
    return np.array([cross @ (x + np.roll(x, -1)), cross @ (y + np.roll(y, -1))]) / (3 * cross.sum())


def test_parts_are_convex_and_tile_the_footprint(letter):
    from manifold3d import CrossSection, OpType

    for part in letter.parts:
        along = np.roll(part.outline, -1, axis=0) - part.outline
        after = np.roll(along, -1, axis=0)
        assert (along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0] > 0).all()
    assert sum(polygon_area(part.outline) for part in letter.parts) == pytest.approx(letter.area, abs=1e-7)
    sections = [CrossSection([part.outline]) for part in letter.parts]
    union = CrossSection.batch_boolean(sections, OpType.Add)
    assert (union - letter.footprint).area() < 1e-6
    assert (letter.footprint - union).area() < 1e-6


def test_symmetry_is_found_from_the_shape():
    found = {name: models.letter(name).symmetry for name in "AEIOU"}
    assert found == {"A": 1, "E": 1, "I": 2, "O": math.inf, "U": 1}


def test_the_bar_has_the_moments_of_a_rectangle():
    bar = models.letter("I")
    (part,) = bar.parts
    width, height = np.ptp(part.outline, axis=0)
    assert bar.area == pytest.approx(width * height)
    assert bar.inertia_over_mass == pytest.approx((width**2 + height**2) / 12)
    assert bar.radius == pytest.approx(math.hypot(width, height) / 2)


def test_letters_pickle(letter):
    assert pickle.loads(pickle.dumps(letter)) == letter


def test_an_unknown_letter_is_named():
    with pytest.raises(InputError, match="unknown letter 'ß'"):
        models.letter("ß")
