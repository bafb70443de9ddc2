"""Close a hand with a pad on each of its five fingertips on a ball, an egg and a letter, and lift it.

    python examples/hand/grasp.py FOLDER [--seconds 10] [ball] [egg] [letter]

Writes pictures, hand.png and attached-sites.png, and a film, hand.gif, to the folder, and says what each pad carries.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray
from PIL import Image

import tactsim

HAND = Path(__file__).with_name("hand.xml")
OBJECTS = ("ball", "egg", "letter")
TIPS = ("fingertip0", "fingertip1", "fingertip2", "fingertip3", "thumbtip")
NAMES = ("index", "middle", "ring", "little", "thumb")
# 30 taxels without gaps, wrapped around a fingertip: rows along the finger, columns around it.
FOIL = tactsim.Pad(rows=6, columns=5, pitch_x=2, pitch_y=3, taxel_width=2, taxel_height=3)
READ_EVERY = 10  # steps of 2 ms


def scene(name: str, psf_sigma: float = 1.0) -> tuple[mujoco.MjModel, list[tactsim.press.PadReader]]:
    """Put an object under the hand, and pads on its fingertips: the model, and a reader for each of `TIPS`."""
    spec = mujoco.MjSpec.from_file(str(HAND))
    pads = [
        # A fingertip stands along its z; the fingers look along -y and the thumb along +y.
        tactsim.press.attach(
            spec, tip, FOIL, normal=(0, 1 if tip == "thumbtip" else -1, 0), stiffness=300, psf_sigma=psf_sigma
        )
        for tip in TIPS
    ]
    body = spec.worldbody.add_body(name=name)
    body.add_freejoint()
    colour = [0.35, 0.55, 0.8, 1.0]
    if name == "ball":
        body.pos = [0, 0, 0.033]
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.033, 0, 0], mass=0.06, rgba=colour)
    elif name == "egg":
        egg = trimesh.creation.icosphere(3).vertices * [0.041, 0.03, 0.03]
        egg[:, 1:] *= 1 - 6 * egg[:, :1]
        spec.add_mesh(name="egg", uservert=egg.ravel())
        body.pos = [0, 0, 0.0303]
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="egg", mass=0.06, rgba=colour)
    else:  # convex parts, three times as large as the letters that are recognised; its back to the fingers
        box = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(name="stand", type=box, size=[0.012, 0.012, 0.013], pos=[0, 0, 0.013])
        body.pos = [0, 0, 0.0261]
        body.quat = [np.sqrt(0.5), 0, 0, -np.sqrt(0.5)]
        letter = tactsim.models.letter("E")
        for number, part in enumerate(letter.parts):
            spec.add_mesh(name=f"part{number}", uservert=(part.vertices * 3e-3).ravel())
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"part{number}",
                mass=0.06 / len(letter.parts),
                rgba=colour,
            )
    model = spec.compile()
    return model, tactsim.press.bind(model, pads)


def grasp(
    name: str, seconds: float = 10.0, psf_sigma: float = 1.0
) -> Iterator[tuple[mujoco.MjModel, mujoco.MjData, list[tactsim.press.PadReading]]]:
    """Close the hand on an object, lift it and hold it: at each reading the model, its data and what the pads read."""
    model, readers = scene(name, psf_sigma)
    data = mujoco.MjData(model)
    while data.time < seconds:
        closed, lifted = np.clip((data.time - 0.2) / 1.0, 0, 1), np.clip((data.time - 1.6) / 1.0, 0, 1)
        data.ctrl[0] = 0.05 * lifted  # m
        data.ctrl[1:6] = 0.45 * closed  # rad, at the fingers' bases
        data.ctrl[6:] = -0.1 * closed  # and at their knuckles, so that the fingertips close flat
        mujoco.mj_step(model, data)
        if round(data.time / model.opt.timestep) % READ_EVERY == 0:
            yield model, data, [reader.read(data) for reader in readers]


def triangles(
    model: mujoco.MjModel, data: mujoco.MjData
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """List what is seen of a scene but for the table: corners (n, 3, 3) m, colours (n, 3), how many are of sites."""
    corners, colours = [], []
    for geom in range(model.ngeom):
        kind, size = model.geom_type[geom], model.geom_size[geom]
        if kind == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            shape = trimesh.convex.convex_hull(model.mesh_vert[first : first + count])
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            shape = trimesh.creation.capsule(2 * size[1], size[0], count=[12, 16])
            shape.apply_translation([0, 0, -size[1]] if shape.bounds[0, 2] > -size[1] else [0, 0, 0])
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            shape = trimesh.creation.box(2 * size).subdivide().subdivide()
        else:
            shape = trimesh.creation.icosphere(3, size[0])
        corners.append(shape.triangles @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
        colours.append(np.tile(model.geom_rgba[geom, :3], (len(shape.triangles), 1)))
    of_geoms = sum(map(len, corners))
    for site in range(model.nsite):  # taxels, and arrows where pads look
        size = model.site_size[site]
        if model.site_type[site] == mujoco.mjtGeom.mjGEOM_BOX:
            shape = trimesh.creation.box(2 * size)
        else:
            shape = trimesh.creation.cylinder(size[0], 2 * size[1], sections=16)
        corners.append(shape.triangles @ data.site_xmat[site].reshape(3, 3).T + data.site_xpos[site])
        colours.append(np.tile(model.site_rgba[site, :3], (len(shape.triangles), 1)))
    whole = np.concatenate(corners)
    return whole, np.concatenate(colours), len(whole) - of_geoms


def draw_scene(axes, model: mujoco.MjModel, data: mujoco.MjData, turn: float = np.radians(38)) -> None:
    """Draw a scene on Matplotlib axes, seen from one side and from above: what is nearer over what is farther."""
    lean = np.radians(14)
    right = np.array([np.cos(turn), np.sin(turn), 0])
    towards = np.array([np.sin(turn) * np.cos(lean), -np.cos(turn) * np.cos(lean), np.sin(lean)])
    up = np.cross(towards, right)
    corners, colours, on_top = triangles(model, data)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = 0.45 + 0.55 * np.clip(normals @ (0.5 * towards + 0.75 * up - 0.4 * right), 0, 1)
    depth = corners.mean(axis=1) @ towards
    depth[len(depth) - on_top :] += 0.005  # m: a taxel lies on what it is drawn over
    order = np.argsort(depth)
    order = order[normals[order] @ towards > 0]
    flat = np.stack([corners @ right, corners @ up], axis=-1)[order]
    shaded = np.clip(colours * light[:, None], 0, 1)[order]
    axes.add_collection(PolyCollection(flat, facecolors=shaded, edgecolors=shaded, linewidths=0.3))
    table = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.075
    axes.add_patch(Polygon(np.stack([table @ right, table @ up], axis=-1), facecolor="0.92", zorder=0))
    axes.set(xlim=(-0.107, 0.107), ylim=(-0.03, 0.172), aspect="equal")
    axes.set_axis_off()


def draw_pads(axes, readings: Sequence[tactsim.press.PadReading], most: float) -> None:
    """Draw what each pad reads on its own axes: pressure, shear as arrows, and the force that it carries."""
    for each, name, reading in zip(axes, NAMES, readings, strict=True):
        x, y = FOIL.taxel_xy.T
        each.imshow(
            reading.kpa.reshape(FOIL.rows, FOIL.columns), origin="lower", extent=(-5, 5, -9, 9), vmin=0, vmax=most,
            cmap="magma",
        )  # fmt: skip
        each.quiver(
            x,
            y,
            *reading.shear_kpa.T,
            color="white",
            scale=most / 3,
            scale_units="inches",
            width=0.02,
            minlength=0,
        )
        each.set_title(f"{name}\n{reading.force - reading.outside:.1f} N", fontsize=8)
        each.set(xticks=[], yticks=[], xlim=(-5, 5), ylim=(-9, 9))


def sites(path: Path) -> None:
    """Draw where the thumb's pad lies and looks, before a step is made."""
    spec = mujoco.MjSpec.from_file(str(HAND))
    tactsim.press.attach(spec, "thumbtip", FOIL, normal=(0, 1, 0)).show()
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    figure = Figure(figsize=(5, 4), layout="constrained")
    axes = figure.subplots()
    draw_scene(axes, model, data, turn=np.radians(150))
    axes.set(xlim=(-0.06, 0.02), ylim=(0.015, 0.079))
    figure.savefig(path, dpi=110)


def film(folder: Path, names: Sequence[str], seconds: float) -> None:
    """Grasp each object; write hand.gif, and hand.png of the last moment of each."""
    frames: list[Image.Image] = []
    picture = Figure(figsize=(8, 2.5 * len(names)), layout="constrained")
    rows = np.atleast_1d(picture.subfigures(len(names), 1))
    for name, row in zip(names, rows, strict=True):
        for model, data, readings in grasp(name, seconds):
            if round(data.time, 3) * 10 % 2 == 0 and data.time < 4:
                frames.append(frame(model, data, readings))
        draw(row, model, data, readings)
        carried = ", ".join(
            f"{who} {reading.force - reading.outside:.2f}"
            for who, reading in zip(NAMES, readings, strict=True)
        )
        print(f"{name}: after {data.time:.1f} s the pads carry, N: {carried}")
    picture.savefig(folder / "hand.png", dpi=110)
    frames[0].save(
        folder / "hand.gif", save_all=True, append_images=frames[1:], duration=120, loop=0, optimize=True
    )


def draw(
    figure, model: mujoco.MjModel, data: mujoco.MjData, readings: Sequence[tactsim.press.PadReading]
) -> None:
    """Draw the scene on the left and the five pads on the right."""
    axes = figure.subplots(1, 6, width_ratios=[3.2, 1, 1, 1, 1, 1])
    draw_scene(axes[0], model, data)
    draw_pads(axes[1:], readings, 150.0)
    scale = figure.colorbar(axes[-1].images[0], ax=axes[1:], fraction=0.04, pad=0.02, ticks=[0, 50, 100, 150])
    scale.set_label("kPa", size=8)
    scale.ax.tick_params(labelsize=7)


def frame(
    model: mujoco.MjModel, data: mujoco.MjData, readings: Sequence[tactsim.press.PadReading]
) -> Image.Image:
    """Draw one picture of the film."""
    figure = Figure(figsize=(6, 2.4), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    draw(figure, model, data, readings)
    figure.set_dpi(80)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(64)


def main() -> None:
    """Run the example as the top of this file says."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where hand.png and hand.gif are written")
    parser.add_argument(
        "objects", nargs="*", default=OBJECTS, help="of ball, egg and letter; all if none is given"
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="of simulation for each object")
    given = parser.parse_args()
    if unknown := [name for name in given.objects if name not in OBJECTS]:
        parser.error(f"unknown object {unknown[0]!r}: known are {', '.join(OBJECTS)}")
    given.folder.mkdir(parents=True, exist_ok=True)
    sites(given.folder / "attached-sites.png")
    film(given.folder, given.objects, given.seconds)


if __name__ == "__main__":
    main()
