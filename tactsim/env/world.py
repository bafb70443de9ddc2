"""`World`: what an environment presses, and what there is to learn from before anything is touched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.config import RunConfig, Slip, merged
from tactsim.bench.experiment import gather, silent
from tactsim.bench.tasks import Task, task
from tactsim.bench.trials import fit
from tactsim.core import InputError, Scan
from tactsim.core.checking import checked
from tactsim.core.errors import short
from tactsim.core.pad import offsets
from tactsim.core.poses import FloatArray
from tactsim.estimators import NONE, Estimator, create
from tactsim.press import PressModel, forward_model
from tactsim.press.engine import press_at
from tactsim.press.scan_poses import stage_for
from tactsim.press.scanning import as_pressed, letters_of
from tactsim.press.sensor import gains
from tactsim.press.spread import Patches, contact_map
from tactsim.press.touches import Touches

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

    @cached_property
    def scan(self) -> Scan:
        """Press, or read from the cache, the training readings of the letters that are not held out."""
        return gather(self._config, jobs=1, cache=True, progress=silent).scan.where("train")

    def answer(self, letter: int) -> str:
        """Name the right label of an object, by its index among the letters."""
        name = self.letters[letter].name
        return name if name in self.labels else NONE

    def fitted(self, estimator: str, options: Mapping[str, Any]) -> Estimator:
        """Make an estimator and fit it to the training readings. Raises InputError as `create` and `fit` do."""
        made = create(estimator, **options)
        fit(made, self.scan, forward_model)
        return made

    def press(
        self, letters: Sequence[int], poses: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Press objects, all of one letter at once: (n, taxels) kPa without imperfections, and which came to rest.

        letters: (n,) index of each press's letter. poses: (n, 3) sensor_in_object as stated. normals: (n, NORMALS),
        which decide how far a press is off. What a press reads does not depend, to the last bit, on the others.
        """
        chosen = np.asarray(letters)
        ideal = np.zeros((len(chosen), self.options.pad.taxels))
        rests = np.ones(len(chosen), dtype=bool)
        for index in np.unique(chosen):
            rows = np.flatnonzero(chosen == index)
            touches = as_pressed(
                self.letters[index], poses[rows], "test", self.options, partial(_drawn, normals[rows])
            )  # fmt: skip
            ideal[rows], rests[rows] = self._pressed(touches)
        return ideal, rests

    def _pressed(self, touches: Touches) -> tuple[FloatArray, NDArray[np.bool_] | bool]:
        if self.model is not None:
            return _by_model(self.model, touches, self.options.press.tilt_x, self.options.press.tilt_y), True
        options = self.options
        pressed = press_at(touches, options)
        rests = ~np.isin(np.arange(len(touches)), list(pressed.blanks))
        if len(touches) == 1:
            return pressed.readings(options), rests
        load = pressed.load
        if not isinstance(load, Patches):
            each = [self._pressed(touches.some(slice(row, row + 1)))[0] for row in range(len(touches))]
            return np.concatenate(each), rests
        cells, sigma = options.press.cells_per_taxel, options.sensor.psf_sigma
        return contact_map(
            load.bed, load.pressure, load.gradient, options.pad, cells, sigma, alone=True
        ), rests


def _unbent(options: Any) -> Any:
    """Take the response curve out: the forward model would bend its readings, and `answered` bends them too."""
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
