"""Let an elastic layer carry a load: how far a body sinks in, and turns, until the layer's pressure balances it.

The layer is a bed of springs (Winkler): pressure = stiffness * depth, never below 0. A small motion q of the
body changes the depth at each point by q . basis, and the same basis gives the load's components (virtual work):
the force along the approach, and the moments about the point where it acts, which are 0. The balance is where a
convex energy is least; Newton's method finds it.
"""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray

_MOST_STEPS = 60
_TOLERANCE = 1e-9  # of the load
# A turn's own stiffness over that of a layer that touches everywhere. It is felt only where the load stands on the
# very rim of what touches, which no finite turn balances.
_HOLD = 1e-6


def balance(gap: FloatArray, weight: FloatArray, basis: FloatArray, force: float) -> FloatArray:
    """Find the motion (m,) after which the layer carries a force, N.

    gap: (n,) mm between surface and body. weight: (n,) N/mm, stiffness times area of each point. basis: (m, n),
    what each motion adds to the depth: the first is the approach and above 0, the others turn the body about
    the point in which the force acts. The depth is then motion @ basis - gap, or 0 where that is less.
    """
    approach = _approach(gap, weight, basis[0], force)
    if len(basis) == 1:
        return np.array([approach])
    motion, load, hold = np.zeros((3, len(basis)))
    motion[0], load[0] = approach, force
    hold[1:] = _HOLD * weight.sum()

    def energy(motion: FloatArray) -> float:
        depth = np.maximum(motion @ basis - gap, 0)
        return float(weight @ depth**2 / 2 + hold @ motion**2 / 2 - load @ motion)

    now = energy(motion)
    for _ in range(_MOST_STEPS):
        depth = motion @ basis - gap
        active = weight * (depth > 0)
        slope = basis @ (active * depth) + hold * motion - load
        if np.abs(slope).max() <= _TOLERANCE * force:
            break
        step = np.linalg.solve((basis * active) @ basis.T + np.diag(hold), -slope)
        length = 1.0
        while length > 1e-6 and (then := energy(motion + length * step)) > now + 1e-4 * length * (
            slope @ step
        ):
            length /= 2
        motion, now = motion + length * step, then
    return motion


def _approach(gap: FloatArray, weight: FloatArray, basis: FloatArray, force: float) -> float:
    """Find how far a body sinks in without a turn, mm: exact, by steps from above, as the force is convex."""
    active, touching = weight * basis, len(gap) + 1
    while True:
        approach = float((force + active @ gap) / (active @ basis))
        active = np.where(approach * basis > gap, active, 0)
        if (still := int(np.count_nonzero(active))) == touching:
            return approach
        touching = still
