"""Touch every object of a scan in space: touches that teach it, even over its surface, and touches from anywhere."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import OWN_LICENCE
from tactsim.core.rigid import from_vector, multiply, random_rotations, turn_from_z, turned
from tactsim.core.scan import SPLITS
from tactsim.core.seeds import stream
from tactsim.solids.options import SpaceOptions
from tactsim.solids.press import SpacePress
from tactsim.solids.solid_scan import SpaceScan

_CANDIDATES = 8  # points drawn for each that is kept
_CLEAR = 1.0  # mm between an object's bounding sphere and the pads that start outside


def scan_solids(
    options: SpaceOptions, *, progress: Callable[[int, int], None] | None = None
) -> tuple[SpaceScan, dict[str, Any]]:
    """Touch every object: `touch_grid` to train, touches from anywhere to test.

    progress(done, total): called as touches are done. Returns the scan and its work: `presses`, and of those `misses`.
    The same options give the same bits, and an object's readings do not depend on the other objects.

    Raises InputError for an object or mesh that does not exist, or is none that can be touched.
    """
    solids = solids_of(options)
    press = SpacePress(solids, options)
    done, total = 0, len(solids) * (options.points * options.turns + options.tests)
    batches, labels, splits = [], [], []
    for solid in solids:
        for split in SPLITS:
            draw = stream(options.seed, solid.name, split, "touches")
            starts = (
                touch_grid(solid, options.points, options.turns, options.lean, draw)
                if split == "train"
                else random_starts(solid, options.tests, draw)
            )
            touched = press.touch(solid.name, starts, stream(options.seed, solid.name, split, "placement"))
            batches.append(press.sensed(touched, stream(options.seed, solid.name, split, "sense")))
            labels += [solid.name] * len(starts)
            splits += [split] * len(starts)
            done += len(starts)
            if progress is not None:
                progress(done, total)
    scan = SpaceScan(
        readings=np.concatenate([batch.readings for batch in batches]),
        poses=np.concatenate([batch.stated for batch in batches]),
        labels=np.array(labels),
        split=np.array(splits),
        taxel_points=press.lattice.taxel_points,
        taxel_normals=press.lattice.taxel_normals,
        touch=np.arange(len(labels)),
        meta={
            "source": "simulated",
            "options": options.model_dump(mode="json"),
            "stroke": options.stroke,
            **({"load_bounds": options.pad.load_bounds} if options.radius is None else {}),
            "objects": {solid.name: solid.facts() for solid in solids},
            "versions": {"numpy": np.__version__, "tactsim": version("tactsim")},
            # Whose a user's own meshes are is not ours to say.
            **({} if options.meshes else {"licence": OWN_LICENCE}),
        },
    )
    misses = sum(int(np.count_nonzero(~batch.met)) for batch in batches)
    return scan, {"presses": len(scan), "misses": misses, "skipped": {}}


def solids_of(options: SpaceOptions) -> list[models.Solid]:
    """Build the objects and read the meshes that a scan touches, in its order.

    Raises InputError for one that does not exist or is none, and if two have the same name.
    """
    solids = [models.solid(name) for name in options.objects]
    solids += [models.read_solid_file(path) for path in options.meshes]
    twice = [name for name, count in Counter(solid.name for solid in solids).items() if count > 1]
    if twice:
        raise InputError(f"two objects are called {twice[0]!r}; each needs a name of its own")
    if not solids:
        raise InputError("there is nothing to touch: name an object or a mesh")
    return solids


def touch_grid(
    solid: models.Solid, points: int, turns: int, lean: float, rng: np.random.Generator
) -> FloatArray:
    """Choose where touches that teach an object start: (points * turns, 7) sensor_in_object, outside the object.

    The points lie even in area over the surface: each is the one farthest from those before, of many drawn evenly. The
    pad aims at each along its inward normal, turned about it by `turns` even angles from one drawn at random. All but
    the first of these touches lean: the pad is turned about the point by up to `lean` rad, to any side, so that edges
    and corners are touched as well as faces. Where something else of the object is in the way, that is touched.
    """
    drawn, normals = solid.sample_surface(_CANDIDATES * points, rng)
    chosen = np.empty(points, dtype=np.intp)
    away = np.full(len(drawn), np.inf)
    chosen[0] = 0
    for number in range(1, points):
        away = np.minimum(away, np.sum((drawn - drawn[chosen[number - 1]]) ** 2, axis=1))
        chosen[number] = away.argmax()
    first = rng.uniform(0, 2 * math.pi, points)
    angles = (first[:, None] + 2 * math.pi * np.arange(turns) / turns).ravel()
    about_z = from_vector(np.stack([np.zeros_like(angles), np.zeros_like(angles), angles], axis=1))
    rotations = multiply(np.repeat(turn_from_z(-normals[chosen]), turns, axis=0), about_z)
    # Even over the directions of a cone.
    tilt = np.arccos(1 - rng.random(points * turns) * (1 - math.cos(lean)))
    tilt[::turns] = 0.0
    side = rng.uniform(0, 2 * math.pi, points * turns)
    leaning = from_vector(np.stack([tilt * np.cos(side), tilt * np.sin(side), np.zeros_like(side)], axis=1))
    return _starts(np.repeat(drawn[chosen], turns, axis=0), multiply(rotations, leaning), solid.radius)


def random_starts(solid: models.Solid, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw where touches from anywhere start: (count, 7) sensor_in_object, outside the object.

    All rotations are alike, and the points aimed at are even in the box that holds the object.
    """
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    return _starts(rng.uniform(low, high, (count, 3)), random_rotations(count, rng), solid.radius)


def _starts(aim: FloatArray, rotations: FloatArray, radius: float) -> FloatArray:
    """Go back from points (n, 3) mm along the pad's normal until the whole pad is outside a sphere about the origin."""
    normal = turned(rotations, np.array([0.0, 0.0, 1.0]))
    back = radius + _CLEAR + np.einsum("ij,ij->i", aim, normal)
    return np.concatenate([aim - back[:, None] * normal, rotations], axis=1)
