"""Reference policies: touch at random, where an estimator expects to learn most, or where trees expect it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import gymnasium
import numpy as np

from tactsim.core import InputError, compose, invert, wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.env import TouchEnv, entropy
from tactsim.press.scan_poses import random_poses

CANDIDATES = 64  # poses that a policy chooses one touch from
ROUNDS = 3  # of collecting touches: the first at random, the others half of them as learned so far
EPISODES = 250  # a round
TOUCHES = 6  # an episode
_FAR = 100.0  # mm: how far the last touch is, if there was none


class Policy(ABC):
    """Choose where to touch next, by what was observed.

    belief: the estimator whose belief it observes. name: what a table calls it, by default its class's name.
    """

    name = ""

    def __init__(self, belief: str = "refined") -> None:
        self.belief = belief
        self.name = self.name or type(self).__name__

    def learn(self, task: str, scan_seed: int) -> None:
        """Learn in environments of one scan seed, which its episodes will have too. Nothing by default."""
        return

    def begin(self, rng: np.random.Generator) -> None:
        """Begin an episode; all randomness until the next one comes from `rng`."""
        self.rng = rng

    @abstractmethod
    def choose(self, env: TouchEnv, observation: dict[str, Any]) -> FloatArray:
        """Choose sensor_in_robot (3,), mm, mm, rad, within the reach."""


class RandomPolicy(Policy):
    """Touch at random poses within the reach."""

    name = "random"

    def choose(self, env: TouchEnv, observation: dict[str, Any]) -> FloatArray:
        """Draw x and y within the reach and any angle."""
        return random_poses(self.rng, 1, env.reach)[0]


class InformationPolicy(Policy):
    """Touch where the estimator of the belief expects to learn most of label and pose (`Estimator.propose`)."""

    name = "expected information"

    def choose(self, env: TouchEnv, observation: dict[str, Any]) -> FloatArray:
        """Have the estimator choose among random poses. Raises InputError if it proposes none."""
        poses = random_poses(self.rng, CANDIDATES, env.reach)
        if env.estimator is None:
            raise InputError("the policy of expected information needs a belief, such as belief='refined'")
        return poses[env.estimator.propose(poses)]


class LearnedPolicy(Policy):
    """Touch where gradient-boosted trees predict the largest gain of information; needs the extra `learned`.

    It is fitted Q iteration with a discount of 0 (Ernst, Geurts and Wehenkel 2005): the value of a touch is the
    information of this one touch, which is greedy. It looks at the belief and at where it touched before, and at
    nothing of the pad: no measurement model is known to it, unlike to the policy of expected information.
    """

    name = "learned"

    def __init__(self, belief: str = "refined", *, rounds: int = ROUNDS, episodes: int = EPISODES) -> None:
        super().__init__(belief)
        self._rounds, self._episodes = rounds, episodes
        self._trees: Any = None
        self._threads: Any = None
        self._before: list[FloatArray] = []

    def begin(self, rng: np.random.Generator) -> None:
        """Begin an episode, and forget where was touched."""
        super().begin(rng)
        self._before = []

    def choose(self, env: TouchEnv, observation: dict[str, Any]) -> FloatArray:
        """Choose the best of random poses. Raises InputError if nothing was learned."""
        if self._trees is None:
            raise InputError("the learned policy has learned nothing yet; call learn")
        poses = random_poses(self.rng, CANDIDATES, env.reach)
        seen = features(observation["probabilities"], observation["place"], poses, self._before)
        with self._one_thread():
            chosen = poses[int(self._trees.predict(seen).argmax())]
        self._before.append(chosen)
        return chosen

    def learn(self, task: str, scan_seed: int) -> None:
        """Learn from episodes of its own: each touch gives the features of its choice and what it told."""
        try:
            from sklearn.ensemble import HistGradientBoostingRegressor
            from threadpoolctl import ThreadpoolController  # which scikit-learn needs too
        except ModuleNotFoundError:
            raise InputError("the learned policy needs scikit-learn: pip install scikit-learn") from None
        env = gymnasium.make(f"tactsim/{task}", belief=self.belief, scan_seed=scan_seed, fast=True).unwrapped
        assert isinstance(env, TouchEnv)
        self._threads = ThreadpoolController()
        rng = np.random.default_rng([scan_seed, 15])
        seen: list[FloatArray] = []
        told: list[float] = []
        self._trees = None
        for number in range(self._rounds):
            for episode in range(self._episodes):
                # Seeds from 2^32 on: nobody evaluates there by accident.
                observation, _ = env.reset(seed=2**32 + number * self._episodes + episode)
                self.begin(rng)
                for _ in range(TOUCHES):
                    greedy = self._trees is not None and rng.random() < 0.5
                    before = list(self._before)
                    pose = self.choose(env, observation) if greedy else random_poses(rng, 1, env.reach)[0]
                    if not greedy:
                        self._before.append(pose)
                    old = observation
                    observation, *_ = env.step(env.touch(pose))
                    seen.append(features(old["probabilities"], old["place"], pose[None], before)[0])
                    told.append(float(entropy(old["probabilities"]) - entropy(observation["probabilities"])))
            trees = HistGradientBoostingRegressor(max_iter=150, learning_rate=0.06, random_state=0)
            with self._one_thread():
                self._trees = trees.fit(np.array(seen), np.array(told))

    def _one_thread(self) -> Any:
        """Keep scikit-learn to one thread: for so little, threads wait for each other longer than they work."""
        return self._threads.limit(limits=1, user_api="openmp")


def features(
    probabilities: FloatArray, place: FloatArray, poses: FloatArray, before: list[FloatArray]
) -> FloatArray:
    """Describe touches that may be made: (n, features), for poses (n, 3) sensor_in_robot.

    What is believed (the labels' probabilities and their entropy), where the touch would lie on the object if that were
    where it is believed to be (x, y, distance from the object's middle, angle), where it lies in the robot's frame, how
    many touches there were, and how near the nearest of them was. before: poses (3,) of these touches.
    """
    belief = np.concatenate([probabilities, [entropy(probabilities), len(before)]])
    on_object = compose(np.asarray(place, dtype=float), poses)
    middle = invert(np.asarray(place, dtype=float))[:2]
    nearest, turned = np.full(len(poses), _FAR), np.zeros(len(poses))
    if before:
        done = np.array(before)
        away = np.hypot(*(poses[:, None, :2] - done[None, :, :2]).transpose(2, 0, 1))
        closest = away.argmin(axis=1)
        nearest = away.min(axis=1)
        turned = np.abs(wrap_angle(poses[:, 2] - done[closest, 2]))
    return np.column_stack(
        [
            np.tile(belief, (len(poses), 1)),
            on_object[:, :2],
            np.hypot(*(poses[:, :2] - middle).T),
            np.cos(on_object[:, 2]),
            np.sin(on_object[:, 2]),
            np.hypot(*poses[:, :2].T),
            nearest,
            turned,
        ]
    )
