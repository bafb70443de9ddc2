import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.rounding import CHORD_ERROR, profile

RADIUS = 0.4


@pytest.mark.parametrize("name", ["A", "B", "O", "S"])
def test_parts_are_convex_and_make_up_the_solid(name):
    letter = models.letter(name, rounding=RADIUS)
    solid = letter.solid
    assert solid.status().name == "NoError"
    assert solid.volume() < letter.area * letter.height
    # Hulls cannot be smaller than the parts: if they add up to the solid, the parts are convex.
    hulls = sum(ConvexHull(part.vertices).volume for part in letter.parts)
    assert hulls == pytest.approx(solid.volume(), abs=1e-5)
    areas = [
        0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
        for x, y in (part.outline.T for part in letter.parts)
    ]
    assert min(areas) > 0
    assert sum(areas) == pytest.approx(letter.area, abs=1e-6)


def test_the_volume_of_a_rounded_bar():
    """Around a bar a x b the fillet takes (1 - pi/4) r^2 a mm, and at mitred corners less by a known sum."""
    bar = models.letter("I", rounding=1.0)
    a, b, r = 4.5, 25.0, 1.0
    depth = np.linspace(0, 1, 20001)
    inset = r - np.sqrt(r**2 - (r - depth) ** 2)  # of the section at this depth below the face
    section = (a - 2 * inset) * (b - 2 * inset)
    exact = (bar.height - r) * a * b + np.trapezoid(section, depth)
    assert bar.volume == pytest.approx(exact, abs=2 * (a + b) * CHORD_ERROR * r * math.pi / 2)
    assert bar.volume < exact  # chords lie inside the circle


def test_the_profile_stays_near_its_quarter_circle():
    for radius in (0.05, 0.3, 2.0):
        corners = profile(radius)
        middle = (corners[1:] + corners[:-1]) / 2
        assert np.hypot(*(radius - corners).T) == pytest.approx(radius)
        assert radius - np.hypot(*(radius - middle).T).min() <= CHORD_ERROR
        assert corners[0] == pytest.approx([0, radius])
        assert corners[-1] == pytest.approx([radius, 0])


def test_sections_shrink_by_the_profile():
    letter = models.letter("A", rounding=0.5)
    sharp = models.letter("A")
    assert letter.solid.slice(letter.height - 0.6).area() == pytest.approx(sharp.area, abs=1e-5)
    perimeter = sum(np.hypot(*(np.roll(c, -1, axis=0) - c).T).sum() for c in sharp.contours)
    top = letter.solid.slice(letter.height - 1e-6).area()
    assert top == pytest.approx(sharp.area - 0.5 * perimeter, abs=8)  # corners make up the difference


@pytest.mark.parametrize(
    "options",
    [
        {"rounding": 3.0},
        {"rounding": math.nan},
        {"rounding": 4.0, "height": 4.0},
        {"height": 0.0},
        {"height": 1e3},
    ],
)
def test_a_radius_and_a_height_that_do_not_fit_are_refused(options):
    with pytest.raises(InputError, match=next(iter(options))) as error:
        models.letter("E", **options)
    assert "\n" not in str(error.value)
