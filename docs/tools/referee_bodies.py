"""Eight bodies that every referee presses on the same pad: as a height field, as MJCF geoms and as a mesh, in mm.

The pad's face is the plane z = 0 and a body's lowest point touches it; what lies beside the pad touches nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from manifold3d import Manifold, Mesh
from numpy.typing import NDArray
from scipy.special import ndtr

from tactsim import Pad, models

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
from attached_scenes import within

Array = NDArray[np.float64]
PAD = Pad(taxel_width=1.9, taxel_height=1.9, seam=None, unread_columns=0)
HALF = 5.7  # mm, of the pad's side
FORCE = 2.0  # N
STIFFNESS = 1.0  # N/mm^3: the default layer of 1 mm and 1,000 kPa/mm
_FINE = 0.01  # mm, of the brute force
_HIGH = 3.0  # mm of a body that are kept
_ROUND = 96  # sides of a circle
_TILT = 0.004  # rad


@dataclass(frozen=True)
class Body:
    """A rigid body above the pad.

    gap: of x and y, mm, how far it is above its lowest point; infinite where there is none. geoms, assets, pose: MJCF,
    the body's frame in the pad's face. solid: the same, cut at the pad's rim.
    """

    name: str
    gap: Callable[[Array, Array], Array]
    geoms: str
    solid: Manifold
    assets: str = ""
    pose: str = ""


def bodies() -> list[Body]:
    """Make the eight."""
    return [
        _round("sphere", lambda r: 10 - np.sqrt(100 - r**2), 5.6, '<geom size=".01" pos="0 0 .01"/>'),
        _cone(),
        _cylinder(),
        _round("4 mm punch", lambda r: 0 * r, 2.0, '<geom type="cylinder" size=".002 .002" pos="0 0 .002"/>'),
        _letter("A", 0.0),
        _letter("E", _TILT),
        _step(),
        _braille(),
    ]


def truth(body: Body, sigma: float = 0.0) -> tuple[Array, float]:
    """Press a body on a bed of springs by brute force: what the taxels read, (36,) kPa, and how deep it is, mm."""
    axis = np.arange(-HALF + _FINE / 2, HALF, _FINE)
    away = body.gap(*np.meshgrid(axis, axis))
    met = np.sort(away[np.isfinite(away)])
    unit = STIFFNESS * _FINE**2
    depths = (FORCE / unit + np.cumsum(met)) / np.arange(1, len(met) + 1)
    depth = depths[np.searchsorted(met - depths, 0) - 1]
    return taxels(axis, axis, unit * np.maximum(depth - away, 0), sigma), float(depth)


def taxels(x: Array, y: Array, load: Array, sigma: float = 0.0) -> Array:
    """Spread loads (y, x), N, by a Gaussian of sigma mm, and average them over the taxels: (36,) kPa."""

    def felt(at: Array, edges: Array) -> Array:
        away = (edges - at[:, None, None]) / max(sigma, 1e-4)
        return np.diff(ndtr(away), axis=-1)[..., 0] / np.diff(edges, axis=1).T

    return 1e3 * (felt(y, PAD.row_edges).T @ load @ felt(x, PAD.column_edges)).ravel()


def _round(name: str, rise: Callable[[Array], Array], radius: float, geoms: str) -> Body:
    """Turn a profile about the z axis."""

    def gap(x: Array, y: Array) -> Array:
        r = np.hypot(x, y)
        return np.where(r <= radius, rise(np.minimum(r, radius)), np.inf)

    return Body(name, gap, geoms, _turned(rise, radius))


def _turned(rise: Callable[[Array], Array], radius: float) -> Manifold:
    radii = np.linspace(0, radius, 29 if float(rise(np.array([radius]))[0]) else 2)
    angles = 2 * np.pi * np.arange(_ROUND) / _ROUND
    rings = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    low = [[0.0, 0.0, float(rise(np.zeros(1))[0])]]
    for r in radii[1:]:
        low += [[r * x, r * y, float(rise(np.array([r]))[0])] for x, y in rings]
    top = [[radius * x, radius * y, _HIGH] for x, y in rings] + [[0.0, 0.0, _HIGH]]
    here = np.arange(_ROUND)
    after = (here + 1) % _ROUND
    faces = [np.stack([0 * here, 1 + after, 1 + here], axis=1)]
    for ring in range(len(radii) - 1):  # to the next ring; after the last of the profile, to that of the top
        a, b = 1 + ring * _ROUND, 1 + (ring + 1) * _ROUND
        faces += [np.stack([a + here, a + after, b + here], 1), np.stack([a + after, b + after, b + here], 1)]
    last = 1 + (len(radii) - 1) * _ROUND
    faces.append(np.stack([last + here, last + after, 0 * here + last + _ROUND], axis=1))
    return Manifold(Mesh(np.array(low + top, np.float32), np.concatenate(faces).astype(np.uint32)))


def _cone() -> Body:
    """Make a cone of 0.2 mm a mm, a mesh for MuJoCo."""
    angles = 2 * np.pi * np.arange(128) / 128
    rim = np.stack([5.5 * np.cos(angles), 5.5 * np.sin(angles), np.full(128, 1.1)], axis=1)
    corners = np.concatenate([[[0, 0, 0]], rim, rim + [0, 0, 1]]) / 1e3
    body = _round("cone", lambda r: 0.2 * r, 5.5, '<geom type="mesh" mesh="cone"/>')
    return Body(body.name, body.gap, body.geoms, body.solid, _mesh("cone", corners))


def _cylinder() -> Body:
    """Lay a cylinder of R = 6 mm, 8 mm long, along y."""

    def gap(x: Array, y: Array) -> Array:
        return np.where((np.abs(y) <= 4) & (np.abs(x) < 6), 6 - np.sqrt(np.maximum(36 - x**2, 0)), np.inf)

    solid = Manifold.cylinder(8, 6, 6, 8 * _ROUND, True).rotate([90, 0, 0]).translate([0, 0, 6])
    quarter = "0.7071067811865476 0.7071067811865476 0 0"
    geom = f'<geom type="cylinder" size=".006 .004" pos="0 0 .006" quat="{quarter}"/>'
    return Body("cylinder", gap, geom, _cut(solid))


def _letter(name: str, tilt: float) -> Body:
    """Lay a letter face down, its middle 1.3 mm beside the pad's, tilted about y so that +x comes closer."""
    letter = models.letter(name)
    shift = np.array([1.3, 0.7, 0.0])
    assets, geoms = "", ""
    for number, part in enumerate(letter.parts):
        corners = (part.vertices - [0, 0, letter.height]) * [1, 1, -1] + shift
        assets += _mesh(f"part{number}", corners / 1e3)
        geoms += f'<geom type="mesh" mesh="part{number}"/>'

    def gap(x: Array, y: Array) -> Array:
        inside = within(letter.contours, x / np.cos(tilt) - shift[0], y - shift[1])
        return np.where(inside, (HALF - x) * np.tan(tilt), np.inf)

    solid = letter.solid.translate([0, 0, -letter.height]).mirror([0, 0, 1]).translate(shift.tolist())
    solid = solid.rotate([0, float(np.degrees(tilt)), 0]).translate([0, 0, HALF * np.tan(tilt)])
    pose = f'pos="0 0 {HALF * np.tan(tilt) / 1e3}" euler="0 {tilt} 0"'
    return Body(f"tilted {name}" if tilt else name, gap, geoms, _cut(solid), assets, pose)


def _step() -> Body:
    """Put a box of 1 x 8 mm beside one of 6 x 8 mm that lies 0.2 mm behind."""

    def gap(x: Array, y: Array) -> Array:
        along = np.abs(y) < 4
        return np.where(
            along & (np.abs(x + 3) < 0.5), 0.0, np.where(along & (np.abs(x - 0.5) < 3), 0.2, np.inf)
        )

    geoms = """<geom type="box" size=".0005 .004 .001" pos="-.003 0 .001"/>
        <geom type="box" size=".003 .004 .001" pos=".0005 0 .0012"/>"""
    front = Manifold.cube([1, 8, 2], True).translate([-3, 0, 1])
    return Body("step", gap, geoms, front + Manifold.cube([6, 8, 2], True).translate([0.5, 0, 1.2]))


def _braille() -> Body:
    """Take six half balls of R = 1 mm, 2.5 mm apart."""
    dots = [(x, y) for x in (-1.25, 1.25) for y in (-2.5, 0.0, 2.5)]

    def gap(x: Array, y: Array) -> Array:
        away = [(x - a) ** 2 + (y - b) ** 2 for a, b in dots]
        rise = [np.where(r < 1, 1 - np.sqrt(np.maximum(1 - r, 0)), np.inf) for r in away]
        return np.asarray(np.min(rise, axis=0))

    geoms = "".join(f'<geom size=".001" pos="{x / 1e3} {y / 1e3} .001"/>' for x, y in dots)
    dot = _turned(lambda r: 1 - np.sqrt(np.maximum(1 - r**2, 0)), 1.0)
    return Body("Braille cell", gap, geoms, Manifold.compose([dot.translate([x, y, 0]) for x, y in dots]))


def _cut(solid: Manifold) -> Manifold:
    return solid ^ Manifold.cube([2 * HALF, 2 * HALF, 2 * _HIGH], True)


def _mesh(name: str, corners: Array) -> str:
    return f'<mesh name="{name}" vertex="{" ".join(map(repr, corners.ravel().tolist()))}"/>'
