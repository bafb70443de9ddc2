"""Meshes with known touches, as the press takes them: a name, vertices and faces."""

from types import SimpleNamespace

import numpy as np
from manifold3d import Manifold

SEGMENTS = 256


def mesh(name, solid):
    made = solid.to_mesh64()
    return SimpleNamespace(
        name=name, vertices=np.array(made.vert_properties[:, :3]), faces=made.tri_verts.astype(np.int64)
    )


def ball(radius=15.0):
    return mesh("ball", Manifold.sphere(radius, SEGMENTS))


def rod(radius=10.0, length=60.0):
    """A cylinder along y."""
    return mesh("rod", Manifold.cylinder(length, radius, radius, SEGMENTS, True).rotate((90, 0, 0)))


def box(*sides):
    return mesh("box", Manifold.cube(sides, True))


def roof(length=60.0, side=20.0):
    """A box whose edge looks along -z, and lies along y."""
    return mesh("roof", Manifold.cube((side, length, side), True).rotate((0, 45, 0)))


def needle(radius=0.5):
    return mesh("needle", Manifold.cylinder(20.0, radius, radius, SEGMENTS, True))
