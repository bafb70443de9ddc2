"""How a pad feels, as it was learned from training touches, and the room in which touches are weighed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactsim.core.compiling import Ints1D, Reals1D, Reals2D, compiled

WAYS = 5  # in which the pad may be displaced: along z, about x and y, along x and y


class Touching(NamedTuple):
    """How the pad feels, as it was learned from training touches.

    ray: (rays, 3) mm, where rays leave the pad's unloaded surface, on a lattice with so many columns, `step` mm apart.
    taxel: (taxels, 2) mm. start: (taxels + 1,), which, share: which rays a taxel reads, and how much of each.
    stiffness: kPa/mm. soft: mm by which a contact begins early and ends late. deepest: mm that a surface is in the
    layer at most. stroke: mm. noise: (taxels,) kPa, what a taxel reads beside the model. rough: mm, by how much the map
    errs. aside: mm, by how much it, or the pad's place, errs along the pad, which counts where the surface slopes.
    displaced: [mm, rad, rad, mm, mm], by how much the stated pose errs along z, about x and y, and along x and y.
    swept: mm by which the map errs where the pad has passed. freedom: of Student's t. counts: the weight of a taxel.
    trust: the weight of a touch. worst: about what log p falls to at most, where nothing explains a touch. full: kPa
    summed over rays that carry a touch's load. stiffer, softer: by how much the logarithm of the stiffness that the
    load asks for is off, above and below. split: by how much that of the part of the load that taxels read is off.
    """

    ray: Reals2D
    taxel: Reals2D
    start: Ints1D
    which: Ints1D
    share: Reals1D
    stiffness: float
    soft: float
    deepest: float
    stroke: float
    noise: Reals1D
    rough: float
    aside: float
    columns: int
    step: float
    displaced: Reals1D
    swept: float
    freedom: float
    counts: float
    trust: float
    worst: float
    full: float
    stiffer: float
    softer: float
    split: float


class Room(NamedTuple):
    """Arrays that `agreement` works in, made once for many touches.

    near: (rays,) the rays that may touch. into: (rays,) mm, how deep they are pressed; open_to: how that changes with
    their depth; sloped: (rays, 2) how their depth changes along x and y; wrong: mm by which it errs. pressed, error:
    (taxels,) mm and changes: (taxels, ways), the same of what taxels feel. matrix, vector: the normal equations of the
    displacement. of_load, of_image: (ways,) how sums over rays and taxels change. best, change: (ways,). counted: (1,)
    how much a touch counts, which is less the worse it agrees.
    """

    near: Ints1D
    into: Reals1D
    open_to: Reals1D
    sloped: Reals2D
    wrong: Reals1D
    pressed: Reals1D
    error: Reals1D
    changes: Reals2D
    matrix: Reals2D
    vector: Reals1D
    of_load: Reals1D
    of_image: Reals1D
    best: Reals1D
    change: Reals1D
    counted: Reals1D


@compiled(called_from_python=False)
def room_for(touching: Touching) -> Room:
    """Make room for touches by such a pad."""
    rays, taxels = len(touching.ray), len(touching.taxel)
    return Room(
        np.empty(rays, np.int64), np.zeros(rays), np.zeros(rays), np.zeros((rays, 2)), np.zeros(rays),
        np.empty(taxels), np.empty(taxels), np.empty((taxels, WAYS)), np.empty((WAYS, WAYS)), np.empty(WAYS),
        np.empty(WAYS), np.empty(WAYS), np.empty(WAYS), np.empty(WAYS), np.empty(1),
    )  # fmt: skip
