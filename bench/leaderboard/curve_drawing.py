"""Small drawings inside a page: the mark of a method, and a figure against the readings, in the page's own colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element

from tactsim.bench.leaderboard.markup import h
from tactsim.bench.pooled import Figure
from tactsim.bench.report.picture import COLOURS

WIDTH, HEIGHT, LEFT, BELOW, ABOVE, RIGHT = 340.0, 200.0, 38.0, 34.0, 10.0, 8.0
_TICKS = (1, 2, 3, 5, 10, 20, 30, 40, 60, 100, 150)


def swatch(number: int) -> Element:
    """Draw a method's colour as a dot."""
    dot = h("circle", {"r": "5", "class": f"mark m{number % len(COLOURS)}"})
    return h(
        "svg",
        {"class": "swatch", "width": "14", "height": "14", "viewBox": "-7 -7 14 14", "aria-hidden": "true"},
        dot,
    )


def curve(
    name: str, readings: Sequence[int], figures: Sequence[Figure], number: int, *, share: bool
) -> Element:
    """Draw a figure with its intervals against the readings seen, in the colour of method `number`.

    share: whether it is a share from 0 to 1; else it is drawn to a logarithmic scale.
    """
    points = [(at, one) for at, one in zip(readings, figures, strict=True) if one.value is not None]
    known = [value for _, one in points for value in (one.value, one.low, one.high) if value]
    low, high = (0.0, 1.0) if share else _decades(known)

    def x(reading: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * math.log(reading) / math.log(max(readings[-1], 2))

    def y(value: float) -> float:
        part = (
            (value - low) / (high - low) if share else math.log(max(value, low) / low) / math.log(high / low)
        )
        return HEIGHT - BELOW - (HEIGHT - BELOW - ABOVE) * part

    inside = []
    for value in (0.0, 0.5, 1.0) if share else _levels(low, high):
        height = f"{y(value):.1f}"
        inside += [
            h(
                "line",
                {"class": "grid", "x1": f"{LEFT}", "x2": f"{WIDTH - RIGHT}", "y1": height, "y2": height},
            ),
            h("text", {"x": f"{LEFT - 5}", "y": f"{y(value) + 4:.1f}", "text-anchor": "end"}, f"{value:g}"),
        ]
    for tick in _TICKS:
        if tick <= readings[-1]:
            inside.append(
                h(
                    "text",
                    {"x": f"{x(tick):.1f}", "y": f"{HEIGHT - BELOW + 15}", "text-anchor": "middle"},
                    f"{tick}",
                )
            )
    middle = f"{(LEFT + WIDTH - RIGHT) / 2}"
    inside.append(h("text", {"x": middle, "y": f"{HEIGHT - 3}", "text-anchor": "middle"}, "readings seen"))
    colour = f"m{number % len(COLOURS)}"
    if points:
        upper = [
            (x(at), y(one.value if one.high is None else one.high))
            for at, one in points
            if one.value is not None
        ]
        lower = [
            (x(at), y(one.value if one.low is None else one.low))
            for at, one in points
            if one.value is not None
        ]
        line = [(x(at), y(one.value)) for at, one in points if one.value is not None]
        inside.append(h("path", {"class": f"band {colour}", "d": f"M{_path([*upper, *lower[::-1]])}Z"}))
        inside.append(h("path", {"class": f"line {colour}", "d": f"M{_path(line)}"}))
        inside += [
            h("circle", {"class": f"dot {colour}", "cx": f"{a:.1f}", "cy": f"{b:.1f}", "r": "3"})
            for a, b in line
        ]
    drawing = h(
        "svg",
        {
            "class": "curve",
            "viewBox": f"0 0 {WIDTH:g} {HEIGHT:g}",
            "role": "img",
            "aria-label": f"{name} against readings seen",
        },
        *inside,
    )
    return h("figure", {}, h("figcaption", {}, name), drawing)


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
