"""Small drawings inside a page: the mark of a method, and a figure against the readings, in the page's own colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element

from tactsim.bench.leaderboard.markup import h
from tactsim.bench.pooled import Figure
from tactsim.bench.report.picture import COLOURS, look

WIDTH, HEIGHT, LEFT, BELOW, ABOVE, RIGHT = 340.0, 200.0, 38.0, 34.0, 10.0, 8.0
_TICKS = (1, 2, 3, 5, 10, 20, 30, 40, 60, 100, 150)


def swatch(number: int) -> Element:
    """Draw the colour and the marker of a method, as the picture of run time against error has them."""
    _, marker = look(number)
    shape = h("path", {"d": _outline(marker, 4.5), "class": f"mark m{number % len(COLOURS)}"})
    size = {"width": "14", "height": "14", "viewBox": "-7 -7 14 14"}
    return h("svg", {"class": "swatch", **size, "aria-hidden": "true"}, shape)


def _outline(marker: str, r: float) -> str:
    """Draw one of matplotlib's markers about (0, 0), as large as a circle of radius r."""
    if marker == "o":
        return f"M{-r} 0a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0Z"
    if marker == "P":
        q = r / 2.4
        corners = [(-q, -r), (q, -r), (q, -q), (r, -q), (r, q), (q, q), (q, r), (-q, r), (-q, q), (-r, q), (-r, -q),
                   (-q, -q)]  # fmt: skip
        return f"M{_path(corners)}Z"
    count, turn = {"s": (4, 45), "D": (4, 0), "^": (3, -90), "v": (3, 90), "h": (6, 0), "p": (5, -90)}[marker]
    angles = [math.radians(turn + 360 * k / count) for k in range(count)]
    return f"M{_path([(1.2 * r * math.cos(angle), 1.2 * r * math.sin(angle)) for angle in angles])}Z"


def curve(
    name: str, readings: Sequence[int], figures: Sequence[Figure], number: int, *, share: bool
) -> Element:
    """Draw a figure with its intervals against the readings seen, in the colour of method `number`.

    share: whether it is a share from 0 to 1; else it is drawn to a logarithmic scale.
    """
    found = [(at, (one.value, one.low, one.high)) for at, one in zip(readings, figures, strict=True)]
    points = [
        (at, [one[0] if end is None else end for end in one]) for at, one in found if one[0] is not None
    ]
    low, high = (0.0, 1.0) if share else _decades([end for _, ends in points for end in ends if end])

    def x(reading: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * math.log(reading) / math.log(max(readings[-1], 2))

    def y(value: float) -> float:
        part = value if share else math.log(max(value, low) / low) / math.log(high / low)
        return HEIGHT - BELOW - (HEIGHT - BELOW - ABOVE) * part

    inside = []
    for value in (0.0, 0.5, 1.0) if share else _levels(low, high):
        inside.append(
            h("path", {"class": "grid", "d": f"M{_path([(LEFT, y(value)), (WIDTH - RIGHT, y(value))])}"})
        )
        inside.append(_text(LEFT - 5, y(value) + 4, f"{value:g}", "end"))
    inside += [_text(x(tick), HEIGHT - BELOW + 15, f"{tick}") for tick in _TICKS if tick <= readings[-1]]
    inside.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 3, "readings seen"))
    line, lower, upper = ([(x(at), y(ends[end])) for at, ends in points] for end in range(3))
    colour = f"m{number % len(COLOURS)}"
    if points:
        inside.append(h("path", {"class": f"band {colour}", "d": f"M{_path([*upper, *lower[::-1]])}Z"}))
        inside.append(h("path", {"class": f"line {colour}", "d": f"M{_path(line)}"}))
        dots = "".join(f"M{a - 3:.1f} {b:.1f}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0Z" for a, b in line)
        inside.append(h("path", {"class": f"dot {colour}", "d": dots}))
    about = {"role": "img", "aria-label": f"{name} against readings seen"}
    drawing = h("svg", {"class": "curve", "viewBox": f"0 0 {WIDTH:g} {HEIGHT:g}", **about}, *inside)
    return h("figure", {}, h("figcaption", {}, name), drawing)


def _text(x: float, y: float, words: str, anchor: str = "middle") -> Element:
    return h("text", {"x": f"{x:.1f}", "y": f"{y:.1f}", "text-anchor": anchor}, words)


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """Choose a logarithmic axis of at least a factor of four about these values."""
    low, high = (min(values), max(values)) if values else (1.0, 1.0)
    return min(low, high / 4) * 0.9, high * 1.1


def _levels(low: float, high: float) -> list[float]:
    steps = [step * 10.0**power for power in range(-4, 4) for step in (1, 2, 5)]
    shown = [round(step, 6) for step in steps if low <= step <= high]
    return shown if len(shown) <= 6 else [step for step in shown if math.log10(step).is_integer()]


def _path(points: Sequence[tuple[float, float]]) -> str:
    return "L".join(f"{a:.1f} {b:.1f}" for a, b in points)
