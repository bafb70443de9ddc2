"""Read a pad on geoms of a compiled MuJoCo model: what each rigid body that touches it does to its taxels.

MuJoCo says how large the force of each body is. How it shares the force among the body's geoms and contact points means
nothing: the body is one, of all its geoms. An elastic layer on the pad's surface (Winkler, as in docs/sensor.md)
carries exactly that force: the body's true shape, at its true pose, sinks in until the layer's pressure adds up to it,
and turns, where its joints leave it free to, until the pressure is centred where MuJoCo's forces are. So the image
depends on the shapes and on the load, and not on how soft MuJoCo's contacts are. The pad's point spread then makes
kPa of it.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.attach.geom_gap import Body, body_of
from tactsim.attach.pad_kernels import Taxels
from tactsim.attach.pad_press import Contacts, Frames, press
from tactsim.attach.pad_surface import PadSurface, matrix
from tactsim.core.errors import InputError, counted, short
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray

_MM = 1e3  # mm in a metre
_KPA = 1e3  # kPa in a N/mm^2
_NONE = 1e-6  # of a force, which is none
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))


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
    friction on the geom in the pad's frame. contacts: how many carry force. found: whether the search found all that
    touches; where it did not, kpa may be off by more than docs/attach.md says. beside_mm: how far from the pad's rim
    the farthest contact lies on the surface, where there is an `outside`. str(reading) says all in a line.
    """

    kpa: FloatArray
    shear_kpa: FloatArray
    force: float
    outside: float
    shear: FloatArray
    contacts: int
    found: bool = True
    beside_mm: float = 0.0

    def __str__(self) -> str:
        """Say in a line how large the load is, where it presses most, and how much of it acts beside the pad."""
        line = f"{self.force:.2f} N in {counted(self.contacts, 'contact')}"
        if self.force > self.outside + _NONE * self.force:
            line += f"; taxel {int(self.kpa.argmax())} reads most, {self.kpa.max():.1f} kPa"
        if self.outside > _NONE * self.force:
            line += f"; {self.outside:.2f} N acts beside the pad"
            line += f", up to {self.beside_mm:.1f} mm from its rim" if self.beside_mm >= 0.05 else ""
        return line if self.found else line + "; not all that touches was found"


class PadReader:
    """A pad on a geom of a compiled model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        geoms: Sequence[int],
        name: str,
        pad: Pad,
        surface: PadSurface,
        layer: Layer,
    ) -> None:
        """Read a pad on `surface`, which is a face of the first of `geoms`; contacts of all of them are felt.

        name: what the user calls them.
        """
        self.model, self.geoms, self.pad, self.surface = model, tuple(geoms), pad, surface
        self._name = name
        self._centre = layer.centre
        columns, rows = np.array(pad.column_edges), np.array(pad.row_edges)
        bounds = np.array(pad.load_bounds, float).reshape(2, 2)
        pitch = np.array([pad.pitch_x, pad.pitch_y], float)
        stiffness, sigma = layer.stiffness / _KPA, float(layer.psf_sigma)
        self._taxels = Taxels(columns, rows, bounds, pitch, sigma, stiffness)
        self._area = (columns[0, 1] - columns[0, 0]) * (rows[0, 1] - rows[0, 0])
        self._bodies: dict[int, tuple[Body, NDArray[np.int64]]] = {}
        self._awake: mujoco.MjModel | None = None
        self._softer: dict[int, float] = {}  # N/mm^3, of the layers on other geoms
        self._warned = False
        self._own = np.zeros(model.ngeom + 1, dtype=bool)  # the last: what is no geom
        self._own[list(geoms)] = True
        # Of each geom its rigid body, and which it is of those of its body that can touch the pad.
        self._body_of = model.body_weldid[model.geom_bodyid].astype(np.int64)
        self._places = np.full(model.ngeom, -1)
        felt = touchable(model, self.geoms)
        self._felt_geoms = [np.flatnonzero(felt & (self._body_of == body)) for body in range(model.nbody)]
        for listed in self._felt_geoms:
            self._places[listed] = np.arange(len(listed))
        self._unknown = (self._places < 0) & (self._body_of != self._body_of[self.geom])
        # How each joint moves bodies on the pad; what the press alone centres is held.
        self._moves = np.zeros((model.nbody, model.nv))
        for body in range(1, model.nbody) if layer.centre == "auto" else ():
            self._moves[body] = self._moves[model.body_parentid[body]]
            first = model.body_dofadr[body]
            self._moves[body, first : first + model.body_dofnum[body]] = 1
        self._moves -= self._moves[model.geom_bodyid[self.geom]].copy()

    def beside(self, readers: Sequence[PadReader]) -> None:
        """Take note of the pads of other bodies: where their geoms touch this pad, their layers give way, too."""
        for other in readers:
            self._softer.update(dict.fromkeys(other.geoms, other._taxels.stiffness))

    @property
    def geom(self) -> int:
        """The number of the geom whose face carries the pad."""
        return self.geoms[0]

    def read(self, data: mujoco.MjData) -> PadReading:
        """Read the pad in the state whose contacts `data` holds: after mj_step, or mj_forward.

        Raises InputError if the data are not of a model as the one that the pad is bound to, or if a geom touches the
        pad that could not when it was bound.
        """
        if not isinstance(data, mujoco.MjData) or data.signature != self.model.signature:
            got = "those of another" if isinstance(data, mujoco.MjData) else short(type(data))
            raise InputError(f"a pad reads the MjData of the model that it is bound to, got {got}")
        if self.model.opt.enableflags & _SLEEP:
            data = self._without_sleep(data)
        contact = data.contact
        own = self._own[contact.geom]
        (index,) = (own[:, 0] != own[:, 1]).nonzero()
        images, sums = np.zeros((3, self.pad.taxels)), np.zeros(7)
        if len(index):
            forces = np.empty((len(index), 6))
            for row, number in enumerate(index.tolist()):
                mujoco.mj_contactForce(self.model, data, number, forces[row])
            geoms = contact.geom[index]
            if len(new := geoms[self._unknown[geoms]]):
                raise InputError(
                    f"geom {self.model.geom(new[0]).name!r} (number {new[0]}) touches the pad's geom, "
                    "and could not when the pad was bound: bind anew after a change of what can touch what"
                )
            given = contact.frame[index], contact.pos[index], contact.dist[index]
            contacts = Contacts(forces, geoms, *given, self._body_of, self._places)
            for body in set(self._body_of[geoms].ravel().tolist()) - {self._body_of[self.geom]}:
                image, figures = self._felt(data, body, contacts)
                images += image
                sums += figures
        force, inside, _, _, _, count, lost = sums.tolist()
        kpa, outside = _KPA / self._area * images, force - inside
        beside = self._beside(data, contact.pos[index]) if outside > _NONE * force else 0.0
        return PadReading(kpa[0], kpa[1:].T, force, outside, sums[2:5], int(count), not lost, beside)

    def _beside(self, data: mujoco.MjData, points: FloatArray) -> float:
        """Measure how far, mm along the surface, the farthest of points (k, 3) m lies from the pad's rim."""
        rotation, origin = self.frame(data)
        laid = self.surface.place((points - origin) @ rotation * _MM)
        x_low, x_high, y_low, y_high = self.pad.load_bounds
        over = np.maximum([x_low, y_low] - laid, laid - [x_high, y_high])
        return float(np.hypot(*np.maximum(over, 0).T).max(initial=0.0))

    def _without_sleep(self, data: mujoco.MjData) -> mujoco.MjData:
        """Take the state with all contacts: MuJoCo drops those of what sleeps, on a pad that sleeps or never moves."""
        own, asleep = self.model.body_treeid[self.model.geom_bodyid[self.geom]], data.tree_asleep >= 0
        if not (asleep[own] if own >= 0 else asleep.any()):
            return data
        if self._awake is None:
            model = copy.copy(self.model)
            model.opt.enableflags &= ~_SLEEP
            self._awake = model
        whole = mujoco.MjData(self._awake)
        mujoco.mj_copyData(whole, self._awake, data)
        mujoco.mj_forward(self._awake, whole)
        return whole

    def frame_in_body(self) -> tuple[FloatArray, FloatArray]:
        """Return where the pad is in its body's frame: rotation (3, 3) and its middle (3,) mm."""
        geom = matrix(self.model.geom_quat[self.geom])
        return geom @ self.surface.axes, self.model.geom_pos[self.geom] * _MM + geom @ self.surface.origin

    def frame(self, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
        """Return where the pad is in the world: rotation (3, 3) and its middle (3,) m.

        Raises InputError before MuJoCo has placed the bodies.
        """
        geom = data.geom_xmat[self.geom].reshape(3, 3)
        if not geom.any():
            raise InputError("nothing is placed yet: call mujoco.mj_forward(model, data), or a step, before")
        return geom @ self.surface.axes, data.geom_xpos[self.geom] + geom @ self.surface.origin / _MM

    def _felt(self, data: mujoco.MjData, body: int, contacts: Contacts) -> tuple[FloatArray, FloatArray]:
        """Let the layer carry what one rigid body does: (3, taxels) N, and (7,), as `press` gives them."""
        if body not in self._bodies:
            listed = self._felt_geoms[body]
            self._bodies[body] = body_of(self.model, listed.tolist()), listed
        (shape, geoms), face = self._bodies[body], self.surface.face
        rotation, origin = self.frame(data)
        turning = np.eye(3)
        if self._centre != "mujoco":
            turning = self._moves[body][:, None] * data.cdof[:, :3] @ rotation
        frames = Frames(geoms, data.geom_xmat, data.geom_xpos, rotation, origin, turning)
        own, taxels = self._taxels.stiffness, self._taxels
        touching = set(contacts.geoms[self._body_of[contacts.geoms] == body].tolist())
        if touching <= self._softer.keys():
            both = 1 / own + 1 / min(self._softer[geom] for geom in touching)
            taxels = taxels._replace(stiffness=1 / both)
        images, sums = press(face, taxels, shape, frames, contacts, body)
        if (sunk := sums[7] * taxels.stiffness / own) > face.depth and not self._warned:
            self._warned = True
            warnings.warn(
                f"the layer on {self._name} gives way by {sunk:.3g} mm under "
                f"{sums[0]:.3g} N, by more than its geom is thick ({face.depth:.3g} mm): "
                "give it a larger stiffness",
                stacklevel=3,
            )
        return images.reshape(3, -1), sums[:7]


def touchable(model: mujoco.MjModel, geoms: Sequence[int]) -> NDArray[np.bool_]:
    """Tell which geoms (ngeom,) can touch any of `geoms`, by MuJoCo's rules for types, exclusions and pairs."""
    own, listed, welded = model.geom_bodyid[geoms[0]], list(geoms), model.body_weldid
    kinds, others = np.bitwise_or.reduce([model.geom_contype[listed], model.geom_conaffinity[listed]], axis=1)
    felt = (model.geom_contype & others | model.geom_conaffinity & kinds) != 0
    first, second = model.exclude_signature >> 16, model.exclude_signature & 0xFFFF
    felt &= ~np.isin(model.geom_bodyid, [*first[second == own], *second[first == own]])
    # A parent and its child do not touch, unless the parent is the world.
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT) and welded[own]:
        parents = welded[model.body_parentid[welded]]
        kin = (parents == welded[own]) | (welded == parents[own])
        felt &= ~(kin & (welded > 0))[model.geom_bodyid]
    felt[model.pair_geom2[np.isin(model.pair_geom1, listed)]] = True
    felt[model.pair_geom1[np.isin(model.pair_geom2, listed)]] = True
    return felt & (welded[model.geom_bodyid] != welded[own])
