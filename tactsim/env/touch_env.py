"""`TouchEnv`: one hidden object, touched until the policy says what it is; and what that earns, `Reward`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import InputError, Scan, wrap_angle
from tactsim.core.checking import Settings, checked
from tactsim.core.errors import short, unknown
from tactsim.core.poses import FloatArray, invert
from tactsim.env.world import Hidden, World, world
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import checked_estimate, no_exit
from tactsim.press.sensor import EFFECTS, Frames

Floats = NDArray[np.float32]

_STOP = 3  # where an action says whether it stops; the labels' scores come after it

_FARTHEST = 4.0  # times the reach; an estimated place is cut to it


def action_space(labels: Sequence[str]) -> gymnasium.spaces.Box:
    """Make the space of actions: x, y, theta, whether to stop, and a score for each label, all in [-1, 1]."""
    return gymnasium.spaces.Box(-1.0, 1.0, (_STOP + 1 + len(labels),), np.float32)


def scale(reach: float) -> FloatArray:
    """Give x, y mm and theta rad of an action's 1, (3,), if touches reach so many mm."""
    return np.array([reach, reach, np.pi])


def touch_action(sensor_in_robot: ArrayLike, labels: Sequence[str], reach: float) -> Floats:
    """Make the action that touches at a pose [x, y, theta] mm, mm, rad; the angle is folded into [-pi, pi).

    Raises InputError for what is no finite pose, and for one beyond the reach.
    """
    try:
        pose = np.array(sensor_in_robot, dtype=float)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InputError(f"a pose is three numbers [x mm, y mm, theta rad], got {short(sensor_in_robot)}")
    pose[2] = wrap_angle(pose[2])
    action = np.zeros(_STOP + 1 + len(labels), dtype=np.float32)
    action[:3], action[_STOP] = pose / scale(reach), -1.0
    for column in np.flatnonzero(np.abs(action[:3]) > 1):
        raise InputError(_beyond(int(column), float(action[column]), labels, reach))
    return action


def say_action(label: str, labels: Sequence[str]) -> Floats:
    """Make the action that stops and says a label. Raises InputError if it is none of `labels`."""
    if not isinstance(label, str) or label not in labels:
        raise unknown("label", label, labels)
    action = np.zeros(_STOP + 1 + len(labels), dtype=np.float32)
    action[_STOP], action[_STOP + 1 + list(labels).index(label)] = 1.0, 1.0
    return action


def checked_action(action: Any, labels: Sequence[str], reach: float) -> FloatArray:
    """Return an action as an array (4 + labels,).

    Raises InputError, which is a ValueError, for another shape, a NaN, and a number beyond [-1, 1], which for a touch
    is one beyond the pad's reach.
    """
    width = _STOP + 1 + len(labels)
    right = f"an action is an array ({width},) of numbers: x, y, theta, stop and {len(labels)} scores"
    try:
        asked = np.array(action, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{right}; got {type(action).__name__} of something else") from None
    if asked.shape != (width,):
        raise InputError(f"{right}; got shape {asked.shape}")
    if not np.isfinite(asked).all():
        raise InputError("an action's numbers are finite; got NaN or infinity")
    if (np.abs(asked) > 1).any():
        column = int((np.abs(asked) > 1).argmax())
        said = _beyond(column, asked[column], labels, reach)
        raise InputError(
            f"action[{column}] is {asked[column]:.6g}: {said}; an action's numbers lie in [-1, 1], and "
            "gymnasium.wrappers.ClipAction cuts them"
        )
    return asked


def _beyond(column: int, value: float, labels: Sequence[str], reach: float) -> str:
    """Say what a number beyond [-1, 1] would mean."""
    if column < _STOP:
        name, unit, most = ("x", "y", "theta")[column], ("mm", "mm", "rad")[column], scale(reach)[column]
        return f"{name} = {value * most:.4g} {unit} is beyond the pad's reach of {most:.4g} {unit}"
    return (
        "it says whether to stop" if column == _STOP else f"it is the score of {labels[column - _STOP - 1]}"
    )


def decoded(asked: FloatArray, reach: float) -> tuple[FloatArray, bool, int]:
    """Read an action (4 + labels,): sensor_in_robot (3,), whether it stops, and the index of the label it says."""
    return asked[:3] * scale(reach), bool(asked[_STOP] > 0), int(asked[_STOP + 1 :].argmax())


def observation_space(world: World, *, belief: bool) -> gymnasium.spaces.Dict:
    """Make the space of observations. belief: whether `probabilities` and `place` are among them."""
    high = most_pressure(world)
    box, dictionary = gymnasium.spaces.Box, gymnasium.spaces.Dict
    most = scale(world.reach).astype(np.float32)
    spaces = {
        "reading": box(-high, high, (world.options.pad.taxels,), np.float32),
        "pose": box(-most, most, (3,), np.float32),
        "felt": gymnasium.spaces.Discrete(2),
    }
    if belief:
        far = scale(_FARTHEST * world.reach).astype(np.float32)
        spaces["probabilities"] = box(0.0, 1.0, (len(world.labels),), np.float32)
        spaces["place"] = spaces["object_in_robot"] = box(-far, far, (3,), np.float32)
    return dictionary(spaces)


def most_pressure(world: World) -> float:
    """Bound what a taxel reads, kPa: ten times the force on one taxel, and what the pad makes of it."""
    options = world.options
    ideal = 10 * 1e3 * options.press.force / (options.pad.taxel_width * options.pad.taxel_height)
    high, at = (
        np.full(options.pad.taxels, ideal),
        Frames(world.gain, options.pad.rows, np.ones((1, 1), dtype=int)),
    )
    for effect in EFFECTS:
        if effect.acts(options.sensor):
            high = effect.most(options.sensor, high, at)
    return float(np.float32(high.max()))


def within(space: gymnasium.spaces.Dict, name: str, values: ArrayLike) -> Floats:
    """Give values as the space of this name has them: single precision, cut to its bounds."""
    box = space[name]
    assert isinstance(box, gymnasium.spaces.Box)
    return np.clip(np.asarray(values, dtype=np.float32), box.low, box.high)


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
    probabilities: (labels,) and place: (3,) robot_in_object, the most probable one; object_in_robot is its inverse.

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
        """Hide another object. One seed hides the same object and gives the same luck.

        options: none are known; raises InputError for any.
        """
        if options:
            raise InputError(f"an episode is chosen by its seed alone, and knows no options; got {options}")
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
        place = estimate.robot_in_object
        for name, values in (
            ("probabilities", probabilities), ("place", place), ("object_in_robot", invert(place))
        ):  # fmt: skip
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
        """Make the action that touches at [x, y, theta] mm, mm, rad. Raises InputError for what cannot be touched."""
        return touch_action(sensor_in_robot, self.labels, self.reach)

    def say(self, label: str) -> Floats:
        """Make the action that stops and says a label. Raises InputError if there is no such label."""
        return say_action(label, self.labels)
