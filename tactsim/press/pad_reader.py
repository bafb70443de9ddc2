"""Read a pad on a geom of a compiled MuJoCo model: what each geom that touches it does to its taxels.

MuJoCo says how large the force of each pair of touching geoms is and where it acts. An elastic layer on the pad's
surface (Winkler, as in docs/sensor.md) carries exactly that: the other geom's true shape, at its true pose, sinks in
and turns until the layer's pressure balances it. So the image depends on the shapes and on the load, and not on how
soft MuJoCo's contacts are. The pad's point spread then makes kPa of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.press.geom_gap import Body, body_of, gaps
from tactsim.press.layer_balance import balance
from tactsim.press.pad_kernels import spread_forces
from tactsim.press.pad_surface import PadSurface

_MM = 1e3  # mm in a metre
_KPA = 1e3  # kPa in a N/mm^2
_LINES = (24, 64)  # of the lattice that is laid over what touches, along each axis: at least and at most
_LINES_A_PITCH = 3  # between the two
_SEARCH = 10  # of the lattices that find what touches
_SEARCHES = 12
_POINT = 0.01  # of a pitch: what touches less than this is not looked at more closely
_MARGIN = 1.0  # mm about the contact points where the search begins
_FACING = (
    0.7  # a contact whose normal has a smaller part along the pad's is at the geom's rim or on another face
)
_GRAZING = 0.1  # of a curved pad, a point whose normal has a smaller part along the contact's touches nothing
_SPREAD = (
    0.01  # contact points wider apart than this share of the face's touching part say how the load is turned
)


@dataclass(frozen=True, eq=False)
class PadReading:
    """What a pad feels at one moment.

    kpa: (taxels,) kPa, taxel = columns * row + column. force: N, the sum of MuJoCo's normal contact forces on the
    geom. outside: N, the part of `force` that the pad does not carry, because it acts on the geom beside the pad.
    shear: (3,) N, the friction on the geom in the pad's frame; no taxel feels it. contacts: how many carry force.
    """

    kpa: FloatArray
    force: float
    outside: float
    shear: FloatArray
    contacts: int


class _Turn(NamedTuple):
    """How a body may turn: contact points `spread` mm from side to side, and the axis across, a unit vector (3,)."""

    spread: float
    axis: FloatArray


class _Load(NamedTuple):
    """What one other geom does to the pad's geom, in the pad's frame.

    force: N, normal. direction: (3,) from the pad towards the other geom. points: (k, 3) mm of the contacts.
    centre: (3,) mm, where the force acts.
    """

    geom: int
    force: float
    direction: FloatArray
    points: FloatArray
    centre: FloatArray
    turns: list[_Turn]


class _Carried(NamedTuple):
    """What a layer carries on a lattice of cells.

    forces: (rows, columns) N along the load, evenly on the covered part of each cell. shift: (2, cells) or (2, 1), in
    cells along u and v from the cell's middle to that of the covered part. u: (columns + 1,), v: (rows + 1,) mm, edges.
    """

    forces: FloatArray
    shift: FloatArray
    u: FloatArray
    v: FloatArray


class PadReader:
    """A pad on a geom of a compiled model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        geom: int,
        pad: Pad,
        surface: PadSurface,
        stiffness: float,
        psf_sigma: float,
    ) -> None:
        self.model, self.geom, self.pad, self.surface = model, geom, pad, surface
        self._stiffness = stiffness / _KPA  # N/mm^3
        self._sigma = psf_sigma
        x_low, x_high, y_low, y_high = pad.load_bounds
        self._bounds = np.array([[x_low, x_high], [y_low, y_high]])
        self._columns, self._rows = pad.column_edges, pad.row_edges
        self._bodies: dict[int, Body] = {}

    def read(self, data: mujoco.MjData) -> PadReading:
        """Read the pad in the state whose contacts `data` holds: after mj_step, or mj_forward.

        Raises InputError if a height field, a signed distance field or a flex touches the geom.
        """
        rotation, origin = self.frame(data)
        kpa, outside, shear = np.zeros(self.pad.taxels), 0.0, np.zeros(3)
        loads, contacts = self._loads(data, rotation, origin, shear)
        for load in loads:
            felt, inside = self._felt(self._carried(load, data, rotation, origin))
            kpa += felt
            outside += load.force - inside
        return PadReading(kpa, sum(load.force for load in loads), outside, shear, contacts)

    def frame(self, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
        """Return where the pad is in the world: rotation (3, 3) and its middle (3,) m."""
        geom = data.geom_xmat[self.geom].reshape(3, 3)
        return geom @ self.surface.axes, data.geom_xpos[self.geom] + geom @ self.surface.origin / _MM

    def _loads(
        self, data: mujoco.MjData, rotation: FloatArray, origin: FloatArray, shear: FloatArray
    ) -> tuple[list[_Load], int]:
        """Gather the contact forces on the geom by what presses; adds the friction to `shear`."""
        first, second = data.contact.geom1, data.contact.geom2
        rows: dict[int, list[tuple[float, FloatArray, FloatArray]]] = {}
        six = np.zeros(6)
        for index in np.flatnonzero((first == self.geom) | (second == self.geom)):
            mujoco.mj_contactForce(self.model, data, index, six)
            if six[0] <= 0:
                continue
            contact = data.contact[index]
            # The contact's frame has its normal from geom 1 to geom 2, and the force is that on geom 2.
            sign, other = (
                (1.0, int(second[index])) if first[index] == self.geom else (-1.0, int(first[index]))
            )
            if other < 0:
                raise InputError(
                    f"a flex touches geom {self.model.geom(self.geom).name!r}: a pad feels rigid geoms only"
                )
            frame = contact.frame.reshape(3, 3)
            shear -= sign * rotation.T @ (frame[1:].T @ six[1:3])
            rows.setdefault(other, []).append(
                (six[0], sign * rotation.T @ frame[0], rotation.T @ (contact.pos - origin) * _MM)
            )
        loads = []
        for other, contacts in rows.items():
            forces = np.array([force for force, _, _ in contacts])
            direction = forces @ np.array([normal for _, normal, _ in contacts])
            direction /= np.sqrt(direction @ direction)
            points = np.array([point for _, _, point in contacts])
            force = float(forces.sum())
            centre = forces @ points / force
            turns = _turns(points, centre, direction) if len(points) > 1 else []
            loads.append(_Load(other, force, direction, points, centre, turns))
        return loads, sum(len(contacts) for contacts in rows.values())

    def _carried(
        self, load: _Load, data: mujoco.MjData, rotation: FloatArray, origin: FloatArray
    ) -> _Carried:
        """Let the layer carry a load. All forces are 0 where the geom is touched beside the face alone."""
        if load.geom not in self._bodies:
            self._bodies[load.geom] = body_of(self.model, load.geom)
        turned = rotation.T @ data.geom_xmat[load.geom].reshape(3, 3)
        position = rotation.T @ (data.geom_xpos[load.geom] - origin) * _MM
        body = self._bodies[load.geom]
        surface = self.surface
        places = surface.place(load.points)
        low = np.clip(places.min(axis=0) - _MARGIN, surface.low, surface.high)
        high = np.clip(places.max(axis=0) + _MARGIN, surface.low, surface.high)
        carried = _Carried(np.zeros((1, 1)), np.zeros((2, 1)), low[:1], low[:1])
        beside = not surface.curved and load.direction[2] < _FACING
        for _ in range(_SEARCHES):
            if beside or (high <= low).any():
                break
            carried, pose = self._pressed(load, body, (turned, position), low, high, (_SEARCH, _SEARCH))
            size, cell = high - low, (high - low) / _SEARCH
            rows, columns = np.nonzero(carried.forces)
            if not len(rows):  # too small to be seen
                middle = np.clip(surface.place(load.centre[None])[0], low, high)
                low, high = np.maximum(middle - cell, low), np.minimum(middle + cell, high)
                continue
            # What touches, with a cell more on every side, or much more where it reaches the side.
            first, last = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
            below, above = (first == 0) & (low > surface.low), (last == _SEARCH - 1) & (high < surface.high)
            high = np.minimum(np.where(above, high + size, low + (last + 2) * cell), surface.high)
            low = np.maximum(np.where(below, low - size, low + (first - 1) * cell), surface.low)
            pitch = np.array([self.pad.pitch_x, self.pad.pitch_y])
            if (below | above).any():
                continue
            if (high - low < _POINT * pitch).all():
                break
            if (high - low > size / 2).all():
                columns, rows = np.clip(np.ceil(_LINES_A_PITCH * (high - low) / pitch), *_LINES).astype(int)
                return self._pressed(load, body, pose, low, high, (columns, rows))[0]
        return carried

    def _pressed(
        self,
        load: _Load,
        body: Body,
        pose: tuple[FloatArray, FloatArray],
        low: FloatArray,
        high: FloatArray,
        count: tuple[int, int],
    ) -> tuple[_Carried, tuple[FloatArray, FloatArray]]:
        """Balance a load on a lattice of columns x rows cells from low to high (2,) mm.

        pose: (3, 3) and (3,) mm, the other geom's rotation and position; returned as it is where the load is balanced.
        """
        columns, rows = count
        u, v = np.linspace(low[0], high[0], columns + 1), np.linspace(low[1], high[1], rows + 1)
        lines = self.surface.lines(
            np.tile((u[1:] + u[:-1]) / 2, rows), np.repeat((v[1:] + v[:-1]) / 2, columns)
        )
        du, dv = (high - low) / count
        gap, share, shift = gaps(body, *pose, lines, (du, dv))
        facing = lines.normals @ load.direction
        weight = self._stiffness * du * dv * lines.area * share
        some = (weight > 0) & (gap > -self.surface.depth) & (gap < np.inf) & (facing > _GRAZING)
        forces = np.zeros(rows * columns)
        if some.any():
            normals, facing = lines.normals, np.broadcast_to(facing, some.shape)[some]
            normals = normals[some] if len(normals) > 1 else normals
            gap, weight, length = gap[some], weight[some], float((high - low).max()) / 2
            points = lines.points
            if load.turns and shift.shape[1] > 1:
                points = (
                    points + du * shift[0, :, None] * lines.along_u + dv * shift[1, :, None] * lines.along_v
                )
            basis, turns = _basis(load, points[some], normals, facing, length)
            motion = balance(gap, weight, basis, load.force)
            forces[some] = weight * np.maximum(motion @ basis - gap, 0) * facing
            pose = _moved(*pose, load, motion[0], motion[1:] @ turns)
        return _Carried(forces.reshape(rows, columns), shift, u, v), pose

    def _felt(self, carried: _Carried) -> tuple[FloatArray, float]:
        """Spread forces over the taxels: (taxels,) kPa, and the force that the pad carries, N."""
        columns, rows = self._columns, self._rows
        image = np.zeros((len(rows), len(columns)))
        inside = spread_forces(
            carried.forces, carried.shift, carried.u, carried.v, self._bounds[0], self._bounds[1], columns, rows,
            self._sigma, image,
        )  # fmt: skip
        area = (columns[0, 1] - columns[0, 0]) * (rows[0, 1] - rows[0, 0])
        return _KPA / area * np.maximum(image.ravel(), 0), inside


def _basis(
    load: _Load, points: FloatArray, normals: FloatArray, facing: FloatArray, length: float
) -> tuple[FloatArray, FloatArray]:
    """List the motions that balance a load, by what each adds to the depth at n points: (m, n).

    The body approaches along the load's direction, mm, and turns about the load's centre, mm at `length` mm
    from it, which is half the part of the face that is looked at. Returns the turns, too: (m - 1, 3) rad a mm.
    """
    turns = np.array([turn.axis / length for turn in load.turns if turn.spread > _SPREAD * length]).reshape(
        -1, 3
    )
    basis, offsets = [facing], points - load.centre
    for turn in turns:
        # normal . (turn cross offset), as (normal cross turn) . offset
        basis.append(np.einsum("ij,ij->i", normals @ _crossing(turn), offsets))
    return np.array(basis), turns


def _moved(
    turned: FloatArray, position: FloatArray, load: _Load, approach: float, turn: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move a body by what balances a load, so that it sinks `approach` mm in; turn: (3,) rad about the load's centre.

    The turn is that of the surface about the body, as in `_basis`: the body turns the other way.
    """
    if turn.any():
        angle = np.sqrt(turn @ turn)
        crossing = _crossing(turn / angle)  # Rodrigues' formula
        rotation = np.eye(3) - np.sin(angle) * crossing + (1 - np.cos(angle)) * crossing @ crossing
        turned, position = rotation @ turned, load.centre + rotation @ (position - load.centre)
    return turned, position - approach * load.direction


def _crossing(axis: FloatArray) -> FloatArray:
    """Write `vector cross axis` as `vector @ matrix`: (3, 3)."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _turns(points: FloatArray, centre: FloatArray, direction: FloatArray) -> list[_Turn]:
    """List the turns that bring a body nearer on one side, where contact points lie on both sides.

    There, and only there, MuJoCo's forces say where between the sides the load acts.
    """
    offsets = points - centre
    _, spread, across = np.linalg.svd(offsets - np.outer(offsets @ direction, direction), full_matrices=False)
    return [
        _Turn(wide, direction @ _crossing(side))
        for wide, side in zip(spread[:2].tolist(), across, strict=False)
    ]
