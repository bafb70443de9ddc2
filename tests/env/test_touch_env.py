"""One environment: Gymnasium's own checker, what is observed, rewarded and told, and what is refused."""

import copy
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

import tactsim.env
from tactsim.bench import tasks
from tactsim.bench.config import STILL
from tactsim.core import InputError, compose, invert
from tactsim.env.touch_env import say_action, touch_action
from tactsim.env.world import NORMALS, World, world
from tactsim.estimators import create
from tactsim.press.engine import ideal_readings, press_at
from tactsim.press.scan_poses import random_poses
from tactsim.press.touches import Touches

IDS = [f"tactsim/{name}" for name in tasks.names() if tasks.task(name).pressed]
LETTERS = "tactsim/letters-offgrid-v1"


def make(name=LETTERS, **options):
    return gymnasium.make(name, **options).unwrapped


def episode(env, seed, poses):
    """Touch at these poses: all observations, and the rewards."""
    seen, rewards = [env.reset(seed=seed)[0]], []
    for pose in poses:
        observation, reward, *_ = env.step(env.touch(pose))
        seen.append(observation)
        rewards.append(reward)
    return seen, rewards


def same(one, other):
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


POSES = [(0.0, 0.0, 0.0), (5.0, -3.0, 1.0), (-12.0, 12.0, -np.pi), (2.0, 2.0, 3.0)]


@pytest.mark.parametrize("name", IDS)
def test_every_task_passes_gymnasiums_checker_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(name))


def test_a_seed_gives_the_same_bits_again_and_another_seed_does_not():
    first, rewards = episode(make(belief="histogram", information=1.0), 3, POSES)
    again, rewards_again = episode(make(belief="histogram", information=1.0), 3, POSES)
    other, _ = episode(make(belief="histogram"), 4, POSES)
    assert all(map(same, first, again))
    assert rewards == rewards_again
    assert not same(first[1], other[1])


def test_a_belief_changes_nothing_of_what_is_felt():
    plain, _ = episode(make(), 5, POSES)
    believing, _ = episode(make(belief="particle", belief_options={"particles": 200}), 5, POSES)
    for one, other in zip(plain, believing, strict=True):
        assert same(one, {name: other[name] for name in one})


def test_what_is_touched_does_not_change_the_luck_of_later_touches():
    env = make("tactsim/slip-v1")
    first, _ = episode(env, 7, [(0, 0, 0), (1, 1, 1), (3, 0, 0)])
    path = env.hidden.path.copy()
    other, _ = episode(env, 7, [(9, -9, 2), (-5, 4, 0), (3, 0, 0)])
    assert np.array_equal(path, env.hidden.path)
    assert same(first[3], other[3])


@pytest.mark.long
def test_the_belief_is_that_of_an_estimator_which_is_given_the_observations():
    env = make(belief="refined", information=0.5, touch_cost=0.1)
    seen, rewards = episode(env, 2, POSES)
    estimator = create("refined")
    estimator.fit(env.scan)
    estimator.reset(np.random.default_rng(0))
    before = np.log(len(env.labels))
    for observation, reward in zip(seen[1:], rewards, strict=True):
        estimator.update(observation["reading"], observation["pose"])
        estimate = estimator.estimate()
        p = np.array([estimate.probabilities[label] for label in env.labels])
        assert observation["probabilities"] == pytest.approx(p, abs=1e-6)
        assert observation["place"] == pytest.approx(estimate.robot_in_object, abs=1e-5)
        there = compose(observation["place"].astype(float), observation["object_in_robot"].astype(float))
        assert there == pytest.approx(np.zeros(3), abs=1e-4)
        after = -(p[p > 0] * np.log(p[p > 0])).sum()
        assert reward == pytest.approx(0.5 * (before - after) - 0.1, abs=1e-9)
        before = after


@pytest.mark.parametrize("right", [True, False])
def test_a_label_ends_the_episode_and_only_then_the_truth_is_told(right):
    env = make(right=2.0, wrong=3.0)
    env.reset(seed=1)
    *_, info = env.step(env.touch(POSES[0]))
    assert info == {}
    label = env.answer if right else next(one for one in env.labels if one != env.answer)
    _, reward, terminated, truncated, info = env.step(env.say(label))
    assert (reward, terminated, truncated) == (2.0 if right else -3.0, True, False)
    assert info["answer"] == env.answer
    assert info["robot_in_object"].shape == (3,)
    with pytest.raises(ResetNeeded):
        env.step(env.say(label))
    env.reset()
    env.step(env.touch(POSES[0]))


def test_two_truths_that_feel_alike_cannot_be_told_apart(monkeypatch):
    """Hide two objects, and let both read the same: observations, rewards and infos are the same bits."""
    env = make(belief="histogram", information=1.0)
    felt = np.random.default_rng(0).uniform(0, 40, (len(POSES), 36))

    def lived(letter, pose):
        env.reset(seed=11)
        hidden = env.hidden
        hidden.letter, hidden.path = letter, np.tile(pose, (20, 1))
        monkeypatch.setattr(env.world, "press", lambda *_: (felt[hidden.touches].copy(), True))
        return [env.step(env.touch(pose)) for pose in POSES]

    for one, other in zip(lived(0, [1.0, 2.0, 3.0]), lived(3, [-4.0, 0.0, 0.5]), strict=True):
        assert same(one[0], other[0])
        assert one[1:] == other[1:]


def test_a_press_that_does_not_come_to_rest_costs_its_touch_and_tells_nothing(monkeypatch):
    env = make(belief="histogram", information=1.0, touch_cost=0.25)
    (_, before), _ = episode(env, 1, POSES[:1])
    monkeypatch.setattr(env.world, "press", lambda *_: (np.zeros(36), False))
    observation, reward, *_ = env.step(env.touch(POSES[1]))
    assert (observation["felt"], before["felt"], reward) == (0, 1, -0.25)
    assert not observation["reading"].any()
    assert observation["pose"] == pytest.approx(POSES[1])
    assert np.array_equal(observation["probabilities"], before["probabilities"])
    hidden = env.hidden
    assert (hidden.touches, hidden.readings) == (2, 1)


def test_a_worn_pad_reads_what_its_sensor_makes_of_the_touches_so_far(monkeypatch):
    env = make("tactsim/worn-pad-v1")
    env.reset(seed=2)
    hidden, world = env.hidden, env.world
    ideal = np.random.default_rng(0).uniform(0, 40, (5, 36))
    pressed, rng, before = [], copy.deepcopy(hidden.rng), None

    def press(letter, pose, normals):
        pressed.append((letter, pose, normals))
        return ideal[hidden.touches].copy(), True

    monkeypatch.setattr(world, "press", press)
    for k in range(5):
        observation, *_ = env.step(env.touch(POSES[1]))
        letter, pose, normals = pressed[k]
        assert letter == hidden.letter
        assert pose == pytest.approx(compose(hidden.path[k], POSES[1]), abs=1e-6)
        assert np.array_equal(normals, rng.standard_normal(6))
        noise, replaced, level = rng.standard_normal(36), rng.random(36), rng.random(36)
        before = world.gain * ideal[k] if before is None else 0.8 * world.gain * ideal[k] + 0.2 * before
        right = before + 0.01 * (k + 1) + 3.0 * noise
        right = np.where(replaced < 0.02, 0.6 * right.max() * level, right)
        right = 0.7 * np.round(right / 0.7)
        right[[2, 13, 27]] = 0
        assert observation["reading"] == pytest.approx(right, abs=1e-4)


def test_an_object_that_slips_is_touched_where_it_then_is():
    env = make("tactsim/letters-offgrid-v1", slip={"drift_mm": 1.0})
    env.reset(seed=0)
    hidden = env.hidden
    places = []
    for _ in range(45):  # beyond the 20 touches of a trial
        places.append(invert(hidden.robot_in_object)[:2])
        env.step(env.touch(POSES[0]))
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps == pytest.approx(1.0)


@given(st.integers(0, 2**31), st.data())
@settings(max_examples=8)
def test_any_action_of_the_space_is_taken_and_what_it_gives_lies_in_the_spaces(seed, data):
    env = shared(data.draw(st.sampled_from(["tactsim/worn-pad-v1", "tactsim/slip-v1"])))
    observation, _ = env.reset(seed=seed)
    assert observation in env.observation_space
    env.action_space.seed(seed)
    for _ in range(4):
        action = env.action_space.sample()
        observation, reward, terminated, *_ = env.step(action)
        assert observation in env.observation_space
        assert np.isfinite(reward)
        assert terminated == (action[3] > 0)
        if terminated:
            break


MADE = {}


def shared(name):
    return MADE.setdefault(name, make(name, belief="histogram", fast=True))


@given(
    st.tuples(st.floats(-12, 12), st.floats(-12, 12), st.floats(-10, 10)), st.sampled_from(["A", "B", "none"])
)
def test_the_actions_that_are_made_are_in_the_space_and_say_what_was_asked(pose, label):
    labels = ("A", "B", "none")
    space = tactsim.env.touch_env.action_space(labels)
    touch, say = touch_action(pose, labels, 12.0), say_action(label, labels)
    assert touch in space
    assert say in space
    read, stops, _ = tactsim.env.touch_env.decoded(touch.astype(float), 12.0)
    assert not stops
    assert read[:2] == pytest.approx(pose[:2], abs=1e-5)
    assert np.cos(read[2] - pose[2]) == pytest.approx(1)
    _, stops, said = tactsim.env.touch_env.decoded(say.astype(float), 12.0)
    assert stops
    assert labels[said] == label


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda a: np.where(np.arange(9) == 0, 1.2, a), "x = 14.4 mm is beyond the pad's reach of 12 mm"),
        (
            lambda a: shared("tactsim/slip-v1").touch([0, -50, 0]),
            "y = -50 mm is beyond the pad's reach of 12 mm",
        ),
        (lambda a: np.where(np.arange(9) == 5, 2, a), "the score of E"),
        (lambda a: np.where(np.arange(9) == 1, np.nan, a), "NaN"),
        (lambda a: a[:3], r"an array \(9,\) of numbers"),
    ],
)
def test_a_wrong_action_is_refused_in_one_line_and_touches_nothing(change, said):
    env = shared("tactsim/slip-v1")
    seen, _ = episode(env, 9, POSES[:2])
    episode(env, 9, POSES[:1])
    with pytest.raises(InputError, match=said) as caught:
        env.step(change(env.touch(POSES[0])))
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="knows no options"):
        env.reset(seed=1, options={"label": "A"})
    assert same(env.step(env.touch(POSES[1]))[0], seen[2])


@pytest.mark.parametrize(
    ("options", "said"),
    [({"information": 1.0}, "information is rewarded only with a belief"),
     ({"belief": "histogramm"}, "did you mean 'histogram'"), ({"touch_cost": -1.0}, "touch_cost"),
     ({"scan_seed": 99}, "letters-offgrid-v1 has the seeds 0, 1, 2, 3, 4")],
)  # fmt: skip
def test_a_wrong_option_is_refused_in_one_line(options, said):
    with pytest.raises(InputError, match=said) as caught:
        make(**options)
    assert "\n" not in str(caught.value)


def test_many_at_once_are_these_environments_one_by_one():
    options = {"belief": "histogram", "fast": True}
    together = gymnasium.make_vec(LETTERS, num_envs=3, **options)
    seen, _ = together.reset(seed=5)
    apart = [make(**options) for _ in range(3)]
    alone = [env.reset(seed=5 + k)[0] for k, env in enumerate(apart)]
    action = apart[0].touch(POSES[1])
    for _ in range(2):
        for k, one in enumerate(alone):
            assert same(one, {name: values[k] for name, values in seen.items()})
        seen, *_ = together.step(np.tile(action, (3, 1)))
        alone = [env.step(action)[0] for env in apart]


TASK = 'line = "x"\nseeds = [0, 1, 2, 3, 4]\ntrials = 1\nreadings = 2\nscored = ["accuracy@2"]\n[words]\n'


@pytest.fixture(scope="module")
def letters():
    return world("letters-offgrid-v1", None, {}, False)


def pressed(world, letter, poses, normals):
    """Press one object at poses (n, 3), all of which come to rest: (n, taxels)."""
    readings, rests = zip(
        *(world.press(letter, *one) for one in zip(poses, normals, strict=True)), strict=True
    )
    assert all(rests)
    return np.array(readings)


def test_without_errors_it_is_the_ideal_press(letters):
    poses = random_poses(np.random.default_rng(0), 7)
    ideal = pressed(letters, 2, poses, np.zeros((7, NORMALS)))
    right, _ = ideal_readings(Touches.of(letters.letters[2], poses), letters.options)
    assert ideal == pytest.approx(right, abs=1e-9)


def test_the_numbers_that_were_drawn_say_how_far_a_press_is_off(letters):
    rng = np.random.default_rng(1)
    poses, normals = random_poses(rng, 5), rng.standard_normal((5, NORMALS))
    ideal = pressed(letters, 0, poses, normals)
    off = compose(poses, normals[:, :3] * [0.1, 0.1, 0.005])
    touches = Touches(letters.letters[0], off, 0.0044 * normals[:, 3:5])
    assert ideal == pytest.approx(press_at(touches, letters.options).readings(letters.options), abs=1e-9)


def test_the_forward_model_presses_with_the_same_errors_and_loads(tmp_path):
    path = tmp_path / "hand-v1.toml"
    path.write_text(TASK + 'world = "handheld"\nscan_set = { press.tilt_x = 0.01 }\n')
    rng = np.random.default_rng(3)
    poses, normals = random_poses(rng, 20), rng.standard_normal((20, NORMALS))
    own, fast = (
        pressed(World(tasks.task(str(path)), 0, STILL, fast), 1, poses, normals) for fast in (False, True)
    )
    assert fast == pytest.approx(own, abs=0.25, rel=0.005)  # kPa; the press has cells, the model has none
    assert own.max() > 40


def test_a_task_of_a_file_has_no_environment(tmp_path, letters):
    (tmp_path / "mine-v1.toml").write_text(TASK + 'scan = "mine.npz"\n')
    (tmp_path / "each-v1.toml").write_text(TASK + 'hold_out = "each"\n')
    letters.scan.save(tmp_path / "mine.npz")
    for name, said in (("mine-v1", "readings from a file"), ("each-v1", "its answer is always 'none'")):
        with pytest.raises(InputError, match=said):
            World(tasks.task(str(tmp_path / f"{name}.toml")), 0, STILL, False)
