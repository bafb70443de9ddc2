"""Find the rotational symmetry of a body in space from its surface.

The inertia axes say which turns may leave a body as it is; each is tried on the surface. About an axis of which the
two moments across are equal, orders are tried; where all three are equal, the turns are tried that permute the points
furthest from the centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.symmetry import LARGEST_ORDER, PRIMES, TOLERANCE
from tactsim.solids.triangles import CELL, CutSurface, to_triangles

_FIRST = 300  # points that are compared first: most turns fail there
_ALIKE = 0.01  # moments of inertia that differ by this share of the largest may be equal
_SAME_TURN = 1e-2  # rad: turns nearer than this are one
_GOLDEN = math.pi * (3 - math.sqrt(5))  # rad: multiples of it fall together with no order's
_MOST_TIPS = 60  # furthest points that are permuted: no finite group but the prisms' has more turns


@dataclass(frozen=True, eq=False)
class SpaceSymmetry:
    """The turns about the origin that leave a body as it is.

    rotations: (k, 4) unit quaternions, the finite group, the identity first. axis: (3,) unit vector or None: every turn
    about it leaves the body as it is too. The group then holds, beside the identity, a turn by pi that reverses the
    axis, if it leaves the body as it is.
    """

    rotations: FloatArray
    axis: FloatArray | None

    @property
    def order(self) -> float:
        """Tell how many turns there are; infinite with an axis."""
        return math.inf if self.axis is not None else len(self.rotations)


def find_symmetry(corners: FloatArray) -> SpaceSymmetry:
    """Find the turns that move no point of a surface by more than 0.05 mm off it.

    corners: (f, 3 corners, 3) mm, a closed mesh about its centre of mass. Orders about an axis are looked for up to 64;
    a surface of higher order is a body of revolution within that tolerance.
    Raises InputError for a ball, which has no pose that could be found.
    """
    surface = _Surface(corners)
    moments, axes = np.linalg.eigh(surface.second_moments)
    near = np.diff(moments) < _ALIKE * moments[-1]
    if near.all():
        return _symmetry_of_equal_moments(surface)
    if near.any():
        return _symmetry_about(surface, axes[:, 2] if near[0] else axes[:, 0])
    turns = [turn for turn in rigid.from_vector(math.pi * axes.T) if surface.is_unchanged(turn)]
    return SpaceSymmetry(_group(turns), None)


class _Surface(CutSurface):
    """A surface that is compared with itself, turned."""

    def __init__(self, corners: FloatArray) -> None:
        super().__init__(corners)
        points = np.concatenate([np.unique(corners.reshape(-1, 3), axis=0), self.middles])
        points = points[np.unique(np.round(points / CELL).astype(int), axis=0, return_index=True)[1]]
        # The furthest points move most, so they are compared first; after them some from everywhere.
        order = np.argsort(-np.linalg.norm(points, axis=1), kind="stable")
        first = np.concatenate([order[: _FIRST // 2], order[_FIRST // 2 :: max(1, 2 * len(order) // _FIRST)]])
        self.first, self.points = points[first], points

    @cached_property
    def weights(self) -> FloatArray:
        """Give the cells' areas, (cells,) mm^2."""
        a, b, c = np.moveaxis(self.cells, 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, dtype=float)

    @cached_property
    def second_moments(self) -> FloatArray:
        """Integrate x x^T over the surface: (3, 3) mm^4. It has every symmetry of the surface."""
        return np.asarray((self.middles * self.weights[:, None]).T @ self.middles, dtype=float)

    def is_unchanged(self, turn: FloatArray) -> bool:
        """Tell whether a turn and its inverse leave all points within TOLERANCE of the surface."""
        both = (turn, rigid.conjugate(turn))
        return all(
            bool((self.distances(rigid.turned(one, points), TOLERANCE) <= TOLERANCE).all())
            for points in (self.first, self.points)
            for one in both
        )


def _symmetry_about(surface: _Surface, axis: FloatArray) -> SpaceSymmetry:
    """Find the symmetry of a body whose only axis of an order above 2 is `axis`."""
    axis = axis * np.sign(axis[np.abs(axis).argmax()])
    if all(surface.is_unchanged(rigid.from_vector(_GOLDEN * count * axis)) for count in range(1, 6)):
        across = rigid.turned(rigid.turn_from_z(axis), (1.0, 0.0, 0.0))
        flip = rigid.from_vector(math.pi * across)
        return SpaceSymmetry(_group([flip] if surface.is_unchanged(flip) else []), axis)
    order = 1
    for prime in PRIMES:
        while order * prime <= LARGEST_ORDER and surface.is_unchanged(
            rigid.from_vector(2 * math.pi / (order * prime) * axis)
        ):
            order *= prime
    turns = [rigid.from_vector(2 * math.pi / order * axis)]
    for across in _flip_axes(surface, axis, order):
        flip = rigid.from_vector(math.pi * across)
        if surface.is_unchanged(flip):
            turns.append(flip)
            break
    return SpaceSymmetry(_group(turns), None)


def _flip_axes(surface: _Surface, axis: FloatArray, order: int) -> list[FloatArray]:
    """List the directions across `axis` about which half a turn may leave the surface as it is.

    With w = x + iy and z along the axis, half a turn about the direction phi maps w to exp(2 i phi) conj(w) and z to
    -z. So a moment c of w^m, weighted evenly in z, is exp(2 i m phi) conj(c): phi is arg(c) / m, up to pi / m.
    """
    frame = rigid.matrix(rigid.turn_from_z(axis))
    x, y, z = (surface.middles @ frame).T
    w, scale = x + 1j * y, np.hypot(x, y).max()
    found = []
    for power in (order, 2 * order, 3 * order):
        for weight in (np.ones_like(z), z**2):
            terms = surface.weights * weight * (w / scale) ** power
            moment = terms.sum()
            if abs(moment) > 1e-4 * np.abs(terms).sum():
                phi = np.angle(moment) / power + math.pi / power * np.arange(power // order)
                found += [frame @ (math.cos(angle), math.sin(angle), 0.0) for angle in phi]
    return found


def _symmetry_of_equal_moments(surface: _Surface) -> SpaceSymmetry:
    """Find the symmetry of a body whose moments of inertia are all equal, like a cube's or a tetrapod's."""
    points = surface.corners.reshape(-1, 3)
    reach = np.linalg.norm(points, axis=1)
    if reach.max() - to_triangles(np.zeros((1, 1, 3)), surface.corners[None]).min() <= TOLERANCE:
        raise InputError("it is a ball, which every turn leaves as it is: there is no pose to find")
    tips = _clusters(points[reach > reach.max() - TOLERANCE])
    if len(tips) == 0 or len(tips) > _MOST_TIPS or np.linalg.matrix_rank(tips, tol=1.0) < 2:
        # Furthest points on a line or a circle: their axis is the only one of an order above 2.
        _, _, directions = np.linalg.svd(tips if len(tips) else points[reach > reach.max() - TOLERANCE])
        axis = directions[0] if np.linalg.matrix_rank(tips, tol=1.0) < 2 else directions[2]
        return _symmetry_about(surface, axis)
    a = tips[0]
    b = tips[np.argmin(np.abs(tips @ a))]
    turns: list[FloatArray] = []
    group = _group(turns)
    for c in tips:
        for d in tips[np.abs(tips @ c - a @ b) < 4 * TOLERANCE * reach.max()]:
            turn = rigid.quaternion(_frame(c, d) @ _frame(a, b).T)
            if rigid.nearest_rotation(turn, group)[0] > _SAME_TURN and surface.is_unchanged(turn):
                turns.append(turn)
                group = _group(turns)
    return SpaceSymmetry(group, None)


def _frame(a: FloatArray, b: FloatArray) -> FloatArray:
    """Make a right-handed frame, its columns, of which x looks along a and y towards b."""
    x = a / np.linalg.norm(a)
    z = np.cross(a, b)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _clusters(points: FloatArray) -> FloatArray:
    """Give the middles (k, 3) of groups of points that lie within 2 mm of their first one."""
    found = []
    while len(points):
        near = np.linalg.norm(points - points[0], axis=1) < 2.0
        found.append(np.unique(points[near], axis=0).mean(axis=0))
        points = points[~near]
    return np.reshape(found, (-1, 3))


def _group(turns: list[FloatArray]) -> FloatArray:
    """Multiply turns until no new one comes: (k, 4), the identity first."""
    group = rigid.IDENTITY[None, 3:]
    fresh = group
    while len(fresh):
        products = [rigid.multiply(turn, fresh) for turn in turns]
        fresh = group[:0]
        for product in np.reshape(products, (-1, 4)):
            known = np.concatenate([group, fresh])
            if rigid.nearest_rotation(product, known)[0] > _SAME_TURN:
                fresh = np.concatenate([fresh, product[None]])
        group = np.concatenate([group, fresh])
        if len(group) > 2 * LARGEST_ORDER:
            raise InputError("its symmetry cannot be told: it is nearly, but not quite, that of a ball")
    group = np.where(group[:, :1] < 0, -group, group)
    group.setflags(write=False)
    return group
