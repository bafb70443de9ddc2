"""The surface of a body in space as triangles: distances from it, faces that cross, and its rotational symmetry.

The inertia axes say which turns may leave a body as it is; each is tried on the surface. About an axis of which the
two moments across are equal, orders are tried; where all three are equal, the turns are tried that permute the points
furthest from the centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.models.letter import LARGEST_ORDER, PRIMES, TOLERANCE

CELL = 1.5  # mm, the longest edge of the cells of a surface
_NEAREST = 32  # cells about a point to which its distance is measured, at most
_STRICTLY = 1e-6  # share of an edge or face by which a crossing must lie inside: faces that meet do not cross
_BATCH = 1 << 17  # pairs of faces that are looked at together


def cut_to(length: float, corners: FloatArray) -> FloatArray:
    """Halve triangles (f, 3 corners, 3) at their longest edges until none is longer than `length` mm: (c, 3, 3)."""
    done = [corners[:0]]
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small = edges.max(axis=1) <= length
        done.append(corners[small])
        corners, longest = corners[~small], edges[~small].argmax(axis=1)
        order = (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


class CutSurface:
    """A mesh cut into small cells, so that distances from it are found quickly.

    corners: (f, 3 corners, 3) mm. cells: (c, 3, 3) mm, and their middles (c, 3).
    """

    def __init__(self, corners: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self.corners = corners
        self.cells = cut_to(CELL, corners)
        self.middles = self.cells.mean(axis=1)
        self._tree = cKDTree(self.middles)

    def distances(self, points: FloatArray, enough: float) -> FloatArray:
        """Measure how far points (n, 3) lie from the surface, mm: (n,).

        What is told is never too small. It is exact for a point much nearer than CELL, unless it is `enough` or less:
        then a face may be nearer still.
        """
        found = np.full(len(points), np.inf)
        for nearest in (_NEAREST // 8, _NEAREST):
            far = np.flatnonzero(found > enough)
            count = min(nearest, len(self.cells))
            near = self._tree.query(points[far], k=range(1, count + 1))[1]
            found[far] = to_triangles(points[far, None], self.cells[near]).min(axis=1)
        return found


def to_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Measure the distances (n, k) mm of points (n, 1, 3) from triangles (n, k, 3 corners, 3)."""
    from trimesh.triangles import closest_point

    nearest = closest_point(
        triangles.reshape(-1, 3, 3), np.repeat(points, triangles.shape[1], axis=1).reshape(-1, 3)
    )
    return np.asarray(np.linalg.norm(nearest.reshape(*triangles.shape[:2], 3) - points, axis=-1), dtype=float)


def crossings(corners: FloatArray) -> NDArray[np.intp]:
    """List the pairs of triangles of which one's edge passes through the inside of the other: (m, 2).

    corners: (f, 3 corners, 3) mm. Triangles that meet at a corner or an edge, or lie in one plane, do not cross there.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    # Sorted along an axis, a triangle's neighbours there are a run behind it. The axis with the shortest runs serves.
    orders = [np.argsort(low[:, axis], kind="stable") for axis in range(3)]
    runs = [
        np.searchsorted(low[order, axis], high[order, axis], side="right") - np.arange(1, len(order) + 1)
        for axis, order in enumerate(orders)
    ]
    shortest = min(range(3), key=lambda axis: int(runs[axis].sum()))
    order, run = orders[shortest], runs[shortest]
    found = [np.empty((0, 2), dtype=np.intp)]
    for rows in np.array_split(np.arange(len(order)), run.sum() // _BATCH + 1):
        first = np.repeat(rows, run[rows])
        place = np.arange(len(first)) - np.repeat(np.cumsum(run[rows]) - run[rows], run[rows])
        pairs = np.sort(np.stack([order[first], order[first + 1 + place]], axis=1), axis=1)
        a, b = pairs.T
        pairs = pairs[((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1)]
        one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
        found.append(pairs[_passes(one, other) | _passes(other, one)])
    return np.unique(np.concatenate(found), axis=0)


def _passes(edges_of: FloatArray, triangles: FloatArray) -> NDArray[np.bool_]:
    """Tell whether an edge of each of `edges_of` (n, 3, 3) passes through the inside of its triangle (n, 3, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    first, second = b - a, c - a
    passes = np.zeros(len(triangles), dtype=bool)
    for corner in range(3):
        start = edges_of[:, corner]
        along = edges_of[:, (corner + 1) % 3] - start
        # Moller and Trumbore (1997): start + t along = a + u first + v second.
        across = np.cross(along, second)
        scale = np.sum(first * across, axis=1)
        size = np.linalg.norm(along, axis=1) * np.linalg.norm(np.cross(first, second), axis=1)
        parallel = np.abs(scale) <= 1e-9 * size
        scale = np.where(parallel, 1.0, scale)
        u = np.sum((start - a) * across, axis=1) / scale
        around = np.cross(start - a, first)
        v = np.sum(along * around, axis=1) / scale
        t = np.sum(second * around, axis=1) / scale
        within = np.min([u, v, 1 - u - v, t, 1 - t], axis=0) > _STRICTLY
        passes |= within & ~parallel
    return passes


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
