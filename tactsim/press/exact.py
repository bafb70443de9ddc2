"""The engine `exact`: flat faces with sharp edges on springs, at rest, in closed form and without MuJoCo.

A level face under a rigid wrist is equally deep everywhere, so its pressure is the force over the area. Where it tilts
or the wrist gives way, depth and tilts are those that `forward_kernels.balance` finds from integrals over the outline,
as for the forward model; `clip` then gives each cell's part of what touches.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.models.letter import Letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.clip import MOMENTS
from tactsim.press.scan_options import PressOptions, ScanOptions
from tactsim.press.spread import Patches
from tactsim.press.touches import TIPPED, Pressed, Touches


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a flat letter until it rests. A press that tips over is a blank, with its reason."""
    face, lines = levels(touches.letter, options.press), options.cell_lines
    force = touches.forces(options.press.force)
    bed = lay_bed(face, touches.poses, *lines)
    area = bed.area_of_presses
    touching = np.flatnonzero(area)
    work = Counter(presses=len(touching), no_contact=len(touches) - len(touching))
    if options.press.wrist_stiffness is None and not touches.tilts.any():
        return Pressed(touches, Patches(bed, force[bed.press] / area[bed.press]), work)
    states = rest(touches, options)
    resting = touching[states[touching, 3] > 0]
    depth, tilt = states[:, 0], states[:, 1:3]
    bed = lay_bed(
        face, touches.poses[resting], *lines, tilts=tilt[resting], depths=depth[resting], moments=MOMENTS
    )
    load = Patches.under(bed.among(resting, len(touches)), depth, tilt, force)
    blanks = dict.fromkeys(np.setdiff1d(touching, resting).tolist(), TIPPED)
    return Pressed(touches, load, work, blanks)


def rest(touches: Touches, options: ScanOptions) -> FloatArray:
    """Find where flat faces come to rest in closed form.

    Returns (n, 4): depth mm at the pad's middle, tilts rad, and the springs' stiffness N/mm^3, 0 of a press that
    touches nothing or tips over.
    """
    # Brings compiled loops, which level faces do without.
    from tactsim.press.forward_kernels import Layer, Outline, rest_all

    states = np.empty((len(touches), 4))
    rest_all(
        Outline(*outline(touches.letter)),
        np.array(touches.poses, dtype=float, order="C"),
        np.array(touches.tilts, dtype=float, order="C"),
        Layer(np.array(options.pad.load_bounds), springs(options.press)),
        touches.forces(options.press.force),
        states,
    )
    return states


def outline(letter: Letter) -> tuple[FloatArray, NDArray[np.int64]]:
    """List the corners of a letter's contours, (n, 2) mm, and where each contour begins, (contours + 1,)."""
    return np.concatenate(letter.contours), np.cumsum([0, *(len(contour) for contour in letter.contours)])


def springs(press: PressOptions) -> FloatArray:
    """Give force N, stiffness N/mm^3, thickness mm and the wrist's N mm/rad (negative: rigid), (4,)."""
    wrist = -1.0 if press.wrist_stiffness is None else press.wrist_stiffness
    return np.array([press.force, 1e-3 * press.stiffness, press.thickness, wrist])
