"""Pads on geoms of other models: closed forms, sums of forces, motions that change nothing, and wrong input."""

import copy
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from attached_scenes import GRAVITY, ball, block, errors, image, rest, roll, simulate
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import tactsim
from tactsim import Pad
from tactsim.core.errors import InputError

PAD = Pad()
# Without gaps and, where it is pressed so, without point spread, the taxels' sum is the force.
TIGHT = Pad(taxel_width=1.9, taxel_height=1.9)
TAXEL = 1.9 * 1.9 / 1e3  # N for a kPa
# The same with 738 taxels.
WIDE = Pad(rows=18, columns=41, pitch_x=1, pitch_y=1, taxel_width=1, taxel_height=1)


def turned(angle):
    return f'quat="{np.cos(angle / 2)} 0 0 {np.sin(angle / 2)}"'


def contact_force(model, data, geom):
    """Add MuJoCo's normal forces on a geom: N, and where they act, (3,) mm."""
    force, total, moment = np.zeros(6), 0.0, np.zeros(3)
    for index, contact in enumerate(data.contact):
        if geom in contact.geom:
            mujoco.mj_contactForce(model, data, index, force)
            total += force[0]
            moment += force[0] * contact.pos * 1e3
    return total, moment / max(total, 1e-300)


@pytest.mark.parametrize(("radius", "x", "y"), [(2, 0.5, 0.5), (10, 5.5, 0)])
def test_a_sphere_is_the_closed_form(radius, x, y):
    _, _, reading = rest(f'type="sphere" size="{radius / 1e3}"', x=x, y=y, height=radius)
    most, largest = errors(reading.kpa, image(PAD, ball(reading.force, radius, x, y)))
    assert most < 0.004
    assert largest < 0.01


def test_a_cylinder_on_its_side_is_the_closed_form():
    angle = 1.2
    lying = Rotation.from_euler("xz", [np.pi / 2, angle]).as_quat(scalar_first=True)
    body = f'type="cylinder" size="0.004 0.004" quat="{" ".join(map(str, lying))}"'
    _, _, reading = rest(body, x=0.5, y=0.2, height=4.1)
    most, largest = errors(reading.kpa, image(PAD, roll(reading.force, 4, 4, angle, 0.5, 0.2)))
    assert most < 0.005
    assert largest < 0.01


@pytest.mark.parametrize("body", ['type="box" size="0.003 0.003 0.003"', 'type="mesh" mesh="cube"'])
@pytest.mark.parametrize(("angle", "x", "y"), [(0.3, 1.1, 0.4), (0.02, 3.3, 3.1)])
def test_the_edges_of_a_block_are_the_closed_form(body, angle, x, y):
    _, _, reading = rest(f"{body} {turned(angle)}", x=x, y=y, height=3.1)
    most, largest = errors(reading.kpa, image(PAD, block(reading.force, 3, 3, angle, x, y)))
    assert most < 0.006
    assert largest < 0.01


@pytest.mark.parametrize(
    ("half_x", "half_y", "angle"), [(15, 5, 0.3), pytest.param(0.05, 8, 0.5, marks=pytest.mark.long)]
)
def test_738_taxels_feel_what_is_much_larger_and_much_smaller_than_they(half_x, half_y, angle):
    body = f'type="box" size="{half_x / 1e3} {half_y / 1e3} 0.01" {turned(angle)}'
    _, _, reading = rest(body, WIDE, x=1, height=10.1, face="0.04 0.04 0.005")
    truth = image(WIDE, block(reading.force, half_x, half_y, angle, 1), fineness=4000 if half_x < 1 else 2000)
    most, largest = errors(reading.kpa, truth)
    assert most < 0.01
    assert largest < 0.01  # 0.009: a blade of a tenth of a taxel, askew


def test_a_load_beside_the_middle_tilts_the_pressure_as_its_moment_says():
    """The block's weight stands off its middle; a stiff layer, so that it does not lean."""
    share = 0.3
    xml = f"""<body name="loaded" pos="0 0 .00801"><freejoint/><geom type="box" size=".003 .003 .003" mass=".1"/>
      <geom type="sphere" size=".001" pos="{2 * share * 3e-3} 0 0" mass=".1" contype="0" conaffinity="0"/></body>"""
    reader, data, reading = rest(
        'type="sphere" size=".001"', x=-15, height=50, steps=1500, xml=xml, stiffness=1e5
    )
    force, centre = contact_force(reader.model, data, reader.geom)
    pose = data.body("loaded")
    middle = (pose.xpos + pose.xmat.reshape(3, 3) @ [0, 0, -3e-3]) * 1e3
    lever = centre[0] - middle[0]
    assert lever == pytest.approx(share * 3, rel=0.1)  # MuJoCo's soft contacts let it lean a little
    truth = image(PAD, block(force, 3, 3, x=middle[0], lever=lever))
    assert errors(reading.kpa, truth)[1] < 0.01


@pytest.mark.parametrize("kind", ["sphere", "box"])
def test_the_image_does_not_depend_on_how_soft_mujocos_contacts_are(kind):
    """The sphere sinks in by 6 mm where they are softest, and hovers 6 mm above the pad with a margin."""
    images = [
        rest(f'type="{kind}" size="0.008 0.008 0.008" solref="{solref}"', x=0.7, height=8.001, steps=4000,
             face=".03 .03 .02")[2]
        for solref in ("0.004 1", "0.05 1", "0.2 1", '.004 1" margin=".006')
    ]  # fmt: skip
    for reading in images[1:]:
        assert reading.force == pytest.approx(images[0].force, rel=1e-3)
        np.testing.assert_allclose(reading.kpa, images[0].kpa, atol=2e-3 * images[0].kpa.max())


def test_a_mesh_whose_hull_mujoco_simplifies_is_felt_where_that_touches():
    corners = np.random.default_rng(0).normal(size=(500, 3))
    corners *= 0.006 / np.linalg.norm(corners, axis=1)[:, None]
    asset = f'<asset><mesh name="m" maxhullvert="12" vertex="{" ".join(map(str, corners.ravel()))}"/></asset>'
    world = f"""{asset}<worldbody><geom name="finger" type="box" size=".02 .02 .005"/>
        <body pos="0 0 .0112"><joint type="slide" axis="0 0 1"/><geom type="mesh" mesh="m" mass=".2"/></body>
        </worldbody>"""
    _, data, reading = simulate(world, pad=PAD, steps=2000)
    centre = reading.kpa @ PAD.taxel_xy / reading.kpa.sum()
    assert data.ncon == 1
    np.testing.assert_allclose(centre, data.contact.pos[0, :2] * 1e3, atol=0.1)  # 0.17 off with all vertices


# MuJoCo before 3.17 refuses a number in XML that is no normal double.
MILLIMETRES = st.floats(-6, 6).map(lambda x: round(x, 9))


@given(
    st.sampled_from(['type="sphere" size=".004"', 'type="box" size=".003 .002 .004"', 'type="capsule" size=".003 .004"',
                     'type="ellipsoid" size=".003 .004 .005"', 'type="mesh" mesh="cube"']),
    MILLIMETRES, MILLIMETRES, st.integers(0, 10**6),
)  # fmt: skip
# Half a cell of the lattice on the pad's rim
@example('type="box" size=".003 .002 .004"', -4.3125, 0.0, 10**6)
@settings(max_examples=10, deadline=None)
def test_taxels_and_what_lies_outside_add_up_to_mujocos_force(body, x, y, seed):
    """In any attitude, also half beside the pad. Taxels without gaps and without a point spread lose nothing."""
    attitude = Rotation.random(rng=np.random.default_rng(seed)).as_quat(scalar_first=True)
    reader, data, reading = rest(
        f'{body} quat="{" ".join(map(str, attitude))}"', TIGHT, x=x, y=y, height=7.5, steps=400, psf_sigma=0
    )
    force, _ = contact_force(reader.model, data, reader.geom)
    assert reading.force == pytest.approx(force, rel=1e-9)
    assert TAXEL * reading.kpa.sum() + reading.outside == pytest.approx(force, rel=1e-9)
    assert reading.outside >= -1e-9


@pytest.mark.parametrize(("x", "angle"), [(4.9, 0), (10.5, 0.3)])
def test_what_lies_beyond_the_rim_is_the_share_of_the_block_there(x, angle):
    """The pad ends at x = 7.7 mm, in the middle of cells that the block covers in part."""
    _, _, reading = rest(
        f'type="box" size=".003 .003 .003" {turned(angle)}', x=x, height=3.1, face=".03 .02 .005"
    )
    at_x, at_y = np.meshgrid(np.linspace(x - 5, x + 5, 2001), np.linspace(-5, 5, 2001))
    pressure = block(1, 3, 3, angle, x)(at_x, at_y)
    beyond = pressure[at_x > 7.7].sum() / pressure.sum()
    assert reading.outside / reading.force == pytest.approx(beyond, abs=1e-3)


@pytest.mark.parametrize(
    ("kind", "size", "normal", "height"),
    [("capsule", ".008 .02", (1, 0, 0), 8), ("sphere", ".012", (0, 0, 1), 12),
     ("ellipsoid", ".02 .02 .012", (0, 0, 1), 12)],
)  # fmt: skip
def test_a_body_that_tumbles_over_a_curved_finger_is_felt_or_outside(kind, size, normal, height):
    """Every 10 ms of a fall from a random attitude: no taxel below 0, and no force lost or made."""
    standing = 'quat=".7071067811865476 0 -.7071067811865476 0"' if normal == (1, 0, 0) else ""
    rng = np.random.default_rng(0)
    felt = []
    for body in (
        'type="box" size=".003 .002 .004"',
        'type="cylinder" size=".003 .004"',
        'type="capsule" size=".003 .004"',
    ):
        attitude = " ".join(map(str, Rotation.random(rng=rng).as_quat(scalar_first=True)))
        x, y = rng.uniform(-5, 5, 2) / 1e3
        spec = mujoco.MjSpec.from_string(f"""<mujoco><option timestep="0.001"/><worldbody>
            <geom name="finger" type="{kind}" size="{size}" {standing}/>
            <body pos="{x} {y} {height / 1e3 + 0.008}" quat="{attitude}"><freejoint/><geom {body} mass=".2"/></body>
            </worldbody></mujoco>""")
        attached = tactsim.press.attach(spec, "finger", TIGHT, normal=normal, psf_sigma=0)
        data, reader = mujoco.MjData(model := spec.compile()), attached.bind(model)
        for step in range(150):
            mujoco.mj_step(model, data)
            if step % 10:
                continue
            reading = reader.read(data)
            assert (reading.kpa >= 0).all()
            felt.append(TAXEL * reading.kpa.sum())
            assert felt[-1] + reading.outside == pytest.approx(reading.force, rel=1e-9, abs=1e-12)
            assert reading.outside >= -1e-9 * reading.force
    assert np.count_nonzero(felt) > 10


def felt_in_a_world(rotation, shift):
    """Press a ball on a finger askew, the whole world turned and shifted; gravity with it."""
    down = rotation.apply([0, 0, -GRAVITY])
    place = " ".join(map(str, rotation.as_quat(scalar_first=True)))
    world = f"""<option gravity="{" ".join(map(str, down))}"/><worldbody>
          <frame pos="{" ".join(map(str, shift))}" quat="{place}">
            <body name="hand"><geom name="finger" type="cylinder" size=".008 .02"
              quat=".7071067811865476 0 -.7071067811865476 0"/></body>
            <body pos="0.001 -0.002 .0141"><joint type="slide" axis="0 0 1"/>
              <geom type="sphere" size=".006" mass=".2"/></body>
          </frame></worldbody>"""
    return simulate(world, pad=Pad(unread_columns=0), steps=300)[2]


def test_a_world_turned_and_shifted_as_a_whole_is_felt_alike():
    still = felt_in_a_world(Rotation.identity(), [0, 0, 0])
    assert still.kpa.max() > 20
    moved = felt_in_a_world(Rotation.random(rng=np.random.default_rng(0)), [0.3, -0.2, 0.5])
    np.testing.assert_allclose(moved.kpa, still.kpa, atol=1e-4 * still.kpa.max())
    np.testing.assert_allclose(moved.shear, still.shear, atol=1e-4 * still.force)


@pytest.mark.parametrize(("geom", "normal"), [("box", (0, 0, -1)), ("capsule", (0, 1, 0))])
def test_sites_show_where_the_taxels_lie_and_change_nothing(geom, normal):
    pad = Pad(rows=3, columns=4, taxel_width=1.5)
    spec, plain = (mujoco.MjSpec.from_string(SCENE) for _ in range(2))
    skin = tactsim.press.attach(spec, geom, pad, normal=normal)
    skin.show()
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    reader = skin.bind(model)
    with pytest.raises(InputError, match="nothing is placed yet"):
        reader.frame(mujoco.MjData(model))
    rotation, origin = reader.frame(data)
    places = (data.site_xpos[-pad.taxels - 1 :] - origin) @ rotation * 1e3
    laid = reader.surface.place(places[:-1])
    assert laid == pytest.approx(pad.taxel_xy, abs=1e-6)
    assert places[-1][2] > 1  # the arrow looks where the pad does
    assert model.nbody == plain.compile().nbody
    assert model.body_mass == pytest.approx(plain.compile().body_mass)
    with pytest.raises(InputError, match="attached to a compiled model"):
        tactsim.press.attach(model, geom, pad, normal=normal).show()


def test_a_load_beside_the_pad_is_named_by_its_distance():
    """A block of 2 x 2 mm stands 3 mm beside the pad's rim, at x = 7.7 mm: its far corners are 5 mm from it."""
    _, _, reading = rest('type="box" size=".001 .001 .003"', x=11.7, height=3.1, face=".03 .02 .005")
    assert reading.outside == pytest.approx(reading.force, rel=1e-6)
    assert reading.beside_mm == pytest.approx(5, abs=0.05)
    assert str(reading).endswith(f"{reading.force:.2f} N acts beside the pad, up to 5.0 mm from its rim")
    assert str(replace(reading, beside_mm=0.01)).endswith("N acts beside the pad")
    _, _, inside = rest('type="box" size=".001 .001 .003"', x=0, height=3.1, face=".03 .02 .005")
    assert inside.beside_mm == 0
    assert "reads most" in str(inside)
    assert "beside" not in str(inside)
    assert str(replace(inside, found=False)) == f"{inside}; not all that touches was found"


def test_a_pad_is_felt_alike_on_a_body_that_moves():
    """Carried at a constant speed, nothing changes."""
    spec = mujoco.MjSpec.from_string("""
        <mujoco><option timestep="0.001"/><worldbody><body name="hand"><joint name="x" type="slide" axis="1 0 0"/>
          <geom name="finger" type="box" size=".02 .02 .005" mass="10"/>
          <body pos="0.001 0.002 .0101"><joint type="slide" axis="0 0 1"/>
              <geom type="sphere" size=".005" mass=".2"/></body>
        </body></worldbody></mujoco>""")
    reader = tactsim.press.attach(spec, "hand", PAD).bind(model := spec.compile())
    images = []
    for speed in (0.0, 0.5):
        data = mujoco.MjData(model)
        data.joint("x").qvel = speed
        for _ in range(1000):
            mujoco.mj_step(model, data)
        images.append(reader.read(data).kpa)
    assert data.joint("x").qpos > 0.4
    np.testing.assert_allclose(images[0], images[1], atol=1e-6 * images[0].max())


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "capsule", "ellipsoid"])
def test_a_curved_pad_tends_to_the_flat_one_as_its_radius_grows(kind):
    """A ball of radius 5 mm on one of radius r is felt as one of 1 / (1 / 5 + 1 / r) on a flat pad."""
    for radius in (0.02, 0.4):
        size = {"ellipsoid": f"{radius} {radius} {radius}"}.get(kind, f"{radius} .05")
        standing = (
            'quat=".7071067811865476 0 -.7071067811865476 0"' if kind in ("cylinder", "capsule") else ""
        )
        world = f"""<worldbody><geom name="finger" type="{kind}" size="{size}" {standing}/>
            <body pos="0 0 {radius + 0.00501}"><joint type="slide" axis="0 0 1"/>
              <geom type="sphere" size=".005" mass=".2"/></body></worldbody>"""
        pad = Pad(unread_columns=0)
        _, _, reading = simulate(world, pad=pad, stiffness=5000)
        across = 1 / (1 / 5 + 1e-3 / radius)
        along = 5 if standing else across
        depth = np.sqrt(reading.force / (np.pi * 5 * np.sqrt(across * along)))

        def pressure(u, v, depth=depth, across=across, along=along):
            return 5 * np.maximum(depth - u**2 / (2 * across) - v**2 / (2 * along), 0)

        assert errors(reading.kpa, image(pad, pressure))[1] < 0.01


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_the_rim_of_a_can_on_a_round_finger_is_felt_as_that_of_a_fine_prism(lean):
    """Some of the pad's normals run along the can, within 78 degrees of its side, and others do not."""
    around = np.linspace(0, 2 * np.pi, 128, endpoint=False)
    places = [[4 * np.cos(angle), 4 * np.sin(angle), end] for end in (-6, 6) for angle in around]
    mesh = " ".join(str(round(value / 1e3, 9)) for value in np.ravel(places))
    readings = []
    for can in ('type="cylinder" size=".004 .006"', 'type="mesh" mesh="prism"'):
        world = f"""<compiler angle="radian"/><asset><mesh name="prism" vertex="{mesh}"/></asset><worldbody>
            <geom name="finger" type="sphere" size=".012"/>
            <body pos=".0055 0 .0185" euler="0 {lean} 0"><joint type="slide" axis="{-np.sin(lean)} 0 {np.cos(lean)}"/>
              <geom {can} mass=".2"/></body></worldbody>"""
        readings.append(simulate(world, pad=TIGHT, steps=500, psf_sigma=1.0)[2])
    can, prism = readings
    assert can.force > 1
    assert can.outside < 0.01 * can.force
    assert errors(can.kpa, prism.kpa)[1] < 0.02


@pytest.mark.parametrize(("kind", "stiffness"), [("sphere", 20_000.0), ("capsule", 200.0)])
def test_a_round_finger_on_a_plane_is_the_closed_form(kind, stiffness):
    """Of a ball with a soft skin: depth along its normals is (R - h) over their cosine, less R (1 / cosine - 1).

    So is the tip of a capsule that stands on its end, with the pad wrapped over it.
    """
    radius, stiff = 12.0, stiffness / 1e3
    shape = {"sphere": 'size=".012"', "capsule": 'size=".012 .02" pos="0 0 .02"'}[kind]
    world = f"""<worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .0121"><joint type="slide" axis="0 0 1"/>
          <geom name="tip" type="{kind}" {shape} mass=".3"/></body></worldbody>"""
    pad = Pad(unread_columns=0)
    _, _, reading = simulate(world, "tip", pad, normal=(0, 0, -1), stiffness=stiffness)
    angle = np.linspace(0, 1, 20_001)

    def force(depth):
        pressure = stiff * np.maximum(radius - (radius - depth) / np.cos(angle), 0)
        return np.trapezoid(pressure * np.cos(angle) * 2 * np.pi * radius**2 * np.sin(angle), angle)

    depth = brentq(lambda depth: force(depth) - reading.force, 0, 3)

    def pressure(u, v):  # on the foil around the ball
        polar = np.hypot(u, v) / radius
        return stiff * np.maximum(radius - (radius - depth) / np.cos(polar), 0) * np.sinc(polar / np.pi)

    assert reading.outside == pytest.approx(0, abs=1e-9)
    assert errors(reading.kpa, image(pad, pressure))[1] < (0.02 if stiffness < 1000 else 0.01)


@pytest.mark.parametrize("polar", [0.0, 0.6])
def test_a_pad_that_wraps_a_capsules_end_is_the_closed_form(polar):
    """A ball presses the round end at an angle to its rim, and on the rim, where the end meets the side.

    The foil is true to length along the capsule, also over the end; circles about the axis are drawn wider there.
    """
    radius, half, stiff = 12.0, 4.0, 5.0
    way = np.array([np.cos(polar), 0, np.sin(polar)])
    middle = [0, 0, half / 1e3] + way * (radius + 5.01) / 1e3
    world = f"""<option gravity="{" ".join(map(str, -GRAVITY * way))}"/><worldbody>
        <geom name="tip" type="capsule" size="{radius / 1e3} {half / 1e3}"/>
        <body pos="{" ".join(map(str, middle))}"><joint type="slide" axis="{" ".join(map(str, way))}"/>
          <geom type="sphere" size=".005" mass=".2"/></body></worldbody>"""
    pad = Pad(rows=16, unread_columns=0)
    _, _, reading = simulate(world, "tip", pad, stiffness=1e3 * stiff)
    across = 1 / (1 / 5 + 1 / radius)

    def pressure(u, v):
        over = np.maximum(v - half, 0) / radius
        along = np.where(v < half, 5, across)  # the side is straight
        away = (u * np.cos(over)) ** 2 / across + (v - half - radius * polar) ** 2 / along
        both = (np.sqrt(5 * across) + across) / 2 if polar == 0 else across
        return (
            stiff * np.maximum(np.sqrt(reading.force / (np.pi * stiff * both)) - away / 2, 0) * np.cos(over)
        )

    assert reading.force == pytest.approx(0.2 * GRAVITY, rel=1e-3)
    assert reading.outside == pytest.approx(0, abs=1e-9)
    assert errors(reading.kpa, image(pad, pressure))[1] < 0.015


@pytest.mark.parametrize("about", ["x", "y"])
def test_a_block_at_rest_on_a_slope_shears_the_pad_downhill_by_its_weights_part(about):
    """By m g sin a, along the pad's x of a pad that is turned about y, and against its y of one turned about x."""
    world = f"""<option cone="elliptic" impratio="10"/><worldbody>
        <frame euler="{"11.4592 0 0" if about == "x" else "0 11.4592 0"}">
          <body name="slope"><geom name="finger" type="box" size=".02 .02 .005" friction="1"/></body>
          <body name="block" pos="0 0 .008"><freejoint/><geom type="box" size=".003 .003 .003" mass=".2"/></body>
        </frame></worldbody>"""
    _, _, reading = simulate(world, "slope", TIGHT, psf_sigma=0)
    weight = 0.2 * GRAVITY
    downhill = np.array([0, -1] if about == "x" else [1, 0]) * weight * np.sin(0.2)
    assert reading.force == pytest.approx(weight * np.cos(0.2), rel=1e-2)
    np.testing.assert_allclose(reading.shear, [*downhill, 0], atol=0.01)
    np.testing.assert_allclose(TAXEL * reading.shear_kpa.sum(axis=0), reading.shear[:2], atol=1e-9)
    np.testing.assert_allclose(reading.shear_kpa, np.outer(reading.kpa, reading.shear[:2] / reading.force))


def test_two_bodies_that_slide_apart_shear_the_pad_each_its_own_way():
    """The sums over the taxels under each, of a pad without gaps."""
    spec = mujoco.MjSpec.from_string("""<mujoco><option timestep="0.0005" integrator="implicitfast" cone="elliptic"/>
        <worldbody>
        <geom name="finger" type="box" size=".02 .02 .005" friction=".5"/>
        <body pos="-.0045 0 .007"><joint name="a" type="slide"/><joint type="slide" axis="0 0 1"/>
          <geom type="box" size=".002 .002 .002" mass=".1"/></body>
        <body pos=".0045 0 .007"><joint name="b" type="slide"/><joint type="slide" axis="0 0 1"/>
          <geom type="box" size=".002 .002 .002" mass=".3"/></body></worldbody>
        <default><joint axis="1 0 0"/><geom friction=".5"/></default>
        <actuator><velocity joint="a" kv="100"/><velocity joint="b" kv="100"/></actuator></mujoco>""")
    reader = tactsim.press.attach(spec, "finger", TIGHT, psf_sigma=0).bind(model := spec.compile())
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.015, -0.025
    for _ in range(300):
        mujoco.mj_step(model, data)
    reading = reader.read(data)
    assert reading.force == pytest.approx(0.4 * GRAVITY, rel=0.1)
    for way, side in ((1, TIGHT.taxel_xy[:, 0] < 0), (-1, TIGHT.taxel_xy[:, 0] > 0)):
        force, shear = reading.kpa[side].sum(), reading.shear_kpa[side].sum(axis=0)
        assert force * TAXEL > 0.9
        np.testing.assert_allclose(shear, [way * 0.5 * force, 0], atol=0.01 * force)
    np.testing.assert_allclose(TAXEL * reading.shear_kpa.sum(axis=0), reading.shear[:2], atol=1e-9)


def test_a_reading_changes_nothing_in_the_simulation():
    reader, data, first = rest('type="box" size="0.003 0.003 0.003"', x=2, height=3)
    before = np.concatenate([data.qpos, data.qvel, data.qacc_warmstart, data.efc_force])
    second = reader.read(data)
    np.testing.assert_array_equal(
        before, np.concatenate([data.qpos, data.qvel, data.qacc_warmstart, data.efc_force])
    )
    np.testing.assert_array_equal(first.kpa, second.kpa)


SCENE = """<mujoco><asset><mesh name="m" vertex="0 0 0 .01 0 0 0 .01 0 0 0 .01"/></asset><worldbody>
  <body name="palm"><geom name="box" type="box" size=".02 .02 .02"/>
    <geom name="ghost" size=".01" contype="0" conaffinity="0"/></body>
  <body name="bone"><geom name="capsule" type="capsule" fromto="0 0 0 0 0 .04" size=".009"/></body>
  <body name="two"><geom size=".01"/><geom name="other" size=".01"/></body>
  <body name="empty"/><body name="plain"><geom size=".03"/></body>
  <geom name="scan" type="mesh" mesh="m"/><geom name="tiny" size=".002"/>
  </worldbody></mujoco>"""


def test_a_pad_is_found_in_a_model_that_its_own_was_attached_to():
    prefix = "left/"
    hand, whole = mujoco.MjSpec.from_string(SCENE), mujoco.MjSpec()
    whole.worldbody.add_geom(name="first", size=[0.1, 0.1, 0.1])
    by_name, by_geom = tactsim.press.attach(hand, "bone"), tactsim.press.attach(hand, hand.geom("box"))
    unnamed = tactsim.press.attach(hand, hand.body("plain"))
    whole.attach(hand, prefix=prefix, frame=whole.worldbody.add_frame())
    model = whole.compile()
    assert model.geom(by_name.bind(model).geom).name == f"{prefix}capsule"
    assert model.geom(by_geom.bind(model).geom).name == f"{prefix}box"
    assert model.geom_size[unnamed.bind(model).geom, 0] == 0.03
    assert tactsim.press.attach(model, f"{prefix}box").bind(model).geom == by_geom.bind(model).geom
    nameless = mujoco.MjModel.from_xml_string(SCENE)
    assert tactsim.press.attach(nameless, "plain").bind(nameless).geom == nameless.body("plain").geomadr[0]


@pytest.mark.parametrize(
    ("geom", "options", "message"),
    [
        (
            "bix",
            {},
            "unknown geom or body 'bix': did you mean 'box'? known are bone, box, palm, plain, scan, tiny, "
            "two, world and 4 more; a geom without a name is spec.body(NAME).geoms[i]",
        ),
        ("", {}, "geom is ''; give the name of a geom or a body, or a geom or a body of the spec"),
        ("ghost", {}, "geom 'ghost' cannot touch anything: its contype and conaffinity are 0"),
        ("palm", {"normal": (1, 1, 0)}, "body 'palm' is a box: its pad looks along an axis"),
        (
            "capsule",
            {"pad": Pad(rows=40, seam=0.4, unread_columns=1)},
            "the pad reaches from (-7.7, -37.95) to (7.7, 37.95) mm and geom 'capsule' from (-13.5, -29.42) to "
            "(13.5, 29.42) mm about the pad's middle: choose a smaller pad",
        ),
        ("box", {"stiffness": -1.0}, "stiffness is -1.0; it is a number of kPa/mm above 0"),
        ("box", {"pad": "pad.toml"}, "pad is 'pad.toml'; give a tactsim.Pad, and of a file Pad.load(file)"),
        ("plain", {"at": (1, 0)}, "body 'plain' is round: turn the pad's normal instead of giving `at`"),
    ],
)
def test_wrong_input_is_one_line(geom, options, message):
    spec = mujoco.MjSpec.from_string(SCENE)
    with pytest.raises(InputError) as error:
        tactsim.press.attach(spec, geom, **options).bind(spec.compile())
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_a_model_without_the_geom_is_one_line():
    spec = mujoco.MjSpec.from_string(SCENE)
    attached = tactsim.press.attach(spec, "box")
    unnamed = tactsim.press.attach(spec, spec.body("plain").geoms[0])
    with pytest.raises(InputError, match="the model has no geom 0 of body 'plain': compile"):
        unnamed.bind(mujoco.MjSpec().compile())
    with pytest.raises(InputError, match="the model has no geom 'box': compile it after `attach`, from the"):
        attached.bind(mujoco.MjSpec().compile())
    with pytest.raises(
        InputError, match=r"a pad is bound to a compiled mujoco\.MjModel, got <class 'mujoco\._specs"
    ):
        attached.bind(spec)
    with pytest.raises(
        InputError, match=r"a pad is attached to a mujoco\.MjSpec or an MjModel, got <class 'str'>"
    ):
        tactsim.press.attach("hand.xml", "box")
    with pytest.raises(InputError, match="unknown geom or body 'bix': did you mean 'box'"):
        tactsim.press.attach(spec.compile(), "bix")
    with pytest.raises(InputError, match="geom is 2; give the name of a geom or a body of the model"):
        tactsim.press.attach(spec.compile(), 2)
    with pytest.raises(InputError, match="among the pads is 'box'; give a list of what `attach` returned"):
        tactsim.press.bind(spec.compile(), ["box"])
    reader = attached.bind(model := spec.compile())
    for data, got in (
        (mujoco.MjData(mujoco.MjSpec().compile()), "those of another"),
        (model, "<class 'mujoco"),
    ):
        with pytest.raises(
            InputError, match=f"a pad reads the MjData of the model that it is bound to, got {got}"
        ):
            reader.read(data)


def test_a_mesh_on_a_body_that_a_urdfs_compiler_fuses_is_one_line():
    """Its normal would be taken in the frame of the body that it is fused with: the pad lay on another side."""
    spec = mujoco.MjSpec.from_string("""<robot name="r"><link name="arm"/>
        <joint name="j" type="revolute"><parent link="arm"/><child link="finger"/><limit lower="0" upper="1"/></joint>
        <link name="finger"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
          </inertial></link>
        <joint name="k" type="fixed"><parent link="finger"/><child link="tip"/><origin rpy="1.5707963 0 0"/></joint>
        <link name="tip"><collision><geometry><box size=".02 .02 .01"/></geometry></collision>
          <collision><geometry><box size=".02 .02 .012"/></geometry></collision></link></robot>""")
    with pytest.raises(
        InputError, match=r"body 'tip' has no joint and is fused .* spec.compiler.fusestatic = F"
    ):
        tactsim.press.attach(spec, "tip")
    spec.compiler.fusestatic = False
    reader = tactsim.press.attach(spec, "tip", Pad(rows=2, columns=2)).bind(model := spec.compile())
    mujoco.mj_forward(model, data := mujoco.MjData(model))
    np.testing.assert_allclose(reader.frame(data)[0][:, 2], [0, -1, 0], atol=1e-6)


@pytest.mark.parametrize("pair", [True, False])
def test_a_child_is_touched_by_those_geoms_of_its_parent_that_a_pair_names(pair):
    """MuJoCo lets nothing else of a parent touch its child; one that it lets do so later asks for a new `bind`."""
    contact = '<contact><pair geom1="tip" geom2="pin"/></contact>' if pair else ""
    spec = mujoco.MjSpec.from_string(f"""<mujoco><worldbody><body>
        <joint type="slide" axis="1 0 0"/><geom name="pin" type="box" size=".003 .003 .005" mass="1"/>
        <geom type="box" size=".002 .002 .007" pos=".006 0 0" mass="1"/>
        <body name="link" pos="0 0 .0099"><joint type="slide" axis="0 0 1"/>
          <geom name="tip" type="box" size=".02 .02 .005" mass="1"/></body></body></worldbody>{contact}</mujoco>""")
    reader = tactsim.press.attach(spec, "tip", TIGHT, normal=(0, 0, -1)).bind(model := spec.compile())
    data = mujoco.MjData(model)
    if not pair:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    for _ in range(300):
        mujoco.mj_step(model, data)
    if pair:
        reading = reader.read(data)
        assert reading.force == pytest.approx(GRAVITY, rel=1e-3)
        assert errors(reading.kpa, image(TIGHT, block(reading.force, 3, 3)))[1] < 0.003
        return
    with pytest.raises(
        InputError, match="touches the pad's geom, and could not when the pad was bound: bind anew"
    ):
        reader.read(data)


@pytest.mark.parametrize(
    ("geom", "one", "other", "overlap"),
    [
        ("box", {"at": (-4, 0)}, {"at": (4, 0)}, True),
        ("box", {"at": (0, 5.65)}, {"at": (0, -5.65)}, False),  # side by side
        ("box", {"pad": Pad(rows=2, columns=2)}, {}, True),  # the one within the other
        ("capsule", {}, {"normal": (0, 1, 0)}, True),
        ("palm", {}, {"normal": (1, 0, 0)}, False),
    ],
)
def test_arrays_that_overlap_on_one_body_are_one_line(geom, one, other, overlap):
    spec = mujoco.MjSpec.from_string(SCENE)
    pads = [tactsim.press.attach(spec, geom, **each) for each in (one, other)]
    model = spec.compile()
    if not overlap:
        readers = tactsim.press.bind(model, pads)
        assert [reader.geom for reader in readers] == [pad.bind(model).geom for pad in pads]
        return
    with pytest.raises(InputError) as error:
        tactsim.press.bind(model, pads)
    body = {"box": "palm", "capsule": "bone"}[geom]
    assert str(error.value).startswith(
        f"the arrays of pads 0 and 1 overlap on body {body!r}: shift one by `at`"
    )
    assert "\n" not in str(error.value)


def test_a_mesh_that_is_not_closed_is_its_convex_hull():
    """As in MuJoCo's collision: five sides of a box carry a pad, also over the open one."""
    corners = (
        "-.01 -.01 0 .01 -.01 0 .01 .01 0 -.01 .01 0 -.01 -.01 .01 .01 -.01 .01 .01 .01 .01 -.01 .01 .01"
    )
    world = f"""<asset><mesh name="m" inertia="shell" vertex="{corners}"
          face="0 3 2 0 2 1 0 4 7 0 7 3 0 1 5 0 5 4 1 2 6 1 6 5 2 3 7 2 7 6"/></asset><worldbody>
        <body name="shell"><geom type="mesh" mesh="m"/></body>
        <body pos=".001 0 .0151"><joint type="slide" axis="0 0 1"/><geom size=".005" mass=".2"/></body></worldbody>"""
    _, _, reading = simulate(world, "shell", PAD)
    assert reading.force == pytest.approx(0.2 * GRAVITY, rel=1e-3)
    assert errors(reading.kpa, image(PAD, ball(reading.force, 5, 1, 0)))[1] < 0.01


@pytest.mark.filterwarnings("ignore:flex 'cloth' is not rigid")
@pytest.mark.parametrize(
    ("asset", "body", "message"),
    [
        (
            '<hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="1 1 1 1"/>',
            '<geom name="ground" type="hfield" hfield="h" {apart}/>',
            "geom 'ground' (number 0) is a hfield, which a pad cannot feel",
        ),
        (
            "",
            """<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".05 .05 .05" dim="2" radius=".005">
              <contact {apart}/></flexcomp>""",
            "flex 'cloth' can touch geom 'finger': a pad feels rigid geoms only",
        ),
    ],
)
def test_what_a_pad_cannot_feel_is_refused_at_bind(asset, body, message):
    def bound(apart, contact=""):
        spec = mujoco.MjSpec.from_string(f"""<mujoco><asset>{asset}</asset><worldbody>{body.format(apart=apart)}
            <body name="tip" pos="0 0 1"><freejoint/><geom name="finger" type="box" size=".02 .02 .02"/></body>
            </worldbody><contact>{contact}</contact></mujoco>""")
        return tactsim.press.attach(spec, "finger", normal=(0, 0, -1)).bind(spec.compile())

    with pytest.raises(InputError) as error:
        bound("")
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)
    assert bound('contype="2" conaffinity="2"').geom >= 0
    if "hfield" in asset:
        assert bound("", '<exclude body1="world" body2="tip"/>').geom >= 0


def test_a_layer_too_soft_for_its_load_warns_once_and_loses_nothing():
    """It gives way by F / k A = 54.5 mm, less what MuJoCo's contact does."""
    with pytest.warns(
        UserWarning, match="the layer on geom 'finger' gives way by 54.[34] mm under 1.96 N"
    ) as warned:
        reader, data, reading = rest('type="box" size=".003 .003 .003"', PAD, height=3, stiffness=1.0)
    assert len(warned) == 1
    assert reading.outside == pytest.approx(0, abs=1e-9)
    assert errors(reading.kpa, image(PAD, block(reading.force, 3, 3)))[1] < 0.003
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reader.read(data)


@pytest.mark.skipif(not hasattr(mujoco.mjtEnableBit, "mjENBL_SLEEP"), reason="this MuJoCo knows no sleep")
def test_a_body_that_falls_asleep_is_felt_until_it_wakes_or_all_begins_anew():
    spec = mujoco.MjSpec.from_string("""<mujoco><option timestep="0.002"><flag sleep="enable"/></option><worldbody>
        <geom name="finger" type="box" size=".02 .02 .005"/>
        <body pos="0 0 .0081"><freejoint/><geom type="box" size=".003 .003 .003" mass=".2"/></body>
        </worldbody></mujoco>""")
    reader = tactsim.press.attach(spec, "finger", PAD).bind(model := spec.compile())
    data, other = mujoco.MjData(model), mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert data.ncon == 0
    reading, copied = reader.read(data), reader.read(copy.copy(data))
    np.testing.assert_array_equal(copied.kpa, reading.kpa)
    assert reading.force == pytest.approx(0.2 * GRAVITY, rel=0.01)
    assert reading.kpa.max() > 50
    mujoco.mj_forward(model, other)
    assert reader.read(other).force == 0
    data.qvel[2] = 0.5
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert reader.read(data).force == 0
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert data.ncon == 0
    reading, copied = reader.read(data), reader.read(copy.copy(data))
    np.testing.assert_array_equal(copied.kpa, reading.kpa)
    assert reading.force > 1
    mujoco.mj_resetData(model, data)
    assert reader.read(data).force == 0
