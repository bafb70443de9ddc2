"""Reference policies: touch at random, or where an estimator expects to learn most."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.env.touch_env import TouchEnv
from tactsim.press.scan_poses import random_poses

CANDIDATES = 64  # poses that a policy chooses one touch from


class Policy(ABC):
    """Choose where to touch next, by what was observed.

    name: what a table calls it. belief: the estimator whose belief it observes.
    """

    def __init__(self, name: str, belief: str) -> None:
        self.name, self.belief = name, belief

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

    def __init__(self, belief: str) -> None:
        super().__init__("random", belief)

    def choose(self, env: TouchEnv, observation: dict[str, Any]) -> FloatArray:
        """Draw x and y within the reach and any angle."""
        return random_poses(self.rng, 1, env.reach)[0]


class InformationPolicy(Policy):
    """Touch where the estimator of the belief expects to learn most of label and pose (`Estimator.propose`)."""

    def __init__(self, belief: str) -> None:
        super().__init__("expected information", belief)

    def choose(self, env: TouchEnv, observation: dict[str, Any]) -> FloatArray:
        """Have the estimator choose among random poses. Raises InputError if it proposes none."""
        poses = random_poses(self.rng, CANDIDATES, env.reach)
        if env.estimator is None:
            raise InputError("the policy of expected information needs a belief, such as belief='refined'")
        return poses[env.estimator.propose(poses)]
