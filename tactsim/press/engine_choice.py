"""Choose the engine that presses a letter: the one asked for, or the cheapest that is exact. Needs no MuJoCo."""

from __future__ import annotations

import numpy as np

from tactsim.core.errors import InputError
from tactsim.models import Letter
from tactsim.press.levels import has_relief
from tactsim.press.scan_options import ScanOptions
from tactsim.press.touches import Touches


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
    if press.foundation != "winkler":
        obstacle = _of_shape(touches, options)
        if obstacle:
            raise InputError(
                f"press.foundation: {press.foundation} cannot carry this: {obstacle}; give winkler"
            )
        return "elastic"
    if _of_shape(touches, options):
        return "relief"
    cheapest = press.skip.solver and press.skip.parts and not _obstacle("exact", touches, options)
    return "exact" if cheapest else "bed"


def _obstacle(engine: str, touches: Touches, options: ScanOptions) -> str:
    """Say why an engine cannot press this; nothing if it can."""
    press = options.press
    if press.foundation != "winkler":
        return f"press.foundation is {press.foundation}, and it has springs that do not move each other"
    if engine in ("exact", "bed"):
        shape = _of_shape(touches, options)
        if shape:
            return shape
    if engine == "collide" and touches.rotations is not None:
        return f"{touches.letter.name!r} is pressed from a side"
    if engine != "exact":
        return ""
    if touches.letter.rounding:
        return f"{touches.letter.name!r} has rounded edges"
    if press.wrist_stiffness is not None:
        return "the wrist gives way (press.wrist_stiffness)"
    if touches.tilts.any():
        return "a press is tilted"
    return ""


def _of_shape(touches: Touches, options: ScanOptions) -> str:
    """Say what makes a press more than that of a flat face or a rounded edge; nothing if it is one."""
    if touches.rotations is not None:
        return f"{touches.letter.name!r} is pressed from a side"
    if has_relief(touches.letter, options.press):
        return f"{touches.letter.name!r} has relief"
    return ""


def check_flat(letter: Letter, options: ScanOptions) -> None:
    """Raise InputError unless the forward model can press the letter: a flat face on springs, at rest."""
    engine = engine_for(Touches.of(letter, np.zeros((1, 3))), options)
    if options.press.dynamics == "full" or letter.rounding or engine not in ("exact", "bed"):
        raise InputError(
            f"the forward model presses flat faces with sharp edges on springs, at rest; {letter.name!r} is pressed "
            f"otherwise here"
        )
