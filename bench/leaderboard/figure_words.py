"""How the leaderboard writes figures: their headings, their numbers and intervals, p values and ranks."""

from __future__ import annotations

from tactsim.bench.runs.pooled import HEADINGS, Figure, in_digits

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


def number(found: Figure, figure: str) -> str:
    """Write the value of a figure with the digits that make sense in a table."""
    return _texts(found, figure)[0]


def interval(found: Figure, figure: str) -> str | None:
    """Write the interval of a figure; None if it has none."""
    return None if found.low is None else "–".join(_texts(found, figure)[1:])


def _texts(found: Figure, figure: str) -> list[str]:
    name = figure.partition("@")[0]
    if name in _READINGS:
        return [
            "later" if value is None else f"{value:.0f}" for value in (found.value, found.low, found.high)
        ]
    if found.value is None:
        return [MISSING]
    return in_digits(found, 2 if name in ("error_mm", "error_all_mm", "sharpness_mm", "efficiency") else 3)


def text_of(found: Figure, figure: str) -> str:
    """Write a figure and its interval in one line."""
    between = interval(found, figure)
    return number(found, figure) + (f" ({between})" if between else "")


def chance(p: float) -> str:
    """Write a p value."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def rank(places: tuple[int, int] | None) -> str:
    """Write the range of ranks that a method can have."""
    if places is None:
        return MISSING
    best, worst = places
    return f"{best}" if best == worst else f"{best}–{worst}"
