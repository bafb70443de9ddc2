import math
import pickle

import numpy as np
import pytest

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.letter import Letter


def polygon_area(outline):
    x, y = outline.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@pytest.fixture(params=["A", "E", "O", "Q", "8"])
def letter(request):
    return models.letter(request.param)


def test_the_solid_is_watertight_and_prismatic(letter):
    assert letter.solid.status().name == "NoError"
    assert letter.volume == pytest.approx(letter.area * letter.height, rel=1e-9)


def test_the_centre_of_area_is_the_origin(letter):
    whole = sum(polygon_area(part.outline) * centroid(part.outline) for part in letter.parts)
    assert np.linalg.norm(whole) / letter.area < 1e-7


def centroid(outline):
    x, y = outline.T
    cross = x * np.roll(y, -1) - y * np.roll(x, -1)
    return np.array([cross @ (x + np.roll(x, -1)), cross @ (y + np.roll(y, -1))]) / (3 * cross.sum())


def test_an_unknown_letter_is_named():
    with pytest.raises(InputError, match="unknown letter 'ß'"):
        models.letter("ß")


def test_letters_are_cached_and_cannot_be_written():
    letter = models.letter("A")
    assert models.letter("A") is letter
    for array in (*letter.contours, letter.parts[0].outline, letter.parts[0].vertices):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_a_letter_travels_and_is_known_by_its_geometry():
    letter = models.letter("A")
    again = pickle.loads(pickle.dumps(letter))
    assert again.digest == letter.digest
    assert Letter("other", letter.contours, letter.height).digest == letter.digest
    others = [models.letter("A", height=3), models.letter("A", rounding=0.2), models.letter("V")]
    moved = Letter("A", (letter.contours[0] + 1e-8, *letter.contours[1:]), letter.height)
    assert len({letter.digest, moved.digest, *(other.digest for other in others)}) == 5
    assert again == letter
    assert letter not in others


def test_the_digest_is_that_of_0_1():
    assert models.letter("A").digest == "925993e4568270a47f9362e60607b4104d9a1fc846d7d4583007fb93e8696bc8"


def test_the_ring_has_the_moments_of_a_polygon_ring():
    ring = models.letter("O")
    outer, inner = (len(contour) for contour in ring.contours)

    def regular(sides, radius):
        """Area and second moment about the centre of a regular polygon (closed form)."""
        step = 2 * math.pi / sides
        area = sides / 2 * radius**2 * math.sin(step)
        return area, area * radius**2 * (2 + math.cos(step)) / 6

    (a, m), (b, n) = regular(outer, 12.5), regular(inner, 8.0)
    assert ring.area == pytest.approx(a - b, rel=1e-7)
    assert ring.inertia_over_mass == pytest.approx((m - n) / (a - b), rel=1e-7)
    assert ring.radius == pytest.approx(12.5)
    assert ring.mass == pytest.approx(ring.area * 4.0 * 1.05e-6, rel=1e-9)  # kg: 1,050 kg / m^3, 4 mm


def test_moments_agree_with_a_sum_over_parts(letter):
    """Parallel axes: the parts' own moments and their distances make up the whole."""
    total = 0.0
    for part in letter.parts:
        x, y = part.outline.T
        cross = x * np.roll(y, -1) - y * np.roll(x, -1)
        for u in (x, y):
            v = np.roll(u, -1)
            total += float(cross @ (u * u + u * v + v * v)) / 12
    assert letter.inertia_over_mass == pytest.approx(total / letter.area, rel=1e-7)


def test_rectangles_are_their_outlines(letter):
    for part in letter.parts:
        if part.rectangle is None:
            continue
        centre, (a, b), angle = part.rectangle
        along, across = (
            np.array([math.cos(angle), math.sin(angle)]),
            np.array([-math.sin(angle), math.cos(angle)]),
        )
        corners = [
            np.array(centre) + s * a * along + t * b * across for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        gaps = np.linalg.norm(part.outline[:, None] - np.array(corners)[None], axis=2).min(axis=1)
        assert gaps.max() < 1e-6
    assert all(part.rectangle is not None for part in models.letter("E").parts)
