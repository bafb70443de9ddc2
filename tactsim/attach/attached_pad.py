"""Put a taxel array on a geom of any MuJoCo model, flat or curved: which geom, which face of it, which layer.

A pad on such a body is projected along its normal, as on an ellipsoid: (u, v) are x and y of the pad's frame. A mesh is
its convex hull, as in MuJoCo's collision. The heights are looked up on a fine grid, with the slope on each point's
flatter side, so that a step between two geoms stays one.

MuJoCo's contacts carry the load, as they do without the pad: nothing is added to the model but a name for a geom that
has none, and nothing of its motion changes. `pad_reader` reads the pad after each step.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, count
from numbers import Real
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.attach.geom_gap import Body, Pose, body_of, measure
from tactsim.attach.pad_kernels import STEEP
from tactsim.attach.pad_reader import Layer, PadReader, touchable
from tactsim.attach.pad_surface import RELIEF, Face, Lines, PadSurface, matrix, pad_axes, pad_surface
from tactsim.core.errors import InputError, short, unknown
from tactsim.core.finite import finite
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray

_MM = 1e3  # mm in a metre
_SEEN = 200  # points along each axis of the grid that finds the body's outline
_FINE = 400, 1000  # and of that of its heights, at most: of one mesh, and of several geoms
_STEP = 0.02  # mm between the latter's points, at least
_JUMP = 1e-3  # mm of height from point to point, beyond the slope's, which is a step between geoms
_STEEPEST = 3.0  # mm of height for a mm along the pad; what is steeper carries no pad
_NO_WIDTH = 1e-6 * np.eye(3)[:2]  # mm along x and y, of a cell that no wall cuts
_EVERYWHERE = np.array([0.0, 0.0, 0.0, np.inf])  # no face of a geom is too far to be looked at
_UP, _DOWN = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]])


def relief_surface(
    model: mujoco.MjModel, geoms: Sequence[int], normal: FloatArray, at: FloatArray, name: str
) -> PadSurface:
    """Find the surface of geoms of one body that is seen against `normal`, (3,) in the body's frame.

    at: (2,) mm, the pad's middle from that of what is seen, along the pad's x and y, which lie to the body's frame as
    to a geom's in `pad_surface`. The frame of the result is in that of the first geom.
    Raises InputError, naming the pad's place, if nothing is seen there.
    """
    axes = pad_axes(normal)
    listed = list(geoms)
    rotations = np.array([axes.T @ matrix(model.geom_quat[geom]) for geom in listed])
    middles, radii = model.geom_pos[listed] @ axes * _MM, model.geom_rbound[listed] * _MM
    body, pose = body_of(model, listed), Pose(rotations, middles)
    far = float((np.abs(middles[:, 2]) + radii).max()) + 1
    low, high = (middles[:, :2] - radii[:, None]).min(axis=0), (middles[:, :2] + radii[:, None]).max(axis=0)
    x, y = (np.linspace(low[axis], high[axis], _SEEN) for axis in (0, 1))
    rows, columns = np.nonzero(np.isfinite(_seen(body, pose, x, y, far)[0]))
    if not len(rows):
        raise InputError(f"{name} has no face that looks along normal={tuple(np.round(normal, 3).tolist())}")
    apart = (high - low) / (_SEEN - 1)
    low = np.array([x[columns.min()], y[rows.min()]]) - apart
    high = np.array([x[columns.max()], y[rows.max()]]) + apart
    count = np.clip(np.ceil((high - low) / _STEP), 2, _FINE[len(geoms) > 1]).astype(int)
    x, y = (np.linspace(low[axis], high[axis], count[axis]) for axis in (0, 1))
    height, depth = _seen(body, pose, x, y, far)
    steps = x[1] - x[0], y[1] - y[0]
    slope_y, slope_x = (_slopes(height, steps[1 - axis], axis) for axis in (0, 1))
    seen = np.isfinite(height) & (np.hypot(slope_x, slope_y) < _STEEPEST)
    rows, columns = np.nonzero(seen)
    low = np.array([x[columns.min()], y[rows.min()]]) - np.array(steps)
    high = np.array([x[columns.max()], y[rows.max()]]) + np.array(steps)
    middle = (low + high) / 2 + at
    column, row = np.abs(x - middle[0]).argmin(), np.abs(y - middle[1]).argmin()
    top = height[row, column] if seen[row, column] else height[seen].max()
    relief = np.where(seen, [height - top, slope_x, slope_y, np.ones_like(height)], 0.0)
    jumps = _jumps(height, seen, slope_x * steps[0], slope_y * steps[1]) * (len(listed) > 1)
    grid = np.array([x[0] - middle[0], y[0] - middle[1], *steps])
    first = matrix(model.geom_quat[geoms[0]])
    origin = axes @ np.array([*middle, top]) - model.geom_pos[geoms[0]] * _MM
    # Column by column, as a lattice's cells come.
    layers = np.ascontiguousarray(np.stack([*relief, *jumps]).T)
    face = Face(RELIEF, np.zeros(3), grid, layers, low - middle, high - middle, depth)
    return PadSurface(first.T @ origin, first.T @ axes, face)


def _seen(body: Body, pose: Pose, x: FloatArray, y: FloatArray, far: float) -> tuple[FloatArray, float]:
    """Look at a body from `far` mm above on a grid: z of what is seen (rows, columns), -inf for nothing.

    Returns also how thick the body is from the highest point to the lowest, mm.
    """
    at_x, at_y = (each.ravel() for each in np.meshgrid(x, y))
    top, lowest = np.full(at_x.size, -np.inf), np.inf
    for geom, (x_there, y_there, _) in enumerate(pose.positions):
        ends: list[FloatArray] = []
        (met,) = np.nonzero(np.hypot(at_x - x_there, at_y - y_there) <= body.radii[geom])
        for side, way in ((far, _DOWN), (-far, _UP)):
            points = np.stack([at_x[met], at_y[met], np.full(met.size, side)], 1)
            gap, share, shift = np.empty(met.size), np.empty(met.size), np.empty((2, met.size))
            lines = Lines(points, way, _NO_WIDTH[:1], _NO_WIDTH[1:], np.ones(1))
            measure(body, geom, pose, lines, _EVERYWHERE, STEEP, gap, share, shift)
            there = np.isfinite(gap) & (share > 0.5)
            met, ends = met[there], [end[there] for end in (*ends, side + way[0, 2] * gap)]
        there = ends[0] > ends[1]
        top[met[there]] = np.maximum(top[met], ends[0])[there]
        lowest = min(lowest, ends[1][there].min(initial=np.inf))
    return top.reshape(len(y), len(x)), float(top.max() - lowest)


def _jumps(height: FloatArray, seen: NDArray[np.bool_], rise_x: FloatArray, rise_y: FloatArray) -> FloatArray:
    """Count the steps, and the rims of what is seen, along x and along y up to each point: (2, rows, columns).

    height: mm. rise_x, rise_y: mm by which the slopes rise to the next point. The sides of the rectangle that holds all
    that is seen do not count: there the face ends.
    """
    jumps = np.zeros((2, *height.shape))
    for each, high, there, rise in (
        (jumps[0], height, seen, rise_x), (jumps[1].T, height.T, seen.T, rise_y.T)
    ):  # fmt: skip
        with np.errstate(invalid="ignore"):
            off = np.abs(np.diff(high, axis=1)) > np.maximum(*np.abs([rise[:, 1:], rise[:, :-1]])) + _JUMP
        each[:, 1:] = np.where(there[:, 1:] & there[:, :-1], off, there[:, 1:] != there[:, :-1])
    rows, columns = np.nonzero(seen)
    within = np.s_[:, rows.min() + 1 : rows.max() + 1, columns.min() + 1 : columns.max() + 1]
    inner = np.zeros(jumps.shape)
    inner[within] = jumps[within]
    return inner.cumsum(axis=1).cumsum(axis=2)


def _slopes(height: FloatArray, step: float, axis: int) -> FloatArray:
    """Take the smaller of the slopes to both sides, along an axis of a grid; where there is nothing, 0."""
    with np.errstate(invalid="ignore"):
        rise = np.diff(height, axis=axis) / step
    rise = np.where(np.isfinite(rise), rise, np.inf)
    edge = [(1, 0) if i == axis else (0, 0) for i in (0, 1)]
    before = np.pad(rise, edge, constant_values=np.inf)
    after = np.pad(rise, [pair[::-1] for pair in edge], constant_values=np.inf)
    least = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(np.isfinite(least), least, 0.0)


_THIN = 1.0  # mm between two arrays, below which they are on each other
_WITHIN = 0.01  # mm from an array's rim to the first of the points that may not lie on another array
_ACROSS = 50  # of these points
_ASKEW = 0.4  # by which no part of a unit vector may change
_RED, _GREEN, _BLUE = (1.0, 0.2, 0.1, 1.0), (0.1, 0.8, 0.2, 1.0), (0.2, 0.5, 1.0, 1.0)
_UNFELT = [int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF)]


@dataclass(frozen=True, eq=False)
class AttachedPad:
    """A pad on geoms of a model that is not compiled yet; `attach` makes it."""

    geoms: tuple[mujoco.MjsGeom | str | int, ...]
    name: str
    pad: Pad
    normal: FloatArray
    at: FloatArray
    layer: Layer
    spec: mujoco.MjSpec | mujoco.MjModel

    def show(self) -> None:
        """Add a site for each taxel to the spec, with an arrow where the pad looks, for any viewer to draw.

        The first taxel is red, the last of its row green: from one to the other runs x. Sites have no part in the
        motion. Raises InputError as `bind` does, and for a pad that was attached to a compiled model.
        """
        first = self.geoms[0]
        if not (isinstance(self.spec, mujoco.MjSpec) and isinstance(first, mujoco.MjsGeom)):
            raise InputError("sites are added to a spec, and the pad was attached to a compiled model")
        reader, size = self.bind(self.spec.compile()), [self.pad.taxel_width, self.pad.taxel_height, 0.2]
        axes, origin = reader.frame_in_body()
        lines = reader.surface.lines(*np.ascontiguousarray(self.pad.taxel_xy.T))
        normals, quat = np.broadcast_to(lines.normals, lines.points.shape), np.empty(4)
        for taxel, (point, z) in enumerate(zip(lines.points, normals, strict=True)):
            x = np.cross([0.0, 1.0, 0.0], z)
            x /= np.linalg.norm(x)
            mujoco.mju_mat2Quat(quat, (axes @ np.column_stack([x, np.cross(z, x), z])).ravel())
            colour = _RED if taxel == 0 else _GREEN if taxel == self.pad.columns - 1 else _BLUE
            first.parent.add_site(
                type=mujoco.mjtGeom.mjGEOM_BOX, pos=(axes @ point + origin) / 1e3, quat=quat,
                size=np.array(size) * 0.45e-3, rgba=colour,
            )  # fmt: skip
        ends = [(origin + length * axes[:, 2]) / 1e3 for length in (0.0, 2 * max(size))]
        first.parent.add_site(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=np.concatenate(ends), rgba=_RED,
            size=[0.1e-3 * max(size)] * 3,
        )  # fmt: skip

    def bind(self, model: mujoco.MjModel) -> PadReader:
        """Find the geom in the compiled model.

        Raises InputError if the model has no such geom, if the geom has no face there, if the pad is larger
        than the face, or if a height field, a signed distance field or a flex can touch the geom.
        """
        if not isinstance(model, mujoco.MjModel):
            raise InputError(f"a pad is bound to a compiled mujoco.MjModel, got {short(type(model))}")
        # A model that was attached to another one with a prefix renames its geoms.
        names = [geom if isinstance(geom, str | int) else geom.name for geom in self.geoms]
        numbers = {model.geom(i).name or i: i for i in range(model.ngeom)}
        if any(name not in numbers for name in names):
            raise InputError(
                f"the model has no {self.name}: compile it after `attach`, from the spec that the pad is "
                "attached to; to a copy in another spec a pad is attached by its name there"
            )
        geoms = [numbers[name] for name in names]
        first = geoms[0]
        kind, size = int(model.geom_type[first]), model.geom_size[first]
        x_low, x_high, y_low, y_high = self.pad.load_bounds
        low, high = np.array([x_low, y_low]), np.array([x_high, y_high])

        def too_large(surface: PadSurface) -> bool:
            return bool((np.minimum(low - surface.face.low, surface.face.high - high) < -1e-9).any())

        if len(geoms) > 1 or kind == mujoco.mjtGeom.mjGEOM_MESH:
            surface = relief_surface(model, geoms, self.normal, self.at, self.name)
        else:
            axes = pad_axes(self.normal)
            if isinstance(self.geoms[0], mujoco.MjsGeom) and self.geoms[0].meshname:
                axes = _fitted(kind, axes, model.mesh_quat[model.mesh(self.geoms[0].meshname).id])
            surface = pad_surface(kind, size, axes, self.at, self.name)
            if kind == mujoco.mjtGeom.mjGEOM_CAPSULE and too_large(surface):
                surface = pad_surface(kind, size, axes, self.at, self.name, over_ends=True)
        if too_large(surface):
            ends = [*surface.face.low, *surface.face.high]
            raise InputError(
                f"the pad reaches from ({x_low:g}, {y_low:g}) to ({x_high:g}, {y_high:g}) mm and {self.name} from "
                f"({ends[0]:.4g}, {ends[1]:.4g}) to ({ends[2]:.4g}, {ends[3]:.4g}) mm "
                "about the pad's middle: choose a smaller pad"
            )
        _refuse_unfelt(model, geoms, self.name)
        return PadReader(model, geoms, self.name, self.pad, surface, self.layer)


def attach(
    spec: mujoco.MjSpec | mujoco.MjModel,
    geom: str | mujoco.MjsGeom | mujoco.MjsBody,
    pad: Pad | None = None,
    *,
    normal: Sequence[float] | None = None,
    at: Sequence[float] = (0.0, 0.0),
    stiffness: float = 1000.0,
    psf_sigma: float = 1.0,
    centre: Literal["auto", "press", "mujoco"] = "auto",
) -> AttachedPad:
    """Put a pad on a geom of `spec`; `bind` the result to the compiled model and `read` it after each step.

    spec: or a compiled model. geom: the name of a geom or of a body or, in a spec, one of them itself; on a body
    the pad lies on all of its geoms that can touch, on what is seen of them against `normal`.
    normal: (3,) in the geom's frame, and in the body's for a mesh or several geoms: where the pad's middle looks, by
    default +z, and +x on a capsule or a cylinder. Where a spec has MuJoCo fit a geom to a mesh, its frame is that in
    the file; a compiled model knows only MuJoCo's own. The pad's rows run along +y, which is the frame's z (its y where
    the pad looks along z); columns along +x = y cross normal. at: mm along the pad's x and y from the middle of the
    geom's face, or of all that is seen of a mesh or of several geoms.
    stiffness: kPa/mm of the layer on the surface (assumed). psf_sigma: mm, standard deviation of the point
    spread (assumed), 0 for none.
    centre: where a body's force is centred on the pad. "press": where such a face, held at the body's pose, would
    carry it. "mujoco": where MuJoCo's contact forces are. "auto": the latter about axes about which joints leave
    the body free to turn on the pad, the former about others.

    Raises InputError if there is no such geom, if it cannot touch anything, or if pad or a number is none.
    """
    pad = Pad() if pad is None else pad
    if not isinstance(pad, Pad):
        raise InputError(f"pad is {short(pad)}; give a tactsim.Pad, and of a file Pad.load(file)")
    if not _is_number(stiffness) or not 0 < stiffness < np.inf:
        raise InputError(f"stiffness is {short(stiffness)}; it is a number of kPa/mm above 0")
    if not _is_number(psf_sigma) or not (psf_sigma == 0 or 0.3 <= psf_sigma < np.inf):
        raise InputError(f"psf_sigma is {short(psf_sigma)}; it is 0 or at least 0.3 mm")
    if centre not in ("auto", "press", "mujoco"):
        raise unknown("centre", centre, ["auto", "press", "mujoco"])
    layer = Layer(stiffness, psf_sigma, centre)
    geoms, name, kind = _find(spec, geom)
    if normal is None:
        upright = kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)
        normal = (1.0, 0.0, 0.0) if upright else (0.0, 0.0, 1.0)
    direction = _vector(normal, 3, "normal")
    if not direction.any():
        raise InputError("normal is (0, 0, 0); it is the direction in which the pad looks")
    return AttachedPad(geoms, name, pad, direction, _vector(at, 2, "at"), layer, spec)


def bind(model: mujoco.MjModel, pads: Iterable[AttachedPad]) -> list[PadReader]:
    """Bind several pads to the compiled model, as `AttachedPad.bind` does each.

    Where geoms with a pad each touch, both layers give way, one behind the other.

    Raises InputError also if two arrays overlap on one body.
    """
    pads = list(pads) if isinstance(pads, Iterable) else [pads]
    if wrong := [pad for pad in pads if not isinstance(pad, AttachedPad)]:
        raise InputError(f"among the pads is {short(wrong[0])}; give a list of what `attach` returned")
    readers = [pad.bind(model) for pad in pads]
    for reader in readers:
        reader.beside(readers)
    for (number, other), (index, reader) in combinations(enumerate(readers), 2):
        if _overlap(reader, other) or _overlap(other, reader):
            body = model.body(model.geom_bodyid[reader.geom]).name
            raise InputError(
                f"the arrays of pads {number} and {index} overlap on body {body!r}: shift one by `at`, turn it by "
                "`normal`, or give both as one array"
            )
    return readers


def _fitted(kind: int, axes: FloatArray, quat: FloatArray) -> FloatArray:
    """Turn a pad's axes (3, 3) from the frame that a file gives a geom into MuJoCo's, which fits it to a mesh.

    quat: (4,), of the mesh: its principal axes in the file's. They are rarely those of the file to the last digit, so
    the axes are turned on to the nearest with which a pad lies on a geom of this kind, if they are within _ASKEW.
    """
    axes = matrix(quat).T @ axes
    if kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        nearest = np.round(axes)
    elif kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
        # Whether the pad looks across the geom's axis, along which its y lies.
        across = abs(axes[2, 2]) < np.sqrt(0.5)
        y, z = axes[:, 1].copy(), axes[:, 2].copy()
        if across:
            y, z[2] = np.array([0.0, 0.0, np.copysign(1.0, y[2])]), 0.0
        else:
            y[2], z = 0.0, np.array([0.0, 0.0, np.copysign(1.0, z[2])])
        y, z = y / np.linalg.norm(y), z / np.linalg.norm(z)
        nearest = np.column_stack([np.cross(y, z), y, z])
        # Where the file's z axis is not the geom's, rows lie as they can.
        if across and abs(axes[2, 1]) < np.sqrt(0.5):
            return nearest
    else:
        return axes
    askew = np.abs(nearest - axes).max() > _ASKEW or abs(np.linalg.det(nearest) - 1) > 1e-9
    return axes if askew else nearest


def _overlap(reader: PadReader, other: PadReader) -> bool:
    """Tell whether some of a lattice of points on one array lies on another one on the same body."""
    model = reader.model
    if model.geom_bodyid[reader.geom] != model.geom_bodyid[other.geom]:
        return False
    x_low, x_high, y_low, y_high = np.array(reader.pad.load_bounds) + _WITHIN * np.array([1, -1, 1, -1])
    u, v = np.linspace(x_low, x_high, _ACROSS), np.linspace(y_low, y_high, _ACROSS)
    lines = reader.surface.lines(np.tile(u, _ACROSS), np.repeat(v, _ACROSS))
    (axes, origin), (other_axes, other_origin) = (each.frame_in_body() for each in (reader, other))
    points = (lines.points[lines.area > 0] @ axes.T + origin - other_origin) @ other_axes
    laid = other.surface.place(points)
    on_face = np.clip(laid, other.surface.face.low, other.surface.face.high)
    below = other.surface.lines(*np.ascontiguousarray(on_face.T))
    x_low, x_high, y_low, y_high = other.pad.load_bounds
    inside = ((laid > [x_low, y_low]) & (laid < [x_high, y_high])).all(axis=1)
    return bool((inside & (np.abs(points - below.points).max(axis=1) < _THIN)).any())


def _refuse_unfelt(model: mujoco.MjModel, geoms: list[int], pads: str) -> None:
    """Raise InputError if a height field, a signed distance field or a flex can touch the pad's geoms."""
    felt = touchable(model, geoms)
    for geom in np.flatnonzero(felt & np.isin(model.geom_type, _UNFELT)):
        body_of(model, [int(geom)])
    own = model.geom_contype[geoms], model.geom_conaffinity[geoms]
    for flex in range(model.nflex):
        if ((own[0] & model.flex_conaffinity[flex]) | (own[1] & model.flex_contype[flex])).any():
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, flex)
            raise InputError(
                f"flex {name!r} can touch {pads}: a pad feels rigid geoms only, so keep the two apart by contype and "
                "conaffinity"
            )


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _vector(values: Sequence[float], size: int, what: str) -> FloatArray:
    vector = finite(values, what)
    if vector.shape != (size,):
        raise InputError(f"{what} has shape {vector.shape}; it is {size} numbers")
    return vector


def _find(
    spec: mujoco.MjSpec | mujoco.MjModel, geom: str | mujoco.MjsGeom | mujoco.MjsBody
) -> tuple[tuple[mujoco.MjsGeom | str | int, ...], str, int]:
    """Find geoms in a spec or a model: each (its name or number), what a user calls them, the type of the first."""
    if not isinstance(spec, mujoco.MjSpec | mujoco.MjModel):
        raise InputError(f"a pad is attached to a mujoco.MjSpec or an MjModel, got {short(type(spec))}")
    compiled = isinstance(spec, mujoco.MjModel)
    if compiled:
        every, bodies = [spec.geom(i) for i in range(spec.ngeom)], [spec.body(i) for i in range(spec.nbody)]
        paired = {every[i].name for i in [*spec.pair_geom1, *spec.pair_geom2]} - {""}
    else:
        every, bodies = spec.geoms, spec.bodies
        paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)} - {""}
    if isinstance(geom, str) and geom:
        named = next((one for one in [*every, *bodies] if one.name == geom), None)
        if named is None:
            unnamed = not compiled and any(not one.name for one in every)
            hint = "; a geom without a name is spec.body(NAME).geoms[i]" if unnamed else ""
            raise InputError(
                f"{unknown('geom or body', geom, [one.name for one in [*every, *bodies] if one.name])}{hint}"
            )
    elif isinstance(geom, mujoco.MjsGeom | mujoco.MjsBody) and not compiled:
        named = geom
    else:
        raise InputError(
            f"geom is {short(geom)}; give the name of a geom or a body"
            f"{' of the model' if compiled else ', or a geom or a body of the spec'}"
        )

    def touches(one: mujoco.MjsGeom) -> bool:
        return bool(one.contype or one.conaffinity or one.name in paired)

    alone = geom in [one.name for one in every] or isinstance(named, mujoco.MjsGeom)
    if alone:
        geoms = [named]
        if not touches(named):
            raise InputError(
                f"geom {named.name!r} cannot touch anything: its contype and conaffinity are 0 and it is in no "
                "contact pair"
            )
    else:
        listed = every[named.geomadr[0] :][: named.geomnum[0]] if compiled else named.geoms
        geoms = [one for one in listed if touches(one)]
        if not geoms:
            raise InputError(f"body {named.name!r} has no geom that can touch: a pad lies on one that can")
    taken = {one.name for one in every}
    for one in [] if compiled else geoms:
        if not one.name:
            names = (f"{one.parent.name}_pad{i}" for i in count())
            one.name = next(name for name in names if name not in taken)
            taken.add(one.name)
    first = int(np.ravel(geoms[0].type)[0]) if len(geoms) == 1 else int(mujoco.mjtGeom.mjGEOM_MESH)
    name = f"{'geom' if alone else 'body'} {named.name!r}"
    if alone and not isinstance(geom, str) and named.name.startswith(f"{named.parent.name}_pad"):
        of_body = [one.name for one in named.parent.geoms]
        name = f"geom {of_body.index(named.name)} of body {named.parent.name!r}"
    body = None if compiled or first != mujoco.mjtGeom.mjGEOM_MESH else geoms[0].parent
    if body and spec.compiler.fusestatic and body != spec.worldbody and not (body.joints or body.mocap):
        raise InputError(
            f"body {body.name!r} has no joint and is fused with the one that it is on, and `normal` is in its frame: "
            "set spec.compiler.fusestatic = False, which a URDF turns on"
        )
    return tuple(one.name or one.id if compiled else one for one in geoms), name, first
