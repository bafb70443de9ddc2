"""The counts of work that an estimator did, nested for a reader and flat to be added up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactsim.core import InputError
from tactsim.core.errors import short


def flatten_work(work: Mapping[str, Any]) -> dict[str, int]:
    """Turn {"presses": 3, "skipped": {"cached": 1}} into {"presses": 3, "skipped.cached": 1}."""
    try:
        flat = {name: int(count) for name, count in work.items() if name != "skipped"}
        if not all(isinstance(name, str) for name in flat):
            raise TypeError("counts have names")
        return flat | {f"skipped.{name}": int(count) for name, count in work.get("skipped", {}).items()}
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"an estimator's work is {short(work)}; it must be counts and `skipped`, a table of counts"
        ) from error


def unflatten_work(flat: Mapping[str, int]) -> dict[str, Any]:
    """Undo `flatten_work`."""
    work: dict[str, Any] = {name: count for name, count in flat.items() if not name.startswith("skipped.")}
    skipped = {name.partition(".")[2]: count for name, count in flat.items() if name.startswith("skipped.")}
    return work | {"skipped": skipped}
