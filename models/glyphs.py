"""The catalogue of glyphs: capitals and digits as unions and differences of strokes (CSG).

Each glyph is drawn as one reads it, x to the right, y up, with its lower left corner at the origin,
in mm. Curves are chords with their ends on the circle, CHORDS to the full turn.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from models.errors import InputError, unknown

if TYPE_CHECKING:
    from manifold3d import CrossSection

CAP_HEIGHT = 25.0  # mm
STROKE = 4.5  # mm
CHORDS = 48  # at most 0.027 mm from the true circle of 12.5 mm radius


def _polygon(*points: tuple[float, float]) -> CrossSection:
    from manifold3d import CrossSection, FillRule

    return CrossSection([np.array(points, dtype=float)], FillRule.NonZero)


def _bar(left: float, bottom: float, right: float, top: float) -> CrossSection:
    return _polygon((left, bottom), (right, bottom), (right, top), (left, top))


def _slant(x0: float, y0: float, x1: float, y1: float, width: float) -> CrossSection:
    """Join two heights by a stroke with level ends; x are its left sides, width is along x."""
    return _polygon((x0, y0), (x0 + width, y0), (x1 + width, y1), (x1, y1))


def _disc(x: float, y: float, radius: float) -> CrossSection:
    from manifold3d import CrossSection

    return CrossSection.circle(radius, CHORDS).translate((x, y))


def _ring(x: float, y: float, radius: float, stroke: float = STROKE) -> CrossSection:
    return _disc(x, y, radius) - _disc(x, y, radius - stroke)


def _a() -> CrossSection:
    width, top, leg = 24.0, 5.6, 5.0
    middle = width / 2
    hull = _polygon((0, 0), (width, 0), (middle + top / 2, CAP_HEIGHT), (middle - top / 2, CAP_HEIGHT))
    legs = _slant(0, 0, middle - top / 2, CAP_HEIGHT, leg) + _slant(
        width - leg, 0, middle + top / 2 - leg, CAP_HEIGHT, leg
    )
    return legs + (hull ^ _bar(0, 6, width, 10.2))


def _e() -> CrossSection:
    return (
        _bar(0, 0, STROKE, CAP_HEIGHT)
        + _bar(0, 0, 17, STROKE)
        + _bar(0, 10.5, 15, 15)
        + _bar(0, CAP_HEIGHT - STROKE, 16.5, CAP_HEIGHT)
    )


def _i() -> CrossSection:
    return _bar(0, 0, STROKE, CAP_HEIGHT)


def _o() -> CrossSection:
    return _ring(12.5, 12.5, 12.5)


def _u() -> CrossSection:
    radius = 10.5
    legs = _bar(0, radius, STROKE, CAP_HEIGHT) + _bar(2 * radius - STROKE, radius, 2 * radius, CAP_HEIGHT)
    return legs + (_ring(radius, radius, radius) ^ _bar(0, 0, 2 * radius, radius))


GLYPHS: dict[str, Callable[[], CrossSection]] = {"A": _a, "E": _e, "I": _i, "O": _o, "U": _u}


def names() -> tuple[str, ...]:
    """List the catalogue's names in order."""
    return tuple(sorted(GLYPHS, key=lambda name: (name.isdigit(), name)))


def parse_letters(text: str) -> tuple[str, ...]:
    """Read a set of letters such as "AEIOU", "A,E,I" or "A-Z0-9", in the order given, each once.

    Spaces and commas only separate; "A-E" is every name of the catalogue from A to E. Raises InputError for a
    name that is not in the catalogue, a range that runs backwards, or an empty set.
    """
    found: list[str] = []
    known = names()
    for first, last, single in re.findall(r"(\S)-(\S)|([^\s,])", text):
        for name in single or first + last:
            if name not in known:
                raise unknown("letter", name, known)
        low, high = known.index(single or first), known.index(single or last)
        if high < low:
            raise InputError(f"letters {text!r}: {first}-{last} runs backwards; write {last}-{first}")
        found += known[low : high + 1]
    if not found:
        raise InputError(f"no letters in {text!r}; name some, for example AEIOU or A-Z0-9")
    return tuple(dict.fromkeys(found))
