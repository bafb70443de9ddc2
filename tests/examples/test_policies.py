"""The reference policies: what they choose, what the learned one learns, and how they are compared."""

import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import tactsim
from tactsim.env import Reward

sys.path.insert(0, str(Path(tactsim.__file__).parents[1] / "examples" / "policies"))
from policies import InformationPolicy, LearnedPolicy, Policy, RandomPolicy, features
from table import compare, play

TASK = "letters-offgrid-v1"


class Middle(Policy):
    """Touch in the middle, with a turn more each time."""

    def begin(self, rng):
        self.turn = 0.0

    def choose(self, env, observation):
        self.turn += 0.1
        return np.array([0.0, 0.0, self.turn])


def env_of(**options):
    return gymnasium.make(f"tactsim/{TASK}", fast=True, **options).unwrapped


@pytest.mark.parametrize("policy", [RandomPolicy("histogram"), InformationPolicy("histogram")])
def test_a_policy_touches_within_the_reach_and_anew_by_the_same_random_numbers(policy):
    env = env_of(belief="histogram")
    chosen = []
    for _ in range(2):
        observation, _ = env.reset(seed=3)
        policy.begin(np.random.default_rng(0))
        for _ in range(3):
            chosen.append(policy.choose(env, observation))
            observation, *_ = env.step(env.touch(chosen[-1]))
    assert np.array_equal(chosen[:3], chosen[3:])
    assert np.ptp([pose[0] for pose in chosen]) > 0
    assert (np.abs(chosen)[:, :2] <= 12).all()


def begun(policy):
    policy.begin(np.random.default_rng(0))
    return policy


def test_features_do_not_depend_on_where_the_robots_frame_lies():
    """Turn and move object and touches together: all but the place in the robot's frame stays."""
    p, place = np.array([0.7, 0.3]), np.array([2.0, -3.0, 0.4])
    poses, before = np.array([[1.0, 2.0, 0.3], [-4.0, 0.0, 2.0]]), [np.array([0.0, 1.0, 0.2])]
    moved = np.array([5.0, 1.0, 1.2])
    other = tactsim.compose(place, tactsim.invert(moved))
    one = features(p, place, poses, before)
    two = features(p, other, tactsim.compose(moved, poses), [tactsim.compose(moved, before[0])])
    robots = one.shape[1] - 3
    assert np.delete(one, robots, axis=1) == pytest.approx(np.delete(two, robots, axis=1))
    assert one[0, -2] == pytest.approx(np.hypot(1, 1))
    assert one[0, -1] == pytest.approx(0.1)


@pytest.mark.long
def test_what_is_learned_is_to_touch_the_object():
    policy = LearnedPolicy("histogram", rounds=4, episodes=30)
    policy.learn(TASK, 0)
    first = []
    env = env_of(belief="histogram")
    for seed in range(12):
        observation, _ = env.reset(seed=seed)
        policy.begin(np.random.default_rng(seed))
        first.append(policy.choose(env, observation))
    # The first touch of a hidden object says most near the middle of where it may be; random ones are 9 mm from it.
    assert np.hypot(*np.array(first)[:, :2].T).mean() < 7


def test_episodes_are_played_as_the_environment_would_have_it():
    """The touches until it is sure, and the return, are those of an episode that is ended there by its label."""
    played = play(Middle("histogram"), TASK, (0,), 3, 4)
    assert played.right.shape == played.sure.shape == (3, 4)
    sums, stops = [], []
    env = gymnasium.make(f"tactsim/{TASK}", belief="histogram").unwrapped
    for k in range(3):
        policy, total, touches, sure = begun(Middle("histogram")), 0.0, 0, 0.0
        observation, _ = env.reset(seed=k)
        while touches < 4 and sure < 0.95:
            observation, reward, *_ = env.step(env.touch(policy.choose(env, observation)))
            total, touches, sure = total + reward, touches + 1, observation["probabilities"].max()
        _, reward, terminated, *_ = env.step(env.say(env.labels[observation["probabilities"].argmax()]))
        assert terminated
        stops.append(touches)
        sums.append(total + reward)
    assert played.stopped.tolist() == stops
    assert played.returns(Reward()) == pytest.approx(sums)


def test_a_policy_of_ones_own_stands_in_the_table_by_its_name(capsys):
    compare([RandomPolicy("histogram"), Middle("histogram")], TASK, episodes=2, touches=2)
    heads, _, *rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines()]
    assert len({len(row) for row in (heads, *rows)}) == 1
    assert [row[:2] for row in rows] == [["| random", "histogram"], ["| Middle", "histogram"]]


@pytest.mark.parametrize(
    ("policies", "options", "message"),
    [
        ([], {}, "give at least one policy, one episode and one touch"),
        ([Middle()], {"episodes": 0}, "give at least one policy, one episode and one touch"),
        ([Middle], {}, "is no policy; give what calling a class makes"),
    ],
)
def test_what_is_no_policy_or_no_episode_is_one_line(policies, options, message):
    with pytest.raises(tactsim.core.InputError, match=message):
        compare(policies, **options)
