"""The bodies that other people's solvers press: mesh and height field of each are one shape, and springs press it."""

import numpy as np
import pytest
from referee_bodies import FORCE, HALF, PAD, STIFFNESS, bodies, truth, within

BODIES = {body.name: body for body in bodies()}


@pytest.mark.parametrize("name", BODIES)
def test_the_mesh_is_the_height_field(name):
    """Both are cut level by level."""
    body = BODIES[name]
    x, y = np.random.default_rng(0).uniform(-HALF, HALF, (2, 2000))
    for height in (0.003, 0.02, 0.13, 0.31):
        within_mesh = within(body.solid.slice(height).to_polygons(), x, y)
        within_field = body.gap(x, y) < height
        assert within_mesh.any() == within_field.any()
        assert (within_mesh == within_field).mean() > 0.99, height  # some lie at a rim


@pytest.mark.parametrize("name", BODIES)
def test_springs_carry_the_force(name):
    kpa, depth = truth(BODIES[name])
    assert kpa.sum() * 1.9**2 * 1e-3 == pytest.approx(FORCE, rel=1e-6)
    assert 0 < depth < 1
    assert len(kpa) == PAD.taxels


def test_springs_under_a_sphere_and_a_cone_are_those_of_the_closed_forms():
    """F = pi k d^2 (R - d / 3) and F = pi k d^3 / (3 s^2)."""
    depth = truth(BODIES["sphere"])[1]
    assert np.pi * STIFFNESS * depth**2 * (10 - depth / 3) == pytest.approx(FORCE, rel=1e-4)
    assert truth(BODIES["cone"])[1] == pytest.approx((3 * FORCE * 0.2**2 / np.pi) ** (1 / 3), rel=1e-4)
