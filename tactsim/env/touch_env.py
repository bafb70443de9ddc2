"""`TouchEnv`: one hidden object, touched until the policy says what it is; and what that earns, `Reward`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import InputError, Scan
from tactsim.core.checking import Settings, checked
from tactsim.core.errors import short
from tactsim.core.poses import FloatArray
from tactsim.env.touch_spaces import (
    Floats,
    action_space,
    checked_action,
    decoded,
    observation_space,
    say_action,
    touch_action,
    within,
)
from tactsim.env.world import Hidden, world
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import checked_estimate, no_exit


class Reward(Settings):
    """The weights of the reward.

    A touch earns `information * (H before - H after) - touch_cost`, H = -sum p log p being the entropy (nats) of the
    belief over the labels. An action that stops earns `right` if its label is the right one, else `-wrong`.

    The information is that of the belief, not of the truth: from its rewards a policy learns of the object only what
    it observes. Over an episode the information adds up to H(start) - H(end), whatever the order of the touches.
    """

    right: float = Field(1.0, ge=0, description="earned by the right label")
    wrong: float = Field(1.0, ge=0, description="lost by a wrong one")
    touch_cost: float = Field(0.02, ge=0, description="lost by each touch")
    information: float = Field(0.0, ge=0, description="earned for each nat; needs a belief")


def entropy(probabilities: FloatArray) -> FloatArray:
    """Compute the entropy (nats) of probabilities (..., labels)."""
    p = np.asarray(probabilities, dtype=float)
    return -np.where(p > 0, p * np.log(np.where(p > 0, p, 1.0)), 0.0).sum(axis=-1)


class TouchEnv(gymnasium.Env):
    """Touch a hidden object of a frozen task, and say what it is.

    An action is one vector in [-1, 1]: x, y, theta of the touch in the robot's frame (1 is `reach` mm, 12 mm
    for the paper's pad and letters, and pi rad),
    whether to stop (above 0), and a score for each label, the highest of which is said. `touch` and `say` make one.

    An observation is a Dict. reading: (taxels,) kPa. pose: (3,) sensor_in_robot, mm, mm, rad. felt: 1 if the reading is
    that of the touch that was asked for; 0 before the first, and if that press did not come to rest. With `belief` also
    probabilities: (labels,) and place: (3,) robot_in_object, the most probable one.

    Rewards are those of `Reward`. An episode terminates with the label; `gymnasium.make` truncates it after as many
    touches as the task's trials have. `info` is empty but for an episode that terminates: it then holds the truth,
    `answer` and `robot_in_object`.

    task: a name of `tactsim.bench.tasks`. belief: a registered estimator, fitted to the training readings, whose belief
    is observed. belief_options: of that estimator. right, wrong, touch_cost, information: see `Reward`. slip: how the
    object moves between touches, changes to what the task says (`bench list slip`). scan_seed: the task's seed whose
    pad and training readings are used, by default the first. fast: press by the forward model. render_mode:
    None, as nothing is drawn.

    labels: those that can be said, in the order of an action's scores. reach: mm, how far touches reach. estimator:
    that of the belief, to ask it for all of its estimate or for proposals; None without one.

    Raises InputError for a wrong option.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as gymnasium declares it
    observation_space: gymnasium.spaces.Dict

    def __init__(
        self,
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
        self.world = world(task, scan_seed, slip or {}, fast)
        self.labels, self.reach = self.world.labels, self.world.reach
        self.estimator: Estimator | None = None
        if belief is not None:
            self.estimator = self.world.fitted(belief, belief_options or {})
        self.action_space = action_space(self.labels)
        self.observation_space = observation_space(self.world, belief=belief is not None)
        self.hidden: Hidden | None = None
        self._seen: dict[str, Any] = {}
        self._entropy = 0.0
        self._running = self._closed = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Hide another object. One seed hides the same object and gives the same luck; options: none are known."""
        super().reset(seed=seed)
        self._check_open()
        # The estimator's seed is drawn with and without one, so that the object and its readings are the same.
        own = np.random.default_rng(self.np_random.integers(2**63))
        self.hidden, self._running = Hidden(self.world, self.np_random), True
        self._seen = {
            name: np.zeros(space.shape or (), dtype=space.dtype)[()]
            for name, space in self.observation_space.items()
        }
        if self.estimator is not None:
            with no_exit(self.estimator):
                self.estimator.reset(own)
            self._believe(self.estimator)
        return self._observation(), {}

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Touch, or stop and say a label.

        Raises InputError, and touches nothing, for an action outside of the space, ResetNeeded if no episode is
        running, ClosedEnvironmentError if the environment was closed.
        """
        self._check_open()
        hidden = self.hidden
        if hidden is None or not self._running:
            raise ResetNeeded("no episode is running; call reset")
        pose, stops, said = decoded(checked_action(action, self.labels, self.reach), self.reach)
        if not stops:
            reward = self._touch(hidden, pose)
            return self._observation(), reward, False, False, {}
        self._running = False
        reward = self.reward.right if self.labels[said] == self.answer else -self.reward.wrong
        truth = {"answer": self.answer, "robot_in_object": hidden.robot_in_object.copy()}
        return self._observation(), reward, True, False, truth

    def _touch(self, hidden: Hidden, asked: FloatArray) -> float:
        """Touch at a pose (3,), and return what that earns."""
        # Estimators are given what is observed, in single precision, as one outside the environment would be.
        pose = within(self.observation_space, "pose", asked)
        felt, rests = hidden.touch(pose.astype(float))
        reading = within(self.observation_space, "reading", felt)
        self._seen |= {"pose": pose, "reading": reading, "felt": np.int64(rests)}
        before = self._entropy
        if self.estimator is not None and rests:
            with no_exit(self.estimator):
                self.estimator.update(reading, pose)
            self._believe(self.estimator)
        return float(self.reward.information * (before - self._entropy) - self.reward.touch_cost)

    def _believe(self, estimator: Estimator) -> None:
        """Note what the estimator believes now. Raises InputError that names it if its answer is no estimate."""
        estimate = checked_estimate(estimator, self.labels)
        probabilities = np.array([estimate.probabilities.get(label, 0.0) for label in self.labels])
        self._entropy = float(entropy(probabilities))
        for name, values in (("probabilities", probabilities), ("place", estimate.robot_in_object)):
            self._seen[name] = within(self.observation_space, name, values)

    def _observation(self) -> dict[str, NDArray[Any]]:
        return {name: values.copy() for name, values in self._seen.items()}

    def close(self) -> None:
        """Close the environment; it can be closed again."""
        self._closed = True

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedEnvironmentError("the environment was closed; make another")

    @property
    def scan(self) -> Scan:
        """The training readings, which a policy may learn from; they are pressed when they are first asked for."""
        return self.world.scan

    @property
    def answer(self) -> str:
        """The right label of the object that is hidden: to score a policy, which must not look at it.

        Raises ResetNeeded before the first `reset`.
        """
        if self.hidden is None:
            raise ResetNeeded("no object was hidden yet; call reset")
        return self.world.answer(self.hidden.letter)

    def touch(self, sensor_in_robot: ArrayLike) -> Floats:
        """Make the action that touches at [x, y, theta] mm, mm, rad. Raises InputError for what is no pose."""
        return touch_action(sensor_in_robot, self.labels, self.reach)

    def say(self, label: str) -> Floats:
        """Make the action that stops and says a label. Raises InputError if there is no such label."""
        return say_action(label, self.labels)
