import math
import pickle

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold
from scipy.spatial.transform import Rotation

from tactsim import models
from tactsim.core import InputError
from tactsim.models.height_field import FELT, Relief


def tower():
    """Stack a ball on a post on a plate: the ball hides part of the plate, and below the ball part of the post."""
    plate, post = Manifold.cube((20, 20, 2), True), Manifold.cylinder(6, 2, 2, 64)
    return plate + post + Manifold.sphere(4, 64).translate((0, 0, 6))


def wedge():
    """A ramp that falls towards +x, by 0.5 mm in 10."""
    outline = CrossSection([[[-5, 0], [5, 0], [5, 3.5], [-5, 4]]])
    return outline.extrude(8).rotate((90, 0, 0)).translate((0, 4, 0))


def areas(facets):
    sides = facets[:, 1:, :2] - facets[:, :1, :2]
    return (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2


def heights(facets, points):
    """Look down at facets (m, 3, 3) with gaps: the least gap at each of `points`, inf where there is none."""
    result = np.full(len(points), np.inf)
    for corners in facets:
        a, b, c = corners
        matrix = np.array([b[:2] - a[:2], c[:2] - a[:2]]).T
        s, t = np.linalg.solve(matrix, (points - a[:2]).T)
        inside = (s >= 0) & (t >= 0) & (s + t <= 1)
        gap = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
        result[inside] = np.minimum(result[inside], gap[inside])
    return result


def met_first(solid, points):
    """Look down at every triangle of a solid, whichever way it faces: the gaps below its highest point."""
    mesh = solid.to_mesh64()
    corners = mesh.vert_properties[:, :3][mesh.tri_verts]
    corners[:, :, 2] = corners[:, :, 2].max() - corners[:, :, 2]
    return heights(corners[np.abs(areas(corners)) > 1e-9], points)


def turn(seed):
    return np.eye(3) if seed is None else Rotation.random(random_state=seed).as_matrix()


@pytest.mark.parametrize("seed", [None, 1, 2])
@pytest.mark.parametrize("make", [tower, lambda: models.letter("E", rounding=0.5).solid])
def test_what_is_seen_is_what_is_met_first_and_nothing_twice(make, seed):
    solid, rotation = make(), turn(seed)
    # x_mesh = rotation x, so the solid seen in those axes is the solid turned back.
    turned = solid.transform(np.column_stack([rotation.T, np.zeros(3)]))
    field = Relief.of(solid).turned(rotation).seen_from_above
    assert areas(field.facets).sum() == pytest.approx(turned.project().area(), rel=1e-5)
    assert (areas(field.facets) > 0).all()
    assert (np.diff(field.front) >= 0).all()
    low_x, low_y, low, high_x, high_y, high = turned.bounding_box()
    assert field.height == pytest.approx(high - low, abs=1e-9)
    points = np.random.default_rng(0).uniform((low_x, low_y), (high_x, high_y), (300, 2))
    expected = met_first(turned, points)
    found = heights(field.facets, points)
    assert np.isfinite(expected).sum() > 50
    steep = np.isfinite(expected) != np.isfinite(found)  # a point on an outline may lie on a facet or not
    assert steep.sum() <= 2
    assert found[~steep] == pytest.approx(expected[~steep], abs=1e-6)


@pytest.mark.parametrize("step", [0.02, 0.5])
def test_a_step_is_part_of_the_footprint_and_of_the_symmetry(step):
    lower = Manifold.cube((8, 8, 4 - step)).translate((8, 0, 0))
    shape = models.relief("step", Manifold.cube((8, 8, 4)) + lower)
    assert shape.area == pytest.approx(128)
    assert shape.height == 4
    assert shape.flat_depth == pytest.approx(step)
    assert shape.symmetry == 1
    x, y, z = shape.relief.vertices.T
    assert (x.min(), x.max(), y.min(), z.min()) == pytest.approx((-8, 8, -4, 0))


def test_what_lies_deeper_than_is_felt_is_no_part_of_the_footprint():
    raised = Manifold.cube((30, 20, 2)) + Manifold.cylinder(3 * FELT + 2, 5, 5, 128).translate((20, 10, 0))
    shape = models.relief("stud", raised)
    assert shape.area == pytest.approx(25 * math.pi, rel=1e-3)
    assert shape.flat_depth == pytest.approx(3 * FELT)
    assert shape.symmetry == math.inf
    assert shape.relief.vertices[:, 0].min() == pytest.approx(-20)


@pytest.mark.parametrize(
    ("make", "order"),
    [
        (lambda: Manifold.cylinder(5, 8, 0, 256), math.inf),
        (lambda: Manifold.cylinder(20, 6, 6, 256, True).rotate((90, 0, 0)), 2),
        (lambda: Manifold.cylinder(2, 8, 6, 6), 6),
        (wedge, 1),  # whose outline has order 2
    ],
    ids=["cone", "lying cylinder", "pyramid", "ramp"],
)
def test_symmetry_of_relief(make, order):
    assert models.relief("it", make()).symmetry == order


def test_a_shape_with_relief_travels_and_is_known_by_its_mesh():
    shape = models.relief("dome", Manifold.sphere(10, 64))
    assert shape.relief.hull is not None
    assert math.isinf(models.relief("box", Manifold.cube((9, 9, 3))).flat_depth)
    again = pickle.loads(pickle.dumps(shape))
    assert again == shape
    assert again.digest == shape.digest
    bigger = models.relief("dome", Manifold.sphere(10, 64) + Manifold.sphere(1, 16).translate((0, 0, -9.5)))
    assert bigger.digest != shape.digest


@pytest.mark.long
def test_convex_parts_of_a_convex_shape_or_a_refusal():
    (part,) = models.relief("dome", Manifold.sphere(10, 64)).parts
    assert part.vertices[:, 2].max() == pytest.approx(20)
    assert part.rectangle is None
    with pytest.raises(InputError, match="not convex"):
        _ = models.relief("tower", tower()).parts


@pytest.mark.parametrize("make", [Manifold, lambda: Manifold.cube((5, 5, 101))], ids=["empty", "too high"])
def test_solids_that_are_none(make):
    with pytest.raises(InputError, match=r"'it': (the solid is empty|height is 101 mm)"):
        models.relief("it", make())
