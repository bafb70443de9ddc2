"""Touches in space against MuJoCo: its rays against the solids' convex parts, and a pad that it presses itself."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

import tactsim
from tactsim import models
from tactsim.core import Pad
from tactsim.core.rigid import matrix
from tactsim.press.space import SpaceOptions, SpacePress, touch_grid
from tactsim.press.space.space_press import advanced
from tactsim.press.spread import felt_along

X_LOW, X_HIGH, Y_LOW, Y_HIGH = Pad().load_bounds
FORCE, STIFFNESS, DEEPEST = 2.0, 0.05, 3.0  # N, N/mm^3, mm


def scene(solid):
    """Make a model of a solid's convex parts, fixed."""
    spec = mujoco.MjSpec()
    spec.option.gravity = (0, 0, 0)
    spec.option.timestep = 5e-4
    for number, part in enumerate(solid.parts):
        spec.add_mesh(name=f"part{number}").uservert = (part / 1e3).ravel().tolist()
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part{number}", friction=(0.01, 0, 0)
        )
    return spec


def seen_by_rays(model, start, fine=0.25):
    """Send rays from the pad: the ways (rows, columns) mm to what they meet, at points x and y mm."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    columns, rows = round((X_HIGH - X_LOW) / fine), round((Y_HIGH - Y_LOW) / fine)
    x = X_LOW + (np.arange(columns) + 0.5) * (X_HIGH - X_LOW) / columns
    y = Y_LOW + (np.arange(rows) + 0.5) * (Y_HIGH - Y_LOW) / rows
    turn = matrix(start[3:])
    met = np.zeros(1, np.int32)
    away = np.array([
        [
            mujoco.mj_ray(model, data, (start[:3] + turn @ (u, v, 0)) / 1e3, turn[:, 2], None, 1, -1, met)
            for u in x
        ]
        for v in y
    ])  # fmt: skip
    return np.where(away < 0, np.inf, 1e3 * away), x, y


@pytest.mark.long
@pytest.mark.parametrize("name", ["star-knob", "nut"])
def test_a_press_through_rays_reads_the_same(name):
    solid, pad = models.solid(name), Pad()
    model = scene(solid).compile()
    starts = touch_grid(solid, 2, 1, 0.0, np.random.default_rng(5))
    found = SpacePress([solid], SpaceOptions()).touch(name, starts)
    for start, travel, reading in zip(starts, found.travel, found.readings, strict=True):
        gap, x, y = seen_by_rays(model, start)
        area = (X_HIGH - X_LOW) * (Y_HIGH - Y_LOW) / gap.size

        def carried(depth, gap=gap, area=area):
            return area * np.maximum(gap.min() + depth - gap, 0)

        stiff = max(STIFFNESS, FORCE / carried(DEEPEST).sum())
        depth = brentq(lambda depth, stiff=stiff: stiff * carried(depth).sum() - FORCE, 0, DEEPEST + 1e-6)
        assert travel == pytest.approx(gap.min() + depth, abs=0.06)
        felt_x, felt_y = felt_along(x, pad.column_edges, 1.0), felt_along(y, pad.row_edges, 1.0)
        expected = 1e3 * (felt_y.T @ (stiff * carried(depth)) @ felt_x).ravel() / 1.8**2
        assert np.abs(reading - expected).max() < 0.06 * expected.max()


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
