"""What results say of the estimator that made them. A confined plug-in's process says it too, so little is imported."""

from __future__ import annotations

from typing import Any

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
