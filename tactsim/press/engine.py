"""Press a letter with the engine asked for, or the cheapest that is exact: what a pad would read, ideal and real.

The engines answer the same question, each in a file of its own: `exact` (flat faces in closed form), `balance` (the
engine `bed`: exact areas, MuJoCo solves the balance of what may move), `collide` (MuJoCo alone, its collision
detection included), `relief` (any shape) and, for a press through time, `dynamics`. Each is imported when it first
presses: some bring MuJoCo or compiled loops.
"""

from __future__ import annotations

import math
from collections import Counter

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.press.bed import has_relief
from tactsim.press.scan_options import ScanOptions
from tactsim.press.touches import Pressed, Touches

_MOST_OF_BED = 20_000  # cells of a pad, past which MuJoCo takes seconds to compile as many springs


def press_at(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a letter until it rests, and keep the pressure on the pad.

    A press that does not come to rest is a blank, with its reason.
    Raises InputError if the engine asked for cannot press this.
    """
    name = "full" if options.press.dynamics == "full" else engine_for(touches, options)
    if name == "exact":
        from tactsim.press.exact import press
    elif name == "bed":
        from tactsim.press.balance import press
    elif name == "collide":
        from tactsim.press.collide import press
    elif name == "relief":
        from tactsim.press.relief import press
    else:
        from tactsim.press.dynamics import press
    pressed = press(touches, options)
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


def engine_for(touches: Touches, options: ScanOptions) -> str:
    """Name the engine that presses: the one asked for, or the cheapest that is exact here.

    Raises InputError if the engine asked for cannot press this.
    """
    press = options.press
    if press.engine != "auto":
        obstacle = _obstacle(press.engine, touches, options)
        if obstacle:
            raise InputError(f"press.engine: {press.engine} cannot press this: {obstacle}; give auto")
        return press.engine
    if has_relief(touches.letter, press):
        return "relief"
    fine = math.prod(len(lines) - 1 for lines in options.cell_lines) > _MOST_OF_BED
    if touches.letter.rounding:
        return "relief" if fine else "bed"
    level = press.wrist_stiffness is None and not touches.tilts.any()
    return "exact" if level or fine else "bed"


def _obstacle(engine: str, touches: Touches, options: ScanOptions) -> str:
    """Say why an engine cannot press this; nothing if it can."""
    press = options.press
    if engine in ("exact", "bed") and has_relief(touches.letter, press):
        return f"{touches.letter.name!r} has relief"
    if engine == "exact" and touches.letter.rounding:
        return f"{touches.letter.name!r} has rounded edges"
    return ""
