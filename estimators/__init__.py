"""Who is it and where: maps learned from readings, likelihoods and filters.

Lives here: one file an estimator, the occupancy maps, the measurement models and the kernels that
they share. Does not live here: physics, files, scores. Of `tactsim` it sees only the data types
(`Scan`, poses).
"""

from tactsim.estimators.estimator import (
    NONE,
    Estimate,
    Estimator,
    Options,
    PlaneBelief,
    check_order,
    check_reading,
)
from tactsim.estimators.registry import create, names

__all__ = [
    "NONE",
    "Estimate",
    "Estimator",
    "Options",
    "PlaneBelief",
    "check_order",
    "check_reading",
    "create",
    "names",
]
