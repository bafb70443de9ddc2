"""Fit an estimator to a scan: learn, and bring what presses to an estimator that presses by itself."""

from __future__ import annotations

from collections.abc import Callable

from tactsim.core import Scan
from tactsim.core.forward import ForwardModel
from tactsim.estimators import Estimator


def fit(estimator: Estimator, scan: Scan, forward: Callable[[Scan], ForwardModel] | None) -> None:
    """Fit an estimator to the training readings of a scan; one that asks for it gets `forward` of the scan first.

    Raises InputError if the estimator needs a forward model, and there is none or the scan does not say how it was
    pressed.
    """
    if forward is not None and estimator.uses_forward_model:
        estimator.bring(forward(scan))
    estimator.fit(scan)
