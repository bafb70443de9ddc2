"""The catalogue of glyphs: capitals and digits as unions and differences of strokes (CSG).

Each glyph is drawn as one reads it, x to the right, y up, with its lower left corner at the origin,
in mm. Curves are chords with their ends on the circle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from tactsim.core.errors import InputError, unknown

if TYPE_CHECKING:
    from manifold3d import CrossSection

Point = tuple[float, float]

CAP_HEIGHT = 25.0  # mm
STROKE = 4.5  # mm
THIN = 4.0  # mm, the stroke of glyphs with two storeys, whose counters would close otherwise
CHORD_ERROR = 0.04  # mm: no chord is further from its circle


def polygon(*points: Point) -> CrossSection:
    """Fill a polygon, mm."""
    from manifold3d import CrossSection, FillRule

    return CrossSection([np.array(points, dtype=float)], FillRule.NonZero)


def _bar(left: float, bottom: float, right: float, top: float) -> CrossSection:
    return polygon((left, bottom), (right, bottom), (right, top), (left, top))


def _slant(x0: float, y0: float, x1: float, y1: float, width: float) -> CrossSection:
    """Draw a slanted stroke with level ends; x0 and x1 are its left corners, and width is measured along x."""
    return polygon((x0, y0), (x0 + width, y0), (x1 + width, y1), (x1, y1))


def _chords(radius: float) -> int:
    """Count the chords of a full circle that stay within CHORD_ERROR of it, as a multiple of four."""
    return 4 * math.ceil(math.pi / math.acos(1 - CHORD_ERROR / radius) / 4)


def arc_points(x: float, y: float, radius: float, start: float, stop: float, chords: int) -> list[Point]:
    """List the chords + 1 points of an arc about (x, y), from `start` to `stop` degrees."""
    angles = np.radians(np.linspace(start, stop, chords + 1))
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]


def disc(x: float, y: float, radius: float, chords: int) -> CrossSection:
    """Fill a regular polygon about (x, y), one corner to the right."""
    return polygon(*arc_points(x, y, radius, 0, 360, chords)[:-1])


def _ring(x: float, y: float, radius: float, stroke: float) -> CrossSection:
    """Draw a ring of outer `radius`. Two outer chords face each inner chord, which keeps convex parts few."""
    inner = _chords(radius - stroke)
    return disc(x, y, radius, 2 * inner) - disc(x, y, radius - stroke, inner)


def _arc(x: float, y: float, radius: float, start: float, stop: float, stroke: float) -> CrossSection:
    """Draw a piece of a ring, counter-clockwise from `start` to `stop` degrees."""
    inner = math.ceil(_chords(radius - stroke) * (stop - start) / 360 - 1e-9)
    outside = arc_points(x, y, radius, start, stop, 2 * inner)
    return polygon(*outside, *arc_points(x, y, radius - stroke, stop, start, inner))


def _a() -> CrossSection:
    width, top, leg = 24.0, 5.6, 5.0
    middle = width / 2
    hull = polygon((0, 0), (width, 0), (middle + top / 2, CAP_HEIGHT), (middle - top / 2, CAP_HEIGHT))
    legs = _slant(0, 0, middle - top / 2, CAP_HEIGHT, leg) + _slant(
        width - leg, 0, middle + top / 2 - leg, CAP_HEIGHT, leg
    )
    return legs + (hull ^ _bar(0, 5.5, width, 9.7))


def _b() -> CrossSection:
    upper, lower = 7.0, 7.5  # the bowls share the middle bar: 2 upper + 2 lower - THIN = CAP_HEIGHT
    bars = _bar(0, 0, 9, THIN) + _bar(0, 2 * lower - THIN, 9, 2 * lower) + _bar(0, 21, 8.2, CAP_HEIGHT)
    bowls = _arc(9, lower, lower, -90, 90, THIN) + _arc(8.2, CAP_HEIGHT - upper, upper, -90, 90, THIN)
    return _bar(0, 0, STROKE, CAP_HEIGHT) + bars + bowls


def _d() -> CrossSection:
    bars = _bar(0, 0, 8, STROKE) + _bar(0, CAP_HEIGHT - STROKE, 8, CAP_HEIGHT)
    return _bar(0, 0, STROKE, CAP_HEIGHT) + bars + _arc(8, 12.5, 12.5, -90, 90, STROKE)


def _k() -> CrossSection:
    width, fork = 6.0, 13.0
    lean = (14 - STROKE + width) / 22  # of the arm, which leaves the stem 3 mm above the base line
    arm = _slant(STROKE - width, 3, 14, CAP_HEIGHT, width)
    leg = _slant(14.5, 0, STROKE - width + (fork - 3) * lean, fork, width)
    return _bar(0, 0, STROKE, CAP_HEIGHT) + ((arm + leg) ^ _bar(STROKE / 2, 0, 25, CAP_HEIGHT))


def _m() -> CrossSection:
    width, notch = 25.0, 5.0
    left = _slant(width / 2 - 2.7, notch, 0, CAP_HEIGHT, 5.4)
    right = _slant(width / 2 - 2.7, notch, width - 5.4, CAP_HEIGHT, 5.4)
    return _bar(0, 0, STROKE, CAP_HEIGHT) + _bar(width - STROKE, 0, width, CAP_HEIGHT) + left + right


def _n() -> CrossSection:
    width = 20.5
    diagonal = _slant(width - 5.8, 0, 0, CAP_HEIGHT, 5.8)
    return _bar(0, 0, STROKE, CAP_HEIGHT) + _bar(width - STROKE, 0, width, CAP_HEIGHT) + diagonal


def _p() -> CrossSection:
    radius = 7.75
    bars = _bar(0, 25 - 2 * radius, 8.5, 25 - 2 * radius + THIN) + _bar(0, 25 - THIN, 8.5, CAP_HEIGHT)
    return _bar(0, 0, STROKE, CAP_HEIGHT) + bars + _arc(8.5, 25 - radius, radius, -90, 90, THIN)


def _s() -> CrossSection:
    radius = (CAP_HEIGHT + THIN) / 4  # the arcs share the middle stroke
    upper = _arc(radius, CAP_HEIGHT - radius, radius, 30, 270, THIN)
    lower = _arc(radius, radius, radius, -150, 90, THIN)
    return upper + lower


def _u() -> CrossSection:
    radius = 10.5
    legs = _bar(0, radius, STROKE, CAP_HEIGHT) + _bar(2 * radius - STROKE, radius, 2 * radius, CAP_HEIGHT)
    return legs + _arc(radius, radius, radius, 180, 360, STROKE)


def _v() -> CrossSection:
    width, foot, leg = 23.0, 5.6, 5.0
    left = _slant((width - foot) / 2, 0, 0, CAP_HEIGHT, leg)
    return left + _slant((width + foot) / 2 - leg, 0, width - leg, CAP_HEIGHT, leg)


def _w() -> CrossSection:
    width, foot, leg, top = 28.0, 5.0, 4.7, 19.0
    valley = (width - leg) / 4 + 0.4
    outer = _slant(valley, 0, 0, CAP_HEIGHT, leg) + _slant(
        width - valley - leg, 0, width - leg, CAP_HEIGHT, leg
    )
    inner = _slant(valley, 0, (width - foot) / 2, top, foot)
    return outer + inner + _slant(width - valley - foot, 0, (width - foot) / 2, top, foot)


def _y() -> CrossSection:
    fork, middle, arm, half = 10.0, 11.0, 5.2, STROKE / 2
    crotch = CAP_HEIGHT - (middle - arm) * (CAP_HEIGHT - fork) / (middle - half)
    left = polygon(
        (middle - half, fork), (middle, fork), (middle, crotch), (arm, CAP_HEIGHT), (0, CAP_HEIGHT)
    )
    stem = _bar(middle - half, 0, middle + half, fork)
    return left + left.mirror((1, 0)).translate((2 * middle, 0)) + stem


def _z() -> CrossSection:
    width = 19.0
    bars = _bar(0, 0, width, STROKE) + _bar(0, CAP_HEIGHT - STROKE, width, CAP_HEIGHT)
    return bars + _slant(0, STROKE, width - 6, CAP_HEIGHT - STROKE, 6)


def _zero() -> CrossSection:
    radius = 8.0
    sides = _bar(0, radius, THIN, CAP_HEIGHT - radius)
    sides += _bar(2 * radius - THIN, radius, 2 * radius, CAP_HEIGHT - radius)
    ends = _arc(radius, CAP_HEIGHT - radius, radius, 0, 180, THIN) + _arc(
        radius, radius, radius, 180, 360, THIN
    )
    return sides + ends


def _one() -> CrossSection:
    stem = _bar(6, 0, 6 + STROKE, CAP_HEIGHT)
    return stem + _bar(0, 0, 16.5, THIN) + polygon((6, 25), (0, 20.5), (0, 15.5), (6, 19.5))


def _two() -> CrossSection:
    radius, end = 8.0, -37.5
    arc = _arc(radius, CAP_HEIGHT - radius, radius, end, 172.5, THIN)
    x, y = math.cos(math.radians(end)), math.sin(math.radians(end))
    outer = (radius + radius * x, CAP_HEIGHT - radius + radius * y)
    inner = (radius + (radius - THIN) * x, CAP_HEIGHT - radius + (radius - THIN) * y)
    # The diagonal leaves the arc along its tangent and runs into the foot.
    feet = [(px + y / x * (py - level), level) for px, py in (outer, inner) for level in (THIN,)]
    return arc + polygon(outer, inner, feet[1], feet[0]) + _bar(0, 0, 16, THIN)


def _three() -> CrossSection:
    upper, lower = 6.9, 7.6
    top = _arc(lower, CAP_HEIGHT - upper, upper, -90, 150, THIN)
    bottom = _arc(lower, lower, lower, -150, 90, THIN)
    return top + bottom + _bar(4.6, 2 * lower - THIN, lower, 2 * lower)


def _four() -> CrossSection:
    bar = _bar(0, 5.5, 20, 9.7)
    return bar + _bar(11.5, 0, 16, CAP_HEIGHT) + _slant(0, 9.7, 10, CAP_HEIGHT, 5.5)


def _five() -> CrossSection:
    radius = 8.1
    bowl = _arc(8.2, radius, radius, -150, 90, THIN)
    bars = _bar(1.4, 2 * radius - THIN, 8.2, 2 * radius) + _bar(1.4, CAP_HEIGHT - THIN, 15.5, CAP_HEIGHT)
    return bowl + bars + _bar(1.4, 2 * radius - THIN, 1.4 + THIN, CAP_HEIGHT)


def _six() -> CrossSection:
    radius, sweep = 8.1, 16.9
    return _ring(radius, radius, radius, THIN) + _arc(sweep, radius, sweep, 97.5, 180, THIN)


def _eight() -> CrossSection:
    upper, lower = 6.6, 7.9  # the rings share the middle stroke
    return _ring(lower, CAP_HEIGHT - upper, upper, THIN) + _ring(lower, lower, lower, THIN)


def _nine() -> CrossSection:
    radius = 7.8
    stem = _bar(2 * radius - THIN, 0, 2 * radius, CAP_HEIGHT - radius)
    return _ring(radius, CAP_HEIGHT - radius, radius, THIN) + stem


GLYPHS: dict[str, Callable[[], CrossSection]] = {
    "A": _a, "B": _b,
    "C": lambda: _arc(12.5, 12.5, 12.5, 45, 315, STROKE),
    "D": _d,
    "E": lambda: _bar(0, 0, STROKE, CAP_HEIGHT) + _bar(0, 0, 17, STROKE) + _bar(0, 10.5, 15, 15)
    + _bar(0, CAP_HEIGHT - STROKE, 16.5, CAP_HEIGHT),
    "F": lambda: _bar(0, 0, STROKE, CAP_HEIGHT) + _bar(0, 9.5, 14, 14) + _bar(0, CAP_HEIGHT - STROKE, 17, CAP_HEIGHT),
    "G": lambda: _arc(12.5, 12.5, 12.5, 45, 360, STROKE) + _bar(13, 8, 22, 12.5),
    "H": lambda: _bar(0, 0, STROKE, CAP_HEIGHT) + _bar(20 - STROKE, 0, 20, CAP_HEIGHT) + _bar(0, 10.25, 20, 14.75),
    "I": lambda: _bar(0, 0, STROKE, CAP_HEIGHT),
    "J": lambda: _bar(15 - STROKE, 7.5, 15, CAP_HEIGHT) + _arc(7.5, 7.5, 7.5, 180, 360, STROKE),
    "K": _k,
    "L": lambda: _bar(0, 0, STROKE, CAP_HEIGHT) + _bar(0, 0, 16, STROKE),
    "M": _m, "N": _n,
    "O": lambda: _ring(12.5, 12.5, 12.5, STROKE),
    "P": _p,
    "Q": lambda: _ring(12.5, 12.5, 12.5, STROKE) + _slant(20, -1.5, 12, 8, 6),
    "R": lambda: _p() + _slant(11.5, 0, 5, 12, 5.2),
    "S": _s,
    "T": lambda: _bar(0, CAP_HEIGHT - STROKE, 19, CAP_HEIGHT) + _bar(7, 0, 12, CAP_HEIGHT),
    "U": _u, "V": _v, "W": _w,
    "X": lambda: _slant(0, 0, 15.4, CAP_HEIGHT, 5.6) + _slant(15.4, 0, 0, CAP_HEIGHT, 5.6),
    "Y": _y, "Z": _z, "0": _zero, "1": _one, "2": _two, "3": _three, "4": _four, "5": _five, "6": _six,
    "7": lambda: _bar(0, CAP_HEIGHT - STROKE, 17.5, CAP_HEIGHT) + _slant(4, 0, 12.4, CAP_HEIGHT - STROKE, 5.1),
    "8": _eight, "9": _nine,
}  # fmt: skip


def names() -> tuple[str, ...]:
    """List the catalogue's names in order."""
    return tuple(sorted(GLYPHS, key=lambda name: (name.isdigit(), name)))


def parse_letters(text: str) -> tuple[str, ...]:
    """Read a set of letters such as "AEIOU", "A,E,I" or "A-Z0-9", in the order given, each once.

    Spaces and commas only separate; "A-E" is every name of the catalogue from A to E. Raises InputError for a
    name that is not in the catalogue, a range that runs backwards, or an empty set.
    """
    if "." in text:
        raise InputError(f"letters {text!r}: a file with a shape of your own is given by --shape")
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
