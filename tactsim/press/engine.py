"""Press a letter with the engine that `engine_choice` names: what an ideal pad would read.

The engines answer the same question, each in a file of its own: `exact` (a level flat face needs no solver),
`balance` (the engine `bed`: exact areas, MuJoCo solves the balance of what may move), `collide` (MuJoCo alone,
its collision detection included), `relief` (any shape, from any side), `elastic` (a layer or half-space instead
of springs) and, for a press through time, `dynamics`. Nothing random happens here and nothing that belongs to
one sensor: its imperfections come afterwards, in `sensor`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.press import balance, collide, exact
from tactsim.press.bed import Bed, lay_bed
from tactsim.press.dynamics import ForceTrace, History, press_through_time
from tactsim.press.engine_choice import engine_for
from tactsim.press.levels import levels
from tactsim.press.pressed import Patches, Pressed, unsettled
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import Setup, UnsettledError, scene
from tactsim.press.touches import Touches


def _elastic(touches: Touches, options: ScanOptions) -> Pressed:
    from tactsim.press import elastic  # brings SciPy

    return elastic.press(touches, options)


def _press_relief(touches: Touches, options: ScanOptions) -> Pressed:
    # Its compiled loops take a while to load, and most scans do without.
    from tactsim.press import facets

    return facets.press(touches, options)


ENGINES: dict[str, Callable[[Touches, ScanOptions], Pressed]] = {
    "exact": exact.press,
    "bed": balance.press,
    "collide": collide.press,
    "elastic": _elastic,
    "relief": _press_relief,
}


@dataclass(frozen=True, eq=False)
class Moving:
    """The images of one press through time, (frames, taxels) kPa at times (frames,) s, and its force."""

    times: FloatArray
    images: FloatArray
    trace: ForceTrace


def press_at(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a letter until it rests, and keep the pressure on the pad.

    A press that does not come to rest is a blank, with its reason.
    Raises InputError if the engine asked for cannot press this.
    """
    if options.press.dynamics == "full":
        pressed, name = _press_through_time(touches, options), "full"
    else:
        name = engine_for(touches, options)
        pressed = ENGINES[name](touches, options)
    pressed.work[f"engine_{name}"] = pressed.work["presses"]
    return pressed


def ideal_readings(touches: Touches, options: ScanOptions) -> tuple[FloatArray, Counter[str]]:
    """Press a letter until it rests.

    Returns (n, taxels) kPa without imperfections, and the work: `presses`, and what was skipped by reason.
    Raises UnsettledError, naming letter and pose, if a press does not come to rest; InputError if the engine
    asked for cannot press this.
    """
    pressed = press_at(touches, options).settled()
    return pressed.readings(options), pressed.work


def ideal_sequence(touches: Touches, options: ScanOptions) -> Moving | None:
    """Press a letter once, through time: its images, or None where nothing touches.

    The last image is at rest and is the ideal reading.
    Raises UnsettledError, naming letter and pose, if the press does not come to rest.
    """
    bed = _bed(touches, options)
    if not bed.area.any():
        return None
    try:
        history = contact_history(bed, touches, 0, options)
    except UnsettledError as error:
        raise unsettled(touches.letter.name, touches.poses[0], str(error)) from error
    images = _even(bed.repeat(len(history.times)), history.forces.ravel()).readings(options)
    return Moving(history.times, images, history.trace)


def _press_through_time(touches: Touches, options: ScanOptions) -> Pressed:
    """Step every press through time, and keep its last image."""
    bed = _bed(touches, options)
    forces, blanks = np.zeros(len(bed.area)), {}
    touching = 0
    for index, springs in enumerate(bed.springs):
        if not springs.area:
            continue
        touching += 1
        try:
            forces[springs.rows] = contact_history(bed, touches, index, options).forces[-1]
        except UnsettledError as error:
            blanks[index] = str(error)
    work = Counter(presses=touching, no_contact=len(touches) - touching)
    return Pressed(touches, _even(bed, forces), work, blanks)


def _bed(touches: Touches, options: ScanOptions) -> Bed:
    """Lay the bed of presses that are stepped through time. Raises InputError for what cannot be."""
    if options.press.engine != "auto":
        raise InputError(
            f"press.engine: {options.press.engine} works out presses at rest; with dynamics = full give auto"
        )
    if touches.rotations is not None:
        raise InputError("a press from another side is worked out at rest alone; give dynamics = equilibrium")
    return lay_bed(levels(touches.letter, options.press), touches.poses, *options.cell_lines)


def contact_history(bed: Bed, touches: Touches, index: int, options: ScanOptions) -> History:
    """Step press `index` through time until it rests; `bed` is of all presses. Raises UnsettledError if it does not."""
    press, springs = options.press, bed.springs[index]
    setup = Setup(
        mass=press.moving_mass,
        wrist_stiffness=press.wrist_stiffness,
        letter=None if press.skip.parts else touches.letter,
        skip_stages=press.skip.stages,
    )
    stage = scene(setup, len(springs.share))
    stage.place_letter(touches.poses[index], touches.tilts[index])
    force = float(touches.forces(press.force)[index])
    return press_through_time(stage, springs, press.model_copy(update={"force": force}))


def _even(bed: Bed, forces: FloatArray) -> Patches:
    """Spread each contact's force evenly over its part."""
    return Patches(bed, np.divide(forces, bed.area, out=np.zeros_like(forces), where=bed.area > 0))
