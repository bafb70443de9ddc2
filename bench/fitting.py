"""Fit an estimator to a scan: learn, and bring what presses to an estimator that presses by itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tactsim.core import InputError, Scan
from tactsim.core.forward import ForwardModel
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import name_of, no_exit
from tactsim.estimators.options import FilterOptions, wants_pad_fit

if TYPE_CHECKING:
    from tactsim.estimators.pad_fit import PadFit


def fit(estimator: Estimator, scan: Scan, forward: Callable[[Scan], ForwardModel] | None) -> None:
    """Fit an estimator to the training readings of a scan; one that asks for it gets `forward` of the scan first.

    Raises InputError if the estimator needs a forward model, and there is none, the scan does not say how it was
    pressed, or its readings are not in kPa.
    """
    unit, name = scan.meta.get("unit", "kPa"), name_of(estimator)
    if estimator.uses_forward_model and unit != "kPa":
        raise InputError(
            f"the readings are in {unit}; {name} presses the letters "
            "itself, in kPa: convert the readings, or take an estimator that learns them, such as refined"
        )
    with no_exit(name):
        if forward is not None and estimator.uses_forward_model:
            estimator.bring(forward(scan))
        estimator.fit(scan)


def pad_fit_of(estimator: Estimator, scan: Scan) -> PadFit | None:
    """Say what an estimator fits to the pad of a scan, whether it has done so yet or not; None if it does not."""
    options = estimator.options
    if not (
        isinstance(options, FilterOptions) and hasattr(estimator, "pad_fit") and wants_pad_fit(options, scan)
    ):
        return None
    if estimator.pad_fit is not None:
        known: PadFit = estimator.pad_fit
        return known
    from tactsim.estimators.pad_fit import fit_to_pad

    return fit_to_pad(scan, options)
