import math

import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st
from manifold3d import CrossSection
from scipy.spatial import ConvexHull

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.parts import CHORD_ERROR, convex_pieces, profile
from tactsim.models.shapes import cleaned


def area(outline):
    x, y = outline.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def check_tiling(region):
    """Assert that the pieces are convex, cover the region and do not overlap; return them."""
    contours = region.to_polygons()
    pieces = convex_pieces(contours)
    scale = max(1.0, abs(region.area()))
    for piece in pieces:
        along = np.roll(piece, -1, axis=0) - piece
        after = np.roll(along, -1, axis=0)
        cross = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
        assert len(piece) >= 3
        assert (cross > -1e-4 * (np.hypot(*along.T) + np.hypot(*after.T))).all()  # convex within 1e-4 mm
    assert sum(map(area, pieces)) == pytest.approx(sum(map(area, contours)), abs=1e-6 * scale)
    sections = [CrossSection([piece]) for piece in pieces]
    for k, section in enumerate(sections):
        assert (section - region).area() < 1e-6 * scale
        for other in sections[:k]:
            assert (section ^ other).area() < 1e-6 * scale
    return pieces


@pytest.mark.parametrize(
    ("outline", "count"),
    [
        ([(0, 0), (4, 0), (4, 3), (0, 3)], 1),
        ([(0, 0), (9, 0), (9, 3), (3, 3), (3, 9), (0, 9)], 2),  # L
        ([(0, 0), (10, 0), (10, 10), (7, 10), (7, 3), (3, 3), (3, 10), (0, 10)], 3),  # U
        ([(0, 0), (4, 2), (8, 0), (4, 6)], 2),  # dart
    ],
)
def test_simple_outlines_need_few_pieces(outline, count):
    assert len(check_tiling(CrossSection([np.array(outline, dtype=float)]))) == count


@pytest.mark.parametrize("name", ["A", "B", "O", "S"])
def test_letters_are_tiled(name):
    check_tiling(models.letter(name).footprint)


def test_right_angles_give_rectangles():
    pieces = check_tiling(models.letter("E").footprint)
    assert sorted(len(piece) for piece in pieces) == [4, 4, 4, 4]


def test_a_ring_gives_a_trapezoid_for_each_inner_chord():
    ring = CrossSection.circle(10, 24) - CrossSection.circle(6, 24)
    pieces = check_tiling(ring)
    assert len(pieces) == 24
    assert max(map(area, pieces)) == pytest.approx(min(map(area, pieces)), rel=1e-6)


def test_pieces_are_at_most_one_more_than_the_reflex_corners():
    teeth = 30
    angle = np.linspace(0, 2 * math.pi, 2 * teeth, endpoint=False)
    radius = np.where(np.arange(2 * teeth) % 2, 6.0, 10.0)
    star = CrossSection([np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)])
    assert len(check_tiling(star)) <= teeth + 1


def test_holes_that_touch_and_islands_in_holes():
    region = CrossSection.square((20, 20)) - CrossSection.square((5, 5)).translate((5, 5))
    region -= CrossSection.square((5, 5)).translate((10, 10))  # it touches the first at one corner
    region += CrossSection.square((2, 2)).translate((6, 6))
    check_tiling(cleaned(region))


@st.composite
def regions(draw):
    """Draw unions and differences of boxes on a coarse grid (many touch or line up), triangles and discs."""
    numbers = st.integers(0, 12).map(lambda n: n * 1.25)
    region = CrossSection()
    for _ in range(draw(st.integers(1, 8))):
        kind = draw(st.sampled_from(["box", "triangle", "disc"]))
        x, y = draw(numbers), draw(numbers)
        if kind == "box":
            piece = CrossSection.square((1.25 + draw(numbers), 1.25 + draw(numbers))).translate((x, y))
            piece = piece.rotate(draw(st.sampled_from([0, 0, 0, 90, 30, 45.5])))
        elif kind == "triangle":
            corners = np.array([(draw(numbers), draw(numbers)) for _ in range(3)])
            piece = CrossSection([corners if area(corners) > 0 else corners[::-1]])
        else:
            piece = CrossSection.circle(1 + draw(numbers) / 2, draw(st.integers(5, 24))).translate((x, y))
        region = region - piece if draw(st.booleans()) and not region.is_empty() else region + piece
    return cleaned(region)


@settings(max_examples=50, deadline=None)
@given(regions())
def test_any_region_is_tiled(region):
    note([contour.tolist() for contour in region.to_polygons()])
    if not region.is_empty():
        check_tiling(region)


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
