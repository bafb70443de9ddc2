"""`TouchVectorEnv`: many hidden objects, whose touches are pressed together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.core.poses import FloatArray
from tactsim.env.sub_environments import SubEnvironments
from tactsim.env.touch_spaces import checked_actions

Batch = dict[str, NDArray[Any]]
Stepped = tuple[Batch, FloatArray, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class TouchVectorEnv(gymnasium.vector.VectorEnv):
    """`num_envs` environments like `TouchEnv`, stepped together.

    They give the same bits as `gymnasium.vector.SyncVectorEnv` around as many `TouchEnv`, but all touches of a step on
    one letter are pressed at once, which is several times as fast. options: the arguments of `TouchEnv`.
    max_episode_steps: touches after which an episode is truncated; None for never. autoreset_mode: as Gymnasium defines
    it, by default in the next step.

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
        if not _counts(num_envs):
            raise InputError(f"num_envs {short(num_envs)}: give a whole number from 1")
        if not (max_episode_steps is None or _counts(max_episode_steps)):
            raise InputError(
                f"max_episode_steps {short(max_episode_steps)}: give a whole number from 1, or None for no end"
            )
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(repr(mode.value) for mode in AutoresetMode)
            raise InputError(f"autoreset_mode {short(autoreset_mode)}: give one of {modes}") from None
        self.num_envs = num_envs
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self._objects = SubEnvironments(num_envs, task, **options)
        self.single_action_space = self._objects.action_space
        self.single_observation_space = self._objects.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._longest = max_episode_steps
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._steps = np.zeros(num_envs, dtype=np.int64)
        # Which episodes are over, and begin anew with the next step or when they are reset; at first all.
        self._over = np.ones(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Batch, dict[str, Any]]:
        """Begin new episodes: of all, or of those that `options["reset_mask"]` (num_envs,) names.

        seed: environment i takes seed + i, or its own of a list; None goes on with the random numbers of before.
        Raises InputError for a list or a mask of another length.
        """
        self._check_open()
        seeds = [None if seed is None else seed + i for i in range(self.num_envs)] if not isinstance(
            seed, Sequence) else list(seed)  # fmt: skip
        if len(seeds) != self.num_envs:
            raise InputError(f"{len(seeds)} seeds for {self.num_envs} environments; give one each")
        mask = np.ones(self.num_envs, dtype=bool)
        if options is not None and "reset_mask" in options:
            mask = options["reset_mask"]
            if not (isinstance(mask, np.ndarray) and mask.dtype == bool and mask.shape == (self.num_envs,)):
                raise InputError(f"reset_mask {short(mask)}: give an array of {self.num_envs} booleans")
        for index in np.flatnonzero(mask).tolist():
            if seeds[index] is not None or self._rngs[index] is None:
                self._rngs[index], _ = seeding.np_random(seeds[index])
            self._begin(index)
        return self._objects.observation, {}

    def step(self, actions: ArrayLike) -> Stepped:
        """Do one action (num_envs, 4 + labels) in each environment.

        Raises InputError for an action outside of the space, ResetNeeded before the first `reset` and, in the mode
        Disabled, for an episode that is over, ClosedEnvironmentError if the environments were closed.
        """
        self._check_open()
        if None in self._rngs or (self._mode == AutoresetMode.DISABLED and self._over.any()):
            which = np.flatnonzero(self._over).tolist()
            raise ResetNeeded(f"no episode is running in the environments {short(which)}; call reset")
        asked = checked_actions(actions, self.num_envs, self.labels, self.reach)
        rewards = np.zeros(self.num_envs)
        stopped, truncated = np.zeros((2, self.num_envs), dtype=bool)
        begins, goes_on = np.flatnonzero(self._over).tolist(), np.flatnonzero(~self._over)
        if len(goes_on):
            rewards[goes_on], stopped[goes_on] = self._objects.step(goes_on.tolist(), asked[goes_on])
        for index in begins:  # of the mode NextStep
            self._begin(index)
        self._steps[goes_on] += 1
        if self._longest is not None:
            truncated[goes_on] = self._steps[goes_on] >= self._longest
        self._over = stopped | truncated
        infos: dict[str, Any] = {}
        told = {index: self._objects.truth(index) for index in np.flatnonzero(stopped).tolist()}
        if self._mode == AutoresetMode.SAME_STEP:
            infos = self._begin_at_once(told)
        else:
            for index, truth in told.items():
                infos = self._add_info(infos, truth, index)
        return self._objects.observation, rewards, stopped, truncated, infos

    def _begin_at_once(self, told: dict[int, dict[str, Any]]) -> dict[str, Any]:
        """Begin anew what is over, and give as `info` what was observed last and what is told of it."""
        infos: dict[str, Any] = {}
        last = self._objects.observation
        for index in np.flatnonzero(self._over).tolist():
            seen = {name: values[index] for name, values in last.items()}
            infos = self._add_info(infos, {"final_obs": seen, "final_info": told.get(index, {})}, index)
            self._begin(index)
        return infos

    def _begin(self, index: int) -> None:
        rng = self._rngs[index]
        assert rng is not None
        self._objects.reset(index, rng)
        self._steps[index], self._over[index] = 0, False

    def _check_open(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("the environments were closed; make others")

    @property  # type: ignore[misc] # SyncVectorEnv gives several in the same way
    def np_random(self) -> Any:
        """The random generators, one an environment; None before `reset`."""
        return tuple(self._rngs)

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


def _counts(number: Any) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and number >= 1
