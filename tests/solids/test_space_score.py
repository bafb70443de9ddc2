"""Metrics of runs in space, worked out the slow way, and the comparison of two runs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_space import make_space_run, make_space_trials
from manifold3d import CrossSection, Manifold, OpType

from tactsim import models
from tactsim.bench.compare import compare
from tactsim.bench.score import Scored, summarise
from tactsim.core import InputError, rigid
from tactsim.core.rigid import compose, from_vector
from tactsim.solids import solid_of
from tactsim.solids.score import Surface, angle, surface_distance, turn_between
from tactsim.solids.symmetry import find_symmetry

IDENTITY = np.array([[1.0, 0, 0, 0]])
HALF_TURNS = np.eye(4)  # of a box: the identity and half a turn about each axis
FLIP = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])  # beside the axis z of a cylinder
Z = np.array([0.0, 0, 1])


def points(count=64, seed=0):
    return np.random.default_rng(seed).normal(size=(count, 3)) * (10, 6, 3)


def poses(count, seed):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(scale=5, size=(count, 3)), rigid.random_rotations(count, rng)], axis=1)


def about_z(angle):
    return rigid.from_vector(np.multiply.outer(np.asarray(angle), Z))


def beside(pose, rotation):
    """Give the pose of an object that was first turned about its own origin."""
    return rigid.compose(pose, np.concatenate([np.zeros((*np.shape(rotation)[:-1], 3)), rotation], axis=-1))


def by_hand(estimated, true, cloud, group):
    """Work out the distance, the slow way: matrices, one member of the group after the other."""
    found = []
    for one in group:
        at = rigid.matrix(true[3:]) @ rigid.matrix(one) @ cloud.T + true[:3, None]
        other = rigid.matrix(estimated[3:]) @ cloud.T + estimated[:3, None]
        found.append(np.linalg.norm(at - other, axis=0).mean())
    return min(found)


@pytest.mark.parametrize("group", [IDENTITY, HALF_TURNS])
def test_a_finite_group_against_every_one_of_its_members(group):
    cloud, estimated, true = points(), poses(20, 1), poses(20, 2)
    found = surface_distance(estimated, true, Surface(cloud, group))
    wanted = [by_hand(e, t, cloud, group) for e, t in zip(estimated, true, strict=True)]
    assert np.allclose(found, wanted, rtol=0, atol=1e-9)


def test_an_axis_against_a_fine_grid_of_turns():
    cloud = points()
    estimated, true = poses(4, 3), poses(4, 4)
    estimated[2:] = rigid.compose(
        true[2:], np.concatenate([[0.5, 0.2, 0.1], rigid.from_vector([0.1, 0.05, 0.7])])
    )
    turns = about_z(np.linspace(0, 2 * np.pi, 900, endpoint=False))
    group = np.concatenate([rigid.multiply(turns, one) for one in FLIP])
    of = Surface(cloud, FLIP, Z)
    wanted = [by_hand(e, t, cloud, group) for e, t in zip(estimated, true, strict=True)]
    assert np.allclose(surface_distance(estimated, true, of), wanted, rtol=0, atol=2e-2)
    angles = rigid.angle_between(rigid.multiply(true[:, None, 3:], group[None]), estimated[:, None, 3:]).min(
        axis=1
    )
    assert np.allclose(turn_between(estimated, true, of), angles, rtol=0, atol=2e-3)


def test_a_shift_is_as_far_as_it_is_long_and_a_turn_of_a_ring_as_its_chord():
    true = poses(5, 5)
    shifted = true + np.array([3.0, 4, 0, 0, 0, 0, 0])
    assert np.allclose(surface_distance(shifted, true, Surface(points(), IDENTITY)), 5)
    assert np.allclose(turn_between(shifted, true, Surface(points(), IDENTITY)), 0)
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = 7 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    turned = beside(true, about_z(np.full(5, 0.6)))
    assert np.allclose(surface_distance(turned, true, Surface(ring, IDENTITY)), 2 * 7 * np.sin(0.3))
    assert np.allclose(turn_between(turned, true, Surface(ring, IDENTITY)), 0.6)


@given(seed=st.integers(0, 2**32), turn=st.floats(-10, 10), flip=st.integers(0, 1))
def test_poses_that_look_alike_are_no_distance_apart(seed, turn, flip):
    true = poses(1, seed)
    alike = beside(true, rigid.multiply(about_z([turn]), FLIP[[flip]]))
    of = Surface(points(16), FLIP, Z)
    assert surface_distance(alike, true, of)[0] < 5e-3
    assert turn_between(alike, true, of)[0] < 1e-6


@given(seed=st.integers(0, 2**32))
def test_it_is_the_same_in_any_frame(seed):
    estimated, true, frame = poses(3, seed), poses(3, seed + 1), poses(1, seed + 2)
    for of in (Surface(points(16), HALF_TURNS), Surface(points(16), IDENTITY, Z)):
        there = rigid.compose(frame, estimated), rigid.compose(frame, true)
        assert np.allclose(surface_distance(*there, of), surface_distance(estimated, true, of), atol=2e-3)
        assert np.allclose(turn_between(*there, of), turn_between(estimated, true, of), atol=1e-6)


@pytest.fixture(scope="module")
def run():
    return make_space_run(n=40, r=3)


def test_errors_are_mean_distances_of_surface_points_and_angles(run):
    trials, scored = run.trials, Scored(run.trials, run.objects)
    for i in range(40):
        for k in range(3):
            points = run.objects[trials.truth[i]].points
            at, other = (
                rigid.transform(rigid.invert(pose), points)
                for pose in (trials.pose[i, k], trials.true_pose[i, k])
            )
            assert scored.error[i, k] == pytest.approx(np.linalg.norm(at - other, axis=1).mean(), abs=1e-9)
            assert angle(scored)[i, k] == pytest.approx(
                np.degrees(rigid.angle_between(trials.pose[i, k, 3:], trials.true_pose[i, k, 3:]))
            )


def test_a_run_that_is_never_right_has_no_error(run):
    trials = make_space_trials(6, 3)
    trials.label[:] = np.where(trials.truth == "wedge", "block", "wedge")[:, None]
    summary = summarise(Scored(trials, run.objects))
    assert summary["error_mm"] == summary["angle_deg"] == summary["error_low_mm"] == [None] * 3
    assert summary["accuracy"] == [0.0] * 3
    assert summary["settled_95"] is None
    assert summary["confusion"] == {"wedge": {"block": 3}, "block": {"wedge": 3}}


def test_a_run_is_not_worse_than_itself_and_a_pose_that_is_off_is_worse():
    base = make_space_run(n=40, r=3)
    assert {row.verdict for row in compare(base, base)} <= {"not told apart", ""}
    off = np.concatenate([[0.0, 0, 4], from_vector([0.3, 0, 0])])
    worse = replace(base, trials=replace(base.trials, pose=compose(off, base.trials.pose)))
    verdicts = {row.name: row.verdict for row in compare(base, worse)}
    assert verdicts["share of touches right"] == "not told apart"
    assert (
        verdicts["error after 3, mm, both right"] == verdicts["angle after 3, degrees, both right"] == "worse"
    )
    back = {row.name: row.verdict for row in compare(worse, base)}
    assert back["error after 3, mm, both right"] == "better"


def test_other_hidden_objects_are_refused():
    base, new = make_space_run(), make_space_run(seed=1)
    other = {"seed": 1, "objects": ["nut"], "scan": "a.npz"}
    with pytest.raises(InputError, match=r"same objects.* --objects, --seed, --scan"):
        compare(base, replace(new, config=base.config | other))


def test_files_of_one_name_and_another_shape_are_refused():
    def run_of(digest):
        base = make_space_run()
        scan = {"objects": {"wedge": {"digest": digest}}}
        return replace(
            base, config=base.config | {"shapes": ["wedge.stl"]}, about=base.about | {"scan": scan}
        )

    compare(run_of("a" * 64), run_of("a" * 64))
    with pytest.raises(InputError, match="wedge is of another shape"):
        compare(run_of("a" * 64), run_of("b" * 64))


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
