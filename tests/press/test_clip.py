import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection

from tactsim.press.clip import MOMENTS, POWERS, cell_moments, covers, edges_of

X_LINES = np.array([-3.0, -2.0, -0.5, 0.5, 1.0, 4.0])
Y_LINES = np.array([-2.0, -1.0, 0.0, 1.5, 2.5])
SHAPES = {
    "frame": CrossSection.square((3.0, 3.0), True) - CrossSection.square((1.5, 1.5), True),
    "star": CrossSection(
        [[(0, 3), (-0.4, 0.5), (-3, 0), (-0.4, -0.5), (0, -3), (0.4, -0.5), (3, 0), (0.4, 0.5)]]
    ),
    "ring": CrossSection.circle(2.2, 40) - CrossSection.circle(1.7, 40),
}


def by_triangles(region, centre):
    """All moments up to the third of a region, by a rule that is exact for cubics on triangles to a corner."""
    total = np.zeros(MOMENTS)
    barycentric = [(1 / 3, 1 / 3, -27 / 48), (0.6, 0.2, 25 / 48), (0.2, 0.6, 25 / 48), (0.2, 0.2, 25 / 48)]
    for contour in region.to_polygons():
        a = contour - centre
        b = np.roll(a, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        for s, t, weight in barycentric:
            u, v = (s * a + t * b).T
            total += [(weight * cross / 2 * u**i * v**j).sum() for i, j in POWERS]
    return total


def assert_moments(moments, region, within):
    """Check moments (k, rows, columns) of each cell with those of a region by triangles."""
    for row in range(len(Y_LINES) - 1):
        for column in range(len(X_LINES) - 1):
            low = np.array([X_LINES[column], Y_LINES[row]])
            high = np.array([X_LINES[column + 1], Y_LINES[row + 1]])
            cell = CrossSection.square(tuple(high - low)).translate(tuple(low))
            truth = by_triangles(region ^ cell, (low + high) / 2)
            assert moments[:, row, column] == pytest.approx(truth[: len(moments)], abs=within)


@given(
    st.sampled_from(sorted(SHAPES)),
    st.floats(-4, 4),
    st.floats(-4, 4),
    st.one_of(st.sampled_from([0.0, np.pi / 2, np.pi, -np.pi / 2]), st.floats(-7, 7)),
)
@settings(deadline=None, max_examples=50)
def test_moments_are_those_of_the_clipped_polygon(name, x, y, angle):
    shape = SHAPES[name]
    moments = cell_moments(edges_of(shape.to_polygons()), np.array([[x, y, angle]]), X_LINES, Y_LINES)[:, 0]
    # manifold3d rounds corners to 1e-8 mm, so no more can be asked
    assert_moments(moments, shape.rotate(np.degrees(angle)).translate((x, y)), 1e-6)


def test_an_edge_that_crosses_a_line_by_less_than_any_double_is_no_edge_of_its_own():
    """Its slope is infinite, and infinity times nothing is no number."""
    lines, step = np.array([-2.0, 0.0, 2.0]), 5e-324
    exact, bent = (
        cell_moments(
            edges_of([np.array([(left, -1.5), (1.0, -1.5), (1.0, 1.5), (right, 1.5)])]),
            np.zeros((1, 3)), lines, lines,
        )
        for left, right in ((0.0, 0.0), (-step, step))
    )  # fmt: skip
    assert bent == pytest.approx(exact, abs=1e-12)


@given(
    st.sampled_from(sorted(SHAPES)),
    st.floats(-3, 3),
    st.floats(-7, 7),
    st.tuples(st.floats(-2, 2), st.floats(-7, 7),
              st.one_of(st.sampled_from([0.0, 1e-300, 1e-13]), st.floats(1e-3, 1))),
    st.floats(-0.3, 0.3),
)  # fmt: skip
@example("ring", 0.0, 0.0, (2.2250738585e-313, 0.0, 1.0), 0.0)
@settings(deadline=None, max_examples=50)
def test_only_what_lies_deep_enough_counts_and_a_tilt_foreshortens(name, x, angle, surface, tilt):
    shape = SHAPES[name]
    level, towards, steepness = surface
    a, b = steepness * np.cos(towards), steepness * np.sin(towards)
    plane = np.array([[np.cos(tilt), 0.0], [0.1 * np.sin(tilt), 1.0]])
    moments = cell_moments(
        edges_of(shape.to_polygons()), np.array([[x, 0.3, angle], [0.0, 0.0, 0.0]]), X_LINES, Y_LINES,
        plane=np.stack([plane, np.eye(2)]), depth=np.array([(level, a, b), (-1.0, 0.0, 0.0)]),
        moments=MOMENTS,
    )  # fmt: skip
    assert not moments[:, 1].any()  # nothing of the second press is deep enough
    placed = shape.rotate(np.degrees(angle)).translate((x, 0.3))
    placed = placed.transform(np.column_stack([plane, np.zeros(2)]))
    if steepness < 1e-3 or abs(level) > 20 * steepness:  # the line is far away, if there is one
        kept = placed if level > 0 else CrossSection()
    else:
        up = np.array([a, b]) / steepness
        along, middle = np.array([-up[1], up[0]]), -level / steepness * up
        kept = placed ^ CrossSection([[middle + 50 * k for k in (-along, up - along, up + along, along)]])
    assert_moments(moments[:, 0], kept, 2e-5)


def test_a_point_is_covered_where_the_ring_is():
    points = np.random.default_rng(1).uniform(-3, 3, (2000, 2))
    radius = np.hypot(*points.T)
    clear = (np.abs(radius - 2.2) > 0.01) & (np.abs(radius - 1.7) > 0.01)
    inside = covers(SHAPES["ring"].to_polygons(), points)
    assert np.array_equal(inside[clear], ((radius > 1.7) & (radius < 2.2))[clear])
