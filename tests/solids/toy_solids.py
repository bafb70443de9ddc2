"""Solids whose height along any direction is known in closed form, and a pad that is pressed against them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tactsim.core import Pad, rigid
from tactsim.solids.scan import SpaceScan
from tactsim.solids.voxels import distance_at

STIFFNESS, THICKNESS, FORCE, BLUR, STROKE = 50.0, 3.0, 2.0, 1.0, 60.0  # kPa/mm, mm, N, mm, mm
PAD = Pad()
_FINE = 0.475  # mm between the points at which the layer is worked out
FAR = 1e3  # mm; where a ray hits nothing


@njit
def distances(voxels, points):
    """Look up signed distances (n,) mm at points (n, 3) mm."""
    found = np.empty(len(points))
    for n in range(len(points)):
        found[n] = distance_at(voxels, points[n, 0], points[n, 1], points[n, 2])
    return found


@dataclass(frozen=True)
class Ball:
    """A sphere. radius, centre: mm."""

    radius: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def hit(self, point, along):
        """Give how far rays go before they hit: (n,) mm, FAR if they do not."""
        away = point - self.centre
        b = (away * along).sum(-1)
        c = (away**2).sum(-1) - self.radius**2
        under = b**2 - c
        return np.where(under > 0, -b - np.sqrt(np.maximum(under, 0)), FAR)

    def surface(self, count, rng):
        normal = rng.standard_normal((count, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return normal * self.radius + self.centre, normal

    def distance(self, points):
        return np.linalg.norm(points - self.centre, axis=-1) - self.radius

    @property
    def area(self):
        return 4 * np.pi * self.radius**2


@dataclass(frozen=True)
class Box:
    """A box. half: mm, half its sides."""

    half: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def hit(self, point, along):
        """Give how far rays go before they hit: (n,) mm, FAR if they do not."""
        half, away = np.array(self.half), point - self.centre
        inverse = 1 / np.where(np.abs(along) < 1e-12, 1e-12, along)
        first, second = (-half - away) * inverse, (half - away) * inverse
        near, far = np.minimum(first, second).max(-1), np.maximum(first, second).min(-1)
        return np.where(near < far, near, FAR)

    def surface(self, count, rng):
        half = np.array(self.half)
        areas = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
        axis = rng.choice(3, count, p=areas / areas.sum())
        sign = rng.choice([-1.0, 1.0], count)
        points, normal = rng.uniform(-half, half, (count, 3)), np.zeros((count, 3))
        points[np.arange(count), axis] = sign * half[axis]
        normal[np.arange(count), axis] = sign
        return points + self.centre, normal

    def distance(self, points):
        away = np.abs(points - np.array(self.centre)) - self.half
        return np.linalg.norm(np.maximum(away, 0), axis=-1) + np.minimum(away.max(axis=-1), 0)

    @property
    def area(self):
        x, y, z = self.half
        return 8 * (x * y + y * z + x * z)


@dataclass(frozen=True)
class Union:
    """Several solids in one."""

    parts: tuple[Ball | Box, ...]

    def hit(self, point, along):
        return np.min([part.hit(point, along) for part in self.parts], axis=0)

    def distance(self, points):
        return np.min([part.distance(points) for part in self.parts], axis=0)

    def surface(self, count, rng):
        points, normals = [], []
        areas = np.array([part.area for part in self.parts])
        while sum(map(len, points)) < count:
            which = rng.choice(len(self.parts), p=areas / areas.sum())
            point, normal = self.parts[which].surface(1, rng)
            if self.distance(point)[0] > -1e-9:
                points.append(point), normals.append(normal)
        return np.concatenate(points), np.concatenate(normals)


SOLIDS = {
    "ball": Ball(13.0),
    "block": Box((15.0, 10.0, 6.0)),
    "tee": Union((Box((15.0, 5.0, 5.0)), Box((5.0, 5.0, 12.0), (0.0, 0.0, 12.0)))),
}


def press(solid, start, stroke=STROKE):
    """Press the pad from `start` (n, 7): rest poses (n, 7), ideal readings (n, taxels) kPa, whether it met (n,)."""
    low_x, high_x, low_y, high_y = PAD.load_bounds
    x, y = np.arange(low_x + _FINE / 2, high_x, _FINE), np.arange(low_y + _FINE / 2, high_y, _FINE)
    lattice = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)
    near = ((PAD.taxel_xy[:, None] - lattice[None, :, :2]) ** 2).sum(-1)
    width = BLUR**2 + 1.8**2 / 12
    share = np.exp(-near / 2 / width) * _FINE**2 / (2 * np.pi * width)
    along = rigid.turned(start[:, 3:], np.array([0.0, 0.0, 1.0]))
    rest, readings, met = start.copy(), np.zeros((len(start), PAD.taxels)), np.zeros(len(start), bool)
    for number, pose in enumerate(start):
        height = solid.hit(rigid.transform(pose, lattice), along[number])
        low, high = 0.0, stroke
        for _ in range(50):
            travel = (low + high) / 2
            layer = STIFFNESS * np.clip(travel - height, 0, THICKNESS)
            low, high = (travel, high) if layer.sum() * _FINE**2 / 1000 < FORCE else (low, travel)
        met[number] = travel < stroke - 1e-6
        if met[number]:
            readings[number] = share @ layer
        rest[number, :3] += travel * along[number]
    return rest, readings, met


def toward(points, inward, rng, back=30.0):
    """Place pads `back` mm before points (n, 3) that look along `inward` (n, 3), turned at random: (n, 7)."""
    count = len(points)
    turn = rigid.from_vector(np.outer(rng.uniform(-np.pi, np.pi, count), [0.0, 0.0, 1.0]))
    return np.concatenate([points - back * inward, rigid.multiply(rigid.turn_from_z(inward), turn)], axis=1)


def touches(solid, count, rng, tilt=0.0, aside=0.0):
    """Touch a solid evenly over its surface along the inward normal, up to `tilt` rad and `aside` mm off."""
    points, normals = solid.surface(count, rng)
    off = tilt * rng.standard_normal((count, 3))
    inward = rigid.turned(rigid.from_vector(off), -normals)
    return press(solid, toward(points + aside * rng.standard_normal((count, 3)), inward, rng))


def placed(poses, rng, mm=0.2, rad=0.01):
    """State poses (n, 7) as wrongly as a robot does."""
    count = len(poses)
    off = np.concatenate(
        [mm * rng.standard_normal((count, 3)), rigid.from_vector(rad * rng.standard_normal((count, 3)))],
        axis=1,
    )
    return rigid.compose(poses, off)


def toy_scan(count, seed, labels=tuple(SOLIDS), tilt=0.3, aside=1.0, noise=2.0):
    """Scan the toy solids: `count` training touches of each, and a tenth as many to test, tilted more."""
    rng = np.random.default_rng(seed)
    taxels = np.column_stack([PAD.taxel_xy, np.zeros(PAD.taxels)])
    rows = []
    for label in labels:
        for split, number, tilted in (("train", count, tilt), ("test", count // 10, 0.6)):
            rest, ideal, _ = touches(SOLIDS[label], number, rng, tilted, aside)
            readings = ideal + noise * rng.standard_normal(ideal.shape)
            rows.append((readings, placed(rest, rng), np.full(number, label), np.full(number, split)))
    readings, poses, names, split = (np.concatenate(column) for column in zip(*rows, strict=True))
    return SpaceScan(
        readings=readings, poses=poses, labels=names, split=split, taxel_points=taxels,
        taxel_normals=np.tile([0.0, 0.0, 1.0], (PAD.taxels, 1)), touch=np.arange(len(readings)),
        meta={"stroke": STROKE},
    )  # fmt: skip
