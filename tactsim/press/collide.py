"""The engine `collide`: MuJoCo alone, which finds by its own collision detection what touches.

The pad is a fixed lattice of small spheres that knows nothing of the letter. The letter's convex parts are
geoms. Contacts are what MuJoCo finds between the two, each a spring as stiff as the layer under the point's
share of the pad, and one implicit time step finds their balance. The footprint is sampled by the lattice,
so this engine is less exact than `bed` and dearer; it shares none of the code that clips and checks that.

The scene is compressed along the pad's normal: depths, gaps and tilts are all smaller by one factor, and the
layer and the wrist stiffer by its inverse. To first order in the tilt this changes no force. Contact
normals then are the pad's normal, the layer's springs do not see the slopes of a face, and the depth
at each point is linear in how the letter moves. So the first step, which begins where the letter touches every
point that it can ever touch, is exact: MuJoCo's solver finds which of them let go.
"""

from __future__ import annotations

import math
import threading
from collections import Counter, OrderedDict
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray, invert
from tactsim.models.letter import Letter
from tactsim.models.parts import ConvexPart
from tactsim.press.bed import MM, slopes
from tactsim.press.scan_options import PressOptions, ScanOptions
from tactsim.press.scene import UNREAD_STAGES, describe_carriage, memory
from tactsim.press.spread import felt_along
from tactsim.press.touches import MOST_TILT, TIPPED, Pressed, Touches

# rad, from the pad's x axis to the lattice's densest rows. A straight edge errs most where it runs along rows, which a
# hexagonal lattice has at every multiple of 30 degrees. Turned by 7.5 degrees they lie farthest from all multiples
# of 15 degrees from the pad's axes, at which edges often meet it.
_TURN = math.pi / 24
_ORIGIN = (0.618, 0.382)  # of the pad's middle in the lattice's cell; off its symmetric points
# Of a regular hexagon about a line through its middle, per area squared
_SECOND_MOMENT = 5 / (36 * math.sqrt(3))
_KPA = 1e3  # kPa in a N/mm^2


@dataclass(frozen=True, eq=False)
class Points:
    """Forces on points of the pad's lattice.

    presses: how many presses there are. press: (k,) index of the press that each force belongs to, ascending.
    point: (k,) index of the point in `lattice`. force: (k,) N along the pad's normal. A point that two
    parts of the letter touch stands there twice.
    """

    presses: int
    press: NDArray[np.intp]
    point: NDArray[np.intp]
    force: FloatArray

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the forces over the taxels: (n, taxels) kPa without imperfections.

        A point's force lies evenly on its share of the pad, a hexagon. A Gaussian with the hexagon's second
        moment stands for it, and convolved with the point spread it is a Gaussian again.
        """
        pad, per_taxel = options.pad, options.press.points_per_taxel
        columns, rows = _felt(pad, per_taxel, options.sensor.psf_sigma)
        start = np.searchsorted(self.press, np.arange(self.presses + 1))
        result = np.empty((self.presses, pad.rows, pad.columns))
        for index in range(self.presses):
            here = slice(start[index], start[index + 1])
            point = self.point[here]
            result[index] = (rows[point] * self.force[here, None]).T @ columns[point]
        return _KPA / (pad.taxel_width * pad.taxel_height) * result.reshape(self.presses, pad.taxels)


@lru_cache(maxsize=4)
def lattice(pad: Pad, points_per_taxel: int) -> FloatArray:
    """Lay a hexagonal lattice over the surface that carries load: (n, 2) mm in the sensor frame.

    Each point stands for `share` of the surface.
    """
    spacing = math.sqrt(share(pad, points_per_taxel) * 2 / math.sqrt(3))
    left, right, low, high = pad.load_bounds
    far = math.ceil(2 * math.hypot(right - left, high - low) / spacing)
    index = np.arange(-far, far + 1)
    i, j = (along.ravel() for along in np.meshgrid(index, index))
    first = spacing * np.array([math.cos(_TURN), math.sin(_TURN)])
    second = spacing * np.array([math.cos(_TURN + math.pi / 3), math.sin(_TURN + math.pi / 3)])
    points = (i + _ORIGIN[0])[:, None] * first + (j + _ORIGIN[1])[:, None] * second
    x, y = points.T
    points = points[(left <= x) & (x <= right) & (low <= y) & (y <= high)]
    points.setflags(write=False)
    return points


def share(pad: Pad, points_per_taxel: int) -> float:
    """Give the part of the pad's surface that each point of its lattice stands for, mm^2."""
    return pad.pitch_x * pad.pitch_y / points_per_taxel


@lru_cache(maxsize=4)
def _felt(pad: Pad, points_per_taxel: int, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Work out what each column (n, columns) and row (n, rows) feels of a unit force on each point."""
    wide = math.hypot(sigma, math.sqrt(_SECOND_MOMENT * share(pad, points_per_taxel)))
    x, y = lattice(pad, points_per_taxel).T
    return felt_along(x, pad.column_edges, wide), felt_along(y, pad.row_edges, wide)


# m. A sphere beside a letter's outline touches it from sqrt(2 radius depth) away, at most 3 um. Its centre stays above
# the face: one that got below would be pushed out by the nearest side.
_RADIUS = 5e-6
_DEPTH = 1e-6  # m, the deepest at which a step begins, compressed
_MARGIN = 0.05  # share of it, by which the last point to be met is met
_BASE = 0.1  # mm, from a part's face to its base: meshes are kept in single precision about their middle
_MASS = 0.01  # kg; an equilibrium does not depend on it
_INERTIA = 1e-8  # m / h^2 as a share of the stiffness under one point
_IMPEDANCE = 0.5  # of every constraint; its inverse weight is set to give the stiffness that is wanted
_BALANCE = 1e-6  # share of the force that the contacts may miss
_MOST_STEPS = 10
_MOST_POINTS = 50_000
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_MOST_SCENES = 16
_THREAD = threading.local()  # a scene holds the state of one press, so threads do not share it


@dataclass(frozen=True)
class _Setup:
    """What a scene is compiled for. compression: of the parts' relief, 1 if they have none."""

    letter: Letter
    pad: Pad
    points_per_taxel: int
    compression: float
    hinged: bool


@dataclass(frozen=True, eq=False)
class _Scene:
    """A compiled scene. rest: the state that every press starts from."""

    setup: _Setup
    model: Any
    data: Any
    rest: FloatArray
    letter_body: int
    gimbal_body: int


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a letter until it rests.

    A press that tips over or finds no balance is a blank, with its reason.
    Raises InputError for a pad of more points than a scene can hold.
    """
    press, pad = options.press, options.pad
    left, right, low, high = pad.load_bounds
    slope = slopes(touches.tilts)
    relief = max(touches.letter.height - _top(part).min() for part in touches.letter.parts)
    # mm by which the corners of the pad lie higher or lower than its middle, of each press.
    reach = np.abs(slope) @ (max(-left, right), max(-low, high))
    # Compressed by so much, the letter is _DEPTH deep at most when the step begins.
    forces_set = touches.forces(press.force)
    give = forces_set / (1e-3 * press.stiffness * (right - left) * (high - low))
    compression = (1 - _MARGIN) * _DEPTH / MM / np.maximum(relief + 2 * reach, give)
    if relief:  # a compiled scene depends on it, and a few such scenes serve
        compression = 2.0 ** np.floor(np.log2(compression))
    depth = compression * (relief + reach) * MM + _MARGIN * _DEPTH
    elastic = bool(relief) or press.wrist_stiffness is not None or bool(reach.any())
    presses, points, forces, blanks = [], [], [], {}
    for index, pose in enumerate(touches.poses):
        factor = float(compression[index])
        stage = _scene(
            _Setup(
                touches.letter,
                pad,
                press.points_per_taxel,
                factor if relief else 1.0,
                press.wrist_stiffness is not None,
            )
        )
        _place(stage, pose, factor * slope[index])
        set_now = press.model_copy(update={"force": float(forces_set[index])})
        point, force, reason = _rest(stage, float(depth[index]), factor, elastic, set_now)
        if reason:
            blanks[index] = reason
            continue
        presses.append(np.full(len(point), index))
        points.append(point)
        forces.append(force)
    nothing = np.zeros(0, dtype=np.intp)
    load = Points(
        len(touches),
        np.concatenate([nothing, *presses]),
        np.concatenate([nothing, *points]),
        np.concatenate([np.zeros(0), *forces]),
    )
    return Pressed(touches, load, Counter(presses=len(touches)), blanks)


def _rest(
    stage: _Scene, depth: float, compression: float, elastic: bool, press: PressOptions
) -> tuple[NDArray[np.intp], FloatArray, str]:
    """Press the letter that was placed: points that touch, their forces (N), and why it does not rest, if so.

    depth: m, compressed, where it touches all that it can. elastic: whether the layer's stiffness is felt.
    """
    data, setup = stage.data, stage.setup
    area = share(setup.pad, setup.points_per_taxel)
    stiffness = press.stiffness
    _begin(stage, depth, stiffness * area / press.force / compression, press, compression)
    # The layer is so stiff that the force does not press it through.
    enough = press.stiffness_over(area * max(1, len(np.unique(data.contact.geom[:, 0])))) if elastic else 0.0
    if enough > stiffness:
        _begin(stage, depth, enough * area / press.force / compression, press, compression)
    for _ in range(_MOST_STEPS):
        contact = data.contact
        point = contact.geom[:, 0].astype(np.intp)  # a copy: the next step writes there
        if not len(point):
            return point, np.zeros(0), ""
        force = data.efc_force[contact.efc_address] * np.abs(contact.frame[:, 2])
        if abs(force.sum() - 1) <= _BALANCE:
            tipped = setup.hinged and np.abs(data.qpos[1:]).max() > MOST_TILT * compression
            return point, press.force * force, TIPPED if tipped else ""
        # Where the step began far too deep, the letter's inertia held some of the force.
        data.qvel[:] = 0
        mujoco.mj_step(stage.model, data)
    return point, force, f"after {_MOST_STEPS} steps the contacts carry {force.sum():g} of the force"


def _begin(stage: _Scene, depth: float, spring: float, press: PressOptions, compression: float) -> None:
    """Step once from `depth` m, each contact a spring of `spring` / m, under a force of 1.

    Forces are in units of the press's, as MuJoCo takes what is below 1e-15 for nothing. The springs are taken at the
    end of the step (the docstring of `scene` has the equations), which is so long that the mass does not matter.
    """
    model, data = stage.model, stage.data
    step = math.sqrt(_MASS / (_INERTIA * spring))
    model.opt.timestep = step
    model.opt.o_solref[:] = -_IMPEDANCE / step**2, -_IMPEDANCE / step
    model.opt.o_solimp[:2] = _IMPEDANCE
    model.body_invweight0[stage.letter_body, 0] = 1 / (spring * step**2)
    mujoco.mj_setState(model, data, stage.rest, _STATE)
    if press.wrist_stiffness is not None:
        hinge = press.wrist_stiffness * MM / press.force / compression
        model.dof_invweight0[1:] = 1 / (hinge * step**2)
        model.eq_solref[:] = model.opt.o_solref
        model.eq_solimp[:, :2] = _IMPEDANCE
        data.qpos[1:] = model.eq_data[:, 0]
    data.qpos[0] = depth
    data.qfrc_applied[0] = 1.0
    mujoco.mj_step(model, data)


def _top(part: ConvexPart) -> FloatArray:
    """Give the heights of the part's corners above its base, mm."""
    heights: FloatArray = part.vertices[:, 2]
    return heights[heights > 0]


def _place(stage: _Scene, sensor_in_object: FloatArray, slope: FloatArray) -> None:
    """Put the letter at a pose [x mm, y mm, theta rad], its face at z = 0 in the pad's middle, on a slope (2,)."""
    model = stage.model
    x, y, angle = invert(sensor_in_object)
    model.body_pos[stage.letter_body, :2] = x * MM, y * MM
    model.body_quat[stage.letter_body] = (math.cos(angle / 2), 0, 0, math.sin(angle / 2))
    tilt = np.array([slope[1], -slope[0]])
    if stage.setup.hinged:
        model.eq_data[:, 0] = tilt
    else:
        model.body_quat[stage.gimbal_body, 1:3] = tilt / 2


def _scene(setup: _Setup) -> _Scene:
    """Give this thread's scene, compiled when it is first asked for."""
    known = _THREAD.__dict__.setdefault("scenes", OrderedDict())
    if setup not in known:
        known[setup] = _compile(setup)
        if len(known) > _MOST_SCENES:
            known.popitem(last=False)
    scene: _Scene = known[setup]
    return scene


def _compile(setup: _Setup) -> _Scene:
    points = lattice(setup.pad, setup.points_per_taxel)
    if len(points) > _MOST_POINTS:
        raise InputError(
            f"press.points_per_taxel: the pad has {len(points):,} points, more than {_MOST_POINTS:,}; "
            "choose fewer, or a smaller pad"
        )
    spheres = "".join(
        f'<geom class="point" pos="{x * MM!r} {y * MM!r} {_RADIUS}"/>' for x, y in points.tolist()
    )
    parts = [_compressed(part, setup) for part in setup.letter.parts]
    meshes, geoms = zip(*(_describe_part(index, part) for index, part in enumerate(parts)), strict=True)
    carriage, springs = describe_carriage("".join(geoms), _MASS, hinged=setup.hinged)
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <compiler angle="radian"/>
        <size memory="{memory(len(points))}"/>
        <option gravity="0 0 0" iterations="50" tolerance="0" ccd_tolerance="1e-12" ccd_iterations="200">
          <flag override="enable"/>
        </option>
        <default>
          <geom density="0" condim="1" contype="1" conaffinity="0"/>
          <default class="point"><geom size="{_RADIUS}" contype="0" conaffinity="1"/></default>
        </default>
        <asset>{"".join(meshes)}</asset>
        <worldbody>
          {spheres}
          {carriage}
        </worldbody>
        <equality>{springs}</equality>
        </mujoco>"""
    )
    model.opt.disableflags = sum(int(stage) for stage in UNREAD_STAGES)
    data = mujoco.MjData(model)
    rest = np.zeros(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, rest, _STATE)
    letter, gimbal = (
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("letter", "gimbal")
    )
    return _Scene(setup, model, data, rest, letter, gimbal)


def _compressed(part: ConvexPart, setup: _Setup) -> ConvexPart:
    """Move a part's foremost face to z = 0 and its base near to it, and compress what is between."""
    vertices = part.vertices.copy()
    top = vertices[:, 2] > 0
    vertices[top, 2] = (vertices[top, 2] - setup.letter.height) * setup.compression
    vertices[~top, 2] = -_BASE
    return ConvexPart(part.outline, vertices)


def _describe_part(index: int, part: ConvexPart) -> tuple[str, str]:
    """Write a part as MJCF, m: its mesh, or nothing for an upright box, and its geom."""
    if part.rectangle is None:
        vertices = " ".join(f"{value:.17g}" for value in (part.vertices * MM).ravel())
        return f'<mesh name="part{index}" vertex="{vertices}"/>', (
            f'<geom name="part{index}" type="mesh" mesh="part{index}"/>'
        )
    low, high = part.vertices[:, 2].min() * MM, part.vertices[:, 2].max() * MM
    (x, y), (a, b), angle = part.rectangle
    return "", (
        f'<geom name="part{index}" type="box" size="{a * MM} {b * MM} {(high - low) / 2}" '
        f'pos="{x * MM} {y * MM} {(high + low) / 2}" euler="0 0 {angle}"/>'
    )
