"""`Hidden`: one object that was hidden for an episode, and what the pad reads where it is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.trials import draw_true_pose
from tactsim.core import compose
from tactsim.core.poses import FloatArray
from tactsim.env.world import NORMALS, World
from tactsim.press.sensor import Chance, answered, reported, textured


@dataclass(eq=False)
class Hidden:
    """One hidden object and its luck.

    world: what is pressed. rng: of the episode. As many numbers are drawn for each touch whatever is touched, so a
    policy cannot change its luck, and two policies that are given the same seed meet the same object and the same
    errors, touch by touch. letter: index of the letter. path: (n, 3) robot_in_object at each touch so far foreseen.
    touches, readings: how many there were. felt: (taxels,) what the pad felt last, which a pad with lag remembers.
    """

    world: World
    rng: np.random.Generator
    letter: int = field(init=False)
    path: FloatArray = field(init=False)
    touches: int = 0
    readings: int = 0
    felt: FloatArray | None = None

    def __post_init__(self) -> None:
        self.letter = int(self.rng.integers(len(self.world.letters)))
        self.path = self._course(draw_true_pose(self.rng, self.world.offsets), self.world.task.readings)

    def _course(self, first: FloatArray, touches: int) -> FloatArray:
        return self.world.slip.poses(first, touches, self.rng)

    @property
    def robot_in_object(self) -> FloatArray:
        """Say where the object is at the next touch, T_R^O (3,)."""
        return self.path[self.touches]

    def go_on(self) -> None:
        """Move the object on to the next touch. A trial's course is drawn at once; who touches longer gets another."""
        self.touches += 1
        if self.touches == len(self.path):
            more = self._course(self.path[-1], self.world.task.readings + 1)
            self.path = np.concatenate([self.path, more[1:]])


def touch(
    world: World, hidden: Sequence[Hidden], sensor_in_robot: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Touch each hidden object once, at sensor_in_robot (n, 3): what the pad reports, and which presses came to rest.

    Returns (n, taxels) kPa, 0 where a press did not come to rest, and (n,). The objects then move on.
    """
    sensor = world.options.sensor
    normals = np.stack([one.rng.standard_normal(NORMALS) for one in hidden])
    chance = Chance(
        *map(
            np.stack, zip(*(Chance.draw((world.options.pad.taxels,), one.rng) for one in hidden), strict=True)
        )
    )
    poses = compose(np.stack([one.robot_in_object for one in hidden]), sensor_in_robot)
    ideal, rests = world.press([one.letter for one in hidden], poses, normals)
    gain = world.gain
    if sensor.texture:
        gain = np.concatenate([textured(gain, sensor, 1, one.rng) for one in hidden])
    felt = answered(ideal, sensor, gain)
    for row, one in enumerate(hidden):
        if rests[row]:
            if sensor.lag and one.felt is not None:
                felt[row] += sensor.lag * (one.felt - felt[row])
            one.felt, one.readings = felt[row].copy(), one.readings + 1
        one.go_on()
    number = np.array([one.readings for one in hidden])
    readings = reported(felt, number, sensor, chance, world.options.pad.rows)
    return np.where(rests[:, None], readings, 0.0), rests
