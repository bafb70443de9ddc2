"""What results say of an estimator: how it is set up, its budget, and the counts of its work.

A confined plug-in's process says it too, so little is imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactsim.core import InputError
from tactsim.core.errors import short
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import no_exit


def about_estimator(estimator: Estimator) -> dict[str, Any]:
    """Describe how an estimator is set up, so that a report can do without the estimator's plug-in.

    options: all of them. settings: those that are not the defaults. budget: see `budget_of`.
    """
    with no_exit(estimator):
        description = estimator.describe()
    return {
        "description": description,
        "options": estimator.options.model_dump(mode="json"),
        "settings": estimator.options.model_dump(mode="json", exclude_defaults=True),
        "budget": budget_of(estimator),
    }


def budget_of(estimator: Estimator) -> dict[str, Any] | None:
    """Name the option that says how much an estimator may compute, and its value; None if it has none."""
    if estimator.budget is None:
        return None
    return {"option": estimator.budget, "value": getattr(estimator.options, estimator.budget)}


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
