"""The catalogue of solids: twelve families of objects in space, each built by CSG, and variants of them by size."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError, unknown
from tactsim.models.glyphs import Point, arc_points, disc, polygon
from tactsim.solids.body import Solid, solid_of

if TYPE_CHECKING:
    from manifold3d import Manifold

AROUND = 60  # chords round an axis: 0.03 mm within a circle of 44 mm across
LARGEST_COUNT = 50  # the twelve and their variants


def solid_names(count: int = 12) -> tuple[str, ...]:
    """List the first `count` names: the twelve families, then `bolt-2`, `nut-2`, ... up to 50.

    Raises InputError for a count that is not 1 to 50.
    """
    if not 1 <= count <= LARGEST_COUNT:
        raise InputError(f"there are 1 to {LARGEST_COUNT} solids to choose from, not {count}")
    rounds = max(map(len, _VARIANTS.values()))
    names = [*_FAMILIES]
    for turn in range(rounds):
        names += [f"{family}-{turn + 2}" for family in _FAMILIES if turn < len(_VARIANTS[family])]
    return tuple(names[:count])


@lru_cache(maxsize=64)
def solid(name: str) -> Solid:
    """Build a solid of the catalogue. Raises InputError for a name that is not in it."""
    if name not in solid_names(LARGEST_COUNT):
        raise unknown("solid", name, solid_names(LARGEST_COUNT))
    # A family's own name may have a hyphen: "star-knob", "star-knob-2".
    family, _, number = (name, "", "") if name in _FAMILIES else name.rpartition("-")
    sizes = _VARIANTS[family][int(number) - 2] if number else {}
    return solid_of(name, _FAMILIES[family](**sizes))


def _revolved(*profile: Point) -> Manifold:
    """Turn a profile of points (distance from the axis, height) round the z axis."""
    from manifold3d import Manifold

    return Manifold.revolve(polygon(*profile), AROUND)


def _hexagon(flats: float, height: float, *, below: bool) -> Manifold:
    """Make a hexagon prism on z = 0, its corners turned off at 30 degrees at the top, and at the bottom if `below`."""
    from manifold3d import Manifold

    corner, inner = flats / math.sqrt(3), 0.475 * flats
    outer = corner + 1
    drop = (outer - inner) * math.tan(math.radians(30))
    bottom = [(inner, 0.0), (outer, drop)] if below else [(outer, 0.0)]
    turned = _revolved((0, 0), *bottom, (outer, height - drop), (inner, height), (0, height))
    return Manifold.cylinder(height, corner, circular_segments=6) ^ turned


def _bolt(flats: float = 18, head: float = 8, shank: float = 10, length: float = 34) -> Manifold:
    """Make a bolt with a hexagon head and a smooth shank with a chamfered tip."""
    r, tip = shank / 2, 0.15 * shank
    body = _revolved((0, -length), (r - tip, -length), (r, -length + tip), (r, 1), (0, 1))
    return _hexagon(flats, head, below=False) + body


def _nut(flats: float = 24, height: float = 13, hole: float = 14) -> Manifold:
    """Make a hexagon nut with a smooth hole."""
    from manifold3d import Manifold

    bore = Manifold.cylinder(height + 2, hole / 2, circular_segments=AROUND).translate((0, 0, -1))
    return _hexagon(flats, height, below=True) - bore


def _key(
    bow: float = 22, blade: float = 32, width: float = 9, thickness: float = 5,
    cuts: tuple[float, ...] = (3.0, 1.2, 3.6, 2.0),
) -> Manifold:  # fmt: skip
    """Make a flat key: a bow with a hole, a blade with cuts along one edge and a groove along one face."""
    from manifold3d import Manifold

    head = disc(0, 0, bow / 2, AROUND) - disc(-0.22 * bow, 0, 0.16 * bow, 24)
    start, end, half = 0.4 * bow, bow / 2 + blade, width / 2
    outline = polygon((start, -half), (end - half, -half), (end, 0), (end - half, half), (start, half))
    step = (blade - width) / len(cuts)
    for place, depth in enumerate(cuts):
        x = bow / 2 + 3 + (place + 0.5) * step
        low, top = half - depth, half + 1
        outline -= polygon(
            (x - 0.2 * step, low), (x + 0.2 * step, low), (x + 0.5 * step, top), (x - 0.5 * step, top)
        )
    flat = (head + outline).extrude(thickness)
    groove = Manifold.cube((blade + 2, 0.22 * width, 0.4 * thickness))
    return flat - groove.translate((bow / 2 + 1, -0.34 * width, 0.6 * thickness + 1e-3))


def _mug(bottom: float = 36, top: float = 42, height: float = 44, wall: float = 3.5) -> Manifold:
    """Make a mug without a handle, a little wider at its rim."""
    low, high = bottom / 2, top / 2
    return _revolved(
        (0, 0), (low - 1.5, 0), (low, 1.5), (high, height), (high - wall, height), (low - wall, 4), (0, 4)
    )


def _gear(
    teeth: int = 12, outer: float = 44, depth: float = 5, thickness: float = 11, bore: float = 10
) -> Manifold:
    """Make a spur gear with straight flanks and a round bore."""
    points: list[Point] = []
    pitch, root, tip = 2 * math.pi / teeth, outer / 2 - depth, outer / 2
    for tooth in range(teeth):
        for share, radius in ((-0.29, root), (-0.14, tip), (0.14, tip), (0.29, root)):
            angle = (tooth + share) * pitch
            points.append((radius * math.cos(angle), radius * math.sin(angle)))
    return (polygon(*points) - disc(0, 0, bore / 2, AROUND)).extrude(thickness)


def _spool(
    flange: float = 36, rim: float = 4, core: float = 16, length: float = 38, bore: float = 8
) -> Manifold:
    """Make a spool for thread: two flanges, a core and a bore."""
    f, c, b, half = flange / 2, core / 2, bore / 2, length / 2
    upper = [(c, half - rim), (f, half - rim), (f, half), (b, half)]
    return _revolved(*((x, -height) for x, height in reversed(upper)), *upper)


def _bracket(
    base: float = 40, upright: float = 30, width: float = 24, thickness: float = 5, rib: float = 15,
    hole: float = 8,
) -> Manifold:  # fmt: skip
    """Make an angle bracket: a base with a hole, an upright with a slot, and a rib between them."""
    from manifold3d import Manifold

    plates = Manifold.cube((base, width, thickness)) + Manifold.cube((thickness, width, upright))
    reach = thickness + rib
    side = polygon((0, 0), (reach, 0), (reach, thickness), (thickness, reach), (0, reach))
    # An outline lies in the xy plane: turned by 90 degrees about x it stands along y.
    web = side.extrude(4).rotate((90, 0, 0)).translate((0, width / 2 + 2, 0))
    drill = Manifold.cylinder(thickness + 2, hole / 2, circular_segments=36)
    drill = drill.translate((0.75 * base, width / 2, -1))
    slot = (disc(0, -3, 2.5, 24) + disc(0, 3, 2.5, 24)).hull().extrude(thickness + 2)
    slot = slot.rotate((0, 90, 0)).translate((-1, width / 2, upright - 5))
    return plates + web - drill - slot


def _egg(across: float = 40, blunt: float = 22, pointed: float = 30) -> Manifold:
    """Make an egg of two half ellipsoids: `blunt` and `pointed` mm long, of one width."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 25)
    profile = [
        (max(across / 2 * math.cos(a), 0.0), math.sin(a) * (pointed if a > 0 else blunt)) for a in angles
    ]
    return _revolved(*profile)


def _cone(across: float = 42, height: float = 44, tip: float = 3) -> Manifold:
    """Make a cone whose tip is rounded with a radius of `tip` mm."""
    base = across / 2
    slope = math.atan2(base, height)  # half the angle at the apex
    centre = height - tip / math.sin(slope)
    arc = arc_points(0, centre, tip, math.degrees(slope), 90, 8)
    return _revolved((0, 0), (base, 0), *arc[:-1], (0, centre + tip))


def _star_knob(
    lobes: int = 5, across: float = 46, height: float = 13, boss: float = 16, below: float = 11
) -> Manifold:
    """Make a star knob: round lobes on a disc, with a boss below."""
    radius = 0.34 * across / math.sqrt(lobes)
    reach = across / 2 - radius
    lobe, star = disc(reach, 0, radius, 36), disc(0, 0, reach, AROUND)
    for number in range(lobes):
        star += lobe.rotate(360 * number / lobes)
    stem = _revolved((0, -below), (boss / 2, -below), (boss / 2, 1), (0, 1))
    return star.extrude(height) + stem


def _ring(across: float = 46, thickness: float = 11) -> Manifold:
    """Make a ring with a round section (a torus)."""
    return _revolved(*arc_points((across - thickness) / 2, 0, thickness / 2, 0, 360, 24)[:-1])


def _tetrapod(leg: float = 23, root: float = 13, tip: float = 9) -> Manifold:
    """Make a tetrapod: four tapering legs with round ends that point to the corners of a tetrahedron."""
    from manifold3d import Manifold

    low = arc_points(0, 0, root / 2, -90, 0, 6)
    high = arc_points(0, leg, tip / 2, 0, 90, 6)
    one = Manifold.revolve(polygon(*low[:-1], *low[-1:], *high[:-1], (0.0, leg + tip / 2)), 36)
    lean = math.degrees(math.acos(-1 / 3))
    legs = [one] + [one.rotate((0, lean, 0)).rotate((0, 0, 120 * turn)) for turn in range(3)]
    return legs[0] + legs[1] + legs[2] + legs[3]


_FAMILIES: Mapping[str, Callable[..., Manifold]] = {
    "bolt": _bolt, "nut": _nut, "key": _key, "mug": _mug, "gear": _gear, "spool": _spool, "bracket": _bracket,
    "egg": _egg, "cone": _cone, "star-knob": _star_knob, "ring": _ring, "tetrapod": _tetrapod,
}  # fmt: skip

_VARIANTS: Mapping[str, tuple[dict[str, object], ...]] = {
    "bolt": (
        {"flats": 24, "head": 10, "shank": 14, "length": 40},
        {"flats": 13, "head": 6, "shank": 8, "length": 26},
        {"flats": 16, "head": 8, "shank": 10, "length": 22},
        {"flats": 20, "head": 7, "shank": 8, "length": 48},
    ),
    "nut": (
        {"flats": 30, "height": 16, "hole": 18},
        {"flats": 20, "height": 10, "hole": 11},
        {"flats": 28, "height": 24, "hole": 14},
        {"flats": 34, "height": 9, "hole": 22},
    ),
    "key": (
        {"bow": 26, "blade": 30, "cuts": (1.2, 3.6, 2.0)},
        {"bow": 18, "blade": 38, "width": 8, "cuts": (2.0, 3.0, 1.0, 3.0, 2.0)},
        {"bow": 24, "blade": 34, "width": 12, "thickness": 8, "cuts": (4.0, 2.0, 5.0)},
    ),
    "mug": (
        {"bottom": 44, "top": 44, "height": 36},
        {"bottom": 26, "top": 40, "height": 50},
        {"bottom": 30, "top": 32, "height": 56, "wall": 5},
    ),
    "gear": (
        {"teeth": 9, "outer": 40, "depth": 6, "thickness": 16},
        {"teeth": 16, "outer": 54, "depth": 5, "thickness": 9, "bore": 20},
        {"teeth": 8, "outer": 30, "depth": 5, "thickness": 24, "bore": 8},
    ),
    "spool": (
        {"flange": 46, "rim": 5, "core": 24, "length": 28},
        {"flange": 28, "rim": 3, "core": 18, "length": 50, "bore": 12},
        {"flange": 40, "rim": 10, "core": 12, "length": 44, "bore": 6},
    ),
    "bracket": (
        {"base": 50, "upright": 24, "width": 20},
        {"base": 32, "upright": 40, "width": 34, "thickness": 4, "rib": 20},
        {"base": 44, "upright": 44, "width": 16, "thickness": 7, "rib": 24, "hole": 6},
    ),
    "egg": (
        {"across": 34, "blunt": 18, "pointed": 24},
        {"across": 46, "blunt": 24, "pointed": 28},
        {"across": 30, "blunt": 26, "pointed": 34},
    ),
    "cone": (
        {"across": 54, "height": 34, "tip": 4},
        {"across": 30, "height": 56, "tip": 3},
        {"across": 36, "height": 36, "tip": 8},
    ),
    "star-knob": (
        {"lobes": 3, "across": 50, "height": 15},
        {"lobes": 6, "across": 40, "height": 18, "boss": 14, "below": 16},
        {"lobes": 4, "across": 44, "height": 11, "boss": 22, "below": 20},
    ),
    "ring": (
        {"across": 54, "thickness": 8},
        {"across": 40, "thickness": 16},
        {"across": 30, "thickness": 8},
    ),
    "tetrapod": (
        {"leg": 30, "root": 12, "tip": 8},
        {"leg": 18, "root": 16, "tip": 12},
        {"leg": 26, "root": 10, "tip": 14},
    ),
}  # fmt: skip
