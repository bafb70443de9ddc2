"""List the flat regions of a letter that a pad can touch: its face, the levels of a rounded edge, or its parts."""

from __future__ import annotations

import numpy as np

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.models.rounding import inset
from tactsim.press.bed import Level
from tactsim.press.clip import edges_of
from tactsim.press.scan_options import PressOptions

ROUNDING_LEVELS = 16  # levels of a rounded edge; more of them change no taxel by 0.1 % of the largest


def levels(letter: models.Letter, options: PressOptions) -> list[Level]:
    """List the flat regions that a press can touch, the foremost first, or the letter's parts.

    A rounded edge is a quarter circle, cut into levels at equal angles; each lies at its mean gap.
    Raises InputError if a rounded letter is to be pressed by its parts, or if the letter has relief.
    """
    if has_relief(letter, options):
        raise InputError(
            f"{letter.name!r} has relief, which is pressed at rest alone; give dynamics = equilibrium, engine = auto"
        )
    if options.skip.parts:
        return [Level(edges_of(letter.contours))] if not letter.rounding else _rounded(letter)
    if letter.rounding:
        raise InputError(f"letter {letter.name!r} has rounded edges, which are no parts; leave skip.parts on")
    return [Level(edges_of([part.outline])) for part in letter.parts]


def has_relief(letter: models.Letter, options: PressOptions) -> bool:
    """Tell whether a press may feel more of a letter than a flat face or the rounded edge of one.

    Only the layer's thickness matters, because a layer never gives way by more.
    """
    return letter.relief is not None and letter.flat_depth < options.thickness


def _rounded(letter: models.Letter) -> list[Level]:
    radius = letter.rounding
    angle = np.linspace(0, np.pi / 2, ROUNDING_LEVELS + 1)  # from the flat of the face to its side
    outlines = [
        inset(letter.contours, distance) if distance > 0 else list(letter.contours)
        for distance in radius * (1 - np.sin(angle))
    ]
    # The mean of the gap, radius (1 - cos), over an inset that grows as sin.
    integral = np.sin(angle) - angle / 2 - np.sin(2 * angle) / 4
    gaps = radius * np.diff(integral) / np.diff(np.sin(angle))
    return [Level(edges_of(outlines[0]))] + [
        Level(edges_of([*outer, *(contour[::-1] for contour in inner)]), float(gap))
        for inner, outer, gap in zip(outlines[:-1], outlines[1:], gaps, strict=True)
    ]
