"""What the paper prints of its results (section IV): the only figures here that are copied and not computed."""

from __future__ import annotations

from dataclasses import dataclass

from tactsim.bench.results import Run
from tactsim.bench.runs.naming import budget

LETTERS = ("A", "E", "I", "O", "U")


@dataclass(frozen=True)
class Printed:
    """A result as the paper's text states it: the filter with its bins or particles, and what it reaches.

    share: of the trials right. readings: from which on, as figures 6a and 7a have them. error: mm, mean distance from
    the true pose where the letter is right; None where only a curve of figure 6b or 7b shows it.
    """

    estimator: str
    option: str
    amount: int
    share: float
    readings: int
    error: float | None = None

    @property
    def words(self) -> str:
        """Say it in one line."""
        error = "" if self.error is None else f", {self.error:g} mm"
        return (
            f"{100 * self.share:.0f} % from {self.readings} on{error} "
            f"({self.estimator} filter, {self.amount:,} {self.option})"
        )


BEST = Printed("histogram", "bins", 10_000, 1.0, 9, 1.3)
PRINTED = (
    Printed("histogram", "bins", 1_000, 1.0, 46),
    BEST,
    Printed("particle", "particles", 10_000, 0.74, 10),
)


def beside(run: Run) -> Printed | None:
    """Give what the paper prints of a run's filter and budget, or else its best; None of other objects than its own."""
    if run.in_space or sorted(run.letters) != list(LETTERS) or run.config["hold_out"]:
        return None
    return of_filter(run) or BEST


def in_figure(run: Run) -> Printed | None:
    """Give what the paper prints of a run's filter and budget if the run follows the protocol of its figures."""
    follows = "test poses same" in run.protocol and run.config["explore"] == "random"
    return of_filter(run) if follows and beside(run) else None


def of_filter(run: Run) -> Printed | None:
    """Give what the paper prints of a run's own filter and budget; None if that is nothing."""
    allowed = budget(run)
    for printed in PRINTED:
        if allowed and (run.estimator, allowed.amount) == (printed.estimator, printed.amount):
            return printed
    return None
