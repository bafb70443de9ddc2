"""`TouchEnv`: one hidden object, touched until the policy says what it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import ArrayLike

from tactsim.core import Scan
from tactsim.env.sub_environments import SubEnvironments
from tactsim.env.touch_spaces import Floats, say_action, touch_action
from tactsim.estimators import Estimator


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

    Raises InputError for a wrong option.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as gymnasium declares it

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
        self._objects = SubEnvironments(
            1, task, belief=belief, belief_options=belief_options, right=right, wrong=wrong, touch_cost=touch_cost,
            information=information, slip=slip, scan_seed=scan_seed, fast=fast, render_mode=render_mode,
        )  # fmt: skip
        self.action_space = self._objects.action_space
        self.observation_space = self._objects.observation_space
        self._running = self._closed = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Hide another object. One seed hides the same object and gives the same luck; options: none are known."""
        super().reset(seed=seed)
        self._check_open()
        self._objects.reset(0, self.np_random)
        self._running = True
        return self._observation(), {}

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Touch, or stop and say a label.

        Raises InputError for an action outside of the space, ResetNeeded if no episode is running,
        ClosedEnvironmentError if the environment was closed.
        """
        self._check_open()
        if not self._running:
            raise ResetNeeded("no episode is running; call reset")
        (reward,), (stopped,) = self._objects.step([0], [action])
        self._running = not stopped
        return (
            self._observation(),
            float(reward),
            bool(stopped),
            False,
            self._objects.truth(0) if stopped else {},
        )

    def close(self) -> None:
        """Close the environment; it can be closed again."""
        self._closed = True

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedEnvironmentError("the environment was closed; make another")

    def _observation(self) -> dict[str, Any]:
        return {name: values[0] for name, values in self._objects.observation.items()}

    @property
    def reach(self) -> float:
        """How far touches reach, mm: the x or y of an action's 1."""
        return self._objects.world.reach

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels that can be said, in the order of an action's scores."""
        return self._objects.labels

    @property
    def scan(self) -> Scan:
        """The training readings, which a policy may learn from; they are pressed when they are first asked for."""
        return self._objects.world.scan

    @property
    def estimator(self) -> Estimator | None:
        """The estimator of `belief`, to ask it for all of its estimate or for proposals; None without one."""
        return self._objects.beliefs[0] if self._objects.beliefs else None

    @property
    def answer(self) -> str:
        """The right label of the object that is hidden: to score a policy, which must not look at it.

        Raises ResetNeeded before the first `reset`.
        """
        return self._objects.answer(0)

    def touch(self, sensor_in_robot: ArrayLike) -> Floats:
        """Make the action that touches at [x, y, theta] mm, mm, rad. Raises InputError for what is no pose."""
        return touch_action(sensor_in_robot, self.labels, self.reach)

    def say(self, label: str) -> Floats:
        """Make the action that stops and says a label. Raises InputError if there is no such label."""
        return say_action(label, self.labels)
