"""Fill the table of a page with what other people's solvers read of eight bodies: `make referees`.

What stands between two comments is replaced:

    <!-- referees: eight bodies -->
    <!-- end of referees -->

Each solver presses the same bodies on the same 36 taxels with 2 N (`referee_bodies`). Those that know a bed of springs,
or only where and how deep bodies touch, are compared with springs by brute force; those of elastic solids with one
another. An image is scaled to the true sum before it is compared; how far its own sum is off stands beside it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

import mujoco
import numpy as np
import tamaas
import trimesh
from ContactMechanics import FreeFFTElasticHalfSpace, PeriodicFFTElasticHalfSpace
from ContactMechanics.Systems import NonSmoothContactSystem
from page_blocks import fill_blocks, fill_one
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticPropertiesForHalfSpace,
    AddRigidHydroelasticProperties,
    HalfSpace,
    HydroelasticContactRepresentation,
    InMemoryMesh,
    ProximityProperties,
)
from pydrake.geometry import Mesh as DrakeMesh
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from referee_bodies import FORCE, HALF, PAD, STIFFNESS, Array, Body, bodies, taxels, truth
from scipy.optimize import brentq
from SurfaceTopography import Topography

import tactsim
from tactsim.bench.runs.tables import markdown_table
from tactsim.core import InputError

_AREA = 1.9**2 * 1e-3  # N a kPa, of a taxel
_GRID = 228  # squares along the pad's side, 0.05 mm each
_POISSON = 0.45
# N/mm^2, Young's, of the layer of 1 mm
_MODULUS = STIFFNESS * (1 + _POISSON) * (1 - 2 * _POISSON) / (1 - _POISSON)
_CONTACT_MODULUS = _MODULUS / (1 - _POISSON**2)
_FAR = 100.0  # mm: what is nowhere lies so high
_CUT = 1.0  # mm, the longest edge of Drake's meshes
_PARTS = 12  # into how many pieces along each side Drake's triangles are cut, to be sorted into taxels
_STEPS = 1500  # of 1 ms, until a body rests
_EYE = 1.0  # m from touch_grid's site to the face, so that its equal angles are equal lengths


class Image(NamedTuple):
    """What a referee reads. kpa: (36,), or None if it cannot press this. seconds: of processor time, to read it."""

    kpa: Array | None
    seconds: float = 0.0


Referee = Callable[[Body], Image]


# In MuJoCo: the body comes down along a slide onto a box as large as the pad.


def scene(body: Body, sensor: str = "", assets: str = "", parts: str = "") -> mujoco.MjModel:
    """Compile a body above a finger with one of MuJoCo's sensors on it, or none."""
    spec = mujoco.MjSpec.from_string(f"""
        <mujoco><option timestep="0.001"/><compiler angle="radian"/>
          <extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>
          <asset>{body.assets}{assets}</asset>
          <worldbody>
            <body><geom name="finger" type="box" size="{HALF / 1e3} {HALF / 1e3} .005" pos="0 0 -.005"/>{parts}</body>
            <body {body.pose}><joint type="slide" axis="0 0 1"/>
              <inertial pos="0 0 0" mass="{FORCE / 9.81}" diaginertia="1e-5 1e-5 1e-5"/>{body.geoms}</body>
          </worldbody>
          <sensor>{sensor}</sensor></mujoco>""")
    for mesh in spec.meshes:
        mesh.needsdf = "tactile" in sensor and mesh.name != "plate"  # how deep a vertex lies in it
    return spec.compile()


def rest(model: mujoco.MjModel) -> mujoco.MjData:
    """Step a model until its body rests."""
    data = mujoco.MjData(model)
    for _ in range(_STEPS):
        mujoco.mj_step(model, data)
    return data


def of_steps(model: mujoco.MjModel, data: mujoco.MjData, plain: mujoco.MjModel) -> float:
    """Time a step with a sensor beyond one without: s of processor time, the least of some."""
    times = []
    for each, at in ((model, data), (plain, rest(plain))):
        rounds = []
        for _ in range(5):
            start = process_time()
            for _ in range(20):
                mujoco.mj_step(each, at)
            rounds.append((process_time() - start) / 20)
        times.append(min(rounds))
    return max(times[0] - times[1], 0.0)


def attached(body: Body) -> Image:
    """Read `tactsim.press.attach`."""
    model = scene(body)
    reader = tactsim.press.attach(model, "finger", PAD, psf_sigma=0).bind(model)
    data = rest(model)
    reader.read(data)
    times = []
    for _ in range(5):
        start = process_time()
        reading = reader.read(data)
        times.append(process_time() - start)
    return Image(reading.kpa, min(times))


def touch_grid(body: Body) -> Image:
    """Read the plugin that sorts contact points by angle; its rows run along -y."""
    # Its keys are degrees, from the middle to the side
    angle = float(np.degrees(np.arctan(HALF / 1e3 / _EYE)))
    angle *= 1.001  # contacts on the rim belong to the last row
    sensor = f"""<plugin name="felt" plugin="mujoco.sensor.touch_grid" objtype="site" objname="eye">
        <config key="size" value="6 6"/><config key="fov" value="{angle} {angle}"/>
        <config key="gamma" value="0"/><config key="nchannel" value="1"/></plugin>"""
    model = scene(body, sensor, parts=f'<site name="eye" pos="0 0 {-_EYE}" quat="0 1 0 0"/>')
    data = rest(model)
    # A sign says which geom is first
    felt = np.abs(data.sensor("felt").data.reshape(6, 6))[::-1].ravel() / _AREA
    return Image(felt, of_steps(model, data, scene(body)))


def tactile(side: int, true_depth: bool) -> Referee:
    """Make a referee of MuJoCo's `tactile` with side x side vertices a taxel, at its own or the springs' depth.

    It gives lengths; they count as the springs' pressure.
    """

    def read(body: Body) -> Image:
        count = 6 * side
        half = HALF / 1e3
        plate = f'<mesh name="plate" builtin="plate" params="{count} {count}" scale="{half} {half} 0"/>'
        skin = (
            '<geom name="skin" type="mesh" mesh="plate" contype="0" conaffinity="0" mass="0" quat="0 1 0 0"/>'
        )
        model = scene(body, '<tactile name="felt" geom="skin" mesh="plate"/>', plate, skin)
        data = rest(model)
        seconds = of_steps(model, data, scene(body))
        if true_depth:
            data.qpos[0] = -truth(body)[1] / 1e3
            mujoco.mj_forward(model, data)
        geom = model.geom("skin").id
        first = model.mesh_vertadr[model.mesh("plate").id]
        vertices = model.mesh_vert[first : first + count**2]
        places = (vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])[:, :2] * 1e3
        depth = 1e3 * data.sensor("felt").data[: count**2]
        column, row = np.clip(np.floor((places + HALF) / 1.9).astype(int), 0, 5).T
        sums, counts = (np.bincount(6 * row + column, weights, 36) for weights in (depth, None))
        return Image(1e3 * STIFFNESS * sums / counts, seconds)

    return read


# Drake: a rigid mesh in a compliant half-space, whose pressure is in proportion to the depth.


def drake(body: Body) -> Image:
    """Press Drake's hydroelastic contact to the force by root finding, and sort its surface into taxels."""
    mesh = body.solid.refine_to_length(_CUT).to_mesh()
    written = trimesh.Trimesh(mesh.vert_properties[:, :3] / 1e3, mesh.tri_verts, process=False).export(
        file_type="obj", digits=12
    )
    shape = DrakeMesh(InMemoryMesh(mesh_file=MemoryFile(written.encode(), ".obj", body.name)))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    soft, rigid = ProximityProperties(), ProximityProperties()
    AddCompliantHydroelasticPropertiesForHalfSpace(1e-3, STIFFNESS * 1e6, soft)  # 1 mm of N/mm^2
    AddRigidHydroelasticProperties(_CUT / 1e3, rigid)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "pad", soft)
    link = plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
    plant.RegisterCollisionGeometry(link, RigidTransform(), shape, "body", rigid)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    of_plant, of_scene = plant.GetMyMutableContextFromRoot(context), scene_graph.GetMyContextFromRoot(context)

    def load(depth: float) -> tuple[Array, Array]:
        """Give places (n, 2) mm and vertical forces (n,) N on small pieces of the contact surface."""
        plant.SetFreeBodyPose(of_plant, link, RigidTransform([0, 0, -depth / 1e3]))
        start = process_time()
        query = scene_graph.get_query_output_port().Eval(of_scene)
        surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kTriangle)
        spent.append(process_time() - start)
        if not surfaces:
            return np.zeros((0, 2)), np.zeros(0)
        surface = surfaces[0].tri_mesh_W()
        field = surfaces[0].tri_e_MN()
        corners = 1e3 * np.array(list(surface.vertices()))
        pressures = np.array([field.EvaluateAtVertex(vertex) for vertex in range(len(corners))]) / 1e6
        faces = np.array([[face.vertex(k) for k in range(3)] for face in surface.triangles()])
        return _pieces(corners[faces], pressures[faces])

    spent: list[float] = []  # s, in Drake itself
    depth = brentq(lambda depth: load(depth)[1].sum() - FORCE, 1e-4, 1.0, xtol=1e-7)
    places, forces = load(depth)
    column, row = np.clip(np.floor((places + HALF) / 1.9).astype(int), 0, 5).T
    return Image(np.bincount(6 * row + column, forces, 36) / _AREA, sum(spent))


def _pieces(corners: Array, pressures: Array) -> tuple[Array, Array]:
    """Cut triangles (n, 3, 3) mm with pressures at their corners (n, 3) N/mm^2 evenly: places and vertical forces."""
    step = np.arange(_PARTS)
    i, j = (index.ravel() for index in np.meshgrid(step, step))
    up, down = i + j < _PARTS, i + j < _PARTS - 1
    first = np.concatenate([i[up] + 1 / 3, i[down] + 2 / 3]) / _PARTS
    second = np.concatenate([j[up] + 1 / 3, j[down] + 2 / 3]) / _PARTS
    weights = np.stack([first, second, 1 - first - second], axis=-1)  # of the pieces' centroids, (pieces, 3)
    a, b = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    places = np.einsum("pk,nkd->npd", weights, corners[:, :, :2])
    forces = (pressures @ weights.T) * (area / len(weights))[:, None]
    return places.reshape(-1, 2), forces.ravel()


# Elastic solids: rigid height fields on a grid.


def heights(body: Body, pad: int = 0) -> tuple[Array, Array]:
    """Give the middles of a grid's squares, mm, and how high the body is there; `pad` more squares each side."""
    axis = (np.arange(-pad, _GRID + pad) + 0.5) * 2 * HALF / _GRID - HALF
    away = body.gap(*np.meshgrid(axis, axis))
    beside = np.abs(axis) > HALF
    away[beside] = away[:, beside] = np.inf
    return axis, np.where(np.isfinite(away), away, _FAR)


def contact_mechanics(layer: bool, sigma: float = 0.0) -> Referee:
    """Make a referee of ContactMechanics: a bonded layer of 1 mm, or a half-space."""

    def read(body: Body) -> Image:
        margin = _GRID // 2 if layer else 0  # the layer's solver is periodic: images lie 11 mm off
        axis, away = heights(body, margin)
        size = (len(axis) * 2 * HALF / _GRID,) * 2
        start = process_time()
        if layer:
            base: Any = PeriodicFFTElasticHalfSpace(
                away.shape, _MODULUS, size, thickness=1.0, poisson=_POISSON
            )
        else:
            base = FreeFFTElasticHalfSpace(away.shape, _CONTACT_MODULUS, size)
        system = NonSmoothContactSystem(base, Topography(-away.T, size))
        found = system.minimize_proxy(external_force=FORCE, pentol=1e-6)
        seconds = process_time() - start
        if not found.success:
            raise InputError(f"ContactMechanics does not converge on {body.name}")
        load = np.abs(np.asarray(system.force))[
            : len(axis), : len(axis)
        ].T  # by its sign a force may push or pull
        return Image(taxels(axis, axis, load, sigma), seconds)

    return read


def tamaas_half_space(sigma: float = 0.0) -> Referee:
    """Make a referee of tamaas: a half-space without periodic images, by convolution on a padded grid."""

    def read(body: Body) -> Image:
        axis, away = heights(body)
        start = process_time()
        size = [2 * HALF, 2 * HALF]
        model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, size, list(away.shape))
        model.E, model.nu = _MODULUS, _POISSON
        tamaas.ModelFactory.registerNonPeriodic(model, "free")
        solver = tamaas.PolonskyKeerRey(model, np.ascontiguousarray(-away), 1e-9)
        solver.setIntegralOperator("free")
        solver.max_iter, solver.dump_freq = 3000, 10**9
        solver.solve(FORCE / (4 * HALF**2))
        seconds = process_time() - start
        load = np.asarray(model.traction) * (2 * HALF / _GRID) ** 2
        return Image(taxels(axis, axis, load, sigma), seconds)

    return read


def brute_force(sigma: float = 0.0) -> Referee:
    """Make a referee of the springs themselves."""

    def read(body: Body) -> Image:
        start = process_time()
        kpa, _ = truth(body, sigma)
        return Image(kpa, process_time() - start)

    return read


def own_press(body: Body) -> Image:
    """Read `tactsim.press`."""
    mesh = body.solid.mirror([0, 0, 1]).translate([0, 0, 3]).to_mesh()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "body.stl"
        trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts).export(path)
        shape = tactsim.models.shape(path)
    options = tactsim.ScanOptions(
        pad=PAD,
        press={"wrist_stiffness": None, "force": FORCE},
        sensor={"psf_sigma": 0, "noise": 0, "resolution": 0},
    )
    # A shape's frame begins at its centre of area: where the pad's middle is in that.
    x0, y0, x1, y1 = shape.footprint.bounds()
    box = body.solid.bounding_box()
    pose = [(x0 + x1 - box[0] - box[3]) / 2, (y0 + y1 - box[1] - box[4]) / 2, 0.0]
    tactsim.press(shape, pose, options)  # what is compiled or tabulated at first does not count
    start = process_time()
    kpa = tactsim.press(shape, pose, options).ideal
    return Image(kpa, process_time() - start)


# What each group of rows is compared with, and the rows.
TABLE: tuple[tuple[str, Referee, tuple[tuple[str, Referee], ...]], ...] = (
    (
        "springs, brute force",
        brute_force(),
        (
            ("`tactsim.press.attach`", attached),
            ("`tactsim.press`", own_press),
            ("Drake, mesh cut to 1 mm", drake),
            ("`tactile`, 1 vertex a taxel", tactile(1, False)),
            ("the same, at the springs' depth", tactile(1, True)),
            ("`tactile`, 144 vertices a taxel", tactile(12, False)),
            ("the same, at the springs' depth", tactile(12, True)),
            ("`touch_grid`", touch_grid),
        ),
    ),
    (
        "half-space, ContactMechanics",
        contact_mechanics(layer=False),
        (
            ("tamaas", tamaas_half_space()),
            ("springs", brute_force()),
        ),
    ),
    (
        "the same, spread by 1 mm",
        contact_mechanics(layer=False, sigma=1.0),
        (("springs", brute_force(1.0)),),
    ),
    (
        "bonded layer of 1 mm, ContactMechanics",
        contact_mechanics(layer=True),
        (("springs", brute_force()),),
    ),
    (
        "the same, spread by 1 mm",
        contact_mechanics(layer=True, sigma=1.0),
        (("springs", brute_force(1.0)),),
    ),
)


def rows(pressed: Sequence[Body]) -> list[list[str]]:
    """Press the bodies with everybody, and lay out the table: rms / worst taxel in % of the peak.

    The last columns are by how much a sum is off at most, in %, and the median time of a press, ms.
    """
    names = [body.name for body in pressed]
    table = [["compared with", "read by", *names, "sum off, %", "ms"]]
    for against, referee, others in TABLE:
        right = [referee(body) for body in pressed]
        for name, other in others:
            images = [other(body) for body in pressed]
            cells = [_cell(one, known) for one, known in zip(images, right, strict=True)]
            pairs = [(one, known) for one, known in zip(images, right, strict=True) if one.kpa is not None]
            balance = max((_sum(one) / _sum(known) - 1 for one, known in pairs), key=abs)
            seconds = float(np.median([one.seconds for one, _ in pairs]))
            table.append([against, name, *cells, _short(100 * balance), _short(1e3 * seconds)])
            print(" | ".join(table[-1]), file=sys.stderr, flush=True)
    return table


def _cell(one: Image, right: Image) -> str:
    assert right.kpa is not None
    if one.kpa is None:
        return "-"
    if not one.kpa.any():
        return "nothing"
    off = 100 * np.abs(one.kpa * _sum(right) / _sum(one) - right.kpa) / right.kpa.max()
    return " / ".join(dict.fromkeys(map(_short, (np.sqrt((off**2).mean()), off.max()))))


def _sum(one: Image) -> float:
    assert one.kpa is not None
    return float(one.kpa.sum())


def _short(value: float) -> str:
    """Write two digits, or none of what is below 0.01."""
    if abs(value) < 0.01:
        return "< 0.01"
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.2g}"


def fill(text: str) -> str:
    """Replace the table of a page."""
    packages = ", ".join(
        f"{name} {version(name)}" for name in ("ContactMechanics", "tamaas", "drake", "mujoco")
    )
    made = f"{markdown_table(rows(bodies()))}\n*`make referees`: {packages}.*\n"
    return fill_blocks(text, "referees", lambda _: made)


def main(words: Sequence[str]) -> int:
    """Fill the page `words[0]`; returns the exit status."""
    tamaas.set_log_level(tamaas.LogLevel.error)
    return fill_one("page_referees.py", words, fill)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
