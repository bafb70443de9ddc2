"""Cut a polygon with holes into few convex pieces that tile it.

MuJoCo collides convex bodies only, and each piece costs time in every press. Each reflex corner is
resolved by one cut, the cheapest one found. A cut leads to a corner in sight, or extends one of the reflex
corner's own edges, which keeps right angles right. A cut costs its length. It costs more at a sharp angle to
an edge, because that leaves slivers, and half as much if it resolves two reflex corners. So r reflex corners
make at most r + 1 pieces. As a cut resolves at most two of them, no way of cutting makes fewer than r / 2 + 1.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

_SAME = 1e-6  # mm: a cut that passes a point this near ends there
_FLAT = 1e-8  # rad: a corner that turns by less is straight
_NEAREST = 12  # corners, the nearest in the right direction, that are tried as the end of a cut
_INSERTION = 1.2  # a cut that ends on an edge counts this much longer than one that ends at a corner
_TWO_FOR_ONE = 0.5  # a cut that resolves two reflex corners counts this much
_BATCH = 1 << 20  # rays times edges that are intersected at a time


def convex_pieces(contours: Sequence[FloatArray]) -> list[FloatArray]:
    """Split the region inside `contours` into convex polygons without overlap or gap.

    contours: (k, 2) mm each, outer ones counter-clockwise and holes clockwise, without straight corners and
    nowhere nearer to each other or to themselves than 1e-5 mm. Returns (k, 2) mm arrays,
    counter-clockwise, without straight corners, and convex within 1e-4 mm where corners nearly line up.
    """
    graph = _Graph(contours)
    graph.cut_reflex_corners()
    return graph.faces()


class _Cut(NamedTuple):
    """A cut that could be made, ordered by cost: from a reflex corner to `end`, or to `stop` on an edge."""

    cost: float
    length: float
    corner: int
    end: int  # -1: none, the cut stops on an edge
    stop: tuple[float, float]
    alone: float  # the cost when the cut serves its own corner only


class _Graph:
    """The outline's edges and the cuts made so far, as a planar graph with the region on the left."""

    def __init__(self, contours: Sequence[FloatArray]) -> None:
        sizes = np.array([len(contour) for contour in contours])
        first = np.repeat(np.cumsum(sizes) - sizes, sizes)
        place = np.arange(sizes.sum()) - first
        following = first + (place + 1) % np.repeat(sizes, sizes)
        before = first + (place - 1) % np.repeat(sizes, sizes)
        xy = np.concatenate(list(contours)).astype(float)
        self.corners = len(xy)
        self.points = _Table(xy)  # x, y: the corners, then the points that cuts have put on edges
        self.edges: list[tuple[int, int]] = list(zip(range(self.corners), following.tolist(), strict=True))
        self.ends = _Table(np.concatenate([xy, xy[following]], axis=1))  # x, y of both ends of each edge
        self.on_edge: dict[int, list[int]] = {}  # edge -> points that cuts have put on it
        forward, backward = xy[following] - xy, xy[before] - xy
        # A direction at a corner is the angle to it, counter-clockwise, from the edge that leaves the corner.
        self.zero = np.arctan2(forward[:, 1], forward[:, 0])
        self.inside = _turn(np.arctan2(backward[:, 1], backward[:, 0]) - self.zero)
        self.cuts_at: dict[int, list[float]] = {}  # corner -> directions of its cuts
        self.reflex = set(np.flatnonzero(self.inside > math.pi + _FLAT).tolist())

    def cut_reflex_corners(self) -> None:
        """Add cuts, the cheapest first, until no corner of the region is reflex."""
        queue = self._possible_cuts()
        heapq.heapify(queue)
        while self.reflex:
            cut = heapq.heappop(queue)
            if cut.corner not in self.reflex:
                continue
            if cut.cost < cut.alone and cut.end not in self.reflex:
                heapq.heappush(queue, cut._replace(cost=cut.alone))
                continue
            origin = self.points.rows[cut.corner]
            direction = (np.array(cut.stop) - origin) / cut.length
            reach, edge, point = _first_hit(origin[None], direction[None], self.ends.rows, self.points.rows)
            far, end = float(reach[0]), int(point[0])
            if far < cut.length - _SAME:  # a cut made since is in the way, and this one can end on it
                x, y = (origin + far * direction).tolist()
                cost = _INSERTION * cut.alone * far / cut.length
                heapq.heappush(queue, _Cut(cost, far, cut.corner, end, (x, y), cost))
            else:
                self._add(cut.corner, self._put_on_edge(cut.stop, int(edge[0])) if end < 0 else end)

    def faces(self) -> list[FloatArray]:
        """Walk round every face of the graph and return the outlines."""
        leaving: dict[int, list[int]] = {}
        for index, (a, b) in enumerate(self.edges):
            between = sorted(self.on_edge.get(index, []), key=lambda point: self._distance(a, point))
            for u, v in pairwise([a, *between, b]):
                leaving.setdefault(u, []).append(v)
                if index >= self.corners:  # a cut has the region on both sides
                    leaving.setdefault(v, []).append(u)
        unused = dict.fromkeys((u, v) for u, ends in leaving.items() for v in ends)
        found = []
        while unused:
            u, v = first = next(iter(unused))
            face = []
            while True:
                del unused[u, v]
                face.append(u)
                u, v = v, self._next(u, v, leaving[v])
                if (u, v) == first:
                    break
            found.append(_without_straight_corners(self.points.rows[face]))
        # Where cuts and corners nearly line up, a face can be thinner than what counts as the same point.
        return [outline for outline in found if not _is_sliver(outline)]

    def _next(self, u: int, v: int, ends: list[int]) -> int:
        """Choose where the face on the left of u -> v goes on: along the first edge clockwise from v -> u."""
        if len(ends) == 1:
            return ends[0]
        back = self._angle(v, u)
        return min((w for w in ends if w != u), key=lambda w: (back - self._angle(v, w)) % math.tau)

    def _possible_cuts(self) -> list[_Cut]:
        """List the cuts that meet nothing but the outline at their end, each resolving its corner."""
        reflex = np.array(sorted(self.reflex), dtype=np.intp)
        if not len(reflex):
            return []
        corners = self.points.rows
        zero, inside = self.zero[reflex], self.inside[reflex]
        row, end = self._corners_ahead(reflex)
        count = len(row)
        toward = corners[end] - corners[reflex[row]]
        extension = np.concatenate([zero + math.pi, zero + inside - math.pi])
        rays = np.concatenate([
            toward / np.hypot(*toward.T)[:, None], np.stack([np.cos(extension), np.sin(extension)], axis=1),
        ])  # fmt: skip
        row = np.concatenate([row, np.tile(np.arange(len(reflex)), 2)])
        origins = corners[reflex[row]]
        reach, edge, point = _first_hit(origins, rays, self.ends.rows, corners)
        # Cuts to corners that are out of sight are dropped. All extensions are kept, so each corner has a cut.
        kept = np.concatenate([point[:count] == end, np.ones(len(rays) - count, dtype=bool)])
        row, rays, origins, reach, edge, point = (a[kept] for a in (row, rays, origins, reach, edge, point))

        angle = np.arctan2(rays[:, 1], rays[:, 0])
        direction = _turn(angle - zero[row])
        at_corner = point >= 0
        back = _turn(angle + math.pi - self.zero[point])
        both = at_corner & (self.inside[point] > math.pi + _FLAT)
        both &= _convex_both_sides(back, self.inside[point], reach)
        on_edge = np.mod(
            angle - np.arctan2(*(self.ends.rows[edge, 2:] - self.ends.rows[edge, :2]).T[::-1]), math.pi
        )
        arrival = np.minimum(
            np.where(at_corner, back, on_edge),
            np.where(at_corner, self.inside[point] - back, math.pi - on_edge),
        )
        sharpest = np.minimum(np.minimum(direction, inside[row] - direction), arrival)
        alone = reach * np.where(at_corner, 1.0, _INSERTION) / np.sin(np.clip(sharpest, 1e-3, math.pi / 2))
        cost = alone * np.where(both, _TWO_FOR_ONE, 1.0)
        stop = np.where(at_corner[:, None], corners[point], origins + reach[:, None] * rays)
        columns = (cost, reach, reflex[row], point, stop, alone)
        return [
            _Cut(cost, length, corner, end, (x, y), single)
            for cost, length, corner, end, (x, y), single in zip(*(a.tolist() for a in columns), strict=True)
        ]

    def _corners_ahead(self, reflex: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """List pairs (row of a reflex corner, corner to which a cut would resolve it), the nearest ones."""
        corners = self.points.rows
        rows, ends = [], []
        for row, corner in enumerate(reflex):
            toward = corners - corners[corner]
            distance = np.hypot(toward[:, 0], toward[:, 1])
            distance[corner] = 1.0
            direction = _turn(np.arctan2(toward[:, 1], toward[:, 0]) - self.zero[corner])
            good = _convex_both_sides(direction, self.inside[corner], distance)
            good[corner] = False
            ahead = np.flatnonzero(good)
            ahead = ahead[np.argsort(distance[ahead], kind="stable")[:_NEAREST]]
            rows.append(np.full(len(ahead), row))
            ends.append(ahead)
        return np.concatenate(rows), np.concatenate(ends)

    def _angle(self, a: int, b: int) -> float:
        (ax, ay), (bx, by) = self.points.rows[[a, b]].tolist()
        return math.atan2(by - ay, bx - ax)

    def _distance(self, a: int, b: int) -> float:
        return math.dist(*self.points.rows[[a, b]].tolist())

    def _put_on_edge(self, point: tuple[float, float], edge: int) -> int:
        """Add a point to an edge and return its index."""
        index = len(self.points.rows)
        self.points.append(point)
        self.on_edge.setdefault(edge, []).append(index)
        return index

    def _add(self, a: int, b: int) -> None:
        """Add a cut between two points, and note which reflex corners it resolves."""
        self.ends.append((*self.points.rows[a], *self.points.rows[b]))
        self.edges.append((a, b))
        slack = 2 * (_FLAT + _SAME / self._distance(a, b))
        for corner, end in ((a, b), (b, a)):
            if corner in self.reflex:
                cuts = self.cuts_at.setdefault(corner, [])
                cuts.append((self._angle(corner, end) - float(self.zero[corner])) % math.tau)
                stops = sorted([0.0, float(self.inside[corner]), *cuts])
                if max(high - low for low, high in pairwise(stops)) <= math.pi + slack:
                    self.reflex.discard(corner)


class _Table:
    """Rows of numbers to which more are appended without copying all of them each time."""

    def __init__(self, rows: FloatArray) -> None:
        self._space = np.concatenate([rows, np.empty_like(rows)])
        self.rows = self._space[: len(rows)]

    def append(self, row: Sequence[float]) -> None:
        count = len(self.rows)
        if count == len(self._space):
            self._space = np.concatenate([self._space, np.empty_like(self._space)])
        self._space[count] = row
        self.rows = self._space[: count + 1]


def _first_hit(
    origins: FloatArray, rays: FloatArray, ends: FloatArray, points: FloatArray
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]]:
    """Find how far rays get before an edge or, nearer than _SAME, a point stops them.

    origins and rays: (n, 2). ends: (m, 4), x and y of both ends of the edges. points: (k, 2), among them
    every end of an edge. Returns the reach (n,), the edge (n,) and the point (n,), -1 where it is an edge.
    """
    reach, point = np.empty(len(rays)), np.empty(len(rays), dtype=np.intp)
    edge = np.empty(len(rays), dtype=np.intp)
    ax, ay = ends[:, 0], ends[:, 1]
    ux, uy = ends[:, 2] - ax, ends[:, 3] - ay
    parallel = _FLAT * np.hypot(ux, uy)
    step = max(1, _BATCH // len(ends))
    for k in range(0, len(rays), step):
        part = slice(k, k + step)
        dx, dy = rays[part, 0, None], rays[part, 1, None]
        ox, oy = ax - origins[part, 0, None], ay - origins[part, 1, None]
        cross = dx * uy - dy * ux
        skew = np.abs(cross) > parallel
        cross = np.where(skew, cross, 1.0)
        far = (ox * uy - oy * ux) / cross
        place = (ox * dy - oy * dx) / cross
        far[~(skew & (place >= 0) & (place <= 1) & (far > _SAME))] = np.inf
        row = np.arange(len(far))
        edge[part] = np.argmin(far, axis=1)
        to_edge = far[row, edge[part]]

        px, py = points[:, 0] - origins[part, 0, None], points[:, 1] - origins[part, 1, None]
        along = px * dx + py * dy
        along[(np.abs(px * dy - py * dx) > _SAME) | (along < 2 * _SAME)] = np.inf
        nearest = np.argmin(along, axis=1)
        to_point = along[row, nearest]
        first = to_point <= to_edge + _SAME
        point[part] = np.where(first, nearest, -1)
        reach[part] = np.where(first, to_point, to_edge)
    return reach, edge, point


def _convex_both_sides(direction: FloatArray, inside: FloatArray, length: FloatArray) -> NDArray[np.bool_]:
    """Tell whether a cut leaves both sides of a corner convex, within _SAME at its far end."""
    slack = _FLAT + _SAME / length
    return (direction >= inside - math.pi - slack) & (direction <= math.pi + slack)


def _turn(angle: FloatArray | float) -> FloatArray:
    """Fold angles into (0, 2 pi]."""
    return math.tau - np.mod(-np.asarray(angle), math.tau)


def _without_straight_corners(outline: FloatArray) -> FloatArray:
    """Leave out the corners that lie within 1e-8 mm of the line between their neighbours."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return outline[np.abs(cross) > 1e-8 * np.hypot(*(before + after).T)]


def _is_sliver(outline: FloatArray) -> bool:
    """Tell whether a convex outline is thinner than _SAME."""
    x, y = outline.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return 2 * area < _SAME * float(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum())
