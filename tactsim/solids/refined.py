"""The coarse-to-fine filter in space, and particles that are born of its cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import checked_poses
from tactsim.estimators.estimator import Estimate, Estimator, PoseSamples, check_order, name_of
from tactsim.estimators.filters.states import Weights
from tactsim.solids.field import SpaceField, SpaceMapOptions, information
from tactsim.solids.particles import MovedParticles, born, draw, evidence, find_modes, mean_around, widened
from tactsim.solids.pose_search import PointReader, PoseSearch
from tactsim.solids.scan import SpaceScan

STATES = 48  # drawn from the belief for one choice
_LEAST = 1e-9  # the share of the belief that an object keeps
_LATER = 1.5  # times as many contacts as at the last search make another one due
_SEEDS = 75  # particles that modes are sought from, beside the better ones of a search's seeds
_KEPT = 300  # of these
_EFFECTIVE = 20.0  # particles that hold the belief about a pose, at least: three for each of its numbers
_BEFORE = 256  # poses of an object that stand for it until something is touched


class SpaceRefinedOptions(SpaceMapOptions):
    """Options of the coarse-to-fine filter in space."""

    reach: float = Field(
        20.0,
        gt=0,
        le=1000,
        description="the object's origin is within this of the robot's along each axis, mm",
    )
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


class SpaceRefinedFilter(Estimator):
    """A coarse-to-fine search over all (object, object_in_robot), poses in SE(3), and particles about its modes.

    Before the first touch all objects are as probable, the origin is even over a box about the robot's, the rotation
    even over all. Objects whose maps are equal are one hypothesis and share its probability.

    After a contact `PoseSearch` moves the middles of coarse cells to where touches agree. From the better ones, and
    from some of the particles so far, the modes of the belief are climbed to, and particles are drawn
    about them. These are weighed by the likelihood of all touches; where too few of them count they are weighed little
    by little and moved (`MovedParticles`). A belief that is too wide for modes, as after a first contact, is held by
    poses in cells that are halved, or by the particles of the touch before. After a touch for which no search is due
    the particles go on where enough of them count; else modes are climbed to from them alone.
    """

    KIND = "solids"
    POSE = rigid.POSE
    options_type = SpaceRefinedOptions
    options: SpaceRefinedOptions
    budget = "cells"

    def __init__(self, options: SpaceRefinedOptions) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self._started = False

    def fit(self, scan: SpaceScan) -> None:  # type: ignore[override]
        """Learn surfaces from the scan's training touches; its test touches are not looked at.

        Raises InputError if the scan is none of objects in space, or has no training touches.
        """
        if not isinstance(scan, SpaceScan):
            raise InputError(
                f"estimator {name_of(self)} works in space; give it a scan of objects "
                "in space, as `bench scan --task solids` makes"
            )
        self.fit_field(SpaceField.learn(scan, self.options), scan.taxel_points)

    def fit_field(self, field: SpaceField, taxel_points: FloatArray) -> None:
        """Take what was learned: a field over objects and poses, and the taxels (taxels, 3) mm."""
        self.field, self.labels, self._started = field, tuple(field.labels), False
        self.taxel_points = np.asarray(taxel_points, dtype=float)
        feel, chosen = field.touching, self.options
        self.reader = PointReader(self.taxel_points, feel.stiffness, float(np.median(feel.noise)))
        self._alike = alike(field)
        self._distinct = np.flatnonzero(self._alike == np.arange(len(self.labels))).tolist()
        self._search = PoseSearch(
            field, self._distinct, self.reader, chosen.rotations, chosen.voxel, chosen.reach
        )
        self._evaluated = 0
        self._least = chosen.survivors * chosen.particles

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        check_order(bool(self.labels), "fit", "reset")
        self.field.reset()
        self._search.reset()
        # Proposals have a random stream of their own: asking for them makes regions wider, and changes nothing else.
        self._planning, self._rng = rng.spawn(1)[0], rng
        self._normal = rng.spawn(1)[0].standard_normal((self.options.particles, 6))
        self._started, self._due, self._open, self._proposed = True, 0.0, True, False
        self._touched = np.empty((0, 3))
        count = _BEFORE * len(self._distinct)
        place = rng.uniform(-1, 1, (count, 3)) * self.options.reach
        self._particles = MovedParticles(
            np.repeat(self._distinct, _BEFORE), np.concatenate([place, rigid.random_rotations(count, rng)], axis=1),
            np.zeros(count), np.full(count, -np.log(_BEFORE)), 1.0,
        )  # fmt: skip

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in a touch: a reading (taxels,) kPa at a pose (7,), or one of several pads, (m, taxels) at (m, 7).

        Readings of several pads are independent given the object and its pose. Raises InputError, and leaves the belief
        as it was, for a wrong shape, a number that is not finite, or a rotation that is none.
        """
        self._check_started("update")
        readings, sensors = check_touch(reading, sensor_in_robot, len(self.taxel_points))
        self.field.append(readings, sensors, self._proposed)
        chosen, old = self.options, self._particles
        met = np.flatnonzero(self.reader.met(readings))
        places = [self.reader.anchor(readings[one], sensors[one]) for one in met.tolist()]
        self._touched = np.concatenate([self._touched, *(place[None] for place in places)])
        self._search.take_in(readings, sensors)
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

    def estimate(self) -> Estimate:
        """Say which object it is and where: the mean about the best pose of the most probable object.

        Samples are so much wider than the belief as left-out touches say that it is too sure.
        """
        self._check_started("estimate")
        label, poses, weights = self.belief()
        mass = np.bincount(label, weights.relative, minlength=len(self.labels))
        # An object that no state is left of is improbable, not impossible.
        mass = np.maximum(mass, _LEAST * mass.sum())[self._alike]
        chance = mass / mass.sum()
        best = int(chance.argmax())
        mine = np.flatnonzero(label == self._alike[best])
        poses, held = poses[mine], Weights(weights.log[mine])
        mean, near = mean_around(poses, held.normalised)
        spread = self._particles.spread(mine, _EFFECTIVE).normalised
        wide = widened(poses, mean, np.where(near, spread, 0.0), self.field.too_sure, self._normal)
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, chance.tolist(), strict=True)),
            robot_in_object=rigid.invert(mean),
            samples=PoseSamples(rigid.invert(wide), spread),
        )

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the start (k, 7), sensor_in_robot, whose touch should say most about the state."""
        self._check_started("propose")
        self._proposed = True
        starts = checked_poses(candidates, "candidates")
        if starts.ndim != 2 or not len(starts):
            raise InputError(
                f"candidates have shape {starts.shape}; they are one or more [x, y, z, qw, qx, qy, qz]"
            )
        label, poses, weights = self.belief()
        chosen = weights.systematic(STATES, self._planning)
        return int(information(self.field, label[chosen], poses[chosen], starts).argmax())

    def belief(self) -> tuple[NDArray[np.int64], FloatArray, Weights]:
        """Give the particles that stand for the belief: objects (n,), object_in_robot (n, 7) and n weights."""
        return self._particles.label, self._particles.pose, Weights(self._particles.rest)

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations of the likelihood, a pose in a touch each, and quick looks at one."""
        return {"likelihood_evaluations": self._evaluated, "screened": self._search.screened, "skipped": {}}

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

    def _check_started(self, call: str) -> None:
        check_order(self._started, "reset" if self.labels else "fit", call)


def alike(field: SpaceField) -> NDArray[np.int64]:
    """Give for each object the first one whose map is the same, to the bit: (labels,)."""
    first: dict[bytes, int] = {}
    charts = [b"".join(np.asarray(part).tobytes() for part in field.maps[label]) for label in field.labels]
    return np.array([first.setdefault(chart, number) for number, chart in enumerate(charts)])


def check_touch(reading: ArrayLike, sensor_in_robot: ArrayLike, taxels: int) -> tuple[FloatArray, FloatArray]:
    """Return readings (m, taxels) kPa and poses (m, 7) of a touch by one pad or by m.

    Raises InputError if a shape is wrong, a number is not finite or a rotation is none.
    """
    readings, sensors = np.array(reading, dtype=float), np.array(sensor_in_robot, dtype=float)
    if readings.ndim not in (1, 2) or not readings.size or readings.shape[-1] != taxels:
        raise InputError(f"a reading has shape {readings.shape}; the maps were learned from {taxels} taxels")
    if sensors.shape != (*readings.shape[:-1], 7):
        raise InputError(
            f"sensor_in_robot has shape {sensors.shape}; readings of shape {readings.shape} need one pose "
            "[x, y, z, qw, qx, qy, qz] each"
        )
    readings = finite(readings, "reading")
    sensors = checked_poses(sensors, "sensor_in_robot")
    return readings.reshape(-1, taxels), sensors.reshape(-1, 7)
