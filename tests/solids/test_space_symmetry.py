"""Symmetry in space: groups that are known, however the body is turned or its mesh is cut, and near misses."""

import math

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold, OpType

from tactsim import models
from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.solids import solid_of
from tactsim.solids.symmetry import find_symmetry

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 12.0
GOLDEN = (1 + math.sqrt(5)) / 2
ICOSAHEDRON = np.concatenate(
    [np.roll([[0, s, t * GOLDEN] for s in (-1, 1) for t in (-1, 1)], k, axis=1) for k in range(3)]
) * 10.0  # fmt: skip


def prism(sides, height=17.0):
    angle = np.arange(sides) * 2 * math.pi / sides
    return CrossSection([12 * np.stack([np.cos(angle), np.sin(angle)], axis=1)]).extrude(height)


def box(*sizes):
    return Manifold.cube(sizes, True)


SHAPES = {
    "box": (box(20, 30, 40), 4),
    "wedge": (Manifold.hull_points(np.array([[0, 0, 0], [30, 0, 0], [0, 12, 0], [0, 0, 20], [30, 0, 20.0]])), 1),
    "square bar": (box(20, 20, 40), 8),
    "prism of 5, of a cube's moments": (prism(5, 12 * math.sqrt(3)), 10),
    "pyramid of 6": (Manifold.cylinder(20, 15, 5, 6), 6),
    "tetrahedron": (Manifold.hull_points(TETRAHEDRON), 12),
    "cube": (box(24, 24, 24), 24),
    "icosahedron": (Manifold.hull_points(ICOSAHEDRON), 60),
    "propeller of 3": (
        Manifold.batch_boolean(
            [Manifold.hull_points(np.array(blade, dtype=float)).rotate((0, 0, 120 * k)) for k in range(3) for blade in [
                [[0, -3, -5], [0, 3, -1], [0, 3, 5], [0, -3, 1], [25, -3, 1], [25, 3, -5], [25, -3, 5], [25, 3, -1]]
            ]], OpType.Add),
        6,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
def test_groups_that_are_known(name):
    rng = np.random.default_rng(5)
    shape, order = SHAPES[name]
    solid = solid_of(name, shape)
    group = solid.symmetry.rotations
    assert solid.symmetry.axis is None
    assert len(group) == order
    assert group[0] == pytest.approx([1, 0, 0, 0])
    # A group: products of its turns are its turns.
    products = rigid.multiply(group[:, None], group).reshape(-1, 4)
    assert rigid.nearest_rotation(products, group)[0].max() < 1e-2
    # Another mesh of the body, turned: the same group, turned.
    turn = rigid.random_rotations(1, rng)[0]
    corners = rigid.turned(turn, solid_of(name, shape.refine(3)).corners)
    other = find_symmetry(corners).rotations
    assert len(other) == order
    back = rigid.multiply(rigid.conjugate(turn), rigid.multiply(other, turn))
    assert rigid.nearest_rotation(back, group)[0].max() < 1e-2


@pytest.mark.parametrize("name", ["star-knob", "ring"])
def test_the_group_turns_with_the_solid(name):
    rng = np.random.default_rng(6)
    solid = models.solid(name)
    turn = rigid.random_rotations(1, rng)[0]
    found, own = find_symmetry(rigid.turned(turn, solid.corners)), solid.symmetry
    assert len(found.rotations) == len(own.rotations)
    if own.axis is not None:
        assert abs(found.axis @ rigid.turned(turn, own.axis)) == pytest.approx(1, abs=1e-5)
        # What is beside the turns about the axis reverses it.
        assert rigid.turned(found.rotations[1], found.axis) == pytest.approx(-found.axis, abs=1e-5)


@pytest.mark.parametrize(("bump", "order"), [(0.04, 6), (0.12, 1)])
def test_a_bump_counts_from_the_tolerance_on(bump, order):
    """One face of a hexagonal rod is raised on a spot of 3 mm: it is felt, however little volume it has."""
    rod = prism(6, 40).translate((0, 0, -20))
    apothem = 12 * math.cos(math.pi / 6)
    spot = Manifold.cube((2 * bump, 3, 3), True).rotate((0, 0, 30))
    angle = math.radians(30)
    place = (apothem * math.cos(angle), apothem * math.sin(angle), 9.0)
    solid = solid_of("rod", rod + spot.translate(place))
    # Two ends alike make the group twice as large, if the bump does not count.
    assert solid.symmetry.order == (2 * order if order > 1 else 1)


def test_a_fine_regular_prism_is_a_body_of_revolution():
    symmetry = solid_of("rod", prism(60, 30)).symmetry
    assert symmetry.order == math.inf
    assert len(symmetry.rotations) == 2


def test_a_ball_is_refused():
    ball = solid_of("ball", Manifold.sphere(20, 120))
    with pytest.raises(InputError, match="'ball': it is a ball, which every turn leaves as it is"):
        _ = ball.symmetry
