"""`SubEnvironments`: hidden objects that are touched together, with the beliefs about them and what they earn."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.errors import short
from tactsim.core.poses import FloatArray
from tactsim.env.hidden_objects import Hidden, touch
from tactsim.env.reward import Reward, entropy
from tactsim.env.touch_spaces import action_space, checked_actions, decoded, observation_space, within
from tactsim.env.world import World, world
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import checked_estimate, no_exit


class SubEnvironments:
    """What one environment and many have in common: `count` objects, each with its observation.

    The arguments are those of `TouchEnv`, which describes them. Each object has a random stream of its own, and its
    readings do not depend on the others: one environment alone gives the same bits as the same one among many.
    """

    def __init__(
        self,
        count: int,
        task: str,
        *,
        belief: str | None = None,
        belief_options: Mapping[str, Any] | None = None,
        right: float = 1.0,
        wrong: float = 1.0,
        touch_cost: float = 0.02,
        information: float = 0.0,
        slip: Mapping[str, Any] | None = None,
        scan_seed: int | None = None,
        fast: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None:
            raise InputError(f"render_mode {short(render_mode)}: an environment draws nothing; leave it out")
        words = {"right": right, "wrong": wrong, "touch_cost": touch_cost, "information": information}
        self.reward = checked(Reward, words, "environment")
        if belief is None and information:
            raise InputError(
                "information is rewarded only with a belief; name an estimator, such as belief='refined'"
            )
        if belief is None and belief_options:
            raise InputError("belief_options are those of an estimator; name it, such as belief='refined'")
        if not _by_name({} if belief_options is None else belief_options):
            raise InputError(
                f"belief_options {short(belief_options)}: give values by name, such as {{'bins': 500}}"
            )
        self.world: World = world(task, scan_seed, slip or {}, fast)
        self.labels = self.world.labels
        self.beliefs: list[Estimator] = []
        if belief is not None:
            fitted = self.world.fitted(belief, belief_options or {})
            self.beliefs = [fitted, *(copy.deepcopy(fitted) for _ in range(count - 1))]
        self.hidden: list[Hidden | None] = [None] * count
        self.action_space: gymnasium.spaces.Box = action_space(self.labels)
        self.observation_space: gymnasium.spaces.Dict = observation_space(
            self.world, belief=belief is not None
        )
        self._seen: dict[str, NDArray[Any]] = {
            name: np.zeros((count, *(space.shape or ())), dtype=space.dtype)
            for name, space in self.observation_space.items()
        }
        self._entropy = np.zeros(count)

    @property
    def observation(self) -> dict[str, NDArray[Any]]:
        """Copy what is observed of every object, an array (count, ...) a name."""
        return {name: values.copy() for name, values in self._seen.items()}

    def reset(self, index: int, rng: np.random.Generator) -> None:
        """Hide a new object, and forget what was believed of the last one."""
        # The estimator's seed is drawn with and without one, so that the object and its readings are the same.
        own = np.random.default_rng(rng.integers(2**63))
        self.hidden[index] = Hidden(self.world, rng)
        for values in self._seen.values():
            values[index] = 0
        if self.beliefs:
            with no_exit(self.beliefs[index]):
                self.beliefs[index].reset(own)
            self._believe(index)

    def step(self, rows: Sequence[int], actions: Any) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Do one action (len(rows), 4 + labels) for each of these objects: rewards, and which are finished.

        All that touch are pressed together. Raises InputError, and touches nothing, for an action that is wrong.
        """
        poses, stops, says = decoded(
            checked_actions(actions, len(rows), self.labels, self.world.reach), self.world.reach
        )
        rewards = np.empty(len(rows))
        for row in np.flatnonzero(stops).tolist():
            right = self.labels[says[row]] == self.answer(rows[row])
            rewards[row] = self.reward.right if right else -self.reward.wrong
        touching = np.flatnonzero(~stops).tolist()
        if touching:
            rewards[touching] = self._touch([rows[row] for row in touching], poses[touching])
        return rewards, stops

    def _touch(self, rows: Sequence[int], poses: FloatArray) -> FloatArray:
        # Estimators are given what is observed, in single precision, as one outside the environment would be.
        seen = within(self.observation_space, "pose", poses)
        readings, rests = touch(self.world, [self._of(row) for row in rows], seen.astype(float))
        self._seen["pose"][rows] = seen
        self._seen["reading"][rows] = within(self.observation_space, "reading", readings)
        self._seen["felt"][rows] = rests
        if not self.beliefs:
            return np.full(len(rows), -self.reward.touch_cost)
        before = self._entropy[rows]
        for row in np.asarray(rows)[rests].tolist():
            with no_exit(self.beliefs[row]):
                self.beliefs[row].update(self._seen["reading"][row], self._seen["pose"][row])
            self._believe(row)
        return self.reward.information * (before - self._entropy[rows]) - self.reward.touch_cost

    def _believe(self, index: int) -> None:
        """Note what an estimator believes now. Raises InputError that names it if its answer is no estimate."""
        estimate = checked_estimate(self.beliefs[index], self.labels)
        probabilities = np.array([estimate.probabilities.get(label, 0.0) for label in self.labels])
        self._entropy[index] = entropy(probabilities)
        self._seen["probabilities"][index] = within(self.observation_space, "probabilities", probabilities)
        self._seen["place"][index] = within(self.observation_space, "place", estimate.robot_in_object)

    def answer(self, index: int) -> str:
        """Name the right label of an object that is hidden. Raises ResetNeeded if none is."""
        return self.world.answer(self._of(index).letter)

    def truth(self, index: int) -> dict[str, Any]:
        """Tell what was hidden: for the `info` of an episode that is over."""
        return {"answer": self.answer(index), "robot_in_object": self._of(index).robot_in_object.copy()}

    def _of(self, index: int) -> Hidden:
        hidden = self.hidden[index]
        if hidden is None:
            raise ResetNeeded("no object was hidden yet; call reset")
        return hidden


def _by_name(options: Any) -> bool:
    return isinstance(options, Mapping) and all(isinstance(name, str) for name in options)
