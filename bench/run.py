"""The old name of the module of `Run`, which is `tactsim.Run`."""

from tactsim.bench.results import Run

__all__ = ["Run"]
