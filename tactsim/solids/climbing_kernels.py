"""Kernels that move poses to where touches agree better, by Gauss-Newton steps."""

from __future__ import annotations

import math

import numpy as np
from numba.extending import register_jitable

from tactsim.core.compiling import Reals, Reals1D, Reals2D, Reals3D, compiled
from tactsim.solids.agreement_kernels import AHEAD, LOUD, agreement, pull
from tactsim.solids.feeling_kernels import HOPELESS, bounded, feel, intrusion, sensor_in_object
from tactsim.solids.pad_feel import WAYS, Touching, room_for
from tactsim.solids.pose_steps import advance, shortened, solve
from tactsim.solids.voxels import Voxels

_FAR = 2.5  # mm up to which a surface is looked for that a touch has met
_VAGUE = 1.0  # mm by which such a surface may be off
_HELD = 3.0, 0.3  # mm and rad: the standard deviation of a step, if touches say nothing
_LONGEST = 2.0, 0.2  # mm and rad of a step
_SHORTER = 0.4  # times as long is the next step from where one has ended worse


@register_jitable
def _displaced(place: Reals, turn: Reals, ways: Reals) -> None:
    """Write how a pad is displaced, in its own frame, when the object moves in its own: (ways, 6)."""
    for a in range(WAYS):
        axis = (2, 0, 1, 0, 1)[a]
        x, y, z = turn[0, axis], turn[1, axis], turn[2, axis]
        if a == 1 or a == 2:
            ways[a, 0] = ways[a, 1] = ways[a, 2] = 0.0
            ways[a, 3], ways[a, 4], ways[a, 5] = -x, -y, -z
        else:
            ways[a, 0], ways[a, 1], ways[a, 2] = -x, -y, -z
            ways[a, 3] = place[2] * y - place[1] * z
            ways[a, 4] = place[0] * z - place[2] * x
            ways[a, 5] = place[1] * x - place[0] * y


@compiled()
def climb(
    voxels: Voxels, touching: Touching, corner: Reals2D, object_in_robot: Reals2D, readings: Reals2D,
    sensor_in_robot: Reals2D, steps: int, information: Reals3D, log_p: Reals1D,
) -> None:  # fmt: skip
    """Move objects at (n, 7) by at most so many Gauss-Newton steps, changed in place, never to where less is agreed on.

    Every touch asks for a displacement of its pad (`pull`), which the object's pose is to give it. A step that ends
    worse is taken again from where it began, and shorter. corner: as in `intrusion`. readings: (m, taxels) kPa at
    sensor_in_robot (m, 7). Fills information (n, 6, 6) about [x, y, z, about x, about y, about z] in the object's
    frame, mm and rad, and log_p (n,), that of `add_log_p`, both at the poses that are reached.
    """
    place, turn, depth = np.empty(3), np.empty((3, 3)), np.empty(len(touching.ray))
    room, ahead = room_for(touching), touching.soft + AHEAD
    asked, towards, ways = np.empty((WAYS, WAYS)), np.empty(WAYS), np.empty((WAYS, 6))
    matrix, step, best_step, pose = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(7)
    for n in range(len(object_in_robot)):
        best, pace = -np.inf, 1.0
        pose[:] = object_in_robot[n]
        for turns in range(steps + 1):
            matrix[:] = 0.0
            step[:] = 0.0
            for axis in range(3):
                matrix[axis, axis], matrix[axis + 3, axis + 3] = 1 / _HELD[0] ** 2, 1 / _HELD[1] ** 2
            total = 0.0
            for m in range(len(readings)):
                sensor_in_object(pose, sensor_in_robot[m], place, turn)
                into = intrusion(voxels, corner, place, turn, touching.deepest, touching.stroke)
                feel(voxels, touching.ray, place, turn, touching.deepest, _FAR, depth)
                highest = -np.inf
                for ray in range(len(depth)):
                    highest = max(highest, depth[ray])
                    depth[ray] = max(depth[ray], -ahead)
                total += touching.trust * bounded(
                    touching, agreement(touching, depth, readings[m], room), into
                )
                if into > HOPELESS:
                    continue
                if highest > -ahead:
                    pull(touching, room, asked, towards)
                elif highest > -_FAR and readings[m].sum() > LOUD * math.sqrt((touching.noise**2).sum()):
                    asked[:] = 0.0
                    towards[:] = 0.0
                    asked[0, 0], towards[0] = 1 / _VAGUE**2, -highest / _VAGUE**2
                else:
                    continue
                _displaced(place, turn, ways)
                for i in range(6):
                    for a in range(WAYS):
                        step[i] += ways[a, i] * towards[a]
                        by = 0.0
                        for b in range(WAYS):
                            by += ways[b, i] * asked[b, a]
                        for j in range(6):
                            matrix[i, j] += by * ways[a, j]
            if total > best:
                best, pace = total, 1.0
                object_in_robot[n], information[n], log_p[n] = pose, matrix, total
                solve(matrix, step)
                best_step[:] = step
            else:
                pace *= _SHORTER
            if turns < steps:
                pose[:] = object_in_robot[n]
                advance(pose, best_step, pace * shortened(best_step, *_LONGEST))
