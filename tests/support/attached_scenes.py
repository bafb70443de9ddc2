"""Scenes for pads that are attached to a geom: one body that rests on a pad, and what the pad should read."""

import mujoco
import numpy as np
from scipy.special import ndtr

import tactsim

GRAVITY = 9.81


def simulate(world, geom="finger", pad=None, *, steps=1000, **options):
    """Attach a pad in a world, MJCF, and step it: the reader, the data, and the reading."""
    spec = mujoco.MjSpec.from_string(f'<mujoco><option timestep="0.001"/>{world}</mujoco>')
    reader = tactsim.press.attach(spec, geom, pad, **options).bind(model := spec.compile())
    data = mujoco.MjData(model)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return reader, data, reader.read(data)


def rest(
    body,
    pad=None,
    *,
    x=0.0,
    y=0.0,
    height=5.0,
    steps=1200,
    face="0.02 0.02 0.005",
    xml="",
    **options,
):
    """Let a body of 0.2 kg rest on a box that carries a pad: its reader, the data, and the reading.

    body: MJCF of a geom. x, y, height: mm, where its frame begins above the box's face. xml: more of the world.
    """
    world = f"""
          <asset><mesh name="cube" vertex="1 1 1 -1 1 1 1 -1 1 -1 -1 1 1 1 -1 -1 1 -1 1 -1 -1 -1 -1 -1"
                       scale=".003 .003 .003"/></asset>
          <worldbody>
            <geom name="finger" type="box" size="{face}"/>
            <body name="body" pos="{x / 1e3} {y / 1e3} {height / 1e3 + float(face.split()[-1])}">
              <joint type="slide" axis="0 0 1"/><geom name="object" {body} mass="0.2"/>
            </body>{xml}
          </worldbody>"""
    return simulate(world, pad=pad, steps=steps, **options)


def felt(at, edges, sigma):
    """Give the share of a load at each place that taxels between edges feel, for a mm of their width."""
    return np.diff(ndtr((edges - at[:, None, None]) / sigma), axis=-1)[..., 0] / (edges[0, 1] - edges[0, 0])


def image(pad, pressure, *, fineness=1200):
    """Spread a pressure(x, y), N/mm^2 over mm, over the taxels by a fine lattice: (taxels,) kPa."""
    x_low, x_high, y_low, y_high = pad.load_bounds

    def middles(low, high):
        edges = np.linspace(low, high, fineness + 1)
        return (edges[1:] + edges[:-1]) / 2

    x, y = middles(x_low, x_high), middles(y_low, y_high)
    lattice = pressure(*np.meshgrid(x, y)) * (x[1] - x[0]) * (y[1] - y[0])
    return 1e3 * (felt(y, pad.row_edges, 1.0).T @ lattice @ felt(x, pad.column_edges, 1.0)).ravel()


def errors(kpa, truth):
    """Compare with the truth: the 95th percentile and the largest error over the taxels, as shares of the peak."""
    off = np.abs(kpa - truth) / truth.max()
    return np.percentile(off, 95), off.max()


def block(force, half_x, half_y, angle=0.0, x=0.0, y=0.0, lever=0.0):
    """Give the pressure under a flat rectangle, mm; `lever` mm is where along its x the force stands."""
    cosine, sine = np.cos(angle), np.sin(angle)

    def pressure(at_x, at_y):
        across, along = cosine * (at_x - x) + sine * (at_y - y), cosine * (at_y - y) - sine * (at_x - x)
        within = (np.abs(across) <= half_x) & (np.abs(along) <= half_y)
        return within * force / (4 * half_x * half_y) * (1 + 3 * lever * across / half_x**2)

    return pressure


def ball(force, radius, x=0.0, y=0.0):
    """Give the pressure under a sphere: force = pi k d^2 (R - d / 3), of a spherical cap."""
    depths = np.linspace(0, radius, 200_001)
    depth = np.interp(force, np.pi * depths**2 * (radius - depths / 3), depths)

    def pressure(at_x, at_y):
        height = np.sqrt(np.maximum(radius**2 - (at_x - x) ** 2 - (at_y - y) ** 2, 0))
        return np.maximum(depth - radius + height, 0)

    return pressure


def roll(force, radius, half, angle=0.0, x=0.0, y=0.0):
    """Give the pressure under a cylinder that lies along y, turned by `angle`: a circle's segment for a mm of it."""
    depths = np.linspace(0, radius, 200_001)
    inner = radius - depths
    segments = radius**2 * np.arccos(inner / radius) - inner * np.sqrt(radius**2 - inner**2)
    depth = np.interp(force, 2 * half * segments, depths)
    cosine, sine = np.cos(angle), np.sin(angle)

    def pressure(at_x, at_y):
        across, along = cosine * (at_x - x) + sine * (at_y - y), cosine * (at_y - y) - sine * (at_x - x)
        height = np.sqrt(np.maximum(radius**2 - across**2, 0))
        return (np.abs(along) <= half) * np.maximum(depth - radius + height, 0)

    return pressure


def springs(pad, gap, force, *, fine=0.01, beyond=5.0):
    """Press a height field on springs by brute force: (taxels,) kPa, the force on the pad, N, and the depth, mm.

    gap: of x and y, mm, how far what presses is above the pad where it first touches; infinite where there is none.
    The layer has 1 N/mm^3. fine: mm. What lies beside the pad up to `beyond` mm away is pressed, too.
    """
    x_low, x_high, y_low, y_high = pad.load_bounds
    x, y = (
        np.arange(low - beyond + fine / 2, high + beyond, fine)
        for low, high in ((x_low, x_high), (y_low, y_high))
    )
    away = gap(*np.meshgrid(x, y))
    met = np.sort(away[np.isfinite(away)])
    unit = fine**2
    depths = (force / unit + np.cumsum(met)) / np.arange(1, len(met) + 1)
    depth = depths[np.searchsorted(met - depths, 0) - 1]
    load = unit * np.maximum(depth - away, 0)
    load[(y < y_low) | (y > y_high)] = 0
    load[:, (x < x_low) | (x > x_high)] = 0

    kpa = 1e3 * (felt(y, pad.row_edges, 1.0).T @ load @ felt(x, pad.column_edges, 1.0)).ravel()
    return kpa, load.sum(), depth


def within(contours, x, y):
    """Tell which points lie in a shape, by counting how often a line from each crosses the contours."""
    inside = np.zeros(x.shape, dtype=bool)
    for contour in contours:
        for (ax, ay), (bx, by) in zip(contour, np.roll(contour, -1, axis=0), strict=True):
            if ay != by:
                inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return inside


def settle(geoms, pad=None, *, pose="", assets="", **options):
    """Let a body of several geoms, MJCF in m, slide down on a box of 60 x 60 mm: its reader, data and reading.

    The face is at z = 0. pose: MJCF attributes of the body.
    """
    world = f"""
        <compiler angle="radian"/><asset>{assets}</asset><worldbody>
          <geom name="finger" type="box" size=".03 .03 .005" pos="0 0 -.005"/>
          <body name="body" {pose}><joint type="slide" axis="0 0 1"/>
            <inertial pos="0 0 0" mass="0.2" diaginertia="1e-5 1e-5 1e-5"/>{geoms}</body>
        </worldbody>"""
    return simulate(world, pad=pad, steps=1500, **options)


def letter_geoms(letter):
    """Write a letter's convex parts as mesh geoms, its face down at z = 0: assets and geoms, MJCF."""
    assets, geoms = [], []
    for number, part in enumerate(letter.parts):
        places = (part.vertices - [0, 0, letter.height]) * [1, -1, -1] / 1e3
        assets.append(f'<mesh name="m{number}" vertex="{" ".join(map(repr, places.ravel().tolist()))}"/>')
        geoms.append(f'<geom type="mesh" mesh="m{number}"/>')
    return "".join(assets), "".join(geoms)
