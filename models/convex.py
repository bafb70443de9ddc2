"""Cut a polygon with holes into few convex pieces that tile it.

MuJoCo collides convex bodies only, and each piece costs time in every press. Each reflex corner is
resolved by one cut, the shortest found: to a corner that it sees, or along the extension of one of
its own edges, which keeps right angles right. A cut that serves two reflex corners counts half.
The number of pieces is at most the number of reflex corners + 1 (at least half of that).
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_SAME = 1e-7  # mm: points nearer than this are one point; ten times the grid of the outlines
_FLAT = 1e-9  # rad: a corner that turns by less is straight
_INSERTION = 1.2  # a cut that ends on an edge counts this much longer than one that ends at a corner
_TWO_FOR_ONE = 0.5  # a cut that resolves two reflex corners counts this much


def convex_pieces(contours: Sequence[FloatArray]) -> list[FloatArray]:
    """Split the region inside `contours` into convex polygons without overlap or gap.

    contours: (k, 2) mm each, simple and disjoint, outer ones counter-clockwise and holes clockwise,
    with no straight corners. Returns (k, 2) mm arrays, counter-clockwise, without straight corners.
    """
    graph = _Graph(contours)
    graph.cut_reflex_corners()
    return graph.faces()


class _Graph:
    """The outline's edges and the cuts made so far, as a planar graph with the region on the left."""

    def __init__(self, contours: Sequence[FloatArray]) -> None:
        sizes = [len(contour) for contour in contours]
        self.points: list[FloatArray] = list(np.concatenate(list(contours)).astype(float))
        start = np.repeat(np.cumsum([0, *sizes[:-1]]), sizes)
        local = np.concatenate([np.arange(size) for size in sizes])
        size = np.repeat(sizes, sizes)
        self.following = start + (local + 1) % size
        self.before = start + (local - 1) % size
        self.corners = len(self.points)
        self.edges: list[tuple[int, int]] = list(
            zip(range(self.corners), self.following.tolist(), strict=True)
        )
        self.on_edge: dict[int, list[int]] = {}  # edge -> points that cuts have put on it
        xy = np.array(self.points)
        forward = xy[self.following] - xy
        backward = xy[self.before] - xy
        self.out_angle = np.arctan2(forward[:, 1], forward[:, 0])
        self.inside = _turn(np.arctan2(backward[:, 1], backward[:, 0]) - self.out_angle)
        self.cut_angles: dict[int, list[float]] = {}  # corner -> directions of its cuts, from out_angle

    def cut_reflex_corners(self) -> None:
        """Add cuts, the cheapest first, until no corner of the region is reflex."""
        queue = self._candidates()
        heapq.heapify(queue)
        while queue:
            cost, length, corner, other, x, y = heapq.heappop(queue)
            if self._resolved(corner):
                continue
            if other >= 0 and cost < length and self._resolved(other):
                heapq.heappush(queue, (length, length, corner, other, x, y))  # it now serves one only
                continue
            origin = self.points[corner]
            target = np.array([x, y])
            direction = (target - origin) / length
            cuts = np.arange(self.corners, len(self.edges))
            if len(cuts):
                reach, edge = self._first_hit(origin[None], direction[None], cuts)
                if reach[0] < length - _SAME:
                    if other < 0:  # an extension ends at the first cut that it meets
                        self._add_cut(corner, self._insert(origin + reach[0] * direction, int(edge[0])))
                    continue
            if other < 0:
                reach, edge = self._first_hit(origin[None], direction[None], np.arange(self.corners))
                other = self._insert(target, int(edge[0]))
            self._add_cut(corner, other)

    def faces(self) -> list[FloatArray]:
        """Walk round every face of the graph and return the outlines."""
        leaving: dict[int, list[int]] = {}
        for index, (a, b) in enumerate(self.edges):
            between = self.on_edge.get(index, [])
            between.sort(key=lambda point: float(np.sum((self.points[point] - self.points[a]) ** 2)))
            chain = [a, *between, b]
            for u, v in pairwise(chain):
                leaving.setdefault(u, []).append(v)
                if index >= self.corners:  # a cut has the region on both sides
                    leaving.setdefault(v, []).append(u)
        unused = {(u, v) for u, ends in leaving.items() for v in ends}
        found = []
        while unused:
            u, v = first = min(unused)
            face = []
            while True:
                unused.discard((u, v))
                face.append(u)
                back = self._angle(v, u)
                # The next edge of the face on the left is the first one clockwise from where we came.
                following = min(
                    (w for w in leaving[v] if w != u), key=lambda w: float(_turn(back - self._angle(v, w)))
                )
                u, v = v, following
                if (u, v) == first:
                    break
            found.append(_without_straight_corners(np.array([self.points[point] for point in face])))
        return found

    def _angle(self, a: int, b: int) -> float:
        step = self.points[b] - self.points[a]
        return float(np.arctan2(step[1], step[0]))

    def _candidates(self) -> list[tuple[float, float, int, int, float, float]]:
        """List the cuts that could serve: cost, length, reflex corner, other corner or -1, end x and y."""
        reflex = np.flatnonzero(self.inside > np.pi + _FLAT)
        if not len(reflex):
            return []
        xy = np.array(self.points)
        # A direction at angle a from the leaving edge leaves both sides convex if inside - pi <= a <= pi.
        toward = xy[None] - xy[reflex, None]
        distance = np.hypot(toward[..., 0], toward[..., 1])
        angle = _turn(np.arctan2(toward[..., 1], toward[..., 0]) - self.out_angle[reflex, None])
        low, high = self.inside[reflex, None] - np.pi - _FLAT, np.pi + _FLAT
        row, other = np.nonzero((angle >= low) & (angle <= high) & (distance > _SAME))
        length = distance[row, other]
        extension = np.concatenate(
            [self.out_angle[reflex] + np.pi, self.out_angle[reflex] + self.inside[reflex] - np.pi]
        )
        origins = np.concatenate([xy[reflex][row], xy[reflex], xy[reflex]])
        directions = np.concatenate([
            toward[row, other] / length[:, None],
            np.stack([np.cos(extension), np.sin(extension)], axis=1),
        ])  # fmt: skip
        reach, edge = self._first_hit(origins, directions, np.arange(self.corners))
        seen = np.flatnonzero(reach[: len(row)] > length - _SAME)
        found = []
        for k in seen.tolist():
            corner, end = int(reflex[row[k]]), int(other[k])
            back = float(_turn(np.arctan2(*-directions[k][::-1]) - self.out_angle[end]))
            both = self.inside[end] > np.pi + _FLAT and self._serves(end, back)
            cost = length[k] * (_TWO_FOR_ONE if both else 1.0)
            found.append((float(cost), float(length[k]), corner, end, float(xy[end, 0]), float(xy[end, 1])))
        for k in range(len(row), len(origins)):
            far, corner = float(reach[k]), int(reflex[(k - len(row)) % len(reflex)])
            stop = origins[k] + far * directions[k]
            ends = xy[list(self.edges[edge[k]])]
            if np.min(np.hypot(*(ends - stop).T)) < _SAME:
                continue  # the extension meets a corner: it is already among the cuts to corners
            found.append((far * _INSERTION, far, corner, -1, float(stop[0]), float(stop[1])))
        return found

    def _serves(self, corner: int, angle: float) -> bool:
        return bool(self.inside[corner] - np.pi - _FLAT <= angle <= np.pi + _FLAT)

    def _resolved(self, corner: int) -> bool:
        if corner >= self.corners:
            return True
        stops = np.sort([0.0, self.inside[corner], *self.cut_angles.get(corner, [])])
        return bool(np.max(np.diff(stops)) <= np.pi + 2 * _FLAT)

    def _first_hit(
        self, origins: FloatArray, directions: FloatArray, edges: NDArray[np.intp]
    ) -> tuple[FloatArray, NDArray[np.intp]]:
        """Find how far each ray (n, 2) gets, and the edge that stops it. Touching an end stops it too."""
        xy = np.array(self.points)
        ends = np.array(self.edges)[edges]
        start, along = xy[ends[:, 0]], xy[ends[:, 1]] - xy[ends[:, 0]]
        length = np.hypot(along[:, 0], along[:, 1])
        offset = start[None] - origins[:, None]
        cross = directions[:, None, 0] * along[None, :, 1] - directions[:, None, 1] * along[None, :, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (offset[..., 0] * along[None, :, 1] - offset[..., 1] * along[None, :, 0]) / cross
            place = (
                offset[..., 0] * directions[:, None, 1] - offset[..., 1] * directions[:, None, 0]
            ) / cross
            slack = _SAME / length[None]
            hit = (
                (np.abs(cross) > _FLAT * length[None])
                & (place >= -slack)
                & (place <= 1 + slack)
                & (reach > _SAME)
            )
        reach = np.where(hit, reach, np.inf)
        nearest = np.argmin(reach, axis=1)
        return reach[np.arange(len(origins)), nearest], edges[nearest]

    def _insert(self, point: FloatArray, edge: int) -> int:
        """Put a point on an edge, or take the point that is already there."""
        for known in (*self.edges[edge], *self.on_edge.get(edge, [])):
            if np.hypot(*(self.points[known] - point)) < _SAME:
                return known
        self.points.append(point)
        self.on_edge.setdefault(edge, []).append(len(self.points) - 1)
        return len(self.points) - 1

    def _add_cut(self, a: int, b: int) -> None:
        self.edges.append((a, b))
        for corner, end in ((a, b), (b, a)):
            if corner < self.corners:
                angle = float(_turn(self._angle(corner, end) - self.out_angle[corner]))
                self.cut_angles.setdefault(corner, []).append(angle)


def _turn(angle: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Fold angles into (0, 2 pi]."""
    return 2 * np.pi - np.mod(-np.asarray(angle), 2 * np.pi)


def _without_straight_corners(outline: FloatArray) -> FloatArray:
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    length = np.hypot(*before.T) * np.hypot(*after.T)
    return outline[np.abs(cross) > 2 * _FLAT * length]
