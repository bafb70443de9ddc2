"""What `bench bound` finds: how good an estimator can be on the trials of a run, by reading."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactsim.bench.bound.efficiency import determined_below_mm
from tactsim.bench.bound.exact_bayes import ExactBayes
from tactsim.bench.bound.scan_information import check_motion, scan_bounds
from tactsim.bench.config import RunConfig
from tactsim.bench.experiment import perform, silent
from tactsim.bench.results import Run
from tactsim.bench.runs.figures import Picture, over_readings
from tactsim.bench.trials import Progress
from tactsim.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Bound:
    """The best that readings allow, on the trials that every estimator gets.

    run: exact Bayes on those trials, or, with the reason in `no_bayes`, `nearest`, of which nothing is told; with the
    Cramer-Rao bound of each trial after each reading.
    """

    run: Run
    no_bayes: str = ""

    def as_json(self) -> dict[str, Any]:
        """Put it into one flat object, as `bench bound --json` prints it; lists run over the readings."""
        summary, bound = self.run.summary, self.run.against_bound
        kept = ("accuracy", "accuracy_low", "accuracy_high", "error_mm", "error_standard_error_mm")
        nothing = [None] * self.run.readings
        return {
            **{name: self.run.config[name] for name in ("trials", "readings", "seed")},
            "letters": self.run.letters,
            "protocol": self.run.protocol,
            "scan": self.run.about["scan"]["options"],
            **{f"bayes_{name}": nothing if self.no_bayes else summary[name] for name in kept},
            "no_bayes": self.no_bayes,
            "bound_mm": bound["bound_mm"],
            "determined": bound["determined"],
            "bayes_efficiency": nothing if self.no_bayes else bound["efficiency"],
            "determined_below_mm": determined_below_mm(self.run.trials),
            "seconds": self.run.seconds,
            "versions": self.run.versions,
        }

    def plot(self) -> Picture:
        """Draw accuracy and error of exact Bayes and the bound against readings seen; without it the bound alone."""
        if not self.no_bayes:
            picture: Picture = self.run.plot()
            return picture
        figure = Picture(figsize=(4.5, 3.8), layout="constrained")
        axes = figure.subplots()
        axes.plot(np.arange(1, self.run.readings + 1), self.run.bound_mm, color="black", ls=(0, (5, 3)))
        axes.set(ylabel="Cramer-Rao bound of the error, mm")
        axes.set_ylim(bottom=0)
        figure.suptitle(self.run.protocol, fontsize=10, parse_math=False)
        over_readings(axes, self.run.readings)
        return figure


def find_bound(config: RunConfig, *, jobs: int = 1, cache: bool = True, progress: Progress = silent) -> Bound:
    """Do exact Bayes on the trials that `config` asks for, and bound their errors.

    Where exact Bayes does not know the press there is the Cramer-Rao bound alone.
    Raises InputError if the readings do not say how they were pressed, or if the bound does not know the sensor or how
    the object moves.
    """
    check_motion(config.moving)  # before the work, not after it
    no_bayes = ""
    try:
        if not config.moving.still:
            raise InputError("exact Bayes takes the object to lie still; leave out --slip")
        run = perform(config, estimator=ExactBayes(), jobs=jobs, cache=cache, progress=progress)
    except InputError as error:
        no_bayes = str(error)
        order = config.model_copy(update={"estimator": "nearest"})
        run = perform(order, jobs=jobs, cache=cache, progress=progress)
    assert run.plan is not None
    bounds = scan_bounds(run.plan.scan, run.trials, config.moving, jobs=jobs, progress=progress)
    called = run.config if no_bayes else run.config | {"estimator": "exact Bayes"}
    return Bound(replace(run, config=called, bounds=bounds), no_bayes)
