"""The old name of `experiment`, which tests of tasks made by `bench new` import."""

from tactsim.bench.experiment import perform, silent

__all__ = ["perform", "silent"]
