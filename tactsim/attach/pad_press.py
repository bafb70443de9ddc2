"""Press a rigid body into the layer on a pad's surface: find where it touches, and let the layer carry its load there.

A lattice of few cells finds what touches; a fine one that covers just this gives the pressure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactsim.attach.geom_gap import FACETED, Body, Pose, among, union_gaps
from tactsim.attach.layer_balance import approach, balance
from tactsim.attach.pad_kernels import Carried, Taxels, spread_forces
from tactsim.attach.pad_surface import Face, Lines, dot, lay_lines, place, steps
from tactsim.core.compiling import Bools1D, Int32s2D, Ints1D, Reals1D, Reals2D, Reals3D, compiled

_LINES = (24, 64)  # of the lattice that is laid over what touches, along each axis: at least and at most
_LINES_OF_SEVERAL = 48  # at least, over a body of several geoms, each of which is a part of it
_LINES_OF_STEPS = 200  # at most, on a surface that may jump, which the lattice samples
_LINES_A_PITCH_OF_STEPS = 25
_LINES_A_PITCH = 3  # between the two
_FEW, _ENOUGH = 64, 512  # of its cells carry what touches: too few of a sliver, so many then
_FINEST = 8.0  # times as many lines as else, over a sliver
_ALIKE = 0.2  # of the depth, by which a finer lattice may correct it
_SEARCH = 10  # of the lattices that find what touches
_SEARCHES = 16  # lattices, coarse and fine
# By so much of its size a lattice is widened on a side that touches, once one was narrowed: less than would be narrowed
# again, so that a slanting edge is not found by turns too short and too long.
_AGAIN = 0.3
_OVER_CHORD = math.pi / 2  # length along a round face over that straight through it, at most
_POINT = 0.01  # of a pitch: what touches less than this is not looked at more closely
_MARGIN = 1.0  # mm about the contact points where the search begins
_GRAZING = 0.1  # of a curved pad, a point whose normal has a smaller part along the contact's touches nothing
_RIM = 0.25  # mm from the face's rim within which a contact point may lie
_OFF = 2.0  # mm from the face within which one is on it
# A load along which the face's normal has a smaller part presses the rim or another side of the geom.
_FACING = 0.7
_NONE = 1e-300  # N
_MM = 1e3  # mm in a metre
_HELD = 1e-9  # rad for a unit of all joints, below which they do not turn a body
# Contact points wider apart than this share of the face's touching part say how the load is turned.
_SPREAD = 0.01


class Load(NamedTuple):
    """What a rigid body does to a pad, in the pad's frame.

    force: N, normal. direction: (3,) from the pad towards the body. points: (k, 3) mm, where the pad's geoms are
    touched. centre: (3,) mm, where the force acts. axes: (2, 3), unit vectors about which the body turns until the
    pressure is centred there, or 0. spreads: (2,) mm, how far the contact points reach from side to side of each axis.
    """

    force: float
    direction: Reals1D
    points: Reals2D
    centre: Reals1D
    axes: Reals2D
    spreads: Reals1D


class Contacts(NamedTuple):
    """The k contacts on a pad, as MuJoCo has them.

    forces: (k, 6), as mj_contactForce gives them, on the second of geoms (k, 2). frames (k, 9), with the first axis
    from the first geom to the second; points (k, 3) m, halfway between the two, which are gaps (k,) m apart. bodies: of
    each geom of the model its rigid body. places: which it is of its body's geoms, as `Body` lists them, else -1.
    """

    forces: Reals2D
    geoms: Int32s2D
    frames: Reals2D
    points: Reals2D
    gaps: Reals1D
    bodies: Ints1D
    places: Ints1D


class Frames(NamedTuple):
    """Where p geoms are: their numbers (p,), and of each geom of the model rotations (g, 9) and positions (g, 3) m.

    rotation: (3, 3) and origin: (3,) m, the frame of the pad. turning: (n, 3) rad a unit, in the pad's frame, how each
    of n joints turns the body of the geoms on the pad.
    """

    geoms: Ints1D
    rotations: Reals2D
    positions: Reals2D
    rotation: Reals2D
    origin: Reals1D
    turning: Reals2D


@compiled(called_from_python=False)
def uncorrelate(axes: Reals2D, rows: Reals2D) -> Reals1D:
    """Turn two axes (2, 3) in their plane until the parts of m vectors (m, 3) along them are uncorrelated.

    Changes axes. Returns the root of the summed squares of the parts along each: (2,), the singular values.
    """
    squares = np.zeros(3)
    for i in range(len(rows)):
        x, y = dot(rows, i, axes, 0), dot(rows, i, axes, 1)
        squares += np.array([x * x, y * y, x * y])
    angle = math.atan2(2 * squares[2], squares[0] - squares[1]) / 2
    first, second = axes[0].copy(), axes[1].copy()
    axes[0] = math.cos(angle) * first + math.sin(angle) * second
    axes[1] = math.cos(angle) * second - math.sin(angle) * first
    squares[:] = 0.0
    for i in range(len(rows)):
        squares[0] += dot(rows, i, axes, 0) ** 2
        squares[1] += dot(rows, i, axes, 1) ** 2
    return np.sqrt(squares[:2])


@compiled(called_from_python=False)
def load_of(forces: Reals1D, pushes: Reals2D, points: Reals2D, touched: Reals2D, turning: Reals2D) -> Load:
    """Add up k contacts of a body, in the pad's frame, as `turn_contacts` gives them.

    forces: (k,) N. pushes: (k, 3) N. points, touched: (k, 3) mm. turning: (n, 3) rad a unit, as in `Frames`.
    Where joints let the body turn, the balance of moments alone says where the load is centred, and MuJoCo keeps that
    balance, if contact points lie on both sides. Where joints hold it, its centre is that of MuJoCo's few points.
    """
    direction, centre, force = np.zeros(3), np.zeros(3), forces.sum()
    for i in range(len(forces)):
        for k in range(3):
            direction[k] += pushes[i, k]
            centre[k] += forces[i] / force * points[i, k]
    direction /= math.sqrt((direction**2).sum())
    axes, least = np.zeros((2, 3)), np.abs(direction).argmin()
    axes[0, least] = 1.0
    axes[0] = np.cross(axes[0], direction)
    axes[0] /= math.sqrt((axes[0] ** 2).sum())
    axes[1] = np.cross(direction, axes[0])
    turns = uncorrelate(axes, turning)
    for i in range(2):
        if turns[i] < _HELD:
            axes[i] = 0.0
    levers = np.empty_like(points)  # how far a turn about each axis brings each point nearer
    for i in range(len(points)):
        levers[i] = np.cross(direction, points[i] - centre)
    spreads = uncorrelate(axes, levers)
    return Load(force, direction, touched, centre, axes, spreads)


@compiled(called_from_python=False)
def turn_contacts(
    contacts: Contacts, frames: Frames, number: int
) -> tuple[Reals1D, Reals2D, Reals2D, Reals2D, Reals2D, Ints1D]:
    """Turn those of the contacts that press the pad and that body `number` makes into the pad's frame, k of them.

    Returns the normal forces (k,) N, the same from the pad (k, 3) N, the friction on the pad (k, 3) N, the points
    where they act and those of the pad's geom that are touched, (k, 3) mm, and which of the body's geoms touch (k,).
    """
    most, count = len(contacts.forces), 0
    forces, geoms = np.empty(most), np.empty(most, dtype=np.int64)
    pushes, shears = np.empty((most, 3)), np.empty((most, 3))
    points, touched = np.empty((most, 3)), np.empty((most, 3))
    for row in range(most):
        first, second = contacts.geoms[row, 0], contacts.geoms[row, 1]
        ahead = contacts.bodies[second] == number
        force, sign = contacts.forces[row], 1.0 if ahead else -1.0
        if not (force[0] > 0 and (ahead or contacts.bodies[first] == number)):
            continue
        frame = sign * contacts.frames[row].reshape(3, 3) @ frames.rotation
        pushes[count], shears[count] = force[0] * frame[0], -force[1] * frame[1] - force[2] * frame[2]
        points[count] = _MM * (contacts.points[row] - frames.origin) @ frames.rotation
        touched[count] = points[count] - _MM * contacts.gaps[row] / 2 * frame[0]
        forces[count], geoms[count] = force[0], contacts.places[second if ahead else first]
        count += 1
    return forces[:count], pushes[:count], shears[:count], points[:count], touched[:count], geoms[:count]


@compiled(called_from_python=False)
def group_contacts(pushes: Reals2D) -> Ints1D:
    """Put those of a body's k contacts together that are made in about one direction: the number of each's group, (k,).

    pushes: (k, 3) N from the pad. Each group is that of the largest force which is in none yet.
    """
    groups, left = np.full(len(pushes), -1), np.sqrt((pushes**2).sum(axis=1))
    ways, group = pushes / left.reshape(-1, 1), 0
    while left.any():
        largest = left.argmax()
        for i in range(len(pushes)):
            if groups[i] < 0 and dot(ways, i, ways, largest) > _FACING:
                groups[i], left[i] = group, 0.0
        group += 1
    return groups


@compiled(called_from_python=False)
def pose_of(frames: Frames) -> Pose:
    """Put the frames of geoms into the pad's."""
    count = len(frames.geoms)
    rotations, positions = np.empty((count, 3, 3)), np.empty((count, 3))
    for i, geom in enumerate(frames.geoms):
        rotations[i] = frames.rotation.T @ frames.rotations[geom].reshape(3, 3)
        positions[i] = _MM * (frames.positions[geom] - frames.origin) @ frames.rotation
    return Pose(rotations, positions)


@compiled(called_from_python=False)
def sunken(pose: Pose, load: Load, depth: float, turn: Reals1D) -> Pose:
    """Move a body by what balances a load, so that it sinks `depth` mm in; turn: (3,) rad about the load's centre.

    The turn is that of the surface about the body: the body turns the other way.
    """
    turning, angle = np.eye(3), math.sqrt((turn**2).sum())
    if angle > 0:
        x, y, z = turn[0] / angle, turn[1] / angle, turn[2] / angle
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turning += (1 - math.cos(angle)) * (across @ across) - math.sin(angle) * across  # Rodrigues' formula
    rotations = np.empty_like(pose.rotations)
    for geom in range(len(rotations)):
        rotations[geom] = turning @ pose.rotations[geom]
    positions = (pose.positions - load.centre) @ turning.T + (load.centre - depth * load.direction)
    return Pose(rotations, positions)


@compiled(called_from_python=False)
def lay_lattice(face: Face, u: Reals1D, v: Reals1D) -> Lines:
    """Lay a line through each cell of a lattice, column by column: u (columns + 1,) and v (rows + 1,) mm, its edges."""
    columns, rows = len(u) - 1, len(v) - 1
    at_u, at_v = np.empty(rows * columns), np.empty(rows * columns)
    du, dv = u[1] - u[0], v[1] - v[0]
    for column in range(columns):
        for row in range(rows):
            at_u[column * rows + row], at_v[column * rows + row] = u[column] + du / 2, v[row] + dv / 2
    return lay_lines(face, at_u, at_v, du, dv)


@compiled(called_from_python=False)
def press_cells(
    face: Face,
    taxels: Taxels,
    body: Body,
    pose: Pose,
    load: Load,
    u: Reals1D,
    v: Reals1D,
    sunk: float,
    deep: float,
) -> tuple[Carried, Bools1D, Pose, float, float]:
    """Balance a load on a lattice of cells, whose edges are u (columns + 1,) and v (rows + 1,) mm.

    sunk: mm by which the body was moved along the load already. deep: mm that it sinks in, as far as is known. Returns
    also which of the body's geoms (p,) a line meets, how all lie where the load is balanced, how far the body is sunk
    there, and by how much more it would be without a turn.
    """
    columns, rows = len(u) - 1, len(v) - 1
    cells, du, dv, lines = rows * columns, u[1] - u[0], v[1] - v[0], lay_lattice(face, u, v)
    cover = union_gaps(body, pose, lines, face.depth + sunk, deep, min(du, dv))
    met, gap, shift = cover.cell, cover.gap, cover.shift
    line = met if len(lines.normals) > 1 else np.zeros_like(met)
    # A turn is measured in mm at half the length of what is looked at.
    length = max(du * columns, dv * rows) / 2
    turns = load.axes[load.spreads > _SPREAD * length] / length
    normals, basis = lines.normals[line], np.empty((1 + len(turns), len(met)))
    basis[0] = normals @ load.direction
    weight = taxels.stiffness * du * dv * lines.area[met] * cover.share * (basis[0] > _GRAZING)
    if len(turns) > 0:
        at = lines.points[met] - load.centre
        at += shift[0].reshape(-1, 1) * lines.span_u[line] + shift[1].reshape(-1, 1) * lines.span_v[line]
        basis[1:] = turns @ np.cross(at, normals).T  # normal . (turn cross offset)
    forces, moved = np.zeros(cells), np.zeros((2, cells))
    chosen = np.zeros(len(body.kind), dtype=np.bool_)
    chosen[cover.geom] = True
    if weight.sum() == 0:
        return Carried(forces.reshape(columns, rows), moved, u, v), chosen, pose, sunk, 0.0
    straight = approach(gap, weight, basis[0], load.force)
    motion = balance(gap, weight, basis, load.force, straight)
    carried = weight * np.maximum(motion @ basis - gap, 0.0) * basis[0]
    for i in range(len(met)):
        forces[met[i]] += carried[i]
        moved[0, met[i]] += carried[i] * shift[0, i]
        moved[1, met[i]] += carried[i] * shift[1, i]
    moved /= np.maximum(forces, _NONE)
    there = sunken(pose, load, motion[0], motion[1:] @ turns)
    return Carried(forces.reshape(columns, rows), moved, u, v), chosen, there, sunk + motion[0], straight


@compiled(called_from_python=False)
def widen(
    face: Face, body: Body, pose: Pose, sunk: float, met: Bools1D, low: Reals1D, high: Reals1D
) -> tuple[Reals1D, Reals1D]:
    """Widen low and high, (2,) mm, to all that is below the face of a body that is sunk until a load is balanced.

    A geom without a contact point, or an end of one, may stand so little higher that the layer carries it, too: met
    (p,) is changed. Of a cell the lowest point counts, as its neighbours' gaps tell it.
    """
    if len(met) == 1:
        return low, high
    gaps = np.empty((_SEARCH, _SEARCH))
    for geom in range(len(met)):
        middle, reach = place(face, pose.positions[geom : geom + 1])[0], _OVER_CHORD * body.radii[geom]
        first, last = np.maximum(middle - reach, face.low), np.minimum(middle + reach, face.high)
        size = (last - first) / _SEARCH
        if not (np.isfinite(size) & (size > 0)).all():
            continue
        alone = np.arange(len(met)) == geom
        u, v = np.linspace(first[0], last[0], _SEARCH + 1), np.linspace(first[1], last[1], _SEARCH + 1)
        lines = lay_lattice(face, u, v)
        cover = union_gaps(*among(body, pose, alone), lines, face.depth + sunk, sunk, size.min())
        gaps[:] = np.inf
        for i in range(len(cover.cell)):
            gaps[cover.cell[i] // _SEARCH, cover.cell[i] % _SEARCH] = cover.gap[i]
        for column in range(_SEARCH):
            for row in range(_SEARCH):
                here, falls = gaps[column, row], 0.0
                if here == np.inf:
                    continue
                for i in range(max(column - 1, 0), min(column + 2, _SEARCH)):
                    for j in range(max(row - 1, 0), min(row + 2, _SEARCH)):
                        if gaps[i, j] < np.inf:
                            falls = max(falls, gaps[i, j] - here)
                if here - falls / 2 < 0:
                    corner = np.array([u[column], v[row]])
                    low = np.minimum(low, np.maximum(corner - size, face.low))
                    high = np.maximum(high, np.minimum(corner + 2 * size, face.high))
                    met[geom] = True
    return low, high


@compiled(called_from_python=False)
def beside(face: Face, load: Load) -> bool:
    """Tell whether all contact points are beside the face: on another side of the geom, or past its rim."""
    points, way = load.points, load.direction
    laid = place(face, points)
    u, v = np.empty(9), np.empty(9)
    for i in range(len(points)):
        for j in range(9):
            u[j] = min(max(laid[i, 0] + (j % 3 - 1) * _RIM, face.low[0]), face.high[0])
            v[j] = min(max(laid[i, 1] + (j // 3 - 1) * _RIM, face.low[1]), face.high[1])
        lines = lay_lines(face, u, v, 1.0, 1.0)
        for j in range(9):
            normal = lines.normals[j if len(lines.normals) > 1 else 0]
            off = ((lines.points[j] - points[i]) ** 2).sum()
            if lines.area[j] > 0 and off < _OFF * _OFF and (normal * way).sum() >= _FACING:
                return False
    return True


@compiled(called_from_python=False)
def fine_lines(
    face: Face, taxels: Taxels, low: Reals1D, high: Reals1D, several: bool, finer: float
) -> tuple[Reals1D, Reals1D]:
    """Lay the edges of the lattice that gives the pressure over what lies between low and high, (2,) mm.

    finer: how many times as many lines as over what is no sliver.
    """
    least, count = float(_LINES_OF_SEVERAL if several else _LINES[0]), np.empty(2)
    for i in range(2):
        most, a_pitch = _LINES[1], _LINES_A_PITCH
        if steps(face, low, high, i):
            most, a_pitch = _LINES_OF_STEPS, _LINES_A_PITCH_OF_STEPS
        count[i] = min(max(np.ceil(a_pitch * (high[i] - low[i]) / taxels.pitch[i]), least), most) * finer
    u = np.linspace(low[0], high[0], int(count[0]) + 1)
    return u, np.linspace(low[1], high[1], int(count[1]) + 1)


@compiled(called_from_python=False)
def carry(face: Face, taxels: Taxels, body: Body, pose: Pose, load: Load) -> tuple[Carried, float, bool]:
    """Let the layer carry a load: what it carries, how far it gives way, mm, and whether all that touches was found.

    A coarse lattice is widened until nothing on its sides touches, then narrowed to what touches. A fine one that takes
    its place is widened and narrowed, too. All forces are 0 where the body touches beside the face alone.
    """
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for point in place(face, load.points):
        low, high = np.minimum(low, point), np.maximum(high, point)
    low = np.minimum(np.maximum(low - _MARGIN, face.low), face.high)
    high = np.minimum(np.maximum(high + _MARGIN, face.low), face.high)
    middle = place(face, load.centre.reshape(1, 3))[0]
    carried = Carried(np.zeros((1, 1)), np.zeros((2, 1)), low[:1].copy(), low[:1].copy())
    if beside(face, load) or (high <= low).any():
        return carried, 0.0, True
    parts, there, sunk, straight, fine, growth, finer, rough = body, pose, 0.0, 0.0, False, 1.0, 1.0, 0.0
    for _ in range(_SEARCHES):
        u, v = np.linspace(low[0], high[0], _SEARCH + 1), np.linspace(low[1], high[1], _SEARCH + 1)
        if fine:
            u, v = fine_lines(face, taxels, low, high, len(body.kind) > 1, finer)
            carried, met, there, sunk, straight = press_cells(
                face, taxels, parts, there, load, u, v, sunk, sunk
            )
        else:
            carried, met, there, sunk, straight = press_cells(face, taxels, body, pose, load, u, v, 0.0, sunk)
        size, cell = high - low, np.array([u[1] - u[0], v[1] - v[0]])
        first, last, count = np.full(2, np.inf), np.full(2, -np.inf), 0
        for column in range(len(u) - 1):
            for row in range(len(v) - 1):
                if carried.forces[column, row] != 0:
                    count += 1
                    first[0], last[0] = min(first[0], column), max(last[0], column)
                    first[1], last[1] = min(first[1], row), max(last[1], row)
        if last[0] < 0:  # too small to be seen
            seen = np.minimum(np.maximum(middle, low), high)
            low, high, fine = np.maximum(seen - cell, low), np.minimum(seen + cell, high), False
            continue
        below = (first == 0) & (low > face.low)
        above = (last == np.array([len(u) - 2, len(v) - 2])) & (high < face.high)
        if below.any() or above.any():
            low = np.maximum(low - growth * size * below, face.low)
            high = np.minimum(high + growth * size * above, face.high)
            continue
        # What touches, with as much as a cell of the search on every side.
        start, margin = low, size / _SEARCH
        low = np.maximum(start + first * cell - margin, start)
        high = np.minimum(start + (last + 1) * cell + margin, high)
        if (high - low < _POINT * taxels.pitch).all():
            return carried, 0.0, True
        if (high - low < size / 2).any():
            growth = _AGAIN
        elif fine and count < _FEW and finer < _FINEST and (parts.kind == FACETED).any():
            finer, rough = min(finer * math.sqrt(_ENOUGH / count), _FINEST), sunk
        elif fine:
            # A body that stands on its rim turns, and sinks, without end: that says nothing about the layer.
            found = finer == 1 or abs(sunk - rough) <= _ALIKE * abs(sunk)
            return carried, straight if load.spreads.any() else sunk, found
        else:
            fine, growth = True, _AGAIN
            low, high = widen(face, body, there, sunk, met, low, high)
            # A part of a cell that flat faces bound counts as met; what is round may lie between the lines.
            parts, there = among(body, there, met | (body.kind != FACETED))
    return carried, straight if load.spreads.any() else sunk, False


@compiled()
def press(
    face: Face, taxels: Taxels, body: Body, frames: Frames, contacts: Contacts, number: int
) -> tuple[Reals3D, Reals1D]:
    """Let the layer carry what a rigid body does in each direction, and the taxels feel it.

    number: the body's among those of the contacts. Returns what each taxel feels, (3, rows, columns) N: the normal
    force, and the friction along x and y, which is shared as that is. Then (8,): the normal force, what of it is on the
    pad and the friction along x, y and z, N, how many contacts carry force, of how many loads not all that touches was
    found, and how far the layer gives way, mm, where most of a force is on the pad.
    """
    images, sums = np.zeros((3, len(taxels.rows), len(taxels.columns))), np.zeros(8)
    forces, pushes, shears, points, touched, geoms = turn_contacts(contacts, frames, number)
    groups, pose = group_contacts(pushes), pose_of(frames)
    # A load is on all geoms that may touch the face, but for those that touch it another way.
    reach, other = math.sqrt(((face.high - face.low) ** 2).sum()), np.zeros(len(body.kind) + 1, np.bool_)
    for geom in range(len(body.kind)):
        other[geom] = math.sqrt((pose.positions[geom] ** 2).sum()) - reach > body.radii[geom]
    other[geoms] = True
    for group in range(max(groups) + 1 if len(groups) else 0):
        (rows,) = np.nonzero(groups == group)
        touching = ~other
        touching[geoms[rows]] = True
        load = load_of(forces[rows], pushes[rows], points[rows], touched[rows], frames.turning)
        shear = shears[rows].sum(axis=0)
        parts, there = among(body, pose, touching[:-1])
        carried, sunk, found = carry(face, taxels, parts, there, load)
        image = np.zeros(images[0].shape)
        inside = spread_forces(carried, taxels, image)
        image = np.maximum(image, 0)
        images[0] += image
        images[1] += shear[0] / load.force * image
        images[2] += shear[1] / load.force * image
        sums[0] += load.force
        sums[1] += inside
        sums[2:5] += shear
        sums[5] += len(rows)
        sums[6] += not found
        if inside > load.force / 2:
            sums[7] = max(sums[7], sunk)
    return images, sums
