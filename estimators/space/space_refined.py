"""The coarse-to-fine filter in space, and tempered particles that are born of its cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.space.moved_particles import MovedParticles, born, evidence
from tactsim.estimators.space.pose_modes import draw, find_modes
from tactsim.estimators.space.pose_search import PoseSearch
from tactsim.estimators.space.space_filter import SpaceFilter, SpaceFilterOptions

_LATER = 1.5  # times as many contacts as at the last search make another one due
_SEEDS = 4  # one in so many particles is a seed of the next search's modes
_BEFORE = 256  # poses of an object that stand for it until something is touched


class SpaceRefinedOptions(SpaceFilterOptions):
    """Options of the coarse-to-fine filter in space."""

    rotations: int = Field(
        5, ge=2, le=8, description="coarse cells along each side of the four cubes of rotations"
    )
    voxel: float = Field(7.0, ge=1, le=20, description="side of a coarse cell, mm")
    cells: int = Field(1200, ge=8, le=1_000_000, description="cells that are halved, each time")
    halvings: int = Field(2, ge=0, le=5, description="how many times cells are halved in all six directions")
    searches: int = Field(
        5,
        ge=1,
        le=10_000,
        description="contacts up to which each has cells searched anew; later only some have",
    )
    particles: int = Field(300, ge=8, le=1_000_000, description="n_P, over all objects together")
    rounds: int = Field(10, ge=1, le=100, description="the most rounds of resampling and moving at a touch")
    survivors: float = Field(0.5, gt=0, lt=1, description="share of the particles that must stay effective")


class SpaceRefinedFilter(SpaceFilter):
    """A coarse-to-fine search over all poses, whose cells become particles.

    After a contact `PoseSearch` halves the better of all cells. From the poses that it finds, and from some of the
    particles so far, the modes of the belief are climbed to (`pose_modes`), and particles are drawn about them. These
    are weighed by the likelihood of all touches, little by little where they miss it, and moved (`MovedParticles`).
    After a touch for which no search is due the particles of the last one go on.
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
        self._evaluated = 0

    def _reset(self, rng: np.random.Generator) -> None:
        self._search.reset()
        self._rng, self._due = rng, 0.0
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
            old.raise_power(0.0)
            return
        searched = len(met) > 0 and (contacts <= chosen.searches or contacts >= self._due)
        if searched:
            label, pose, log_held = self._search.find(chosen.cells, chosen.halvings, self._rng)
            searched = len(label) > 0
        if not searched:
            self._settle(old)
            return
        self._due = _LATER * contacts
        log_p = self._log_p(label, pose)
        seeds = np.concatenate([label, old.label[::_SEEDS]]), np.concatenate([pose, old.pose[::_SEEDS]])
        modes = find_modes(self.field, *seeds, chosen.reach)
        drawn, at, drawn_held = draw(modes, chosen.particles, chosen.reach, self._rng)
        drawn_p = self._log_p(drawn, at)
        # Both stand for the whole belief. Modes lack a part of a wide one, cells one of a sharp one: what lacks a part
        # has less evidence.
        if evidence(drawn_held + drawn_p) > evidence(log_held + log_p):
            label, pose, log_p, log_held = drawn, at, drawn_p, drawn_held
        self._particles = born(label, pose, log_p, log_held, chosen.survivors)
        self._settle(self._particles)

    def _settle(self, particles: MovedParticles) -> None:
        chosen = self.options
        particles.settle(
            self._log_p,
            self._touched,
            chosen.reach,
            self._rng,
            chosen.particles,
            chosen.rounds,
            chosen.survivors,
        )

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
