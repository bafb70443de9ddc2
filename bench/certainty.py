"""The old name of a part of `placement`, by which the documentation called it."""

from tactsim.bench.placement import certainty, covariance

__all__ = ["certainty", "covariance"]
