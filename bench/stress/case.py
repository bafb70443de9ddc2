"""A stress case: one thing varied, the worst deviation that was seen, and the limit for it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.errors import InputError

QUICK = "quick"


class Worst:
    """Keep the worst value seen and where; a value that is not finite is the worst of all."""

    def __init__(self) -> None:
        self.value = -math.inf
        self.at = ""
        self.seen = 0

    def see(self, values: ArrayLike, at: str) -> None:
        """Note one value or an array of values, all measured `at` one setting."""
        array = np.asarray(values, dtype=float)
        if not array.size:
            return
        worst = float(np.max(array)) if np.isfinite(array).all() else math.inf
        self.seen += array.size
        if worst > self.value:
            self.value, self.at = worst, at

    def holds(self, truth: bool | np.bool_, at: str) -> None:
        """Note a fact that must hold: a deviation of 0 if it does, of 1 if not."""
        self.see(0.0 if truth else 1.0, at)


@dataclass(frozen=True)
class Case:
    """One numerical stress case.

    name: topic and case, "maps.peak-near-one". varied: what is varied, and how far. deviation: what is
    measured. limit: the largest deviation allowed. because: the reason for the limit. measure(worst) does the work and
    tells `worst` each deviation. Any exception in it is a failure.
    """

    name: str
    varied: str
    deviation: str
    limit: float
    because: str
    measure: Callable[[Worst], None]
    quick: bool = True

    @property
    def tags(self) -> tuple[str, ...]:
        """List the tags by which the case can be chosen: its topic, and "quick"."""
        return (self.name.partition(".")[0], *((QUICK,) if self.quick else ()))


@dataclass(frozen=True)
class Outcome:
    """The result of a case: the worst value (infinite if one was not finite), where it was seen, and seconds."""

    case: Case
    worst: float
    at: str
    seconds: float = field(compare=False)

    @property
    def passed(self) -> bool:
        """Tell whether the worst value keeps to the limit."""
        return self.worst <= self.case.limit

    @property
    def verdict(self) -> str:
        """Say in a word whether the case keeps to its limit."""
        return "passes" if self.passed else "FAILS"

    def as_json(self) -> dict[str, Any]:
        """Put the outcome into what `--json` prints; a worst that is not finite is None."""
        return {
            "name": self.case.name,
            "tags": self.case.tags,
            "varied": self.case.varied,
            "deviation": self.case.deviation,
            "worst": self.worst if math.isfinite(self.worst) else None,
            "at": self.at,
            "limit": self.case.limit,
            "limit_is": "most",
            "because": self.case.because,
            "verdict": self.verdict,
            "seconds": self.seconds,
        }


def case(
    name: str, *, varied: str, deviation: str, limit: float, because: str, quick: bool = True
) -> Callable[[Callable[[Worst], None]], Case]:
    """Make a `Case` of the function below; a module's cases are the Case objects in it."""

    def make(measure: Callable[[Worst], None]) -> Case:
        return Case(name, varied, deviation, limit, because, measure, quick)

    return make


def run_case(chosen: Case) -> Outcome:
    """Do one case. A RuntimeWarning, such as NumPy's for an overflow, fails it as any exception does."""
    worst = Worst()
    start = perf_counter()
    broken = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            chosen.measure(worst)
        if not worst.seen:
            broken = "nothing was measured"
    except Exception as error:
        broken = f"{type(error).__name__}: {error}"
    seconds = perf_counter() - start
    if broken:
        return Outcome(chosen, math.inf, broken, seconds)
    return Outcome(chosen, worst.value, worst.at, seconds)


def run_cases(chosen: Iterable[Case], progress: Callable[[str, int, int], None]) -> list[Outcome]:
    """Do the cases in order; progress("stress", done, total) is called after each."""
    cases = list(chosen)
    outcomes = []
    progress("stress", 0, len(cases))
    for done, one in enumerate(cases, start=1):
        outcomes.append(run_case(one))
        progress("stress", done, len(cases))
    return outcomes


def refused(call: Callable[..., Any], *args: Any, **options: Any) -> bool:
    """Tell whether a call ends in an InputError of one line; any other exception is raised."""
    try:
        call(*args, **options)
    except InputError as error:
        return "\n" not in str(error)
    return False
