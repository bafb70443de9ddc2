"""Many environments at once: the same bits as one by one, in every way of beginning anew."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import tactsim.env  # noqa: F401

SLIP = "tactsim/slip-v1"


def many(count=4, **options):
    return gymnasium.make_vec(SLIP, num_envs=count, **options)


def one_by_one(count, mode, limit, **options):
    def make():
        return gymnasium.make(SLIP, max_episode_steps=limit, **options)

    return SyncVectorEnv([make] * count, autoreset_mode=mode)


def equal(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[name], other[name]) for name in one)
    if isinstance(one, np.ndarray) and one.dtype == object:
        return len(one) == len(other) and all(map(equal, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return type(one) is type(other) and one == other


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("options", [{}, {"belief": "histogram", "information": 1.0, "fast": True}])
def test_many_at_once_give_the_bits_of_one_by_one(mode, options):
    together = many(autoreset_mode=mode, max_episode_steps=3, **options)
    apart = one_by_one(4, mode, 3, **options)
    assert together.single_observation_space == apart.single_observation_space
    assert together.observation_space == apart.observation_space
    assert together.action_space == apart.action_space
    for one, other in zip(together.reset(seed=5), apart.reset(seed=5), strict=True):
        assert equal(one, other)
    rng = np.random.default_rng(0)
    ended = np.zeros(2, dtype=int)
    for _ in range(8):
        actions = rng.uniform(-1, 1, together.action_space.shape).astype(np.float32)
        actions[:, 3] -= 0.7  # mostly they touch
        actions = np.clip(actions, -1, 1)
        both = together.step(actions), apart.step(actions)
        for one, other in zip(*both, strict=True):
            assert equal(one, other)
        assert both[0][0] in together.observation_space
        over = both[0][2] | both[0][3]
        ended += both[0][2].sum(), both[0][3].sum()
        if mode == AutoresetMode.DISABLED and over.any():
            with pytest.raises(ResetNeeded):
                together.step(actions)
            begun = (env.reset(options={"reset_mask": over.copy()}) for env in (together, apart))
            for one, other in zip(*begun, strict=True):
                assert equal(one, other)
    assert ended.all()


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda env: env.step(np.zeros((3, 9))), r"an array \(9,\) of numbers"),
        (lambda env: env.step(np.full((2, 9), 2.0)), "beyond the pad's reach"),
        (lambda env: env.reset(seed=[1, 2, 3]), "match num_envs=2 but got length=3"),
        (lambda env: many(0), "num_envs 0"),
        (lambda env: many(2, autoreset_mode="Sometimes"), "'Sometimes' is not a valid AutoresetMode"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(act, said):
    env = many(2, fast=True)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=said) as caught:
        act(env)
    assert "\n" not in str(caught.value)
