"""Pads under bodies of several geoms, which are read as one: against springs by brute force, and a closed form."""

import mujoco
import numpy as np
import pytest
from attached_scenes import ball, block, errors, image, letter_geoms, settle, simulate, springs, within

import tactsim
from tactsim import Pad, models

PAD = Pad()


def box(x, y, half_x, half_y, above=0.0):
    """Write a box of halves mm, its face `above` mm over z = 0."""
    return f"""<geom type="box" size="{half_x / 1e3} {half_y / 1e3} .002"
        pos="{x / 1e3} {y / 1e3} {0.002 + above / 1e3}"/>"""


def gap_of(boxes):
    def gap(x, y):
        away = np.full(x.shape, np.inf)
        for at_x, at_y, half_x, half_y, *above in boxes:
            inside = (np.abs(x - at_x) < half_x) & (np.abs(y - at_y) < half_y)
            away[inside] = np.minimum(away[inside], sum(above))
        return away

    return gap


@pytest.mark.parametrize(
    "boxes",
    [
        [(-2, 0.13, 4, 4), (3, 0.13, 3, 4), (0.3, 0.13, 1, 4)],  # they overlap
        [(0.2, 0.1, 5, 1.3), (0.2, 0.1, 1.1, 4)],  # a cross
        [(-6, 0, 5, 4), (4.3, 0, 5.3, 4)],  # beyond the pad's rim
        [(-3, 0, 3, 4, 0.0), (3, 0, 3, 4, 0.02)],  # a step
        [(-5, 0, 1, 1, 0.0), (5, 0, 1, 1, 0.05)],  # feet apart, one so high that MuJoCo has no contact there
    ],
)
def test_boxes_of_one_body_are_one_face(boxes):
    _, _, reading = settle("".join(box(*each) for each in boxes), pose='pos="0 0 1e-5"')
    truth, inside, _ = springs(PAD, gap_of(boxes), reading.force)
    assert errors(reading.kpa, truth)[1] < 0.001
    assert reading.outside == pytest.approx(reading.force - inside, abs=5e-4)


def test_parts_that_nothing_presses_change_nothing():
    """Beside the load, and within its lattice but too high."""
    plate = box(-2, 0, 2, 1) + box(2, 0, 2, 1)
    more = plate + box(0, 8, 5, 2, 1.0) + box(0, 1.6, 5, 0.5, 1.0)
    plain, other = (settle(geoms, pose='pos="0 0 1e-5"')[2].kpa for geoms in (plate, more))
    np.testing.assert_allclose(other, plain, atol=1e-9 * plain.max())


def test_a_round_foot_that_mujoco_does_not_feel_is_carried_by_the_layer():
    feet = [(-4, 0.0), (4, 0.4)]
    geoms = "".join(f'<geom size=".003" pos="{x / 1e3} .0003 {0.003 + above / 1e3}"/>' for x, above in feet)
    _, data, reading = settle(geoms, pose='pos="0 0 1e-5"', stiffness=500)
    assert data.ncon == 1

    def gap(x, y):
        away = [9 - (x - at) ** 2 - (y - 0.3) ** 2 for at, _ in feet]
        lower = [
            np.where(inside > 0, 3 - np.sqrt(np.maximum(inside, 0)) + above, np.inf)
            for inside, (_, above) in zip(away, feet, strict=True)
        ]
        return np.minimum(*lower)

    truth, *_ = springs(PAD, gap, 2 * reading.force)  # of 1 N/mm^3, twice as much
    assert errors(2 * reading.kpa, truth)[1] < 0.01


@pytest.mark.parametrize(("name", "tilt"), [("A", 0.0), ("E", 0.02)])
def test_the_convex_parts_of_a_letter_are_one_letter(name, tilt):
    """Parts lie wall to wall along slanted lines. Held by a slide, tilted about y."""
    letter = models.letter(name)
    assets, geoms = letter_geoms(letter)
    pose = f'pos="0 0 {5e-3 * np.sin(tilt) + 1e-5}" euler="0 {tilt} 0"'
    _, _, reading = settle(geoms, assets=assets, pose=pose)

    def gap(x, y):
        return np.where(within(letter.contours, x / np.cos(tilt), -y), (5 - x) * np.tan(tilt), np.inf)

    truth, *_ = springs(PAD, gap, reading.force, fine=0.013, beyond=14)
    assert errors(reading.kpa, truth)[1] < 0.01


@pytest.mark.parametrize("lever", [0.0, 0.6])
def test_a_body_that_is_free_to_turn_is_centred_where_its_weight_is(lever):
    """The plate's seam is off its middle and the contacts lie unevenly; a stiff layer, so that it does not lean."""
    geoms = box(-4, 0, 2, 4) + box(2, 0, 4, 4)
    world = f"""<worldbody><geom name="finger" type="box" size=".03 .03 .005" pos="0 0 -.005"/>
        <body name="body" pos="0 0 1e-5"><freejoint/>
          <inertial pos="{lever / 1e3} 0 .002" mass="0.2" diaginertia="1e-5 1e-5 1e-5"/>{geoms}</body></worldbody>"""
    _, data, reading = simulate(world, pad=PAD, steps=3000, stiffness=1e5)
    truth = image(PAD, block(reading.force, 6, 4, x=data.body("body").xpos[0] * 1e3, lever=lever))
    assert errors(reading.kpa, truth)[1] < 0.02


def test_the_centre_of_force_may_be_mujocos_own():
    """A body that a slide holds: MuJoCo's corners of the smaller box draw its centre to that side."""
    geoms = box(-4, 0, 2, 4) + box(2, 0, 4, 4)
    kpa = {
        centre: settle(geoms, pose='pos="0 0 1e-5"', centre=centre)[2].kpa @ PAD.taxel_xy[:, 0]
        for centre in ("auto", "press", "mujoco")
    }
    assert kpa["auto"] == kpa["press"]
    assert kpa["mujoco"] < kpa["press"]


def test_two_faces_of_one_body_that_hold_a_finger_are_two_loads():
    """A fork's prongs press a ball from either side; each is felt where it is."""
    spec = mujoco.MjSpec.from_string("""<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
        <body name="fork"><geom type="box" size=".002 .01 .01" pos="-.0119 0 0"/>
          <geom type="box" size=".002 .01 .01" pos=".0119 0 0"/></body>
        <body><freejoint/><geom name="finger" size=".01" mass=".1"/></body></worldbody></mujoco>""")
    sides = [tactsim.press.attach(spec, "finger", PAD, normal=(x, 0, 0), stiffness=300) for x in (1, -1)]
    data = mujoco.MjData(model := spec.compile())
    for _ in range(200):
        mujoco.mj_step(model, data)
    right, left = (side.bind(model).read(data) for side in sides)
    assert right.force == left.force
    assert right.outside == pytest.approx(right.force / 2, rel=1e-3)
    assert right.kpa.sum() == pytest.approx(left.kpa.sum(), rel=1e-6)
    assert right.kpa.max() > 1


@pytest.mark.parametrize("squeeze", [0.0, 0.1])
def test_walls_that_press_a_ball_on_the_pads_floor_are_outside_and_the_floor_is_not(squeeze):
    """Three contacts of one geom in three directions, which are no load in their mean direction."""
    walls = "".join(
        f'<geom type="box" size=".002 .01 .01" pos="{x * (7 - squeeze) / 1e3} 0 .005"/>' for x in (-1, 1)
    )
    reading = press_on(
        f'<geom type="box" size=".009 .01 .002" pos="0 0 -.002"/>{walls}',
        pad=Pad(rows=6, columns=4),
        object_geom='<geom size=".005" pos="0 0 .005" mass=".2"/>',
    )
    assert reading.force - reading.outside == pytest.approx(0.2 * 9.81, rel=0.01)
    assert (reading.outside > 0.1) == (squeeze > 0)


def press_on(link, *, pad=PAD, object_geom, assets="", **options):
    """Let a body slide down on a link of geoms, MJCF: the reading."""
    world = f"""<asset>{assets}</asset><worldbody><body name="link">{link}</body>
        <body name="body"><joint type="slide" axis="0 0 1"/>{object_geom}</body></worldbody>"""
    return simulate(world, "link", pad, steps=1200, **options)[2]


def test_an_array_spans_the_boxes_of_a_link():
    """Four small boxes stand 1 mm before a large one, as on the fingers of Franka's hand; a plate rests on them."""
    small = [(x, y, 2.5, 1.5) for x in (-4, 4) for y in (-3, 3)]
    link = '<geom type="box" size=".012 .01 .005" pos="0 0 -.006"/>' + "".join(
        f'<geom type="box" size="{a / 1e3} {b / 1e3} .002" pos="{x / 1e3} {y / 1e3} -.002"/>'
        for x, y, a, b in small
    )
    reading = press_on(link, object_geom='<geom type="box" size=".02 .02 .002" pos="0 0 .00201" mass=".2"/>')
    assert reading.force == pytest.approx(0.2 * 9.81, rel=1e-3)
    assert reading.outside == pytest.approx(0, abs=1e-6)
    truth, *_ = springs(PAD, gap_of(small), reading.force)
    assert errors(reading.kpa, truth)[1] < 0.02  # the lattice samples the steps between the boxes


@pytest.mark.parametrize("x", [1.5, 8.5])
def test_boxes_side_by_side_carry_a_pad_as_one_box_does(x):
    """Their faces are in one plane, so that nothing steps; also at the rim of both."""
    ball = f'<geom size=".006" pos="{x / 1e3} .0007 .01101" mass=".2"/>'
    halves = "".join(f'<geom type="box" size=".0045 .01 .005" pos="{at} 0 0"/>' for at in (-0.0045, 0.0045))
    two = press_on(halves, object_geom=ball)
    plain = press_on('<geom type="box" size=".009 .01 .005"/>', object_geom=ball)
    assert two.force == pytest.approx(plain.force, rel=1e-3)
    assert two.outside == pytest.approx(plain.outside, abs=0.01 * plain.force)
    assert errors(two.kpa, plain.kpa)[1] < 0.01


def mesh_of(points):
    return f'<mesh name="tip" vertex="{" ".join(map(repr, points.ravel().tolist()))}"/>'


def test_a_mesh_that_is_a_box_carries_a_pad_as_the_box_does():
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T * [0.012, 0.01, 0.005]
    ball = '<geom size=".006" pos=".001 .0007 .01101" mass=".2"/>'
    mesh = press_on('<geom type="mesh" mesh="tip"/>', assets=mesh_of(corners), object_geom=ball)
    plain = press_on('<geom type="box" size=".012 .01 .005"/>', object_geom=ball)
    assert mesh.force == pytest.approx(plain.force, rel=1e-3)
    assert errors(mesh.kpa, plain.kpa)[1] < 0.005


def test_a_pad_on_the_tip_of_a_long_mesh_ends_where_its_sides_begin():
    """A pencil whose tip falls by 2.5 mm for each mm: no slope of the tip goes on beyond its sides."""
    around, down = np.linspace(0, 2 * np.pi, 32, endpoint=False), np.linspace(0, 1, 10)
    rings = [(0.1, 0.0), *zip(5 + 0.5 * np.sqrt(down), -12.5 - 86 * down, strict=True)]
    places = np.array([[r * np.cos(at), r * np.sin(at), z] for r, z in rings for at in around]) / 1e3
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><asset>{mesh_of(places)}</asset><worldbody><geom type="mesh" mesh="tip"/></worldbody></mujoco>'
    )
    pad = Pad(rows=2, columns=2, pitch_x=1, pitch_y=1, taxel_width=1, taxel_height=1)
    skin = tactsim.press.attach(spec, spec.geoms[0], pad)
    face = skin.bind(spec.compile()).surface.face
    np.testing.assert_allclose([*face.low, *face.high], [-5, -5, 5, 5], atol=0.05)


@pytest.mark.long
def test_a_fine_mesh_of_an_ellipsoid_carries_a_pad_as_the_ellipsoid_does():
    """The mesh is of the upper part alone, as fine as 60 rings of 120 corners over the whole."""
    polar, around = np.meshgrid(np.linspace(0, np.pi / 3, 21), np.linspace(0, 2 * np.pi, 121)[:-1])
    way = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    ball = '<geom type="box" size=".02 .02 .002" pos="0 0 .01401" mass=".2"/>'
    pad = Pad(unread_columns=0)
    given = {"pad": pad, "object_geom": ball, "stiffness": 200}
    mesh = press_on('<geom type="mesh" mesh="tip"/>', assets=mesh_of(way * [0.02, 0.016, 0.012]), **given)
    plain = press_on('<geom type="ellipsoid" size=".02 .016 .012"/>', **given)
    assert mesh.force == pytest.approx(plain.force, rel=1e-2)
    assert errors(mesh.kpa, plain.kpa)[1] < 0.03


EVEN_PAD = Pad(rows=6, columns=6, pitch_x=2.0, pitch_y=2.0, taxel_width=1.9, taxel_height=1.9)


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
    skin = tactsim.press.attach(spec, "finger", EVEN_PAD)
    data = mujoco.MjData(model := spec.compile())
    mujoco.mj_forward(model, data)
    data.qpos[0] = -heights(model, data, *np.meshgrid(*2 * [np.arange(-12, 12, 0.2)])).min() / 1e3
    data.qfrc_applied[0] = -force
    for _ in range(600):
        mujoco.mj_step(model, data)
    reading = skin.bind(model).read(data)
    right, _, _ = springs(EVEN_PAD, lambda x, y: heights(model, data, x, y), reading.force, fine=fine)
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


def mesh_of_corners(corners, turn="0 0 0", place="0 0 0"):
    """Write the hull of corners (n, 3) m: MJCF of a geom, and its asset."""
    asset = f'<mesh name="m" vertex="{" ".join(map(str, np.ravel(corners)))}"/>'
    return f'<geom type="mesh" mesh="m" euler="{turn}" pos="{place}"/>', asset


def turned_mesh(rng, corners, off):
    turn, place = rng.uniform(-180, 180, 3), rng.uniform(-off, off, 2)
    return mesh_of_corners(corners, " ".join(map(str, turn)), " ".join(map(str, [*place, 0])))


def hull_mesh(rng):
    """Draw the hull of points on an ellipsoid, turned anyhow."""
    corners = rng.normal(size=(rng.integers(6, 60), 3))
    corners *= rng.uniform(0.001, 0.004, 3) / np.linalg.norm(corners, axis=1)[:, None]
    return turned_mesh(rng, corners, 0.004)


def splinter(rng):
    """Draw the hull of a few points, turned anyhow: most are sharp, and sink in by millimetres."""
    corners = rng.uniform(-1, 1, (rng.integers(4, 9), 3)) * rng.uniform(0.001, 0.005, 3)
    return turned_mesh(rng, corners, 0.003)


@pytest.mark.long
@pytest.mark.parametrize("drawn", [geoms_of, box_of, hull_mesh, splinter])
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
        # A slanting edge, found by turns too short and too long
        ('size=".004 .0015 .001" euler="45 65 25"', 1.0),
        # A deep corner between sides that lean by 10 degrees
        ('size=".0012 .0034 .0029" euler="75 -49 -92"', 0.3),
    ],
)
def test_an_edge_and_a_deep_corner_press_as_springs_do(box, force):
    reading, right = pressed(f'<geom type="box" {box}/>', force, fine=0.05)
    assert reading.found
    assert errors(reading.kpa, right)[1] < 0.02


@pytest.mark.parametrize(
    ("corners", "force"),
    [
        (
            [(-0.2, -3.6, 0.9), (0.9, -3.3, 3.6), (4.8, -0.3, 0), (-2.4, -4.3, 3.3)],
            0.3,
        ),  # narrower than cells
        ([(2.6, 0.1, 1.6), (1.4, 1.1, 0.5), (3.6, -0.2, 0), (6.7, -1.5, 4.2)], 3.0),  # 3 mm deep, on a needle
    ],
)
def test_a_splinter_presses_as_springs_do(corners, force):
    geom, asset = mesh_of_corners(np.array(corners) / 1e3)
    reading, right = pressed(geom, force, fine=0.05, assets=asset)
    assert reading.found
    assert errors(reading.kpa, right)[1] < 0.03


def test_a_reading_under_a_razors_edge_is_marked():
    """Of 0.01 mm, which no lattice resolves."""
    geom, asset = mesh_of_corners(np.array([(-4, -3, 0), (4, 3, 0.3), (0, 0.005, 3), (0, -0.005, 3)]) / 1e3)
    with pytest.warns(UserWarning, match="gives way"):
        reading = settle(geom, assets=asset)[2]
    assert not reading.found
    assert "not all that touches was found" in str(reading)


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
    flat = tactsim.press.attach(spec, "finger", EVEN_PAD)
    round_one = tactsim.press.attach(spec, "ball", EVEN_PAD, normal=(0, 0, -1), stiffness=500.0)
    data = mujoco.MjData(model := spec.compile())
    readers = tactsim.press.bind(model, [flat, round_one])
    for _ in range(1000):
        mujoco.mj_step(model, data)
    stiffness = 1 / (1 / 1.0 + 1 / 0.5)
    for reading in (reader.read(data) for reader in readers):
        of_one = ball(reading.force / stiffness, 15.0)
        right = image(EVEN_PAD, lambda x, y, of_one=of_one: stiffness * of_one(x, y))
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
