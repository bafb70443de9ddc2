"""`World`: what an environment presses and what there is to learn from; `Hidden`: an object hidden for an episode."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from tactsim.bench.config import RunConfig, Slip, merged
from tactsim.bench.experiment import gather
from tactsim.bench.tasks import Task, task
from tactsim.bench.trials import draw_true_pose, fit
from tactsim.core import InputError, Scan, compose
from tactsim.core.checking import checked
from tactsim.core.errors import short
from tactsim.core.pad import offsets
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE, Estimator, create
from tactsim.press import PressModel, forward_model
from tactsim.press.engine import press_at
from tactsim.press.scan_poses import stage_for
from tactsim.press.scanning import letters_of
from tactsim.press.sensor import Frames, gains, take
from tactsim.press.touches import Touches, as_pressed

NORMALS = 6  # normal numbers that a press needs: by how far it misses its place, tilt and load
_COLUMNS = {"placement": slice(0, 3), "tilt": slice(3, 5), "load": slice(5, 6)}


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Normal numbers that were drawn before, where the press would draw its own."""

    numbers: FloatArray

    def standard_normal(self, size: int | tuple[int, ...]) -> FloatArray:
        """Give all of them."""
        return self.numbers.reshape(size)


def _drawn(normals: FloatArray, purpose: str) -> _Drawn:
    return _Drawn(normals[:, _COLUMNS[purpose]])


class World:
    """The objects of a task as they are pressed with one scan seed, and the training readings of that seed.

    task: which. scan_seed: one of the task's; it decides the pad's gains and the training readings. slip: how the
    object moves between touches. fast: whether presses are worked out by the forward model.

    Raises InputError for a task whose readings are not pressed or whose known letters change from trial to trial, a
    scan seed that is none of the task's, and, with `fast`, objects that the forward model cannot press.
    """

    def __init__(self, task: Task, scan_seed: int, slip: Slip, fast: bool) -> None:
        if scan_seed not in task.seeds:
            seeds = ", ".join(map(str, task.seeds))
            raise InputError(f"scan_seed {short(scan_seed)}: task {task.name} has the seeds {seeds}")
        config = task.configs("nearest")[task.seeds.index(scan_seed)]
        if not config.pressed:
            raise InputError(f"task {task.name} has readings from a file; an environment needs a press")
        if config.each_held_out:
            raise InputError(
                f"task {task.name} holds out each letter in its own trials, so its answer is always {NONE!r}; "
                "an environment needs a task with letters to name"
            )
        self._config: RunConfig = config
        self.task, self.slip, self.options = task, slip, config.scan_options
        self.letters = tuple(letters_of(self.options))
        known = tuple(one.name for one in self.letters if one.name not in config.hold_out)
        self.labels = (*known, NONE) if config.hold_out else known
        self.gain = gains(self.options)
        pad = self.options.pad
        # mm: how far touches reach, and how far from the robot's origin an object may be hidden, as in a trial.
        self.reach = max(stage_for(pad, one).reach for one in self.letters)
        self.offsets = offsets(pad.taxel_xy)
        self.model = PressModel(self.letters, _unbent(self.options)) if fast else None
        self._fitted: dict[tuple[str, str], Estimator] = {}

    @cached_property
    def scan(self) -> Scan:
        """Press, or read from the cache, the training readings of the letters that are not held out."""
        return gather(self._config).scan.where("train")

    def answer(self, letter: int) -> str:
        """Name the right label of an object, by its index among the letters."""
        name = self.letters[letter].name
        return name if name in self.labels else NONE

    def fitted(self, estimator: str, options: Mapping[str, Any]) -> Estimator:
        """Make an estimator that was fitted to the training readings, once for all environments of this world.

        Raises InputError as `create` and `fit` do.
        """
        key = estimator, repr(sorted(options.items()))
        if key not in self._fitted:
            made = create(estimator, **options)
            fit(made, self.scan, forward_model)
            self._fitted[key] = made
        return copy.deepcopy(self._fitted[key])

    def press(self, letter: int, pose: FloatArray, normals: FloatArray) -> tuple[FloatArray, bool]:
        """Press an object: (taxels,) kPa without imperfections, and whether the press came to rest.

        letter: its index. pose: (3,) sensor_in_object as stated. normals: (NORMALS,), which decide how far off it is.
        """
        touches = as_pressed(
            self.letters[letter], pose[None], "test", self.options, partial(_drawn, normals[None])
        )
        if self.model is not None:
            press = self.options.press
            return _by_model(self.model, touches, press.tilt_x, press.tilt_y)[0], True
        pressed = press_at(touches, self.options)
        return pressed.readings(self.options)[0], not pressed.blanks


def _unbent(options: Any) -> Any:
    """Take the response curve out: the forward model would bend its readings, and `take` bends them too."""
    return options.model_copy(update={"sensor": options.sensor.model_copy(update={"response": 1.0})})


def _by_model(model: PressModel, touches: Touches, tilt_x: float, tilt_y: float) -> FloatArray:
    """Press by the forward model, (n, taxels) kPa. On springs c times load and tilts give c times the pressures."""
    load = np.ones(len(touches)) if touches.load is None else touches.load
    beside = touches.tilts / load[:, None] - (tilt_x, tilt_y)
    return model.readings(touches.letter.name, touches.poses, beside) * load[:, None]


@lru_cache(maxsize=8)
def _world(name: str, scan_seed: int, slip: Slip, fast: bool) -> World:
    return World(task(name), scan_seed, slip, fast)


def world(name: str, scan_seed: int | None, slip: Mapping[str, Any], fast: bool) -> World:
    """Give the world of a task, the same object to all that ask for the same: environments share what it learned.

    scan_seed: None for the task's first. slip: changes to how the task's objects move.
    Raises InputError as `task` and `World` do, and for a wrong name or value in slip.
    """
    asked = task(name)
    changed = merged(asked.configs("nearest")[0].moving.model_dump(), slip)
    seed = asked.seeds[0] if scan_seed is None else scan_seed
    return _world(name, seed, checked(Slip, changed, "slip"), fast)


@dataclass(eq=False)
class Hidden:
    """One hidden object and its luck.

    world: what is pressed. rng: of the episode. As many numbers are drawn for each touch whatever is touched, so a
    policy cannot change its luck, and two policies that are given the same seed meet the same object and the same
    errors, touch by touch. letter: index of the letter. path: (n, 3) robot_in_object at each touch so far foreseen.
    touches, readings: how many there were. felt: (1, taxels) what the pad felt last, which a pad with lag
    remembers, NaN before.
    """

    world: World
    rng: np.random.Generator
    letter: int = field(init=False)
    path: FloatArray = field(init=False)
    touches: int = 0
    readings: int = 0
    felt: FloatArray = field(default_factory=lambda: np.full((1, 1), np.nan))

    def __post_init__(self) -> None:
        self.letter = int(self.rng.integers(len(self.world.letters)))
        self.path = self._course(draw_true_pose(self.rng, self.world.offsets), self.world.task.readings)

    def _course(self, first: FloatArray, touches: int) -> FloatArray:
        return self.world.slip.poses(first, touches, self.rng)

    @property
    def robot_in_object(self) -> FloatArray:
        """Say where the object is at the next touch, T_R^O (3,)."""
        return self.path[self.touches]

    def touch(self, sensor_in_robot: FloatArray) -> tuple[FloatArray, bool]:
        """Touch at sensor_in_robot (3,), after which the object moves on: what the pad reports, and whether it rested.

        Returns (taxels,) kPa, 0 where the press did not come to rest.
        """
        world, options = self.world, self.world.options
        normals = self.rng.standard_normal(NORMALS)
        pose = compose(self.robot_in_object, sensor_in_robot)
        ideal, rests = world.press(self.letter, pose, normals)
        at = Frames(world.gain, options.pad.rows, np.array([[self.readings + 1]]), before=self.felt)
        (reading,) = take(ideal[None, None], options.sensor, at, [self.rng])[0]
        if rests:
            self.felt, self.readings = at.before, self.readings + 1
        self._go_on()
        return reading if rests else np.zeros_like(reading), rests

    def _go_on(self) -> None:
        """Move the object on to the next touch. A trial's course is drawn at once; who touches longer gets another."""
        self.touches += 1
        if self.touches == len(self.path):
            more = self._course(self.path[-1], self.world.task.readings + 1)
            self.path = np.concatenate([self.path, more[1:]])
