"""The spaces of an environment: what an action is, and within which bounds an observation lies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import InputError, wrap_angle
from tactsim.core.errors import short, unknown
from tactsim.core.poses import FloatArray
from tactsim.env.world import World
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

    Raises InputError for what is no finite pose. A pose beyond the reach is refused by `step`.
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
        spaces["place"] = box(-far, far, (3,), np.float32)
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
