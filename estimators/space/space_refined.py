"""Coarse to fine over SO(3) x R^3: cells of poses about the first contact, the better of which are halved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.space import pose_cells
from tactsim.estimators.space.pose_cells import CellSizes
from tactsim.estimators.space.rotation_cells import every_cell
from tactsim.estimators.space.screen_kernels import TouchPoints, distances, screen
from tactsim.estimators.space.space_filter import SpaceFilter, SpaceFilterOptions
from tactsim.estimators.space.touch_points import joined

_WIDTH = 0.4  # mm by which a touched point misses the map
_HOPELESS = 25.0  # nats below the best coarse cell at which one is forgotten
_BEFORE = 256  # poses of an object that stand for it until something is touched


class SpaceRefinedOptions(SpaceFilterOptions):
    """Options of the coarse-to-fine filter in space."""

    rotations: int = Field(6, ge=2, le=8, description="coarse cells along each side of the four cubes of rotations")
    voxel: float = Field(6.0, ge=1, le=20, description="side of a coarse cell, mm")
    cells: int = Field(600, ge=8, le=1_000_000, description="cells that are halved, each time")
    halvings: int = Field(5, ge=0, le=5, description="how many times cells are halved in all six directions")


@dataclass(frozen=True, eq=False)
class _Looked:
    """Cells of one size that were looked at: cell (n,) ascending, and their scores (n,)."""

    cell: NDArray[np.int64]
    score: FloatArray


_NOTHING = _Looked(np.empty(0, dtype=np.int64), np.empty(0))


class SpaceRefinedFilter(SpaceFilter):
    """Cells of poses in space."""

    options_type = SpaceRefinedOptions
    options: SpaceRefinedOptions
    budget = "cells"
    draws = False

    def _fitted(self) -> None:
        self._distinct = np.flatnonzero(self._alike == np.arange(len(self.labels))).tolist()
        voxel = self.options.voxel
        reach = max(self.field.reach(label) for label in self._distinct)
        self._coarse = CellSizes(self.options.rotations, voxel, voxel * np.ceil(reach / voxel + 1), self.options.reach)
        self._charts = [self.field.maps[label] for label in self.labels]
        cube, place = every_cell(self._coarse.side)
        self._every = []
        count = round(2 * self._coarse.reach / voxel)
        voxels = np.stack(np.indices((count, count, count)), axis=-1).reshape(-1, 3)
        middle = (voxels + 0.5) * voxel - self._coarse.reach
        away = np.empty(len(middle))
        for label in self._distinct:
            distances(self._charts[label], middle, away)
            near = np.repeat(voxels[np.abs(away) <= 0.87 * voxel + 0.5], len(cube), axis=0)
            times = len(near) // len(cube)
            self._every.append(pose_cells.packed(label, np.tile(cube, times), np.tile(place, (times, 1)), near))
        low, high = self.taxel_points[:, :2].min(axis=0), self.taxel_points[:, :2].max(axis=0)
        x, y = (np.linspace(low[axis], high[axis], 3) * 0.95 for axis in (0, 1))
        self._lattice = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._screened = self._weighed = self._unrepeated = 0

    def _reset(self, rng: np.random.Generator) -> None:
        self._points: TouchPoints | None = None
        self._anchor: FloatArray | None = None
        self._cells, self._scores = np.empty(0, dtype=np.int64), np.empty(0)
        self._known: list[_Looked] = []
        # Until something is touched, poses anywhere stand for an object.
        own = np.random.default_rng(0)
        place = own.uniform(-1, 1, (_BEFORE, 3)) * self.options.reach
        self._final = np.concatenate([place, rigid.random_rotations(_BEFORE, own)], axis=1)
        self._final = np.tile(self._final, (len(self._distinct), 1))
        self._of = np.repeat(self._distinct, _BEFORE)
        self._log_weight = np.full(len(self._of), -np.log(_BEFORE))

    def _update(self, readings: FloatArray, sensors_in_robot: FloatArray) -> None:
        """Screen the coarse cells, halve the better ones again and again, weigh the smallest."""
        new = self.reader.read(readings, sensors_in_robot)
        first = 0 if self._points is None else len(self._points.sensor)
        self._points = new if self._points is None else joined(self._points, new)
        if self._anchor is None:
            met = np.flatnonzero(self.reader.met(readings))
            if not len(met):
                for label in self._distinct:
                    mine = self._of == label
                    self._log_weight[mine] += self.field.log_p(label, self._final[mine], first)
                    self._weighed += int(mine.sum()) * len(readings)
                return
            strongest = met[readings[met].sum(axis=1).argmax()]
            self._anchor = self.reader.anchor(readings[strongest], sensors_in_robot[strongest])
            self._cells, first = np.concatenate(self._every), 0
            self._scores = np.zeros(len(self._cells))
        self._screen_coarse(first)
        self._halve()

    def _screen_coarse(self, first: int) -> None:
        """Take touches from `first` on into the coarse cells, and forget those that cannot matter."""
        assert self._anchor is not None
        poses = pose_cells.poses_of(self._cells, self._coarse, self._anchor)
        far = np.linalg.norm(poses[:, :3] - self._anchor, axis=1).max(initial=0.0) * self._coarse.turn
        self._prior = pose_cells.log_prior(self._cells, poses, self._coarse, self._coarse.shift + far)
        score = self._screen(self._cells, poses, self._coarse, first, self._scores, self._scores.max() - 80.0)
        mass = score + self._prior
        kept = mass > mass.max() - _HOPELESS
        self._cells, self._scores, self._prior = self._cells[kept], score[kept], self._prior[kept]

    def _halve(self) -> None:
        assert self._anchor is not None
        sizes, cells, log_mass = self._coarse, self._cells, self._scores + self._prior
        log_prior = self._prior
        log_factor = np.zeros(len(cells))
        known = []
        for step in range(2 * self.options.halvings):
            chosen, more = pose_cells.thinned(log_mass, self.options.cells)
            log_factor = np.repeat(log_factor[chosen] + more, 8)
            halves = pose_cells.turned_halves if step % 2 == 0 else pose_cells.shifted_halves
            cells = halves(cells[chosen]).ravel()
            sizes = sizes.turned() if step % 2 == 0 else sizes.shifted()
            poses = pose_cells.poses_of(cells, sizes, self._anchor)
            log_prior = pose_cells.log_prior(cells, poses, sizes, sizes.voxel)
            looked = self._look(step, cells, poses, sizes)
            known.append(looked)
            score = looked.score[np.searchsorted(looked.cell, cells)]
            log_mass = log_factor + log_prior + score
        chosen, more = pose_cells.thinned(log_mass, self.options.cells)
        cells = cells[chosen]
        poses = pose_cells.poses_of(cells, sizes, self._anchor)
        log_p = self._weigh(cells, poses)
        self._final, self._of = poses, pose_cells.label_of(cells)
        self._log_weight = log_factor[chosen] + more + log_prior[chosen] + log_p
        self._known = known

    def _look(self, step: int, cells: NDArray[np.int64], poses: FloatArray, sizes: CellSizes) -> _Looked:
        """Screen cells; those looked at after the last touch need only the new one."""
        order = np.argsort(cells)
        cells, poses = cells[order], poses[order]
        score = self._screen(cells, poses, sizes, 0, np.zeros(len(cells)), -1e9)
        return _Looked(cells, score)

    def _screen(
        self, cells: NDArray[np.int64], poses: FloatArray, sizes: CellSizes, first: int, score: FloatArray, least: float
    ) -> FloatArray:
        assert self._points is not None and self._anchor is not None
        score, labels = score.copy(), pose_cells.label_of(cells)
        for label in np.unique(labels).tolist():
            mine = np.flatnonzero(labels == label)
            part = score[mine]
            screen(
                self._charts[label], self._points, self._lattice, np.ascontiguousarray(poses[mine]), first,
                len(self._points.sensor), self._anchor, sizes.turn, sizes.shift, _WIDTH,
                self.field.touching.stroke, least, part,
            )  # fmt: skip
            score[mine] = part
        self._screened += len(cells) * (len(self._points.sensor) - first)
        return score

    def _weigh(self, cells: NDArray[np.int64], poses: FloatArray) -> FloatArray:
        labels, log_p = pose_cells.label_of(cells), np.empty(len(cells))
        for label in np.unique(labels).tolist():
            mine = np.flatnonzero(labels == label)
            log_p[mine] = self.field.log_p(label, poses[mine])
        self._weighed += len(cells) * self.field.touches
        return log_p

    def log_evidence(self) -> FloatArray:
        """Sum what the smallest cells of each object hold: log p(readings | object), (labels,)."""
        evidence = np.full(len(self.labels), -np.inf)
        for label in self._distinct:
            mine = self._log_weight[self._of == label]
            if len(mine) and mine.max() > -np.inf:
                evidence[label] = np.log(len(mine)) + Weights(mine).log_mean
        return evidence

    def belief_of(self, label: int) -> tuple[FloatArray, FloatArray, int]:
        """Give the smallest cells of an object: poses (n, 7), their weights (n,), and which is the best."""
        mine = np.flatnonzero(self._of == label)
        weights = Weights(self._log_weight[mine])
        return self._final[mine], weights.normalised, int(weights.log.argmax())

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations."""
        return {"likelihood_evaluations": self._weighed, "screened": self._screened, "skipped": {}}
