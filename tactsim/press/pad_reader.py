"""Read a pad on geoms of a compiled MuJoCo model: what each rigid body that touches it does to its taxels.

MuJoCo says how large the force of each body is. How it shares the force among the body's geoms and contact points means
nothing: the body is one, of all its geoms. An elastic layer on the pad's surface (Winkler, as in docs/sensor.md)
carries exactly that force: the body's true shape, at its true pose, sinks in until the layer's pressure adds up to it,
and turns, where its joints leave it free to, until the pressure is centred where MuJoCo's forces are. So the image
depends on the shapes and on the load, and not on how soft MuJoCo's contacts are. The pad's point spread then makes
kPa of it.
"""

from __future__ import annotations

import math
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
from tactsim.press.geom_gap import Body, body_of
from tactsim.press.pad_kernels import Taxels
from tactsim.press.pad_press import Contacts, Frames, Springs, group_contacts, press, turn_contacts
from tactsim.press.pad_surface import PadSurface

_MM = 1e3  # mm in a metre
_KPA = 1e3  # kPa in a N/mm^2
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_HELD = np.zeros((1, 3))  # how joints turn a body that they hold


class Layer(NamedTuple):
    """What lies on a pad's surface, as `attach` takes it: kPa/mm, mm, and which centre of force is kept."""

    stiffness: float
    psf_sigma: float
    centre: Literal["auto", "press", "mujoco"]


@dataclass(frozen=True, eq=False)
class PadReading:
    """What a pad feels at one moment.

    kpa: (taxels,) kPa, taxel = columns * row + column. shear_kpa: (taxels, 2) kPa along the pad's x and y: each body's
    friction, shared as its pressure is. force: N, the sum of MuJoCo's normal contact forces on the geom. outside: N,
    the part of `force` that the pad does not carry, because it acts on the geom beside the pad. shear: (3,) N, the
    friction on the geom in the pad's frame. contacts: how many carry force.
    """

    kpa: FloatArray
    shear_kpa: FloatArray
    force: float
    outside: float
    shear: FloatArray
    contacts: int


class _Load(NamedTuple):
    """What one rigid body does to the pad's geoms in about one direction.

    body: its number. geoms: those that touch. shear: (3,) N, the friction, in the pad's frame.
    """

    body: int
    geoms: set[int]
    shear: FloatArray
    contacts: Contacts


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
        self._centre = layer.centre
        self._springs = Springs(layer.stiffness / _KPA, np.array([pad.pitch_x, pad.pitch_y], dtype=float))
        x_low, x_high, y_low, y_high = pad.load_bounds
        columns, rows = np.array(pad.column_edges), np.array(pad.row_edges)
        self._taxels = Taxels(
            columns, rows, np.array([[x_low, x_high], [y_low, y_high]]), float(layer.psf_sigma)
        )
        self._area = (columns[0, 1] - columns[0, 0]) * (rows[0, 1] - rows[0, 0])
        self._bodies: dict[tuple[int, ...], tuple[Body, NDArray[np.int64]]] = {}
        self._last: WeakKeyDictionary[mujoco.MjData, tuple[float, dict[int, list[PadReading]]]]
        self._last = WeakKeyDictionary()
        self._warned = False
        self._own = np.zeros(model.ngeom + 1, dtype=bool)  # the last: what is no geom
        self._own[list(geoms)] = True
        felt = touchable(model, self.geoms)
        reach = surface.high - surface.low
        self._reach = np.sqrt(reach @ reach) / _MM  # m from the pad's middle
        self._radii = model.geom_rbound.tolist()
        self._body_of = model.body_weldid[model.geom_bodyid].astype(np.int64)
        self._felt_geoms = [np.flatnonzero(felt & (self._body_of == body)) for body in range(model.nbody)]

    @property
    def geom(self) -> int:
        """The number of the geom whose face carries the pad."""
        return self.geoms[0]

    def read(self, data: mujoco.MjData) -> PadReading:
        """Read the pad in the state whose contacts `data` holds: after mj_step, or mj_forward."""
        contact = data.contact
        (touching,) = (self._own[contact.geom1] != self._own[contact.geom2]).nonzero()
        rotation, origin = self.frame(data)
        loads = self._loads(data, touching, rotation, origin) if len(touching) else []
        felt: dict[int, list[PadReading]] = {}
        for load in loads:
            felt.setdefault(load.body, []).append(self._felt(load, loads, data, rotation, origin))
        if self.model.opt.enableflags & _SLEEP:
            felt = self._asleep(data) | felt
            self._last[data] = (data.time, felt)
        readings = [reading for listed in felt.values() for reading in listed]
        if len(readings) == 1:
            return readings[0]
        return PadReading(
            sum((reading.kpa for reading in readings), np.zeros(self.pad.taxels)),
            sum((reading.shear_kpa for reading in readings), np.zeros((self.pad.taxels, 2))),
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

    def frame_in_body(self) -> tuple[FloatArray, FloatArray]:
        """Return where the pad is in its body's frame: rotation (3, 3) and its middle (3,) mm."""
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, self.model.geom_quat[self.geom])
        geom = turned.reshape(3, 3)
        return geom @ self.surface.axes, self.model.geom_pos[self.geom] * _MM + geom @ self.surface.origin

    def frame(self, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
        """Return where the pad is in the world: rotation (3, 3) and its middle (3,) m."""
        geom = data.geom_xmat[self.geom].reshape(3, 3)
        return geom @ self.surface.axes, data.geom_xpos[self.geom] + geom @ self.surface.origin / _MM

    def _loads(
        self, data: mujoco.MjData, index: NDArray[np.intp], rotation: FloatArray, origin: FloatArray
    ) -> list[_Load]:
        """Add up what the geoms of one rigid body do in about one direction, by the contacts `index`."""
        contact = data.contact
        forces = np.empty((len(index), 6))
        for row, number in enumerate(index.tolist()):
            mujoco.mj_contactForce(self.model, data, number, forces[row])
        (pushing,) = (forces[:, 0] > 0).nonzero()
        if not len(pushing):
            return []
        index, forces = index[pushing], forces[pushing]
        normal, first = forces[:, 0].copy(), contact.geom1[index]
        ahead = self._own[first]
        pushes, shears, points = turn_contacts(
            forces, contact.frame[index], contact.pos[index], ahead, rotation, origin
        )
        geoms = np.where(ahead, contact.geom2[index], first).astype(np.int64)
        bodies = self._body_of[geoms]
        groups = group_contacts(normal, pushes, geoms, bodies)
        loads = []
        for group in range(len(set(groups.tolist()))):
            (rows,) = (groups == group).nonzero()
            body = int(bodies[rows[0]])
            turning = self._turning(data, body, rotation) if len(rows) > 1 else _HELD
            contacts = Contacts(normal[rows], pushes[rows], points[rows], turning)
            loads.append(_Load(body, set(geoms[rows].tolist()), np.add.reduce(shears[rows]), contacts))
        return loads

    def _felt(
        self, load: _Load, loads: list[_Load], data: mujoco.MjData, rotation: FloatArray, origin: FloatArray
    ) -> PadReading:
        """Let the layer carry a load. No taxel feels one that acts on the geom beside the face."""
        image, force = np.zeros((self.pad.rows, self.pad.columns)), sum(load.contacts.forces.tolist())
        body, geoms = self._body(load, loads, data, origin)
        face, frames = self.surface.face, Frames(geoms, data.geom_xmat, data.geom_xpos, rotation, origin)
        inside, sunk = press(face, self._springs, self._taxels, body, frames, load.contacts, image)
        if sunk > face.depth and inside > force / 2 and not self._warned:
            self._warned = True
            warnings.warn(
                f"the layer on geom {self.model.geom(self.geom).name!r} gives way by {sunk:.3g} mm under "
                f"{force:.3g} N, by more than its geom is thick ({face.depth:.3g} mm): "
                "give it a larger stiffness",
                stacklevel=3,
            )
        kpa = _KPA / self._area * np.maximum(image.ravel(), 0)
        shear_kpa = kpa[:, None] * (load.shear[:2] / force)
        return PadReading(kpa, shear_kpa, force, force - inside, load.shear, len(load.contacts.points))

    def _turning(self, data: mujoco.MjData, body: int, rotation: FloatArray) -> FloatArray:
        """Tell how each joint turns a body on the pad: (joints, 3) rad a unit, in the pad's frame.

        Where the centre of force is not to be looked for by joints, three turn it every way, or one not at all.
        """
        if self._centre != "auto":
            return np.eye(3) if self._centre == "mujoco" else _HELD
        turns, own = np.empty((2, 3, self.model.nv))
        mujoco.mj_jacBody(self.model, data, None, turns, body)
        mujoco.mj_jacBody(self.model, data, None, own, self.model.geom_bodyid[self.geom])
        return (turns - own).T @ rotation

    def _body(
        self, load: _Load, loads: list[_Load], data: mujoco.MjData, origin: FloatArray
    ) -> tuple[Body, NDArray[np.int64]]:
        """List the geoms of a load's body that may touch the face, but for those that touch it another way."""
        elsewhere = {geom for other in loads if other is not load for geom in other.geoms}
        geoms, felt, middle = set(load.geoms), self._felt_geoms[load.body], origin.tolist()
        for geom, place in zip(felt.tolist(), data.geom_xpos[felt].tolist(), strict=True):
            radius = self._radii[geom]
            if geom not in elsewhere and (radius == 0 or radius >= math.dist(place, middle) - self._reach):
                geoms.add(geom)
        key = tuple(sorted(geoms))
        if key not in self._bodies:
            self._bodies[key] = body_of(self.model, key), np.array(key)
        return self._bodies[key]


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
