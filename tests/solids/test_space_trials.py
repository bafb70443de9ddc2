"""What is hidden and where it is touched: the draws of trials in space, and who gets how many."""

from dataclasses import fields, replace

import numpy as np
import pytest
from made_up_space import make_space_run

from tactsim.bench import formats
from tactsim.bench.placement import certainty, normalised_error
from tactsim.bench.results import task_name
from tactsim.bench.runs.saved import load
from tactsim.core import InputError, rigid
from tactsim.estimators import Estimate, PoseSamples
from tactsim.solids import SpaceOptions
from tactsim.solids.kind import HALF_BOX, SolidPress, draw_pose_in_space, draw_starts, outside_of
from tactsim.solids.score import SpaceTrials, Surface


def test_touches_start_before_anything_that_the_object_can_be_and_aim_into_the_box():
    outside = outside_of(30.0)
    starts = draw_starts(2000, outside, np.random.default_rng(0))
    normal = rigid.turned(starts[:, 3:], [0.0, 0, 1])
    # The object's farthest point: its origin in a corner of the box, its radius beyond.
    corners = HALF_BOX * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    farthest = corners[None] - 30.0 * normal[:, None]
    before = np.einsum("nkj,nj->nk", farthest - starts[:, None, :3], normal)
    assert before.min() >= -1e-9
    assert np.abs(np.einsum("ij,ij->i", starts[:, :3], normal) + outside).max() < 1e-9
    # The line of the stroke comes nearest to the origin where it crosses the plane through it; it aims into the box.
    aim = starts[:, :3] + (np.arange(0, 2 * outside, 0.5)[:, None, None]) * normal
    assert (np.abs(aim).max(axis=2).min(axis=0) <= HALF_BOX + 0.5).all()


def test_directions_and_turns_are_even():
    starts = draw_starts(4000, 60.0, np.random.default_rng(1))
    for vector in np.eye(3):
        turned = rigid.turned(starts[:, 3:], vector)
        assert np.abs(turned.mean(axis=0)).max() < 0.05
        assert np.abs((turned[:, :, None] * turned[:, None]).mean(axis=0) - np.eye(3) / 3).max() < 0.03


def test_the_hidden_pose_is_in_the_box_and_its_rotation_even():
    rng = np.random.default_rng(2)
    hidden = rigid.invert(np.array([draw_pose_in_space(rng) for _ in range(3000)]))
    assert np.abs(hidden[:, :3]).max() <= HALF_BOX
    assert np.abs(hidden[:, :3]).max() > 0.99 * HALF_BOX
    # The angle of an even rotation has the density (1 - cos a) / pi, of mean pi / 2 + 2 / pi.
    angle = rigid.angle_between(hidden[:, 3:], [1.0, 0, 0, 0])
    assert abs(angle.mean() - (np.pi / 2 + 2 / np.pi)) < 0.05


def test_touches_of_a_trial_are_of_its_seed_its_object_and_its_number():
    press = SolidPress(SpaceOptions(objects=("nut", "egg"), points=8))
    touches, again = press.touches("nut", 0, 3), press.touches("nut", 0, 3)
    starts = touches.offer(rigid.IDENTITY)
    assert np.array_equal(again.offer(rigid.IDENTITY), starts)
    first = touches.take(0, rigid.IDENTITY)
    assert np.array_equal(again.take(0, rigid.IDENTITY).reading, first.reading)
    for trial in (("nut", 0, 4), ("egg", 0, 3), ("nut", 1, 3)):
        other = press.touches(*trial)
        assert not np.isin(other.offer(rigid.IDENTITY), starts).any()
        other._truth, other._starts = "nut", starts  # what disturbs the same touch is another draw, too
        assert not np.array_equal(other.take(0, rigid.IDENTITY).reading, first.reading)


def test_certainty_of_a_belief_that_is_a_line_of_shifts():
    of = Surface(np.random.default_rng(3).normal(size=(32, 3)), np.array([[1.0, 0, 0, 0]]))
    estimate, true = rigid.IDENTITY.copy(), rigid.IDENTITY.copy()
    poses = np.tile(rigid.IDENTITY, (1000, 1))
    poses[:, 0] = np.linspace(0, 1, 1000)
    true[0] = 0.3
    belief = Estimate("a", {"a": 1.0}, estimate, PoseSamples(poses, np.full(1000, 1e-3)))
    found = certainty(belief, true, of)
    assert found.credibility == pytest.approx(0.3, abs=0.01)
    assert found.radius == pytest.approx(0.9, abs=0.01)
    assert np.isnan(certainty(Estimate("a", {"a": 1.0}, estimate), true, of).radius)


def quarter_turns(axis: bool) -> Surface:
    """Make a solid that four turns about z leave as it is, or all."""
    turns = rigid.from_vector(np.array([[0.0, 0, k * np.pi / 2] for k in range(1 if axis else 4)]))
    return Surface(
        np.random.default_rng(3).normal(size=(32, 3)), turns, np.array([0.0, 0, 1.0]) if axis else None
    )


@pytest.mark.parametrize("axis", [False, True])
def test_the_normalised_error_in_space_is_1_in_the_mean_whatever_the_symmetry(axis):
    rng, of = np.random.default_rng(4), quarter_turns(axis)
    near = np.concatenate([[5.0, -4.0, 30.0], rigid.random_rotations(1, rng)[0]])
    poses = rigid.compose(rigid.exp(rng.normal(size=(200, 6)) * [0.5, 0.3, 0.2, 0.05, 0.02, 0.1]), near)
    turned = rigid.from_vector(np.array([[0.0, 0, 1.3 if axis else np.pi / 2]]))
    poses[::2] = rigid.compose(np.concatenate([np.zeros((1, 3)), turned], axis=1), poses[::2])
    samples = PoseSamples(poses, np.full(200, 1 / 200))
    errors = [normalised_error(samples, near, pose, of) for pose in poses]
    assert np.mean(errors) == pytest.approx(1, abs=1e-6)
    found = rigid.log(rigid.compose(of.alike(poses, near), rigid.invert(near)))
    assert np.abs(found[:, 3:]).max() < 0.5  # of each the copy that is turned least


@pytest.fixture
def folder(tmp_path):
    return make_space_run().save(tmp_path / "run")


def test_a_run_is_read_back_to_the_bit(folder, tmp_path):
    run, again = make_space_run(), load(folder)
    for field in fields(SpaceTrials):
        assert np.array_equal(
            getattr(again.trials, field.name),
            getattr(run.trials, field.name),
            equal_nan=field.name in ("credibility", "radius_90", "nees"),
        ), field.name
    assert again.summary == run.summary
    assert again.config == run.config
    assert again.work == run.work
    for label, surface in run.objects.items():
        assert np.array_equal(again.objects[label].vertices, surface.vertices)
        assert np.array_equal(again.objects[label].points, surface.points)
    assert again.kind.name == "solids"
    assert again.save(tmp_path / "again")
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name


def test_hdf5_says_of_all_three_axes_of_a_place_that_they_are_in_millimetres(tmp_path):
    import h5py

    formats.write(make_space_run(), tmp_path / "run.h5", "hdf5")
    with h5py.File(tmp_path / "run.h5") as file:
        for of in ("", "true_", "start_"):
            assert [file[f"{of}{axis}"].attrs["unit"] for axis in "xyz"] == ["mm"] * 3
            assert "unit" not in file[f"{of}qw"].attrs


@pytest.mark.parametrize("missing", ["trials.csv", "times.csv", "times.json", "objects.npz"])
def test_a_folder_that_is_not_whole_is_refused_in_one_line(folder, missing):
    (folder / missing).unlink()
    with pytest.raises(InputError, match="not a whole run") as refusal:
        load(folder)
    assert "\n" not in str(refusal.value)


def test_own_meshes_alone_are_called_by_their_files():
    run = make_space_run()
    scan = {"options": {"objects": [], "meshes": ["parts/plate.stl"]}}
    run = replace(run, about=run.about | {"scan": scan})
    assert task_name(run) == "meshes parts/plate.stl"
