"""Touches in space against a pad that MuJoCo presses itself."""

import mujoco
import numpy as np
import pytest

import tactsim
from tactsim import models
from tactsim.core import Pad
from tactsim.solids import SpaceOptions, SpacePress, touch_grid
from tactsim.solids.press import advanced

_, X_HIGH, _, Y_HIGH = Pad().load_bounds
FORCE, STIFFNESS = 2.0, 0.05  # N, N/mm^3


def scene(solid):
    """Make a model of a convex solid, fixed."""
    spec = mujoco.MjSpec()
    spec.option.gravity = (0, 0, 0)
    spec.option.timestep = 5e-4
    spec.add_mesh(name="solid").uservert = (solid.vertices / 1e3).ravel().tolist()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="solid", friction=(0.01, 0, 0))
    return spec


def test_a_pad_that_mujoco_presses_on_an_egg_reads_nearly_the_same():
    """An egg touches at one place, so the load of hard contacts stands within 0.2 mm of where a soft layer's does."""
    solid = models.solid("egg")
    start = touch_grid(solid, 2, 1, 0.0, np.random.default_rng(5))
    found = SpacePress([solid], SpaceOptions()).touch("egg", start)
    for near, expected in zip(advanced(start, found.travel - 4), found.readings, strict=True):
        spec = scene(solid)
        body = spec.worldbody.add_body(pos=near[:3] / 1e3, quat=near[3:])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1), damping=5.0)
        body.add_geom(
            name="finger", type=mujoco.mjtGeom.mjGEOM_BOX, size=(X_HIGH / 1e3, Y_HIGH / 1e3, 0.002),
            pos=(0, 0, -0.002), mass=0.1,
        )  # fmt: skip
        attached = tactsim.press.attach(spec, "finger", stiffness=1e3 * STIFFNESS)
        model = spec.compile()
        data, reader = mujoco.MjData(model), attached.bind(model)
        data.qfrc_applied[0] = FORCE
        for _ in range(400):
            mujoco.mj_step(model, data)
        read = reader.read(data)
        assert read.force == pytest.approx(FORCE, rel=0.01)
        assert np.abs(read.kpa - expected).max() < 0.1 * expected.max()
        x, y = Pad().taxel_xy.T
        assert (read.kpa @ x - expected @ x, read.kpa @ y - expected @ y) == pytest.approx(
            (0, 0), abs=0.2 * expected.sum()
        )
