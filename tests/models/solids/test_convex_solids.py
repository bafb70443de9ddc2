"""Convex parts: their hulls fill the solid, do not overlap, and stand out from it by no more than is said."""

import mujoco
import numpy as np
import pytest
from manifold3d import CrossSection, Manifold, OpType

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.solids import solid_of
from tactsim.models.solids.convex_solids import CONCAVITY
from tactsim.models.solids.triangles import CutSurface


# The others take seconds each.
@pytest.mark.parametrize("name", ["key", "bracket", "tetrapod"])
def test_the_parts_fill_the_solid_and_no_more(name):
    solid = models.solid(name)
    hulls = [Manifold.hull_points(part) for part in solid.parts]
    filled = Manifold.batch_boolean(hulls, OpType.Add)
    assert sum(hull.volume() for hull in hulls) <= filled.volume() * 1.001
    # What is missing are slivers.
    assert (solid.manifold - filled).volume() <= 1e-3 * solid.volume
    outside = (filled - solid.manifold).to_mesh64()
    corners = np.asarray(outside.vert_properties)[np.asarray(outside.tri_verts, dtype=int)]
    if len(corners):
        points = np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)])
        assert CutSurface(solid.corners).distances(points, 0.0).max() <= 1.2 * CONCAVITY
    assert len(hulls) <= 80


@pytest.mark.parametrize(
    ("outline", "pieces"),
    [
        ([[0, 0], [30, 0], [30, 30], [20, 30], [20, 10], [10, 10], [10, 30], [0, 30]], 3),
        ([[0, 0], [30, 0], [30, 30], [0, 30]], 1),
    ],
)
def test_few_pieces_for_plain_shapes(outline, pieces):
    solid = solid_of("thing", CrossSection([np.array(outline, dtype=float)]).extrude(12))
    assert len(solid.parts) == pieces
    assert sum(Manifold.hull_points(part).volume() for part in solid.parts) == pytest.approx(solid.volume)


def test_a_narrow_slot_beside_a_thin_wall_is_no_hull():
    # The bottom of the slot lies 0.04 mm behind the side wall, but 20 mm deep.
    slot = Manifold.cube((0.5, 40, 20)).translate((0.04, -5, 10))
    solid = solid_of("slotted", Manifold.cube((3, 30, 30)) - slot)
    assert len(solid.parts) > 1


def test_what_takes_too_many_pieces_is_refused():
    posts = [Manifold.cube((2, 2, 9)).translate((4 * k, 4 * m, 0)) for k in range(21) for m in range(21)]
    brush = Manifold.batch_boolean([Manifold.cube((90, 90, 3)).translate((-2, -2, -2)), *posts], OpType.Add)
    with pytest.raises(InputError, match="'brush': it takes more than 400 convex pieces"):
        _ = solid_of("brush", brush).parts


def test_mujoco_takes_the_parts_and_weighs_the_solid():
    solid, spec = models.solid("bracket"), mujoco.MjSpec()
    body = spec.worldbody.add_body()
    body.add_freejoint()
    for number, part in enumerate(solid.parts):
        spec.add_mesh(name=str(number), uservert=(part / 1000).ravel().tolist())
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=str(number), density=1050.0)
    model = spec.compile()
    assert model.body_mass[1] == pytest.approx(solid.mass, rel=2e-3)
    assert model.body_ipos[1] == pytest.approx([0, 0, 0], abs=2e-5)
    moments = np.linalg.eigvalsh(solid.inertia) * 1e-6  # kg m^2
    assert np.sort(model.body_inertia[1]) == pytest.approx(moments, rel=2e-3)
