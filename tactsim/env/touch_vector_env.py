"""`TouchVectorEnv`: many hidden objects, whose touches are pressed together."""

from __future__ import annotations

import copy
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from numpy.typing import ArrayLike

from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.env.hidden_objects import touch
from tactsim.env.touch_env import TouchEnv
from tactsim.env.touch_spaces import checked_actions, decoded


class TouchVectorEnv(SyncVectorEnv):
    """`num_envs` environments like `TouchEnv`, stepped together.

    It is Gymnasium's SyncVectorEnv, but all touches of a step on one letter are pressed at once, which is several times
    as fast and gives the same bits. options: the arguments of `TouchEnv`. max_episode_steps: touches after which an
    episode is truncated; None for never. autoreset_mode: as Gymnasium defines it, by default in the next step.

    Raises InputError for a wrong option.
    """

    def __init__(
        self,
        num_envs: int,
        task: str,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        if not isinstance(num_envs, int) or num_envs < 1:
            raise InputError(f"num_envs {short(num_envs)}: give a whole number from 1")
        first = TouchEnv(task, **options)

        def another() -> gymnasium.Env:
            """Make an environment with an object of its own and a copy of the estimator, which is fitted once."""
            env = copy.copy(first)
            env.estimator = copy.deepcopy(first.estimator)
            return env if max_episode_steps is None else TimeLimit(env, max_episode_steps)

        super().__init__([another] * num_envs, autoreset_mode=autoreset_mode)
        self._touched = cast("list[TouchEnv]", [env.unwrapped for env in self.envs])
        self.labels, self.reach = first.labels, first.reach

    def step(self, actions: ArrayLike) -> Any:
        """Do one action (num_envs, 4 + labels) in each environment.

        Raises InputError, and touches nothing, for an action outside of the space, ResetNeeded before the first `reset`
        and, in the mode Disabled, for an episode that is over, ClosedEnvironmentError if the environments were closed.
        """
        asked = checked_actions(actions, self.num_envs, self.labels, self.reach)
        poses, stops, _ = decoded(asked, self.reach)
        over = self._autoreset_envs
        if self.autoreset_mode == AutoresetMode.DISABLED and over.any():
            which = np.flatnonzero(over).tolist()
            raise ResetNeeded(f"no episode is running in the environments {short(which)}; call reset")
        goes_on = ~over if self.autoreset_mode == AutoresetMode.NEXT_STEP else np.ones_like(over)
        for row in np.flatnonzero(goes_on):
            self._touched[row].running()
        rows = np.flatnonzero(goes_on & ~stops)
        if len(rows):
            envs = [self._touched[row] for row in rows]
            seen = envs[0].observed(poses[rows]).astype(float)
            readings, rests = touch(envs[0].world, [env.running() for env in envs], seen)
            for env, reading, rested in zip(envs, readings, rests, strict=True):
                env.pressed = reading, rested
        return super().step(asked)

    @property
    def scan(self) -> Scan:
        """The training readings, which a policy may learn from; they are pressed when they are first asked for."""
        return self._touched[0].scan
