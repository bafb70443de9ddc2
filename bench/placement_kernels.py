"""The distance of placements, and the distance within which a share of a belief lies (compiled)."""

from __future__ import annotations

import math

import numpy as np

from tactsim.core.compiling import GivenReals1D, GivenReals2D, Reals1D, compiled


@compiled(called_from_python=False)
def _placed(pose: GivenReals1D, centre_x: float, centre_y: float) -> tuple[float, float, float, float]:
    """Say where an object lies, T_O^R, for its pose T_R^O (3,): [x, y] of the centre, cosine and sine of the angle."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = centre_x - pose[0], centre_y - pose[1]
    return cos * x + sin * y, cos * y - sin * x, cos, -sin


@compiled()
def distances(
    estimated: GivenReals2D,
    true: GivenReals2D,
    symmetry: int,
    centre_x: float,
    centre_y: float,
    inertia_over_mass: float,
) -> Reals1D:
    """Measure the distance between placements, mm: see `placement_error`.

    estimated: (n, 3) T_R^O, mm, mm, rad. true: (n, 3), or (1, 3) for all. The rest is what `Properties` hold.
    """
    away = np.empty(len(estimated))
    true_x = true_y = true_cos = true_sin = 0.0
    for k in range(len(estimated)):
        if k < len(true):
            true_x, true_y, true_cos, true_sin = _placed(true[k], centre_x, centre_y)
        x, y, cos, sin = _placed(estimated[k], centre_x, centre_y)
        if symmetry == 0:
            chord = 0.0
        elif symmetry <= 2:
            # 2 (1 - cos dtheta) is the squared chord, which needs no angle to be folded.
            chord = (cos - true_cos) ** 2 + (sin - true_sin) ** 2
            if symmetry == 2:
                chord = min(chord, (cos + true_cos) ** 2 + (sin + true_sin) ** 2)
        else:
            turn = (true[min(k, len(true) - 1), 2] - estimated[k, 2]) * symmetry
            chord = 4 * math.sin((turn - 2 * math.pi * np.rint(turn / (2 * math.pi))) / (2 * symmetry)) ** 2
        away[k] = math.sqrt((x - true_x) ** 2 + (y - true_y) ** 2 + inertia_over_mass * chord)
    return away


@compiled()
def radius(away: Reals1D, weights: GivenReals1D, share: float) -> float:
    """Find the least distance within which samples, `away` (n,) mm with weights (n,), hold a share of the weight."""
    left, weight = away.copy(), weights.copy()
    target, farthest = share * weights.sum(), away.max()
    below, low, high = 0.0, 0, len(left)
    # Quickselect: what is nearer than a pivot goes before it, and the part goes on that holds the distance.
    while low < high:
        pivot = left[(low + high) // 2]
        nearer, same, first, here, last = 0.0, 0.0, low, low, high
        while here < last:
            if left[here] < pivot:
                nearer += weight[here]
                left[here], left[first] = left[first], left[here]
                weight[here], weight[first] = weight[first], weight[here]
                first, here = first + 1, here + 1
            elif left[here] > pivot:
                last -= 1
                left[here], left[last] = left[last], left[here]
                weight[here], weight[last] = weight[last], weight[here]
            else:
                same += weight[here]
                here += 1
        if below + nearer >= target and first > low:
            high = first
        elif below + nearer + same >= target:
            return float(pivot)
        else:
            below, low = below + nearer + same, last
    # Rounding may leave the sum of all just below the share asked for.
    return float(farthest)
