"""The coarse-to-fine filter in space, and tempered particles that are born of its cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.states import Weights
from tactsim.estimators.space.moved_particles import MovedParticles, born, evidence
from tactsim.estimators.space.pose_cells import check_room
from tactsim.estimators.space.pose_modes import draw, find_modes
from tactsim.estimators.space.pose_search import PoseSearch
from tactsim.estimators.space.space_filter import SpaceFilter, SpaceFilterOptions

_LATER = 1.5  # times as many contacts as at the last search make another one due
_SEEDS = 75  # particles that modes are sought from, beside the better ones of a search's seeds
_KEPT = 300  # of these
_BEFORE = 256  # poses of an object that stand for it until something is touched


class SpaceRefinedOptions(SpaceFilterOptions):
    """Options of the coarse-to-fine filter in space."""

    rotations: int = Field(
        4, ge=2, le=8, description="coarse cells along each side of the four cubes of rotations"
    )
    voxel: float = Field(9.0, ge=1, le=20, description="side of a coarse cell, mm")
    seeds: int = Field(
        1500,
        ge=8,
        le=1_000_000,
        description="coarse cells from whose middles poses are climbed to, at each search",
    )
    cells: int = Field(800, ge=8, le=1_000_000, description="cells that are halved, each time")
    halvings: int = Field(2, ge=0, le=5, description="how many times cells are halved in all six directions")
    searches: int = Field(
        5,
        ge=1,
        le=10_000,
        description="contacts up to which each has cells searched anew; later only some have",
    )
    particles: int = Field(300, ge=8, le=1_000_000, description="n_P, over all objects together")
    rounds: int = Field(10, ge=1, le=100, description="the most rounds of resampling and moving at a touch")
    survivors: float = Field(0.2, gt=0, lt=1, description="share of the particles that must stay effective")


class SpaceRefinedFilter(SpaceFilter):
    """A coarse-to-fine search over all poses, and particles about the modes that it finds.

    After a contact `PoseSearch` moves the middles of coarse cells to where touches agree. From the better ones, and
    from some of the particles so far, the modes of the belief are climbed to (`pose_modes`), and particles are drawn
    about them. These are weighed by the likelihood of all touches; where too few of them count they are weighed little
    by little and moved (`MovedParticles`). A belief that is too wide for modes, as after a first contact, is held by
    poses in cells that are halved, or by the particles of the touch before. After a touch for which no search is due
    the particles go on where enough of them count; else modes are climbed to from them alone.
    """

    options_type = SpaceRefinedOptions
    options: SpaceRefinedOptions
    budget = "cells"

    def _fitted(self) -> None:
        chosen = self.options
        self._distinct = np.flatnonzero(self._alike == np.arange(len(self.labels))).tolist()
        self._search = PoseSearch(
            self.field, self._distinct, self.reader, chosen.rotations, chosen.voxel, chosen.reach
        )
        check_room(self._distinct, self._search.coarse, chosen.halvings)
        self._evaluated = 0
        self._least = chosen.survivors * chosen.particles

    def _reset(self, rng: np.random.Generator) -> None:
        self._search.reset()
        self._rng, self._due, self._open = rng, 0.0, True
        self._touched = np.empty((0, 3))
        count = _BEFORE * len(self._distinct)
        place = rng.uniform(-1, 1, (count, 3)) * self.options.reach
        self._particles = MovedParticles(
            np.repeat(self._distinct, _BEFORE), np.concatenate([place, rigid.random_rotations(count, rng)], axis=1),
            np.zeros(count), np.full(count, -np.log(_BEFORE)), 1.0,
        )  # fmt: skip

    def _update(self, readings: FloatArray, sensors_in_robot: FloatArray) -> None:
        """Take the touch into the particles and move them till they fit; search anew if that is due."""
        chosen, old = self.options, self._particles
        met = np.flatnonzero(self.reader.met(readings))
        places = [self.reader.anchor(readings[one], sensors_in_robot[one]) for one in met.tolist()]
        self._touched = np.concatenate([self._touched, *(place[None] for place in places)])
        self._search.take_in(readings, sensors_in_robot)
        old.take_in(self._log_p(old.label, old.pose, self.field.touches - len(readings)))
        contacts = len(self._touched)
        if not contacts:
            return
        old.lower_power(self._least)
        due = len(met) > 0 and (contacts <= chosen.searches or contacts >= self._due)
        if old.power == 1.0 and not due:
            return
        every = max(1, len(old.label) // _SEEDS)
        label, pose = old.label[::every], old.pose[::every]
        beliefs = [old]
        if due:
            self._due = _LATER * contacts
            begun, there = self._search.seeds(chosen.seeds, _KEPT, self._rng)
            label, pose = np.concatenate([label, begun]), np.concatenate([pose, there])
            if self._open:
                beliefs = [self._born(*self._search.find(chosen.cells, chosen.halvings, self._rng))]
        modes = find_modes(self.field, label, pose, chosen.reach)
        beliefs.append(self._born(*draw(modes, chosen.particles, chosen.reach, self._rng)))
        # All stand for the whole belief. Modes lack a part of a wide one, cells one of a sharp one: what lacks a part
        # has less evidence.
        held = [evidence(one.rest) for one in beliefs]
        best = int(np.argmax(held))
        self._open &= not (due and best > 0)
        self._particles = beliefs[best] if held[best] > -np.inf else old
        self._particles.settle(
            self._log_p, self._touched, chosen.reach, self._rng, chosen.particles, chosen.rounds, self._least
        )

    def _born(self, label: NDArray[np.int64], pose: FloatArray, log_held: FloatArray) -> MovedParticles:
        """Make particles of poses (n, 7) that stand for so much of the prior (n,), logs."""
        return born(label, pose, self._log_p(label, pose), log_held, self._least)

    def _log_p(self, label: NDArray[np.int64], pose: FloatArray, first: int = 0) -> FloatArray:
        """Sum log p of the touches from `first` on of objects (n,) at poses (n, 7)."""
        log_p = np.empty(len(label))
        for one in np.unique(label).tolist():
            mine = np.flatnonzero(label == one)
            log_p[mine] = self.field.log_p(one, pose[mine], first)
        self._evaluated += len(label) * (self.field.touches - first)
        return log_p

    def belief(self) -> tuple[NDArray[np.int64], FloatArray, Weights]:
        """Give the particles."""
        return self._particles.label, self._particles.pose, Weights(self._particles.rest)

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations of the likelihood, a pose in a touch each, and quick looks at one."""
        return {"likelihood_evaluations": self._evaluated, "screened": self._search.screened, "skipped": {}}


class SpaceTemperedOptions(SpaceRefinedOptions):
    """Options of the tempered particles in space."""

    searches: int = Field(1, ge=1, le=10_000, description="contacts up to which cells are searched anew")
    particles: int = Field(1000, ge=8, le=1_000_000, description="n_P, over all objects together")


class SpaceTemperedFilter(SpaceRefinedFilter):
    """More particles, and fewer searches: one at the first contact, and ever fewer later."""

    options_type = SpaceTemperedOptions
    budget = "particles"
