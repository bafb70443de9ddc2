import math

import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st
from manifold3d import CrossSection

from tactsim import models
from tactsim.models.letter import convex_pieces
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
