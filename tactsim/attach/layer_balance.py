"""Let an elastic layer carry a load: how far a body sinks in, and turns, until the layer's pressure balances it.

The layer is a bed of springs (Winkler): pressure = stiffness * depth, never below 0. A small motion q of the
body changes the depth at each point by q . basis, and the same basis gives the load's components (virtual work):
the force along the approach, and the moments about the point where it acts, which are 0. The balance is where a
convex energy is least; Newton's method finds it.
"""

from __future__ import annotations

import numpy as np

from tactsim.core.compiling import Reals1D, Reals2D, compiled

_MOST_STEPS = 60
_TOLERANCE = 1e-9  # of the load
_SHORTEST = 1e-6  # of a step of Newton's
_ROUNDING = 1e-14  # of the load's energy, which sums of the layer's energy are no closer than
# A turn's own stiffness over that of a layer that touches everywhere. It is felt only where the load stands on the
# very rim of what touches, which no finite turn balances.
_HOLD = 1e-6


@compiled(called_from_python=False)
def energy(gap: Reals1D, weight: Reals1D, basis: Reals2D, force: float, motion: Reals1D) -> float:
    """Add up the layer's energy after a motion, with that of the load and of what holds turns, N mm."""
    depth, hold = np.maximum(motion @ basis - gap, 0.0), _HOLD * weight.sum()
    return (weight * depth * depth).sum() / 2 + hold * (motion[1:] ** 2).sum() / 2 - force * motion[0]


@compiled(called_from_python=False)
def approach(gap: Reals1D, weight: Reals1D, facing: Reals1D, force: float) -> float:
    """Find how far a body sinks in without a turn, mm: exact, by steps from above, as the force is convex."""
    touching, count = np.arange(len(gap)), len(gap)
    while True:
        stiffness = load = 0.0
        for i in touching[:count]:
            stiffness += weight[i] * facing[i] * facing[i]
            load += weight[i] * facing[i] * gap[i]
        depth, still = (force + load) / stiffness, 0
        for i in touching[:count]:
            if depth * facing[i] > gap[i]:
                touching[still] = i
                still += 1
        if still == count:
            return depth
        count = still


@compiled(called_from_python=False)
def balance(gap: Reals1D, weight: Reals1D, basis: Reals2D, force: float, straight: float) -> Reals1D:
    """Find the motion (m,) after which the layer carries a force, N.

    gap: (n,) mm between surface and body. weight: (n,) N/mm, stiffness times area of each point. basis: (m, n),
    what each motion adds to the depth: the first is the approach and above 0, the others turn the body about
    the point in which the force acts. The depth is then motion @ basis - gap, or 0 where that is less.
    straight: mm, the approach without a turn, as `approach` finds it.
    """
    motion, hold = np.zeros(len(basis)), np.zeros(len(basis))
    motion[0], hold[1:] = straight, _HOLD * weight.sum()
    if len(motion) == 1:
        return motion
    now = energy(gap, weight, basis, force, motion)
    for _ in range(_MOST_STEPS):
        depth = motion @ basis - gap
        push = np.where(depth > 0, weight, 0.0) * basis
        slope, stiffness = push @ depth + hold * motion, push @ basis.T + np.diag(hold)
        slope[0] -= force
        if np.abs(slope).max() <= _TOLERANCE * force:
            break
        step = -np.linalg.solve(stiffness, slope)
        length, falls, noise = 1.0, (slope * step).sum(), _ROUNDING * force * abs(motion[0])
        then = energy(gap, weight, basis, force, motion + step)
        while length > _SHORTEST and then > now + 1e-4 * length * falls + noise:
            length /= 2
            then = energy(gap, weight, basis, force, motion + length * step)
        motion, now = motion + length * step, then
    return motion
