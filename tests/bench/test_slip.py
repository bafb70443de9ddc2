"""How the hidden object moves, and that trials and scores follow it."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import refused
from test_score import make_trials
from test_trials import PLAIN, Witness, make_scan

from tactsim.bench.config import STILL, Slip, run_config
from tactsim.bench.placement import Properties
from tactsim.bench.score import Scored, recovered_within
from tactsim.bench.trials import OneTrial, TrialRules, run_trial
from tactsim.core import InputError, invert, wrap_angle
from tactsim.estimators import Options

FIRST = np.array([4.0, -7.0, 2.5])


def steps(slip, readings=400, seed=0):
    """Give the object's steps in the robot's frame, (readings - 1, 3)."""
    placed = invert(slip.poses(FIRST, readings, np.random.default_rng(seed)))
    moved = np.diff(placed, axis=0)
    return np.column_stack([moved[:, :2], wrap_angle(moved[:, 2])])


def test_a_walk_has_the_stated_deviations_and_begins_where_the_trial_does():
    walk = Slip(walk_mm=0.5, walk_rad=0.03)
    assert np.allclose(walk.poses(FIRST, 5, np.random.default_rng(1))[0], FIRST, atol=1e-12)
    made = steps(walk, 20_000)
    assert np.allclose(made.std(axis=0), [0.5, 0.5, 0.03], rtol=0.03)
    assert np.abs(made.mean(axis=0)).max() < 0.015


def test_a_jump_is_one_step_of_the_stated_length_at_any_touch_but_the_first():
    touches = []
    for seed in range(200):
        moved = steps(Slip(jump_mm=5, jump_rad=0.2), readings=6, seed=seed)
        length = np.hypot(*moved[:, :2].T)
        touches.append(int(length.argmax()))
        assert np.sort(length) == pytest.approx([0, 0, 0, 0, 5], abs=1e-9)
        assert abs(moved[touches[-1], 2]) == pytest.approx(0.2)
    assert np.bincount(touches, minlength=5).min() > 20


def test_a_drift_goes_on_in_one_direction():
    moved = steps(Slip(drift_mm=0.1, drift_rad=0.01), readings=30)
    assert np.allclose(moved, moved[0])
    assert np.hypot(*moved[0, :2]) == pytest.approx(0.1)


def test_the_sensor_pose_of_each_touch_goes_with_the_pose_of_the_object_then():
    scan, witness = make_scan(), Witness(Options())
    witness.fit(scan)
    slip = Slip(walk_mm=2, walk_rad=0.2, jump_mm=5)
    of_e, task = scan.where("test", "E"), OneTrial("E", 1)
    words = {"letters": scan.letters, "of": PLAIN}
    still = run_trial(witness, of_e, task, TrialRules(12, 5), **words)
    moving = run_trial(witness, of_e, task, TrialRules(12, 5, moving=slip), **words)
    assert np.array_equal(still.touch_index, moving.touch_index)
    assert np.array_equal(still.true_pose[:, 0], moving.true_pose[:, 0])
    assert np.ptp(still.true_pose, axis=1).max() == 0
    # The witness composes what it is told with where the reading was taken: it finds the pose of that touch.
    assert np.allclose(moving.pose[..., :2], moving.true_pose[..., :2], atol=1e-9)
    assert np.ptp(moving.true_pose[..., 0]) > 1


def test_the_world_slip_presses_as_the_default_one_and_moves_the_object():
    slipping, plain = run_config(world="slip"), run_config()
    assert slipping.scan_options == plain.scan_options
    assert slipping.source == plain.source
    assert slipping.moving == Slip(walk_mm=0.5, walk_rad=0.03)
    assert plain.moving == STILL
    assert slipping.digest != plain.digest
    assert run_config(slip={"walk_mm": "0.5", "walk_rad": 0.03}).digest == slipping.digest
    assert run_config(world="slip", slip={"walk_mm": 1}).moving == Slip(walk_mm=1, walk_rad=0.03)
    assert run_config(slip={"walk_mm": 0}).digest == plain.digest


@pytest.mark.parametrize("words", [{"walk_mm": -1}, {"stride": 1}])
def test_a_wrong_motion_is_refused_in_one_line(words):
    with pytest.raises(InputError, match="slip: ") as error:
        run_config(slip=words)
    assert "\n" not in str(error.value)


def test_a_world_file_may_name_a_motion(tmp_path):
    (tmp_path / "loose.toml").write_text("placement_mm = 0.2\n[slip]\nwalk_mm = 1\n")
    config = run_config(world=str(tmp_path / "loose.toml"))
    assert config.scan_options.placement_mm == 0.2
    assert config.moving == Slip(walk_mm=1)


def test_a_motion_in_a_world_file_that_is_no_table_is_refused_in_one_line(tmp_path):
    (tmp_path / "loose.toml").write_text("slip = 'walk'\n")
    for slip in ({}, {"walk_mm": 1}):
        with pytest.raises(InputError, match=r"loose\.toml: slip: .*give a table") as error:
            run_config(world=str(tmp_path / "loose.toml"), slip=slip)
        assert "\n" not in str(error.value)


WRONG_WORLDS = {
    "a word for a number": ("press.force = 'much'", "press.force: give a number, got 'much'"),
    "a list that noise would replace": ("sensor = [1]", "sensor is a group of options"),
    "a seed": ("seed = -3", "seed is no option of a world; leave it out, and give --seed"),
    "a slip": ("slip.walk_mm = -1", "slip: walk_mm: give a number of at least 0, got -1"),
}


@pytest.mark.parametrize("case", WRONG_WORLDS)
@pytest.mark.parametrize("verb", [["run", "--noise", "3"], ["scan", "--out", "x.npz"]])
def test_a_wrong_world_file_is_named_and_not_replaced(here, tmp_path, case, verb):
    content, said = WRONG_WORLDS[case]
    (tmp_path / "w.toml").write_text(content)
    refused(here(*verb, "--world", "w.toml"), "world w.toml: ", said)


def test_a_jump_counts_as_recovered_by_the_first_estimate_that_is_near_and_right():
    objects = {"A": Properties(1, (0.0, 0.0), 60.0)}

    def share(errors, jump_at=3, label="A" * 8):
        base = make_trials([list(label)])
        placed = np.zeros((1, 8, 3))
        placed[:, jump_at:, 0] = 5
        estimated = placed + np.array(errors)[None, :, None] * [0, 1, 0]
        moved = replace(base, true_pose=invert(placed), pose=invert(estimated))
        return recovered_within(Scored(moved, objects), 3)

    assert share([0, 0, 0, 5, 5, 0.9, 9, 9]) == 1
    assert share([0, 0, 0, 5, 5, 5, 0.9, 0]) == 0
    assert share([0, 0, 0, 5, 5, 0.9, 9, 9], label="AAAAAEAA") == 0
    assert share([0] * 8, jump_at=6) is None  # two readings are left
    assert share([0] * 8, jump_at=5) == 1
    assert share([0] * 8, jump_at=8) is None
