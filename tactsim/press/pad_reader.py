"""Read a pad on geoms of a compiled MuJoCo model: what each rigid body that touches it does to its taxels.

MuJoCo says how large the force of each body is. How it shares the force among the body's geoms and contact points means
nothing: the body is one, of all its geoms. An elastic layer on the pad's surface (Winkler, as in docs/sensor.md)
carries exactly that force: the body's true shape, at its true pose, sinks in until the layer's pressure adds up to it,
and turns, where its joints leave it free to, until the pressure is centred where MuJoCo's forces are. So the image
depends on the shapes and on the load, and not on how soft MuJoCo's contacts are. The pad's point spread then makes
kPa of it.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.press.geom_gap import Body, Part, body_of, union_gaps
from tactsim.press.layer_balance import balance
from tactsim.press.pad_kernels import spread_forces
from tactsim.press.pad_surface import PadSurface

_MM = 1e3  # mm in a metre
_KPA = 1e3  # kPa in a N/mm^2
_LINES = (24, 64)  # of the lattice that is laid over what touches, along each axis: at least and at most
_LINES_OF_SEVERAL = 48  # at least, over a body of several geoms, each of which is a part of it
_LINES_OF_STEPS = 200  # at most, on a surface that may jump, which the lattice samples
_LINES_A_PITCH_OF_STEPS = 25
_LINES_A_PITCH = 3  # between the two
_SEARCH = 10  # of the lattices that find what touches
_SEARCHES = 12
_POINT = 0.01  # of a pitch: what touches less than this is not looked at more closely
_MARGIN = 1.0  # mm about the contact points where the search begins
_FACING = (
    0.7  # a contact whose normal has a smaller part along the pad's is at the geom's rim or on another face
)
_GRAZING = 0.1  # of a curved pad, a point whose normal has a smaller part along the contact's touches nothing
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_HELD = 1e-9  # rad for a unit of all joints, below which they do not turn a body
_NONE = 1e-300  # N
_SPREAD = (
    0.01  # contact points wider apart than this share of the face's touching part say how the load is turned
)


class Layer(NamedTuple):
    """What lies on a pad's surface, as `attach` takes it: kPa/mm, mm, and which centre of force is kept."""

    stiffness: float
    psf_sigma: float
    centre: Literal["auto", "press", "mujoco"]


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


class _Touch(NamedTuple):
    """What one geom does to the pad's geoms at k contact points, in the pad's frame.

    forces: (k,) N, normal. points: (k, 3) mm. push: (3,) N, the sum of the forces, from the pad towards the geom.
    shear: (3,) N, the friction on the pad's geoms.
    """

    geom: int
    forces: FloatArray
    points: FloatArray
    push: FloatArray
    shear: FloatArray


class _Load(NamedTuple):
    """What one rigid body does to the pad's geoms, in the pad's frame.

    body: its number. geoms: those that touch. force: N, normal. shear: (3,) N, friction. direction: (3,) from the pad
    towards the body. points: (k, 3) mm of the contacts. centre: (3,) mm, where the force acts.
    """

    body: int
    geoms: list[int]
    force: float
    shear: FloatArray
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
        geoms: Sequence[int],
        pad: Pad,
        surface: PadSurface,
        layer: Layer,
    ) -> None:
        """Read a pad on `surface`, which is a face of the first of `geoms`; contacts of all of them are felt."""
        self.model, self.geoms, self.pad, self.surface = model, tuple(geoms), pad, surface
        self._layer = layer
        self._stiffness = layer.stiffness / _KPA  # N/mm^3
        x_low, x_high, y_low, y_high = pad.load_bounds
        self._bounds = np.array([[x_low, x_high], [y_low, y_high]])
        self._columns, self._rows = pad.column_edges, pad.row_edges
        self._bodies: dict[int, Body] = {}
        self._last: WeakKeyDictionary[mujoco.MjData, tuple[float, dict[int, list[PadReading]]]]
        self._last = WeakKeyDictionary()
        self._warned = False
        self._own = np.zeros(model.ngeom + 1, dtype=bool)  # the last: what is no geom
        self._own[list(geoms)] = True
        felt = touchable(model, self.geoms)
        self._felt_geoms = [
            np.flatnonzero(felt & (model.body_weldid[model.geom_bodyid] == body))
            for body in range(model.nbody)
        ]

    @property
    def geom(self) -> int:
        """The number of the geom whose face carries the pad."""
        return self.geoms[0]

    def read(self, data: mujoco.MjData) -> PadReading:
        """Read the pad in the state whose contacts `data` holds: after mj_step, or mj_forward."""
        rotation, origin = self.frame(data)
        loads = self._loads(self._touches(data, rotation, origin), data, rotation)
        felt: dict[int, list[PadReading]] = {}
        for load in loads:
            kpa, inside = self._felt(self._carried(load, loads, data, rotation, origin))
            felt.setdefault(load.body, []).append(
                PadReading(kpa, load.force, load.force - inside, load.shear, len(load.points))
            )
        if self.model.opt.enableflags & _SLEEP:
            felt = self._asleep(data) | felt
            self._last[data] = (data.time, felt)
        readings = [reading for one in felt.values() for reading in one]
        return PadReading(
            sum((reading.kpa for reading in readings), np.zeros(self.pad.taxels)),
            sum(reading.force for reading in readings),
            sum(reading.outside for reading in readings),
            sum((reading.shear for reading in readings), np.zeros(3)),
            sum(reading.contacts for reading in readings),
        )

    def _asleep(self, data: mujoco.MjData) -> dict[int, list[PadReading]]:
        """Find what bodies did when last read that sleep since then: MuJoCo drops their contacts. A reset forgets."""
        time, felt = self._last.get(data, (0.0, {}))
        if data.time < time:
            return {}
        trees, own = self.model.body_treeid, self.model.geom_bodyid[self.geom]
        sleeps = [
            body for body in felt if any(t >= 0 and data.tree_asleep[t] >= 0 for t in trees[[body, own]])
        ]
        return {body: felt[body] for body in sleeps}

    def frame(self, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
        """Return where the pad is in the world: rotation (3, 3) and its middle (3,) m."""
        geom = data.geom_xmat[self.geom].reshape(3, 3)
        return geom @ self.surface.axes, data.geom_xpos[self.geom] + geom @ self.surface.origin / _MM

    def _touches(self, data: mujoco.MjData, rotation: FloatArray, origin: FloatArray) -> list[_Touch]:
        """Gather the contact forces on the pad's geoms by what presses."""
        first, second = data.contact.geom1, data.contact.geom2
        rows: dict[int, list[tuple[float, FloatArray, FloatArray, FloatArray]]] = {}
        six = np.zeros(6)
        for index in np.flatnonzero(self._own[first] != self._own[second]):
            mujoco.mj_contactForce(self.model, data, index, six)
            if six[0] <= 0:
                continue
            contact = data.contact[index]
            # The contact's frame has its normal from geom 1 to geom 2, and the force is that on geom 2.
            sign, other = (1.0, second[index]) if self._own[first[index]] else (-1.0, first[index])
            frame = contact.frame.reshape(3, 3)
            turned = sign * frame @ rotation
            point = (contact.pos - origin) @ rotation * _MM
            rows.setdefault(int(other), []).append((six[0], turned[0], point, -six[1:3] @ turned[1:]))
        touches = []
        for other, contacts in rows.items():
            forces, normals, points, shear = (np.array(column) for column in zip(*contacts, strict=True))
            touches.append(_Touch(other, forces, points, forces @ normals, shear.sum(axis=0)))
        return touches

    def _loads(self, touches: list[_Touch], data: mujoco.MjData, rotation: FloatArray) -> list[_Load]:
        """Add up what the geoms of one rigid body do in about one direction."""
        groups: list[tuple[int, FloatArray, list[_Touch]]] = []
        for touch in sorted(touches, key=lambda touch: -touch.forces.sum()):
            body = int(self.model.body_weldid[self.model.geom_bodyid[touch.geom]])
            way = touch.push / np.sqrt(touch.push @ touch.push)
            for known, along, members in groups:
                if known == body and along @ way > _FACING:
                    members.append(touch)
                    break
            else:
                groups.append((body, way, [touch]))
        loads = []
        for body, _, members in groups:
            forces = np.concatenate([touch.forces for touch in members])
            points = np.concatenate([touch.points for touch in members])
            direction = np.sum([touch.push for touch in members], axis=0)
            direction /= np.sqrt(direction @ direction)
            force = float(forces.sum())
            centre = forces @ points / force
            axes = self._free(data, body, direction, rotation) if len(points) > 1 else np.empty((0, 3))
            turns = _turns(points, centre, direction, axes) if len(axes) else []
            geoms, shear = (
                [touch.geom for touch in members],
                np.sum([touch.shear for touch in members], axis=0),
            )
            loads.append(_Load(body, geoms, force, shear, direction, points, centre, turns))
        return loads

    def _free(
        self, data: mujoco.MjData, body: int, direction: FloatArray, rotation: FloatArray
    ) -> FloatArray:
        """List the axes (k, 3) across a load about which its centre, as MuJoCo has it, is to be kept.

        Where joints let the body turn on the pad, the balance of moments alone says where the load is centred, and
        MuJoCo keeps that balance. Where they hold it, its centre is that of MuJoCo's few contact points.
        """
        across = np.linalg.svd(direction[None])[2][1:]
        if self._layer.centre != "auto":
            return across if self._layer.centre == "mujoco" else across[:0]
        turns, own = np.zeros((2, 3, self.model.nv))
        mujoco.mj_jacBody(self.model, data, None, turns, body)
        mujoco.mj_jacBody(self.model, data, None, own, self.model.geom_bodyid[self.geom])
        sides, size, _ = np.linalg.svd(across @ rotation.T @ (turns - own), full_matrices=False)
        return sides[:, size > _HELD].T @ across

    def _parts(
        self, load: _Load, loads: list[_Load], data: mujoco.MjData, rotation: FloatArray, origin: FloatArray
    ) -> list[Part]:
        """List the geoms of a load's body that may touch the face, but for those that touch it another way."""
        elsewhere = {geom for other in loads if other is not load for geom in other.geoms}
        reach = self.surface.high - self.surface.low
        parts = []
        for geom in {*load.geoms, *self._felt_geoms[load.body].tolist()} - elsewhere:
            position = rotation.T @ (data.geom_xpos[geom] - origin) * _MM
            radius = self.model.geom_rbound[geom] * _MM
            if geom not in load.geoms and 0 < radius < np.sqrt(position @ position) - np.sqrt(reach @ reach):
                continue
            if geom not in self._bodies:
                self._bodies[geom] = body_of(self.model, geom)
            parts.append(Part(self._bodies[geom], rotation.T @ data.geom_xmat[geom].reshape(3, 3), position))
        return parts

    def _carried(
        self, load: _Load, loads: list[_Load], data: mujoco.MjData, rotation: FloatArray, origin: FloatArray
    ) -> _Carried:
        """Let the layer carry a load. All forces are 0 where the geom is touched beside the face alone."""
        parts = self._parts(load, loads, data, rotation, origin)
        surface = self.surface
        places = surface.place(load.points)
        low = np.clip(places.min(axis=0) - _MARGIN, surface.low, surface.high)
        high = np.clip(places.max(axis=0) + _MARGIN, surface.low, surface.high)
        carried = _Carried(np.zeros((1, 1)), np.zeros((2, 1)), low[:1], low[:1])
        beside = not surface.curved and load.direction[2] < _FACING
        for _ in range(_SEARCHES):
            if beside or (high <= low).any():
                break
            carried, moved, sunk = self._pressed(load, parts, 0.0, low, high, (_SEARCH, _SEARCH))
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
                least, most = _LINES if len(parts) == 1 else (_LINES_OF_SEVERAL, _LINES[1])
                per_pitch = _LINES_A_PITCH
                if surface.stepped:
                    most, per_pitch = _LINES_OF_STEPS, _LINES_A_PITCH_OF_STEPS
                columns, rows = np.clip(np.ceil(per_pitch * (high - low) / pitch), least, most).astype(int)
                carried, _, sunk = self._pressed(load, moved, sunk, low, high, (columns, rows))
                if sunk > surface.depth and not self._warned:
                    self._warned = True
                    warnings.warn(
                        f"the layer on geom {self.model.geom(self.geom).name!r} gives way by {sunk:.3g} mm under "
                        f"{load.force:.3g} N, by more than its geom is thick ({surface.depth:.3g} mm): "
                        "give it a larger stiffness",
                        stacklevel=3,
                    )
                return carried
        return carried

    def _pressed(
        self,
        load: _Load,
        parts: list[Part],
        sunk: float,
        low: FloatArray,
        high: FloatArray,
        count: tuple[int, int],
    ) -> tuple[_Carried, list[Part], float]:
        """Balance a load on a lattice of columns x rows cells from low to high (2,) mm.

        sunk: mm by which the body was moved along the load already. Returns also the body as it lies where the
        load is balanced, and how far it is sunk there.
        """
        columns, rows = count
        u, v = np.linspace(low[0], high[0], columns + 1), np.linspace(low[1], high[1], rows + 1)
        lines = self.surface.lines(
            np.tile((u[1:] + u[:-1]) / 2, rows), np.repeat((v[1:] + v[:-1]) / 2, columns)
        )
        du, dv = (high - low) / count
        cell, (gap, share, shift) = union_gaps(parts, lines, (du, dv), self.surface.depth + sunk)
        many = len(lines.normals) > 1
        facing = lines.normals @ load.direction
        facing = facing[cell] if many else np.full(len(cell), facing[0])
        area = lines.area[cell] if len(lines.area) > 1 else np.full(len(cell), lines.area[0])
        some = (facing > _GRAZING) & (area > 0)
        if not some.all():
            cell, gap, share = cell[some], gap[some], share[some]
            shift = shift[:, some] if shift.shape[1] > 1 else shift
            facing, area = facing[some], area[some]
        forces, moved = np.zeros(rows * columns), np.zeros((2, 1))
        if len(cell):
            normals = lines.normals[cell] if many else lines.normals
            weight, length = self._stiffness * du * dv * area * share, float((high - low).max()) / 2
            points = lines.points[cell]
            if load.turns and shift.any():
                along_u, along_v = (
                    along[cell] if len(along) > 1 else along for along in (lines.along_u, lines.along_v)
                )
                points = points + du * shift[0, :, None] * along_u + dv * shift[1, :, None] * along_v
            basis, turns = _basis(load, points, normals, facing, length)
            motion = balance(gap, weight, basis, load.force)
            carried = weight * np.maximum(motion @ basis - gap, 0) * facing
            np.add.at(forces, cell, carried)
            if shift.any():
                moved = np.zeros((2, rows * columns))
                for axis in (0, 1):
                    np.add.at(moved[axis], cell, carried * shift[axis])
                moved /= np.maximum(forces, _NONE)
            parts, sunk = _moved(parts, load, motion[0], motion[1:] @ turns), sunk + float(motion[0])
        return _Carried(forces.reshape(rows, columns), moved, u, v), parts, sunk

    def _felt(self, carried: _Carried) -> tuple[FloatArray, float]:
        """Spread forces over the taxels: (taxels,) kPa, and the force that the pad carries, N."""
        columns, rows = self._columns, self._rows
        image = np.zeros((len(rows), len(columns)))
        inside = spread_forces(
            carried.forces, carried.shift, carried.u, carried.v, self._bounds[0], self._bounds[1], columns, rows,
            self._layer.psf_sigma, image,
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


def _moved(parts: list[Part], load: _Load, approach: float, turn: FloatArray) -> list[Part]:
    """Move a body by what balances a load, so that it sinks `approach` mm in; turn: (3,) rad about the load's centre.

    The turn is that of the surface about the body, as in `_basis`: the body turns the other way.
    """
    rotation = np.eye(3)
    if turn.any():
        angle = np.sqrt(turn @ turn)
        crossing = _crossing(turn / angle)  # Rodrigues' formula
        rotation = rotation - np.sin(angle) * crossing + (1 - np.cos(angle)) * crossing @ crossing
    shift = load.centre - approach * load.direction
    return [
        Part(part.body, rotation @ part.rotation, rotation @ (part.position - load.centre) + shift)
        for part in parts
    ]


def _crossing(axis: FloatArray) -> FloatArray:
    """Write `vector cross axis` as `vector @ matrix`: (3, 3)."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _turns(points: FloatArray, centre: FloatArray, direction: FloatArray, axes: FloatArray) -> list[_Turn]:
    """List the turns about axes (k, 3) that bring a body nearer on one side, where contact points lie on both sides.

    There, and only there, MuJoCo's forces say where between the sides the load acts.
    """
    sides = axes @ _crossing(direction)  # where a turn about each axis brings the body away
    _, spread, mixed = np.linalg.svd((points - centre) @ sides.T, full_matrices=False)
    return [_Turn(wide, axis) for wide, axis in zip(spread.tolist(), mixed @ axes, strict=False)]


def touchable(model: mujoco.MjModel, geoms: Sequence[int]) -> NDArray[np.bool_]:
    """Tell which geoms (ngeom,) of a model can touch any of `geoms`, by MuJoCo's rules for types and pairs."""
    felt = np.zeros(model.ngeom, dtype=bool)
    for geom in geoms:
        felt |= (model.geom_contype & model.geom_conaffinity[geom]) != 0
        felt |= (model.geom_conaffinity & model.geom_contype[geom]) != 0
        felt[model.pair_geom2[model.pair_geom1 == geom]] = True
        felt[model.pair_geom1[model.pair_geom2 == geom]] = True
    felt &= model.body_weldid[model.geom_bodyid] != model.body_weldid[model.geom_bodyid[geoms[0]]]
    return felt
