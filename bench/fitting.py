"""Fit an estimator to a scan: learn, and bring what presses to an estimator that presses by itself."""

from __future__ import annotations

from tactsim.core import Scan
from tactsim.estimators import Estimator
from tactsim.press import forward_model


def fit(estimator: Estimator, scan: Scan) -> None:
    """Fit an estimator to the training readings of a scan; one that asks for it gets the scan's forward model first.

    Raises InputError if the estimator needs a forward model and the scan does not say how it was pressed.
    """
    if estimator.uses_forward_model:
        estimator.bring(forward_model(scan))
    estimator.fit(scan)
