"""Pads beside a brute force on the same springs: bodies of any few geoms, pads that touch each other, fitted geoms."""

import mujoco
import numpy as np
import pytest
from attached_scenes import ball, errors, image, springs

import tactsim
from tactsim import Pad

PAD = Pad(rows=6, columns=6, pitch_x=2.0, pitch_y=2.0, taxel_width=1.9, taxel_height=1.9)


def heights(model, data, x, y):
    """Cast rays of MuJoCo's upwards from below the pad: how far above it a body begins, mm, infinite for none."""
    found, geom = np.full(x.size, np.inf), np.zeros(1, np.int32)
    pad, below = model.geom_bodyid[model.geom("finger").id], 50.0
    for i, place in enumerate(np.stack([x.ravel(), y.ravel()], axis=1) / 1e3):
        start, up = np.array([*place, -below / 1e3]), np.array([0.0, 0.0, 1.0])
        distance = mujoco.mj_ray(model, data, start, up, None, 1, pad, geom)
        if distance >= 0:
            found[i] = 1e3 * distance - below
    return found.reshape(x.shape)


def pressed(geoms, force, fine=0.1, assets=""):
    """Push a body of geoms, MJCF, straight down on a flat pad at z = 0: its reading and that of a brute force, kPa."""
    spec = mujoco.MjSpec.from_string(f"""
        <mujoco><asset>{assets}</asset><option gravity="0 0 0" timestep="0.001"/><worldbody>
          <body name="base"><geom name="finger" type="box" size=".03 .03 .005" pos="0 0 -.005"/></body>
          <body name="body" pos="0 0 .03"><joint type="slide" axis="0 0 1" damping="5"/>
            <inertial pos="0 0 0" mass="0.2" diaginertia="1e-5 1e-5 1e-5"/>{geoms}</body>
        </worldbody></mujoco>""")
    skin = tactsim.press.attach(spec, "finger", PAD)
    data = mujoco.MjData(model := spec.compile())
    mujoco.mj_forward(model, data)
    data.qpos[0] = -heights(model, data, *np.meshgrid(*2 * [np.arange(-12, 12, 0.2)])).min() / 1e3
    data.qfrc_applied[0] = -force
    for _ in range(600):
        mujoco.mj_step(model, data)
    reading = skin.bind(model).read(data)
    right, _, _ = springs(PAD, lambda x, y: heights(model, data, x, y), reading.force, fine=fine)
    return reading, right


def geoms_of(rng):
    """Draw one to four geoms of any kind, turned anyhow, whose middles are within 1 mm of one height: MJCF."""
    drawn = ""
    for _ in range(rng.integers(1, 5)):
        kind = rng.choice(["box", "sphere", "capsule", "cylinder", "ellipsoid"])
        size, turn = rng.uniform(0.001, 0.004, 3), rng.uniform(-180, 180, 3)
        place = [*rng.uniform(-0.004, 0.004, 2), rng.uniform(0, 0.001)]
        words = (" ".join(map(str, values)) for values in (size, turn, place))
        drawn += '<geom type="{}" size="{}" euler="{}" pos="{}"/>'.format(kind, *words)
    return drawn, ""


def box_of(rng):
    """Draw a box, turned anyhow: its corners are deep, and its sides lean over the pad."""
    size, turn, place = rng.uniform(0.001, 0.004, 3), rng.uniform(-180, 180, 3), rng.uniform(-0.004, 0.004, 2)
    words = (" ".join(map(str, values)) for values in (size, turn, [*place, 0]))
    return '<geom type="box" size="{}" euler="{}" pos="{}"/>'.format(*words), ""


def mesh_of(rng):
    """Draw the hull of points on an ellipsoid, turned anyhow."""
    corners = rng.normal(size=(rng.integers(6, 60), 3))
    corners *= rng.uniform(0.001, 0.004, 3) / np.linalg.norm(corners, axis=1)[:, None]
    turn, place = rng.uniform(-180, 180, 3), rng.uniform(-0.004, 0.004, 2)
    words = (" ".join(map(str, values)) for values in (turn, [*place, 0]))
    asset = f'<mesh name="m" vertex="{" ".join(map(str, corners.ravel()))}"/>'
    return '<geom type="mesh" mesh="m" euler="{}" pos="{}"/>'.format(*words), asset


@pytest.mark.long
@pytest.mark.parametrize("drawn", [geoms_of, box_of, mesh_of])
def test_any_body_presses_as_springs_by_brute_force(drawn):
    rng, off = np.random.default_rng(2), []
    for _ in range(20):
        geoms, assets = drawn(rng)
        reading, right = pressed(geoms, float(rng.choice([0.3, 1.0, 3.0])), assets=assets)
        assert reading.found
        off.append(errors(reading.kpa, right)[1])
    assert np.sort(off)[-2] <= 0.02
    assert max(off) <= 0.05


@pytest.mark.parametrize(
    ("box", "force"),
    [
        (
            'size=".004 .0015 .001" euler="45 65 25"',
            1.0,
        ),  # a slanting edge, found by turns too short and too long
        (
            'size=".0012 .0034 .0029" euler="75 -49 -92"',
            0.3,
        ),  # a deep corner between sides that lean by 10 degrees
    ],
)
def test_an_edge_and_a_deep_corner_press_as_springs_do(box, force):
    reading, right = pressed(f'<geom type="box" {box}/>', force, fine=0.05)
    assert reading.found
    assert errors(reading.kpa, right)[1] < 0.02


def test_an_arm_without_a_contact_at_its_low_end_is_carried_by_the_layer_there():
    foot = '<geom type="box" size=".0015 .0015 .001" pos="-.004 0 .001"/>'
    arm = '<geom type="box" size=".005 .001 .0005" pos=".003 0 .001729" euler="0 12 0"/>'
    reading, right = pressed(foot + arm, 5.0, fine=0.04)
    assert errors(reading.kpa, right)[1] < 0.03


def test_the_layers_of_two_pads_that_touch_give_way_one_behind_the_other():
    spec = mujoco.MjSpec.from_string("""
        <mujoco><option timestep="0.001"/><worldbody>
          <geom name="finger" type="box" size=".03 .03 .005" pos="0 0 -.005"/>
          <body name="body" pos="0 0 .015"><joint type="slide" axis="0 0 1"/>
            <geom name="ball" size=".015" mass="0.2"/></body>
        </worldbody></mujoco>""")
    flat = tactsim.press.attach(spec, "finger", PAD)
    round_one = tactsim.press.attach(spec, "ball", PAD, normal=(0, 0, -1), stiffness=500.0)
    data = mujoco.MjData(model := spec.compile())
    readers = tactsim.press.bind(model, [flat, round_one])
    for _ in range(1000):
        mujoco.mj_step(model, data)
    stiffness = 1 / (1 / 1.0 + 1 / 0.5)
    for reading in (reader.read(data) for reader in readers):
        of_one = ball(reading.force / stiffness, 15.0)
        right = image(PAD, lambda x, y, of_one=of_one: stiffness * of_one(x, y))
        assert errors(reading.kpa, right)[1] < 0.01
    assert errors(flat.bind(model).read(data).kpa, right)[1] > 0.1


TALL = [(x, y, z) for x in (-0.01, 0.01) for y in (-0.012, 0.012) for z in (-0.03, 0.03)]
FLAT = [(x, y, z) for x in (-0.02, 0.02) for y in (-0.015, 0.015) for z in (-0.01, 0.01)]


@pytest.mark.parametrize(
    "corners", [TALL, FLAT, [(y, z, x) for x, y, z in TALL]], ids=["tall", "flat", "long"]
)
@pytest.mark.parametrize("kind", ["box", "ellipsoid", "capsule"])
@pytest.mark.parametrize("normal", [(0, 0, 1), (0, -1, 0), (1, 0, 0)])
def test_a_geom_that_is_fitted_to_a_mesh_carries_a_pad_where_the_file_says(corners, kind, normal):
    """MuJoCo turns such a geom to the mesh's principal axes."""
    words = " ".join(str(value) for corner in corners for value in corner)
    spec = mujoco.MjSpec.from_string(f"""
        <mujoco><asset><mesh name="m" vertex="{words}"/></asset><worldbody><body name="tip" euler="10 20 30">
          <geom name="g" type="{kind}" mesh="m" euler="40 0 70"/></body></worldbody></mujoco>""")
    small = Pad(rows=2, columns=2, pitch_x=1, pitch_y=1, taxel_width=0.9, taxel_height=0.9)
    skin = tactsim.press.attach(spec, "g", small, normal=normal)
    plain = mujoco.MjSpec.from_string("""
        <mujoco><worldbody><body euler="10 20 30"><geom type="box" size=".1 .1 .1" euler="40 0 70"/></body>
        </worldbody></mujoco>""").compile()
    model = spec.compile()
    for one in (model, plain):
        mujoco.mj_forward(one, data := mujoco.MjData(one))
        if one is model:
            looks = skin.bind(model).frame(data)[0][:, 2]
    assert looks == pytest.approx(data.geom_xmat[0].reshape(3, 3) @ normal, abs=1e-4)
