"""What `bench bound` finds: how good an estimator can be on the trials of a run, by reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactsim.bench.bound.efficiency import bound_curves, determined_below_mm
from tactsim.bench.bound.exact_bayes import ExactBayes
from tactsim.bench.bound.scan_information import check_motion, scan_information
from tactsim.bench.config import RunConfig
from tactsim.bench.experiment import perform, silent
from tactsim.bench.results import Run
from tactsim.bench.runs.figures import BLUE, GREY, ORANGE, Picture, over_readings
from tactsim.bench.trials import Progress
from tactsim.core.errors import InputError, counted
from tactsim.core.poses import FloatArray


@dataclass(frozen=True, eq=False)
class Bound:
    """The best that readings allow, on the trials that every estimator gets.

    run: exact Bayes on those trials, or, with the reason in `no_bayes`, `nearest`, of which nothing is told. pressures,
    classes: (n, r) mm, the Cramer-Rao bound of each trial after each
    reading, of the pressures and of the three classes of eq. 3.
    """

    run: Run
    pressures: FloatArray
    classes: FloatArray
    no_bayes: str = ""

    def as_json(self) -> dict[str, Any]:
        """Put it into one flat object, as `bench bound --json` prints it; lists run over the readings."""
        summary = self.run.summary
        of = (self.run.trials, self.run.objects)
        of_pressures, of_classes = bound_curves(self.pressures, *of), bound_curves(self.classes, *of)
        kept = ("accuracy", "accuracy_low", "accuracy_high", "error_mm", "error_standard_error_mm")
        asked = ("trials", "readings", "seed")
        nothing = [None] * self.run.readings
        return {
            **{name: self.run.config[name] for name in asked},
            "letters": self.run.letters,
            "protocol": self.run.protocol,
            "scan": self.run.about["scan"]["options"],
            **{f"bayes_{name}": nothing if self.no_bayes else summary[name] for name in kept},
            "no_bayes": self.no_bayes,
            "bound_mm": of_pressures["bound_mm"],
            "determined": of_pressures["determined"],
            "bayes_efficiency": nothing if self.no_bayes else of_pressures["efficiency"],
            "classes_bound_mm": of_classes["bound_mm"],
            "classes_determined": of_classes["determined"],
            "determined_below_mm": determined_below_mm(self.run.trials),
            "seconds": self.run.seconds,
            "versions": self.run.versions,
        }

    def plot(self) -> Picture:
        """Draw accuracy and error of exact Bayes and both bounds against readings seen."""
        found, summary = self.as_json(), self.run.summary
        seen = np.arange(1, self.run.readings + 1)
        figure = Picture(figsize=(9, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        if not self.no_bayes:
            low, high = summary["accuracy_low"], summary["accuracy_high"]
            left.fill_between(seen, low, high, color=BLUE, alpha=0.2, lw=0, label="95 % interval")
            left.plot(seen, summary["accuracy"], color=BLUE, lw=1.8, label="exact Bayes")
            right.plot(seen, self.run.error_mm, color=BLUE, lw=1.8, label="exact Bayes")
        left.set(ylim=(0, 1.02), ylabel="share of trials right")
        for name, colour, label in (
            ("bound_mm", "black", "Cramer-Rao, pressures"),
            ("classes_bound_mm", ORANGE, "Cramer-Rao, three classes"),
        ):
            right.plot(seen, np.array(found[name], dtype=float), color=colour, ls=(0, (5, 3)), label=label)
        right.set(yscale="log", ylabel="placement error, mm")
        for axes in (left, right):
            over_readings(axes, self.run.readings)
            if axes.has_data():
                axes.legend(frameon=False)
            axes.grid(which="both", lw=0.3, alpha=0.6, color=GREY)
        title = f"The best possible: {counted(len(self.run.trials.truth), 'trial')}, {self.run.protocol}"
        figure.suptitle(title, fontsize=10, parse_math=False)
        return figure


def find_bound(config: RunConfig, *, jobs: int = 1, cache: bool = True, progress: Progress = silent) -> Bound:
    """Do exact Bayes on the trials that `config` asks for, and bound their errors.

    Exact Bayes is done anew each time; the information behind the Cramer-Rao bound is kept in the cache of readings.
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
    information = scan_information(run.plan.scan, jobs=jobs, cache=cache, progress=progress)
    pressures, classes = (
        information.bounds(run.trials, of, config.moving) for of in ("pressures", "classes")
    )
    return Bound(run, pressures, classes, no_bayes)
