"""A number with what it counts, in words."""

from __future__ import annotations


def counted(number: int, what: str) -> str:
    """Write a number and what it counts, in the plural unless it is one: 1 trial, 20 trials."""
    return f"{number} {what}{'' if number == 1 else 's'}"
