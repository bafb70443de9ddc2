"""Exact Bayes: the posterior of letter and pose with the simulator's own press, noise and unknowns, by brute force.

It knows how the readings were made, so no estimator is right more often but by luck. It is a reference and may be slow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.bench.config import RunConfig
from tactsim.bench.cramer_rao import (
    check_motion,
    determined_below_mm,
    noise_variance,
    pressed_letters,
    scan_bounds,
    stated_options,
)
from tactsim.bench.experiment import perform, silent
from tactsim.bench.placement import Properties, fold_angle, properties
from tactsim.bench.results import Run
from tactsim.bench.runs.figures import Picture, over_readings
from tactsim.bench.trials import Progress
from tactsim.core.errors import InputError
from tactsim.core.forward import ForwardModel
from tactsim.core.pad import offsets
from tactsim.core.poses import FloatArray, compose, invert
from tactsim.core.scan import Scan
from tactsim.estimators import Estimate, Estimator, Options
from tactsim.estimators.estimator import PoseSamples, check_order, check_reading
from tactsim.press import ScanOptions
from tactsim.press.press_model import PressModel
from tactsim.press.sensor import EFFECTS

SIDE, ANGLES = 16, 40  # cells along x and y and round the circle, before any is split
_DEPTH = 6  # times that a cell may be halved along x, y and angle
_DEAD = 30.0  # nats below the heaviest cell, at which a cell is given up
# nats, which the prediction over a whole cell may be too low; a quarter of that over half a cell.
_DOUBT = 20.0
# kPa, by which a taxel changes at most over a cell: beyond, as in a sliver, rounding eats the noise.
_STEEPEST = 1e4
_EDGES = 2  # rounds of splitting cells that do not touch and lie beside such that do


class _Cells(NamedTuple):
    """Parts of the state space: letter (n,), robot_in_object of their middles (n, 3), how often halved (n,), and the
    log-likelihood of the readings so far, averaged over the cell (n,).
    """

    letter: NDArray[np.int64]
    pose: FloatArray
    depth: NDArray[np.int64]
    log_p: FloatArray

    def some(self, which: Any) -> _Cells:
        return _Cells(*(column[which] for column in self))

    def and_also(self, others: _Cells) -> _Cells:
        return _Cells._make(map(np.concatenate, zip(self, others, strict=True)))

    @property
    def log_mass(self) -> FloatArray:
        """Give the log of each cell's share of the belief."""
        mass = self.log_p - 3 * np.log(2) * self.depth
        return mass - np.logaddexp.reduce(mass)


_HALVES = np.stack(np.meshgrid(*3 * [(-0.25, 0.25)], indexing="ij"), axis=-1).reshape(-1, 3)


class ExactBayesOptions(Options):
    """Options of exact Bayes."""

    split: float = Field(1e-3, gt=0, le=1, description="share of the belief above which a cell is split")


class ExactBayes(Estimator):
    """Sum the exact likelihood over cells of the state space, and split those that hold much of the belief.

    A reading is Gaussian about what the press reads at the middle of a cell. Its covariance is the noise, and to first
    order what is unknown of the press and where in the cell the object is. The prior is that of the trials: letters
    alike, x and y uniform in [-10, 10] mm, any angle. The pose is the one of least expected placement error.

    Raises InputError in `fit` if the scan does not say how it was pressed, or was pressed in a way that the forward
    model or the noise's variance does not know.
    """

    options_type = ExactBayesOptions
    options: ExactBayesOptions
    draws = False

    def __init__(self, options: ExactBayesOptions | None = None) -> None:
        super().__init__(options or ExactBayesOptions())
        self._forward: ForwardModel | None = None
        self._cells: _Cells | None = None
        self._evaluations = 0

    def describe(self) -> str:
        """Say how fine the cells are."""
        return f"cells split until each holds at most {self.options.split:g} of the belief"

    def fit(self, scan: Scan) -> None:
        """Take from the scan how it was pressed, and of which letters; none of its readings is looked at."""
        options = stated_options(scan)
        self._noise = noise_variance(options.sensor)
        beyond = _beyond(options)
        if beyond:
            raise InputError(f"exact Bayes does not know {beyond}; leave it at its default")
        letters = pressed_letters(scan, options)
        self._forward = PressModel(list(letters.values()), options)
        self._letters, self._objects = tuple(letters), properties(scan)
        self._offsets = offsets(scan.taxel_xy)
        self._cells = None

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a sequence; nothing is drawn."""
        check_order(self._forward is not None, "fit", "reset")
        self._history: list[tuple[FloatArray, FloatArray]] = []
        step = 2 * self._offsets / SIDE
        self._size = np.array([step, step, 2 * np.pi / ANGLES])
        line = step * (np.arange(SIDE) + 0.5) - self._offsets
        grid = np.meshgrid(line, line, 2 * np.pi * np.arange(ANGLES) / ANGLES - np.pi, indexing="ij")
        poses = np.stack(grid, axis=-1).reshape(-1, 3)
        count = len(self._letters) * len(poses)
        self._cells = _Cells(
            np.repeat(np.arange(len(self._letters)), len(poses)), np.tile(poses, (len(self._letters), 1)),
            np.zeros(count, dtype=np.int64), np.zeros(count),
        )  # fmt: skip

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Weigh every cell by the reading, give up the lightest and split the heaviest until none holds much."""
        check_order(self._cells is not None, "reset" if self._forward else "fit", "update")
        assert self._forward is not None
        assert self._cells is not None
        values, pose = check_reading(reading, sensor_in_robot, self._forward.taxels)
        self._history.append((values, pose))
        cells, touching = self._weighed(self._cells, len(self._history) - 1)
        for _ in range(_EDGES):
            beside = ~touching & (cells.depth < _EDGES)
            if not beside.any() or not values.any():
                break
            halves, felt = self._split(cells.some(beside))
            kept = np.repeat(felt.reshape(-1, 8).any(axis=1), 8)  # where nothing touches, one cell is enough
            whole = np.flatnonzero(beside)[~kept[::8]]
            touching = np.concatenate([touching[~beside], np.ones(len(whole), dtype=bool), felt[kept]])
            cells = cells.some(~beside).and_also(cells.some(whole)).and_also(halves.some(kept))
        for _ in range(_DEPTH):
            mass = cells.log_mass
            highest = mass + _DOUBT / 4.0**cells.depth
            heavy = (highest > np.log(self.options.split)) & (cells.depth < _DEPTH)
            alive = highest > mass.max() - _DEAD
            cells, heavy = cells.some(alive), heavy[alive]
            if not heavy.any():
                break
            cells = cells.some(~heavy).and_also(self._split(cells.some(heavy))[0])
        self._cells = cells

    def _split(self, cells: _Cells) -> tuple[_Cells, NDArray[np.bool_]]:
        """Halve cells in x, y and angle, and weigh the eight parts of each by the whole history."""
        size = self._size / 2.0 ** cells.depth[:, None]
        parts = _Cells(
            np.repeat(cells.letter, 8),
            (cells.pose[:, None] + size[:, None] * _HALVES).reshape(-1, 3),
            np.repeat(cells.depth + 1, 8),
            np.zeros(8 * len(cells.letter)),
        )
        touching = np.zeros(0, dtype=bool)
        for number in range(len(self._history)):
            parts, touching = self._weighed(parts, number)
        return parts, touching

    def _weighed(self, cells: _Cells, number: int) -> tuple[_Cells, NDArray[np.bool_]]:
        """Add the log-likelihood of one reading of the history; also tell which cells' middles touch."""
        assert self._forward is not None
        reading, sensor_in_robot = self._history[number]
        log_p, touching = cells.log_p.copy(), np.zeros(len(cells.log_p), dtype=bool)
        for letter, name in enumerate(self._letters):
            rows = np.flatnonzero(cells.letter == letter)
            for first in range(0, len(rows), 4096):
                some = rows[first : first + 4096]
                size = self._size / 2.0 ** cells.depth[some, None]
                found = self._log_likelihood(name, cells.pose[some], size, reading, sensor_in_robot)
                log_p[some] += found[0]
                touching[some] = found[1]
        self._evaluations += len(log_p)
        return cells._replace(log_p=log_p), touching

    def _log_likelihood(
        self, name: str, pose: FloatArray, size: FloatArray, reading: FloatArray, sensor_in_robot: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Compute log N(reading; mean, noise I + U U') of cells (n,), U being what is unknown of press and pose."""
        assert self._forward is not None
        sensor = compose(pose, sensor_in_robot)
        found = self._forward.linearised(name, sensor)
        # A move of robot_in_object within the cell, seen along the sensor's own axes.
        cos, sin = np.cos(sensor[:, 2]), np.sin(sensor[:, 2])
        arm = sensor[:, :2] - pose[:, :2]
        along = np.stack([found.by_pose[:, 0] * cos[:, None] - found.by_pose[:, 1] * sin[:, None],
                          found.by_pose[:, 0] * sin[:, None] + found.by_pose[:, 1] * cos[:, None]], axis=1)  # fmt: skip
        turn = found.by_pose[:, 2] - along[:, 0] * arm[:, 1:] + along[:, 1] * arm[:, :1]
        within = np.concatenate([along, turn[:, None]], axis=1) * (size / np.sqrt(12))[..., None]
        spread = np.concatenate([found.nuisance, within], axis=1)
        apart = reading - found.mean
        touching = (found.mean != 0).any(axis=1)
        log_p = -(apart**2).sum(axis=1) / (2 * self._noise)
        u = spread[touching].clip(-_STEEPEST, _STEEPEST)
        inner = self._noise * np.eye(u.shape[1]) + u @ u.swapaxes(1, 2)
        seen = np.einsum("nkt,nt->nk", u, apart[touching])
        solved = np.linalg.solve(inner, seen[..., None])[..., 0]
        log_p[touching] += np.einsum("nk,nk->n", seen, solved) / (2 * self._noise)
        log_p[touching] -= (np.linalg.slogdet(inner)[1] - u.shape[1] * np.log(self._noise)) / 2
        return log_p, touching

    def estimate(self) -> Estimate:
        """Sum the cells of each letter; the pose has the least expected placement error among those of the letter."""
        check_order(bool(self._cells and self._history), "update" if self._cells else "reset", "estimate")
        assert self._cells is not None
        mass = np.exp(self._cells.log_mass)
        share = np.bincount(self._cells.letter, mass, len(self._letters))
        best = int(share.argmax())
        rows = np.flatnonzero(self._cells.letter == best)
        samples = PoseSamples(self._cells.pose[rows], mass[rows] / mass[rows].sum())
        name = self._letters[best]
        pose = least_expected_error(samples.poses, samples.weights, self._objects[name])
        probabilities = dict(zip(self._letters, (share / share.sum()).tolist(), strict=True))
        return Estimate(name, probabilities, pose, samples)

    @property
    def work(self) -> dict[str, Any]:
        """Count how many cells were weighed by a reading."""
        return {"likelihood_evaluations": self._evaluations, "skipped": {}}


def _beyond(options: ScanOptions) -> str:
    """Name the first option by which a reading is not Gaussian about what the forward model presses; "" if none is."""
    usual = ScanOptions()
    for name in ("load_spread", "test_load"):
        if getattr(options, name) != getattr(usual, name):
            return name
    for effect in EFFECTS:
        if not effect.facts.gaussian and effect.acts(options.sensor):
            return f"sensor.{effect.facts.name}"
    return ""


def least_expected_error(poses: FloatArray, weights: FloatArray, of: Properties) -> FloatArray:
    """Find the robot_in_object (3,) of least mean placement error to weighted poses (n, 3): their geometric median.

    Weiszfeld's iteration (Tohoku Math. J. 43, 1937) on the object's displacement and its turn times sqrt(I/m), folded
    by its symmetry. It begins at the pose with the most weight near it.
    """
    objects = invert(poses)
    heavy = np.argsort(weights)[::-1][:64]
    scale = np.sqrt(of.inertia_over_mass)

    def apart(at: FloatArray) -> FloatArray:
        turn = fold_angle(objects[:, 2] - at[2], of.symmetry)
        return np.column_stack([objects[:, :2] - at[:2], scale * turn])

    expected = [weights @ np.linalg.norm(apart(objects[row]), axis=1) for row in heavy]
    at = objects[heavy[int(np.argmin(expected))]]
    for _ in range(30):
        steps = apart(at)
        pull = weights / np.maximum(np.linalg.norm(steps, axis=1), 1e-6)
        step = pull @ steps / pull.sum()
        at = at + step / (1, 1, scale)
        if np.linalg.norm(step) < 1e-6:
            break
    return invert(at)


@dataclass(frozen=True, eq=False)
class Bound:
    """The best that readings allow, on the trials that every estimator gets.

    run: exact Bayes on those trials, or, with the reason in `no_bayes`, `nearest`, of which nothing is told; with the
    Cramer-Rao bound of each trial after each reading.
    """

    run: Run
    no_bayes: str = ""

    def as_json(self) -> dict[str, Any]:
        """Put it into one flat object, as `bench bound --json` prints it; lists run over the readings."""
        summary, bound = self.run.summary, self.run.against_bound
        kept = ("accuracy", "accuracy_low", "accuracy_high", "error_mm", "error_standard_error_mm")
        nothing = [None] * self.run.readings
        return {
            **{name: self.run.config[name] for name in ("trials", "readings", "seed")},
            "letters": self.run.letters,
            "protocol": self.run.protocol,
            "scan": self.run.about["scan"]["options"],
            **{f"bayes_{name}": nothing if self.no_bayes else summary[name] for name in kept},
            "no_bayes": self.no_bayes,
            "bound_mm": bound["bound_mm"],
            "determined": bound["determined"],
            "bayes_efficiency": nothing if self.no_bayes else bound["efficiency"],
            "determined_below_mm": determined_below_mm(self.run.trials),
            "seconds": self.run.seconds,
            "versions": self.run.versions,
        }

    def plot(self) -> Picture:
        """Draw accuracy and error of exact Bayes and the bound against readings seen; without it the bound alone."""
        if not self.no_bayes:
            picture: Picture = self.run.plot()
            return picture
        figure = Picture(figsize=(4.5, 3.8), layout="constrained")
        axes = figure.subplots()
        axes.plot(np.arange(1, self.run.readings + 1), self.run.bound_mm, color="black", ls=(0, (5, 3)))
        axes.set(ylabel="Cramer-Rao bound of the error, mm")
        axes.set_ylim(bottom=0)
        figure.suptitle(self.run.protocol, fontsize=10, parse_math=False)
        over_readings(axes, self.run.readings)
        return figure


def find_bound(config: RunConfig, *, jobs: int = 1, cache: bool = True, progress: Progress = silent) -> Bound:
    """Do exact Bayes on the trials that `config` asks for, and bound their errors.

    Where exact Bayes does not know the press there is the Cramer-Rao bound alone. Raises InputError if the readings do
    not say how they were pressed, or if the bound does not know the sensor or how the object moves.
    """
    check_motion(config.moving)  # before the work, not after it
    no_bayes = ""
    try:
        if not config.moving.still:
            raise InputError("exact Bayes takes the object to lie still; leave out --slip")
        run = perform(config, estimator=ExactBayes(), jobs=jobs, cache=cache, progress=progress)
    except InputError as error:
        no_bayes = str(error)
        order = config.model_copy(update={"estimator": "nearest"})
        run = perform(order, jobs=jobs, cache=cache, progress=progress)
    assert run.plan is not None
    bounds = scan_bounds(run.plan.scan, run.trials, config.moving, jobs=jobs, progress=progress)
    called = run.config if no_bayes else run.config | {"estimator": "exact Bayes"}
    return Bound(replace(run, config=called, bounds=bounds), no_bayes)
