"""The inner loops of reading an attached pad: where lines enter a body of flat faces, and what the taxels feel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactsim.attach.pad_surface import Lines, dot
from tactsim.core.compiling import Reals1D, Reals2D, Reals3D, compiled


class Carried(NamedTuple):
    """What a layer carries on a lattice of cells.

    forces: (columns, rows) N along the load, evenly on the covered part of each cell. shift: (2, cells) or (2, 1), in
    cells along u and v from the cell's middle to that of the covered part. u: (columns + 1,), v: (rows + 1,) mm, edges.
    """

    forces: Reals2D
    shift: Reals2D
    u: Reals1D
    v: Reals1D


class Taxels(NamedTuple):
    """Where a pad's taxels are, mm: the edges of its columns and rows, (n, 2), and of all of it along u and v, (2, 2).

    pitch: (2,) mm along u and v. sigma: mm, of the point spread, 0 for none. stiffness: N/mm^3 of the layer on them.
    """

    columns: Reals2D
    rows: Reals2D
    bounds: Reals2D
    pitch: Reals1D
    sigma: float
    stiffness: float


STEEP = 0.2  # a facet whose normal has a smaller part along the surface's normal is a wall: steeper than 78 degrees
SMALL = 1e-12
_ALIKE = 0.7  # walls at a smaller angle than 45 degrees cut a cell as one
_LEAST = 1e-9  # of a cell: less than this is not covered
_CELL = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
_NARROW = 1e-4  # of a cell, to which forces are spread at least
_BLOCK = 512  # lines at a time
_FAR = 8  # standard deviations of the point spread, beyond which it is less than what a double resolves
_STEPS = 64  # of a table for each of them
_AT = np.arange(-_FAR * _STEPS, _FAR * _STEPS + 1) / _STEPS
_BELOW = np.array([math.erfc(-z / math.sqrt(2)) / 2 for z in _AT])
_PASSED = _AT * _BELOW + np.exp(-_AT * _AT / 2) / math.sqrt(2 * math.pi)


@compiled(called_from_python=False)
def clip(
    corners: Reals2D, count: int, outside: float, across_u: float, across_v: float, kept: Reals2D
) -> int:
    """Cut a part of a cell, a convex polygon, by a straight wall.

    corners: the first `count` of (m, 2), in cells from the cell's middle. outside: mm by which the middle lies outside
    the wall. across_u, across_v: mm, how far one goes outwards along u and v of the cell. Fills kept, as corners, and
    returns how many it has.
    """
    left = 0
    for i in range(count):
        u, v = corners[i, 0], corners[i, 1]
        next_u, next_v = corners[(i + 1) % count, 0], corners[(i + 1) % count, 1]
        here, there = outside + u * across_u + v * across_v, outside + next_u * across_u + next_v * across_v
        if here <= 0:
            kept[left, 0], kept[left, 1] = u, v
            left += 1
        if (here <= 0) != (there <= 0):
            way = here / (here - there)
            kept[left, 0], kept[left, 1] = u + way * (next_u - u), v + way * (next_v - v)
            left += 1
    return left


@compiled(called_from_python=False)
def middle(corners: Reals2D, count: int) -> tuple[float, float, float]:
    """Give the area of a convex polygon, the first `count` of corners (m, 2), and where its middle is along u and v."""
    area = u = v = 0.0
    for i in range(count):
        j = (i + 1) % count
        turn = corners[i, 0] * corners[j, 1] - corners[j, 0] * corners[i, 1]
        area += turn / 2
        u += turn * (corners[i, 0] + corners[j, 0]) / 6
        v += turn * (corners[i, 1] + corners[j, 1]) / 6
    if area < _LEAST:
        return 0.0, 0.0, 0.0
    return area, u / area, v / area


@compiled(called_from_python=False)
def cut(outside: float, across_u: float, across_v: float) -> tuple[float, float, float]:
    """Cut a cell by a wall, as `clip`: which share is inside, and where its middle is along u and v, in cells."""
    if abs(outside) >= (abs(across_u) + abs(across_v)) / 2:
        return 1.0 if outside < 0 else 0.0, 0.0, 0.0
    kept = np.empty((5, 2))
    return middle(kept, clip(_CELL.copy(), 4, outside, across_u, across_v, kept))


@compiled(called_from_python=False)
def shared(
    share: float, u: float, v: float, other: float, other_u: float, other_v: float
) -> tuple[float, float, float]:
    """Tell which part of a cell two bodies cover both, each by its share and the shift of its covered part, in cells.

    Returns its share, and where its middle is along u and v, in cells. Covered parts are taken for upright rectangles;
    how much two share is exact where one wall bounds each and the walls are parallel, too.
    """
    left, right = max(u, other_u, 0.0) * 2 - 0.5, min(u, other_u, 0.0) * 2 + 0.5
    low, high = max(v, other_v, 0.0) * 2 - 0.5, min(v, other_v, 0.0) * 2 + 0.5
    least, most = max(share + other - 1, 0.0), min(share, other)
    long = math.sqrt((u * u + v * v) * (other_u * other_u + other_v * other_v))
    alike = (u * other_u + v * other_v) / max(long, SMALL)
    both = min(max(max(right - left, 0.0) * max(high - low, 0.0), least), most)
    if alike > _ALIKE:
        both = most
    elif alike < -_ALIKE:
        both = least
    return both, (left + right) / 2, (low + high) / 2


@compiled()
def unite(gap: Reals2D, share: Reals2D, shift: Reals3D) -> None:
    """Leave to each of g bodies what of n cells no nearer one covers, so that no point counts twice.

    gap (g, n) mm, share (g, n) and shift (g, 2, n) in cells, as in `Cover`; share and shift are changed.
    """
    bodies, cells = gap.shape
    done = np.empty(bodies, dtype=np.bool_)
    for i in range(cells):
        covering = 0
        for body in range(bodies):
            done[body] = share[body, i] <= 0 or not np.isfinite(gap[body, i])
            covering += not done[body]
        if covering < 2:
            continue
        taken, taken_u, taken_v = 0.0, 0.0, 0.0
        for _ in range(covering):
            nearest = -1
            for body in range(bodies):
                if not done[body] and (nearest < 0 or gap[body, i] < gap[nearest, i]):
                    nearest = body
            done[nearest] = True
            own, u, v = share[nearest, i], shift[nearest, 0, i], shift[nearest, 1, i]
            both, both_u, both_v = shared(taken, taken_u, taken_v, own, u, v)
            left = own - both
            if left < _LEAST:
                share[nearest, i] = 0.0
                continue
            u = min(max((own * u - both * both_u) / left, -0.5), 0.5)
            v = min(max((own * v - both * both_v) / left, -0.5), 0.5)
            share[nearest, i], shift[nearest, 0, i], shift[nearest, 1, i] = left, u, v
            taken_u = (taken * taken_u + left * u) / (taken + left)
            taken_v = (taken * taken_v + left * v) / (taken + left)
            taken += left


@compiled(called_from_python=False)
def project(normals: Reals2D, face: int, vectors: Reals2D, parts: Reals1D) -> None:
    """Fill parts (k,) with those along a normal of (f, 3) of vectors (3, k)."""
    x, y, z = normals[face, 0], normals[face, 1], normals[face, 2]
    along_x, along_y, along_z = vectors[0], vectors[1], vectors[2]
    for i in range(len(parts)):
        parts[i] = x * along_x[i] + y * along_y[i] + z * along_z[i]


@compiled(ordered=False, called_from_python=False)
def ends(values: Reals1D) -> tuple[float, float]:
    """Give the least and the largest of n values."""
    low, high = np.inf, -np.inf
    for i in range(len(values)):
        low, high = min(low, values[i]), max(high, values[i])
    return low, high


@compiled(called_from_python=False)
def enter(
    normals: Reals2D,
    offsets: Reals1D,
    lines: Lines,
    steep: float,
    before: Reals1D,
    gap: Reals1D,
    share: Reals1D,
    shift: Reals2D,
) -> None:
    """Find where lines enter a body of flat faces: at the last face that they pass inwards, within the walls.

    A wall that leans over the pad is farther out the deeper the surface lies in the body. What touches it there, less
    and less, adds up to what touches an upright wall that stands where this one is halfway up to the surface.
    normals (f, 3), offsets (f,) mm: the faces. steep: what a wall is, as `STEEP`. before: (n,) mm where the line enters
    what else bounds the body, or (0,). Fills gap (n,) mm, share (n,) and shift (2, n) as in `Cover`.

    As one sees it along the line, a wall meets the face entered, `last`, in an edge, across which in the surface lies
    m = wall - last (wall . line) / (last . line).
    """
    points, ways, span_u, span_v = lines.points, lines.normals, lines.span_u, lines.span_v
    faces, own, bounded = len(offsets), len(ways) > 1, len(before) > 0
    lowest, highest = np.empty(faces), np.empty(faces)
    way, rates = np.empty((3, len(ways))), np.empty(len(ways))
    way[:] = ways.T
    for face in range(faces):
        project(normals, face, way, rates)
        lowest[face], highest[face] = ends(rates)
    limit = -steep if bounded or lowest.min() < -steep else -SMALL
    wall = highest >= limit
    share[:] = 1.0
    shift[:] = 0.0
    # The inner loops are over lines, some at once, of which a block stays in the nearest cache.
    at = np.empty((3, _BLOCK))
    rates, heights, outsides = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    lasts, entered, squares = np.empty(_BLOCK, dtype=np.int64), np.empty((3, _BLOCK)), np.empty(_BLOCK)
    part, spare = np.empty((faces + 4, 2)), np.empty((faces + 4, 2))
    for start in range(0, len(points), _BLOCK):
        size = min(_BLOCK, len(points) - start)
        rate, height, most = rates[:size], heights[:size], outsides[:size]
        last, entry = lasts[:size], gap[start : start + size]
        last[:] = -1
        entry[:] = most[:] = -np.inf
        at[:, :size] = points[start : start + size].T
        if own:
            way[:, :size] = ways[start : start + size].T
        for face in range(faces):
            if lowest[face] >= limit:
                continue
            offset = offsets[face]
            project(normals, face, at, height)
            if own:
                project(normals, face, way, rate)
            else:
                rate[:] = lowest[face]
            for i in range(size):
                ahead = (offset - height[i]) / rate[i]
                later = (rate[i] < limit) & (ahead > entry[i])
                entry[i] = ahead if later else entry[i]
                last[i] = face if later else last[i]
        for i in range(size):
            line = start + i if own else 0
            if bounded and before[start + i] > entry[i]:
                entry[i], last[i] = before[start + i], -1
            # The normal of what is entered, divided by its part along the line. What is no face lies along the surface.
            facing = dot(normals, last[i], ways, line) if last[i] >= 0 else 1.0
            squares[i] = 1 / (facing * facing)
            for k in range(3):
                entered[k, i] = normals[last[i], k] / facing if last[i] >= 0 else ways[line, k]
        for face in range(faces):
            if not wall[face]:
                continue
            offset, x, y, z = offsets[face], normals[face, 0], normals[face, 1], normals[face, 2]
            project(normals, face, at, height)
            if own:
                project(normals, face, way, rate)
            else:
                rate[:] = lowest[face]
            for i in range(size):
                outside = entry[i] * rate[i] + height[i] - offset
                outside -= min(rate[i], 0.0) * min(entry[i], 0.0) / 2
                alike = x * entered[0, i] + y * entered[1, i] + z * entered[2, i]
                outside /= math.sqrt(max(1 + rate[i] * (rate[i] * squares[i] - 2 * alike), SMALL))
                most[i] = outside if (rate[i] >= limit) & (outside > most[i]) else most[i]
        for k in range(size):
            i = start + k
            line = i if own else 0
            if most[k] == -np.inf or not np.isfinite(gap[i]):
                continue
            # A wall farther from the middle of a cell than its sides' lengths allow leaves it whole, or bare.
            if 2 * most[k] * most[k] > dot(span_u, line, span_u, line) + dot(span_v, line, span_v, line):
                share[i] = 0.0 if most[k] > 0 else 1.0
                continue
            part[:4], count = _CELL, 4
            for face in range(faces):
                steepness = dot(normals, face, ways, line)
                if not wall[face] or steepness < limit:
                    continue
                outside = gap[i] * steepness + dot(normals, face, points, i) - offsets[face]
                outside -= min(steepness, 0.0) * min(gap[i], 0.0) / 2
                across_u, across_v = dot(normals, face, span_u, line), dot(normals, face, span_v, line)
                for axis in range(3):
                    across_u -= steepness * entered[axis, k] * span_u[line, axis]
                    across_v -= steepness * entered[axis, k] * span_v[line, axis]
                if 2 * outside > -abs(across_u) - abs(across_v):
                    count = clip(part, count, outside, across_u, across_v, spare)
                    part, spare = spare, part
            share[i], shift[0, i], shift[1, i] = middle(part, count)
            if bounded or not 0 < share[i] < 1:
                continue
            # The gap in the middle of the covered part, where another face may be the last.
            gap[i] = -np.inf
            for face in range(faces):
                steepness = dot(normals, face, ways, line)
                if steepness < limit:
                    across_u, across_v = dot(normals, face, span_u, line), dot(normals, face, span_v, line)
                    there = dot(normals, face, points, i) + shift[0, i] * across_u + shift[1, i] * across_v
                    gap[i] = max(gap[i], (offsets[face] - there) / steepness)


@compiled(called_from_python=False)
def passed(distance: float, sigma: float) -> float:
    """Integrate the normal distribution's function up to `distance` mm from its middle, mm."""
    if distance >= _FAR * sigma:
        return distance
    if distance <= -_FAR * sigma:
        return 0.0
    place = (distance / sigma + _FAR) * _STEPS
    i = min(int(place), len(_AT) - 2)
    # Between two places of the table a cubic with its values and slopes, within 2e-10.
    before, after, rise = place - i, i + 1 - place, _PASSED[i + 1] - _PASSED[i]
    bend = after * (_BELOW[i] / _STEPS - rise) + before * (rise - _BELOW[i + 1] / _STEPS)
    return sigma * (_PASSED[i] + before * (rise + after * bend))


@compiled(called_from_python=False)
def reach(at: float, bounds: Reals1D, taxels: Reals2D, sigma: float, felt: Reals1D) -> None:
    """Tell what each taxel feels of a force of 1 N/mm all along the axis up to `at`, or the pad's end: fills felt, N.

    at: mm. bounds: (2,) mm, of the pad. taxels: (taxels, 2) mm. sigma: mm. felt: (taxels,). What lies before the pad's
    beginning is not felt either: that is left to the caller, who takes the difference of two ends.
    """
    at, end, beyond = min(max(at, bounds[0]), bounds[1]), np.inf, 0.0
    for taxel in range(len(taxels)):
        low, high = taxels[taxel, 0], taxels[taxel, 1]
        before = beyond if low == end else passed(at - low, sigma)  # neighbours without a gap share an edge
        end, beyond = high, passed(at - high, sigma)
        felt[taxel] = before - beyond


@compiled(called_from_python=False)
def feel(
    edges: Reals1D, reached: Reals2D, cell: int, shift: float, bounds: Reals1D, taxels: Reals2D, sigma: float,
    spare: Reals1D, felt: Reals1D,
) -> float:  # fmt: skip
    """Tell along one axis what the taxels feel of 1 N that is spread evenly over the covered part of a cell.

    edges: (cells + 1,) mm. reached: (cells + 1, taxels) N, as `reach` gives for each edge. shift: in cells, from the
    cell's middle to that of the covered part, which begins at the side that it is shifted to.
    bounds: (2,) mm, of the pad. taxels: (taxels, 2) mm. sigma: mm. spare: as felt. Fills felt (taxels,) N and
    returns how much of the force is on the pad.
    """
    low, high = edges[cell], edges[cell + 1]
    bare = min(2 * abs(shift), 1 - _NARROW) * (high - low)
    count = len(felt)
    if bare == 0:
        for taxel in range(count):
            felt[taxel] = reached[cell + 1, taxel] - reached[cell, taxel]
    elif shift > 0:
        low += bare
        reach(low, bounds, taxels, sigma, spare)
        for taxel in range(count):
            felt[taxel] = reached[cell + 1, taxel] - spare[taxel]
    else:
        high -= bare
        reach(high, bounds, taxels, sigma, spare)
        for taxel in range(count):
            felt[taxel] = spare[taxel] - reached[cell, taxel]
    for taxel in range(count):
        felt[taxel] /= high - low
    return (min(max(high, bounds[0]), bounds[1]) - min(max(low, bounds[0]), bounds[1])) / (high - low)


@compiled()
def spread_forces(carried: Carried, taxels: Taxels, image: Reals2D) -> float:
    """Spread the forces on a lattice of cells over the taxels; what lies beyond the pad is not felt.

    Adds N to image (rows, columns) and returns the force on the pad, N.
    """
    forces, shift, u, v = carried.forces, carried.shift, carried.u, carried.v
    columns, rows, sigma = taxels.columns, taxels.rows, taxels.sigma
    bounds_u, bounds_v = taxels.bounds[0], taxels.bounds[1]
    across, up, some = len(u) - 1, len(v) - 1, shift.shape[1] > 1
    reached_u, reached_v = np.empty((len(u), len(columns))), np.empty((len(v), len(rows)))
    for edge in range(len(u)):
        reach(u[edge], bounds_u, columns, sigma, reached_u[edge])
    for edge in range(len(v)):
        reach(v[edge], bounds_v, rows, sigma, reached_v[edge])
    whole_u, whole_v = np.empty((across, len(columns))), np.empty((up, len(rows)))
    on_u, on_v = np.empty(across), np.empty(up)
    felt_u, felt_v = np.empty(len(columns)), np.empty(len(rows))
    spare_u, spare_v = np.empty(len(columns)), np.empty(len(rows))
    for column in range(across):
        on_u[column] = feel(u, reached_u, column, 0.0, bounds_u, columns, sigma, spare_u, whole_u[column])
    for row in range(up):
        on_v[row] = feel(v, reached_v, row, 0.0, bounds_v, rows, sigma, spare_v, whole_v[row])
    inside = 0.0
    strip = np.empty(len(rows))
    for column in range(across):
        strip[:] = 0.0
        for row in range(up):
            force, cell = forces[column, row], column * up + row
            if force == 0:
                continue
            if some and (shift[0, cell] != 0 or shift[1, cell] != 0):
                on = feel(u, reached_u, column, shift[0, cell], bounds_u, columns, sigma, spare_u, felt_u)
                on *= feel(v, reached_v, row, shift[1, cell], bounds_v, rows, sigma, spare_v, felt_v)
                inside += force * on
                for i in range(len(rows)):
                    for j in range(len(columns)):
                        image[i, j] += force * felt_v[i] * felt_u[j]
            else:
                inside += force * on_u[column] * on_v[row]
                for i in range(len(rows)):
                    strip[i] += force * whole_v[row, i]
        for i in range(len(rows)):
            for j in range(len(columns)):
                image[i, j] += strip[i] * whole_u[column, j]
    return inside
