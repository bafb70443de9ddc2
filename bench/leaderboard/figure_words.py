"""How the leaderboard writes figures: their headings, their numbers and intervals, p values and ranks."""

from __future__ import annotations

from tactsim.bench.runs.pooled import HEADINGS, Figure

MISSING = "–"
_HEADINGS = HEADINGS | {
    "accuracy": "right after {}",
    "error_mm": "error after {}, mm",
    "error_all_mm": "error over all trials after {}, mm",
    "efficiency": "× bound after {}",
}
_READINGS = ("settled_95", "settled_50", "all_right_from")


def heading(figure: str) -> str:
    """Name a figure such as accuracy@5 in words."""
    name, _, at = figure.partition("@")
    return _HEADINGS.get(name, f"{name.replace('_', ' ')} after {{}}" if at else name).format(at)


def number(value: float | None, figure: str) -> str:
    """Write a value of a figure with the digits that make sense in a table."""
    name = figure.partition("@")[0]
    if value is None:
        return "later" if name in _READINGS else MISSING
    if name in _READINGS:
        return f"{value:.0f}"
    if name == "efficiency":
        return f"{value:.3g}"
    return f"{value:.2f}" if name in ("error_mm", "error_all_mm", "sharpness_mm") else f"{value:.3f}"


def interval(found: Figure, figure: str) -> str | None:
    """Write the interval of a figure; None if it has none."""
    if found.low is None:
        return None
    return f"{number(found.low, figure)}–{number(found.high, figure)}"


def text_of(found: Figure, figure: str) -> str:
    """Write a figure and its interval in one line."""
    between = interval(found, figure)
    return number(found.value, figure) + (f" ({between})" if between else "")


def chance(p: float) -> str:
    """Write a p value."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def rank(places: tuple[int, int] | None) -> str:
    """Write the range of ranks that a method can have."""
    if places is None:
        return MISSING
    best, worst = places
    return f"{best}" if best == worst else f"{best}–{worst}"
