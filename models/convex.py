"""Cut a polygon with holes into few convex pieces that tile it.

MuJoCo collides convex bodies only, and each piece costs time in every press. Each reflex corner is
resolved by one cut, the cheapest found: to a corner that it sees, or along the extension of one of
its own edges, which keeps right angles right. Short cuts are cheap, cuts at a sharp angle to an edge
are dear (they leave slivers), and a cut that serves two reflex corners counts half. The number of
pieces is at most the number of reflex corners + 1, and no decomposition has less than half of that.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_SAME = 1e-7  # mm: points nearer than this are one point; ten times the grid of the outlines
_FLAT = 1e-8  # rad: a corner that turns by less is straight
_NEAREST = 12  # corners, the nearest in the right direction, that are tried as the end of a cut
_INSERTION = 1.2  # a cut that ends on an edge counts this much longer than one that ends at a corner
_TWO_FOR_ONE = 0.5  # a cut that resolves two reflex corners counts this much
_BATCH = 1 << 20  # rays times edges that are intersected at a time


def convex_pieces(contours: Sequence[FloatArray]) -> list[FloatArray]:
    """Split the region inside `contours` into convex polygons without overlap or gap.

    contours: (k, 2) mm each, outer ones counter-clockwise and holes clockwise, with no straight corners; they
    may touch, but gaps and necks are otherwise wider than 1e-6 mm. Returns (k, 2) mm arrays,
    counter-clockwise, without straight corners.
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
        contours = _with_touching_corners(contours)
        sizes = np.array([len(contour) for contour in contours])
        first = np.repeat(np.cumsum(sizes) - sizes, sizes)
        place = np.arange(sizes.sum()) - first
        following = first + (place + 1) % np.repeat(sizes, sizes)
        before = first + (place - 1) % np.repeat(sizes, sizes)
        xy = np.concatenate(list(contours)).astype(float)
        self.corners = len(xy)
        self.node = _nodes(xy)  # corner -> the first of the corners at its place; contours may touch
        xy = xy[self.node]
        self.xy = xy
        self.points: list[tuple[float, float]] = [(x, y) for x, y in xy.tolist()]
        self.edges: list[tuple[int, int]] = list(zip(range(self.corners), following.tolist(), strict=True))
        self.on_edge: dict[int, list[int]] = {}  # edge -> points that cuts have put on it
        self.ends = np.concatenate([xy, xy[following]], axis=1)  # (edges, 4): x, y of both ends; grows
        forward, backward = xy[following] - xy, xy[before] - xy
        # A direction at a corner is the angle to it, counter-clockwise, from the edge that leaves the corner;
        # the region lies between that edge and the next one, counter-clockwise, that arrives at the same place.
        self.zero = np.arctan2(forward[:, 1], forward[:, 0])
        arriving = np.arctan2(backward[:, 1], backward[:, 0])
        self.inside = _turn(arriving - self.zero)
        for shared in _groups(self.node):
            self.inside[shared] = _turn(arriving[shared][None] - self.zero[shared][:, None]).min(axis=1)
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
            origin = np.array([self.points[cut.corner]])
            direction = (np.array(cut.stop) - origin) / cut.length
            reach, edge = _first_hit(origin, direction, self.ends[: len(self.edges)])
            far = float(reach[0])
            if far < cut.length - _SAME:  # a cut made since is in the way, and this one can end on it
                x, y = (origin + far * direction)[0].tolist()
                cost = _INSERTION * cut.alone * far / cut.length
                heapq.heappush(queue, _Cut(cost, far, cut.corner, -1, (x, y), cost))
            elif cut.end < 0:
                self._add(cut.corner, self._put_on_edge(cut.stop, int(edge[0])))
            else:
                self._add(cut.corner, cut.end)

    def faces(self) -> list[FloatArray]:
        """Walk round every face of the graph and return the outlines."""
        leaving: dict[int, list[int]] = {}
        for index, (a, b) in enumerate(self.edges):
            between = sorted(
                self.on_edge.get(index, []), key=lambda p: math.dist(self.points[a], self.points[p])
            )
            for u, v in pairwise([self._at(a), *between, self._at(b)]):
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
                face.append(self.points[u])
                u, v = v, self._next(u, v, leaving[v])
                if (u, v) == first:
                    break
            found.append(_without_straight_corners(np.array(face)))
        return found

    def _next(self, u: int, v: int, ends: list[int]) -> int:
        """Choose where the face on the left of u -> v goes on: along the first edge clockwise from v -> u."""
        if len(ends) == 1:
            return ends[0]
        back = self._angle(v, u)
        return min((w for w in ends if w != u), key=lambda w: float(_turn(back - self._angle(v, w))))

    def _possible_cuts(self) -> list[_Cut]:
        """List the cuts that meet nothing but the outline at their end, each resolving its corner."""
        reflex = np.array(sorted(self.reflex), dtype=np.intp)
        if not len(reflex):
            return []
        zero, inside = self.zero[reflex], self.inside[reflex]
        row, end = self._corners_ahead(reflex)
        count = len(row)
        toward = self.xy[end] - self.xy[reflex[row]]
        length = np.hypot(toward[:, 0], toward[:, 1])
        extension = np.concatenate([zero + math.pi, zero + inside - math.pi])
        rays = np.concatenate([
            toward / length[:, None], np.stack([np.cos(extension), np.sin(extension)], axis=1),
        ])  # fmt: skip
        row = np.concatenate([row, np.tile(np.arange(len(reflex)), 2)])
        origins = self.xy[reflex[row]]
        reach, edge = _first_hit(origins, rays, self.ends)
        angle = np.arctan2(rays[:, 1], rays[:, 0])
        direction = _turn(angle - zero[row])
        sharpest = np.minimum(direction, inside[row] - direction)

        # Cuts to corners that are seen. They must arrive inside the end's corner: contours may touch there.
        back = _turn(angle[:count] + math.pi - self.zero[end])
        seen = (reach[:count] > length - _SAME) & (back < self.inside[end])
        both = (
            seen & (self.inside[end] > math.pi + _FLAT) & _convex_both_sides(back, self.inside[end], length)
        )
        found = []
        alone = length / _sharpness(np.minimum(sharpest[:count], np.minimum(back, self.inside[end] - back)))
        for k in np.flatnonzero(seen).tolist():
            cost = float(alone[k]) * (_TWO_FOR_ONE if both[k] else 1.0)
            far, corner, other = float(length[k]), int(reflex[row[k]]), int(end[k])
            found.append(_Cut(cost, far, corner, other, self.points[other], float(alone[k])))

        # Extensions: there are always two, so every corner can be resolved.
        stop = origins + reach[:, None] * rays
        along = np.arctan2(*(self.ends[edge, 2:] - self.ends[edge, :2]).T[::-1])
        arrival = np.mod(angle - along, math.pi)
        arrival = np.minimum(arrival, math.pi - arrival)
        alone = _INSERTION * reach / _sharpness(np.minimum(sharpest, arrival))
        for k in range(count, len(rays)):
            x, y = stop[k].tolist()
            cost = float(alone[k])
            found.append(_Cut(cost, float(reach[k]), int(reflex[row[k]]), -1, (x, y), cost))
        return found

    def _corners_ahead(self, reflex: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """List pairs (row of a reflex corner, corner to which a cut would resolve it), the nearest ones."""
        rows, ends = [], []
        for row, corner in enumerate(reflex):
            toward = self.xy - self.xy[corner]
            distance = np.hypot(toward[:, 0], toward[:, 1])
            direction = _turn(np.arctan2(toward[:, 1], toward[:, 0]) - self.zero[corner])
            far = distance > _SAME
            length = np.where(far, distance, 1.0)
            ahead = np.flatnonzero(far & _convex_both_sides(direction, self.inside[corner], length))
            ahead = ahead[np.argsort(distance[ahead], kind="stable")[:_NEAREST]]
            rows.append(np.full(len(ahead), row))
            ends.append(ahead)
        return np.concatenate(rows), np.concatenate(ends)

    def _at(self, point: int) -> int:
        return int(self.node[point]) if point < self.corners else point

    def _angle(self, a: int, b: int) -> float:
        (ax, ay), (bx, by) = self.points[a], self.points[b]
        return math.atan2(by - ay, bx - ax)

    def _put_on_edge(self, point: tuple[float, float], edge: int) -> int:
        """Add a point to an edge, or take the point that is already there."""
        for known in (*self.edges[edge], *self.on_edge.get(edge, [])):
            if math.dist(self.points[known], point) < _SAME:
                return known
        self.points.append(point)
        self.on_edge.setdefault(edge, []).append(len(self.points) - 1)
        return len(self.points) - 1

    def _add(self, a: int, b: int) -> None:
        """Add a cut between two points, and note which reflex corners it resolves."""
        if len(self.edges) == len(self.ends):
            self.ends = np.concatenate([self.ends, np.empty_like(self.ends)])
        self.ends[len(self.edges)] = (*self.points[a], *self.points[b])
        self.edges.append((self._at(a), self._at(b)))
        slack = 2 * (_FLAT + _SAME / math.dist(self.points[a], self.points[b]))
        for corner, end in ((a, b), (b, a)):
            if corner in self.reflex:
                direction = float(_turn(self._angle(corner, end) - self.zero[corner]))
                if direction >= self.inside[corner]:
                    continue  # it arrives at another corner of the same place
                cuts = self.cuts_at.setdefault(corner, [])
                cuts.append(direction)
                stops = sorted([0.0, float(self.inside[corner]), *cuts])
                if max(high - low for low, high in pairwise(stops)) <= math.pi + slack:
                    self.reflex.discard(corner)


def _with_touching_corners(contours: Sequence[FloatArray]) -> list[FloatArray]:
    """Add to each contour the corners of others, or its own, that lie in the middle of its edges."""
    corners = np.concatenate(list(contours))
    found = []
    for contour in contours:
        along = np.roll(contour, -1, axis=0) - contour
        length = np.hypot(along[:, 0], along[:, 1])
        step = max(1, _BATCH // len(corners))
        edges, places, touching = [], [], []
        for k in range(0, len(contour), step):
            unit = along[k : k + step] / length[k : k + step, None]
            offset = corners[None] - contour[k : k + step, None]
            place = np.sum(offset * unit[:, None], axis=2)
            aside = np.abs(offset[..., 0] * unit[:, None, 1] - offset[..., 1] * unit[:, None, 0])
            edge, corner = np.nonzero(
                (aside < _SAME) & (place > _SAME) & (place < length[k : k + step, None] - _SAME)
            )
            edges.append(edge + k)
            places.append(place[edge, corner])
            touching.append(corners[corner])
        edge, place = np.concatenate(edges), np.concatenate(places)
        if len(edge):
            order = np.lexsort((place, edge))
            contour = np.insert(contour, edge[order] + 1, np.concatenate(touching)[order], axis=0)
            contour = contour[np.hypot(*(contour - np.roll(contour, 1, axis=0)).T) > _SAME]
        found.append(contour)
    return found


def _nodes(xy: FloatArray) -> NDArray[np.intp]:
    """Map each point to the first of the points at its place."""
    along = xy @ np.array([0.8, 0.6])
    order = np.argsort(along, kind="stable")
    node = np.arange(len(xy))
    for step in range(1, len(xy)):
        near = along[order[step:]] - along[order[:-step]] < 2 * _SAME
        if not near.any():
            break
        a, b = order[:-step][near], order[step:][near]
        same = np.hypot(*(xy[a] - xy[b]).T) < _SAME
        for low, high in zip(np.minimum(a, b)[same], np.maximum(a, b)[same], strict=True):
            node[high] = min(node[high], node[low])
    return node


def _groups(node: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """List the corners that share a place, for each place with more than one."""
    shared = np.flatnonzero(np.bincount(node) > 1)
    return [np.flatnonzero(node == first) for first in shared]


def _first_hit(
    origins: FloatArray, rays: FloatArray, ends: FloatArray
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Find how far rays (n, 2) get before an edge (m, 4) stops them, and which; an edge's end stops too."""
    reach, edge = np.full(len(rays), np.inf), np.zeros(len(rays), dtype=np.intp)
    if not len(ends):
        return reach, edge
    ax, ay = ends[:, 0], ends[:, 1]
    ux, uy = ends[:, 2] - ax, ends[:, 3] - ay
    length = np.hypot(ux, uy)
    slack = _SAME / length
    step = max(1, _BATCH // len(ends))
    for k in range(0, len(rays), step):
        part = slice(k, k + step)
        dx, dy = rays[part, 0, None], rays[part, 1, None]
        ox, oy = ax - origins[part, 0, None], ay - origins[part, 1, None]
        cross = dx * uy - dy * ux
        skew = np.abs(cross) > _FLAT * length
        cross = np.where(skew, cross, 1.0)
        far = (ox * uy - oy * ux) / cross
        place = (ox * dy - oy * dx) / cross
        far[~(skew & (place >= -slack) & (place <= 1 + slack) & (far > _SAME))] = np.inf
        edge[part] = np.argmin(far, axis=1)
        reach[part] = far[np.arange(len(far)), edge[part]]
    return reach, edge


def _convex_both_sides(direction: FloatArray, inside: FloatArray, length: FloatArray) -> NDArray[np.bool_]:
    """Tell whether a cut leaves both sides of a corner convex, within _SAME at its far end."""
    slack = _FLAT + _SAME / length
    return (direction >= inside - math.pi - slack) & (direction <= math.pi + slack)


def _sharpness(angle: FloatArray) -> FloatArray:
    return np.sin(np.clip(angle, 1e-3, math.pi / 2))


def _turn(angle: FloatArray | float) -> FloatArray:
    """Fold angles into (0, 2 pi]."""
    return 2 * math.pi - np.mod(-np.asarray(angle), 2 * math.pi)


def _without_straight_corners(outline: FloatArray) -> FloatArray:
    """Leave out the corners that lie within 1e-8 mm of the line between their neighbours."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return outline[np.abs(cross) > 1e-8 * np.hypot(*(before + after).T)]
