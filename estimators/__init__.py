"""Which letter is it, and where: maps learned from readings, likelihoods and filters.

Lives here: the face of every estimator, and three rooms. `likelihoods` says what a reading tells of a state,
`field` sums that over the readings of a sequence, `filters` keep a belief. Imports go one way: filters, field,
likelihoods. Leaves beside them: `baselines` have no map, `synthesis` presses the known shapes itself. `contract` checks
what every estimator, also one of a package of its own, must keep. Does not live here: physics, files, scores. Of
`tactsim` it sees only `core`.
"""

from typing import TYPE_CHECKING, Any

from tactsim.estimators.estimator import (
    NONE,
    Estimate,
    Estimator,
    Options,
    PlaneBelief,
    PoseSamples,
    check_order,
    check_reading,
)
from tactsim.estimators.likelihoods.likelihood import Likelihood, TaxelSum
from tactsim.estimators.registry import create, names

if TYPE_CHECKING:
    from tactsim.estimators.batch_estimator import BatchEstimator

__all__ = [
    "NONE",
    "BatchEstimator",
    "Estimate",
    "Estimator",
    "Likelihood",
    "Options",
    "PlaneBelief",
    "PoseSamples",
    "TaxelSum",
    "check_order",
    "check_reading",
    "create",
    "names",
]


def __getattr__(name: str) -> Any:
    if name != "BatchEstimator":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from tactsim.estimators.batch_estimator import BatchEstimator  # no run without a learned method needs it

    return BatchEstimator
