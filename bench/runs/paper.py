"""What the paper prints of its results (section IV): the only figures here that are copied and not computed."""

from __future__ import annotations

from dataclasses import dataclass

from tactsim.bench.kinds import PLANE
from tactsim.bench.results import Run

LETTERS = ("A", "E", "I", "O", "U")


@dataclass(frozen=True)
class Printed:
    """A filter of Pezzementi, Reyda and Hager (2011) with its bins or particles, as their text states it.

    Their curves, figures 6 and 7, are pictures, from which nothing is read here. They have ten trials for each of five
    real letters, and neither intervals nor trials to compare with.

    share: of the trials right, from so many readings on. error: mm, mean distance from the true pose where the letter
    is right; None where the text states none. where: the place in the paper, and what else it says there.
    """

    estimator: str
    option: str
    amount: int
    share: float
    readings: int
    error: float | None
    where: str

    @property
    def method(self) -> str:
        """Name the filter as tables call it."""
        return f"{self.estimator}, {self.amount:,} {self.option} (paper)"

    def accuracy_after(self, reading: int) -> float | None:
        """Give the accuracy that the text states for this many readings or fewer; None if it states none."""
        return self.share if reading >= self.readings else None

    def figure(self, name: str) -> float | None:
        """Give a figure that the text states, such as accuracy@10; None if it does not."""
        metric, _, at = name.partition("@")
        return self.accuracy_after(int(at)) if metric == "accuracy" else None

    @property
    def words(self) -> str:
        """Say it in one line."""
        error = "" if self.error is None else f", {self.error:g} mm"
        return (
            f"{100 * self.share:.0f} % from {self.readings} on{error} "
            f"({self.estimator} filter, {self.amount:,} {self.option})"
        )


BEST = Printed(
    "histogram", "bins", 10_000, 1.0, 9, 1.3,
    "1.00 after 9 readings; objects within 1.3 mm on average, after how many it does not say: section V",
)  # fmt: skip
PRINTED = (
    BEST,
    Printed("histogram", "bins", 1_000, 1.0, 46, None, "1.00 after 46 readings: section V; about 50 in IV"),
    Printed("particle", "particles", 10_000, 0.74, 10, None, "levels out at 0.74 after some 10: section IV"),
)


def beside(run: Run) -> Printed | None:
    """Give what the paper prints of a run's filter and budget, or else its best; None where a run asks something else.

    That is, of other objects than the paper's, with one held out, or where the estimator chooses where to touch.
    """
    if run.kind.name != PLANE or sorted(run.letters) != list(LETTERS) or run.config["hold_out"]:
        return None
    return (of_filter(run) or BEST) if run.config["explore"] == "random" else None


def at_its_poses(run: Run) -> bool:
    """Say if a run tests with the poses that it was trained with, as the paper does."""
    return "test poses same" in run.protocol


def in_figure(run: Run) -> Printed | None:
    """Give what the paper prints of a run's own filter and budget if the run follows the protocol of its figures."""
    return of_filter(run) if beside(run) and at_its_poses(run) else None


def of_filter(run: Run) -> Printed | None:
    """Give what the paper prints of a run's own filter and budget; None if that is nothing."""
    from tactsim.bench.runs.pooled import budget

    allowed = budget(run)
    for printed in PRINTED:
        if allowed and (run.estimator, allowed.amount) == (printed.estimator, printed.amount):
            return printed
    return None
