"""The share of (task, target) pairs that each method has solved, against readings and against processor time.

As COCO shows optimisers (Hansen, Auger, Ros, Mersmann, Tusar and Brockhoff 2021, Optimization Methods and Software 36):
an empirical distribution of what it took to reach each target for the first time.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactsim.bench.leaderboard.drawings import SCHEMES, ground_style, shortened
from tactsim.bench.leaderboard.standings import Entrant, Standings
from tactsim.bench.report.picture import look
from tactsim.bench.runs.figures import as_bytes, plain_log
from tactsim.core.poses import FloatArray

TARGETS = np.geomspace(10.0, 0.1, 21)  # mm of placement error, with the right letter


@dataclass(frozen=True, eq=False)
class Solved:
    """What a method needed for each of its pairs: one of a task, a trial and a target.

    label, number: of the method, see `Entrant`. tasks: how many it entered. weights: (pairs,) the pair's share of all
    pairs of all tasks. readings, ms: (pairs,) after how many readings, and how much processor time, the target was
    reached for the first time; infinite if it never was.
    """

    label: str
    number: int
    tasks: int
    weights: FloatArray
    readings: FloatArray
    ms: FloatArray

    def share(self, by: str, most: float) -> float:
        """Give the share of all pairs that are solved within so many `readings` or `ms`."""
        return float(self.weights[getattr(self, by) <= most].sum())


def solved(standings: Iterable[Standings]) -> list[Solved]:
    """Count what each method has solved on all of these tasks, the best first.

    Tasks weigh alike, and so do trials within a task. What a method did not enter it did not solve.
    """
    tasks = [of for of in standings if of.ranked]
    entered: dict[str, list[Entrant]] = defaultdict(list)
    for of in tasks:
        for one in of.ranked:
            entered[one.label].append(one)
    found = []
    for label, entries in entered.items():
        reached = [first_reached(one) for one in entries]
        weights = [np.full(steps.size, 1 / (len(tasks) * steps.size)) for steps, _ in reached]
        readings, ms = (
            np.concatenate([part.ravel() for part in parts]) for parts in zip(*reached, strict=True)
        )
        found.append(Solved(label, entries[0].number, len(entries), np.concatenate(weights), readings, ms))
    return sorted(found, key=lambda one: (-one.share("readings", np.finfo(float).max), one.label))


def first_reached(one: Entrant) -> tuple[FloatArray, FloatArray]:
    """Find after how many readings, and ms, each trial first reached each target: (n, targets) each, inf if never.

    Reached is a target by the right letter, placed within it; by "none of them" where that is right.
    """
    trials = one.pooled.trials
    close = one.pooled.errors[..., None] <= TARGETS
    reached = trials.right[..., None] & (close | ~trials.known[:, None, None])
    first, ever = reached.argmax(axis=1), reached.any(axis=1)
    ms = np.take_along_axis(1e3 * trials.seconds.cumsum(axis=1), first, axis=1)
    return np.where(ever, first + 1.0, np.inf), np.where(ever, ms, np.inf)


def picture(lines: Sequence[Solved], scheme: str = "light", kind: str = "svg") -> bytes:
    """Draw the shares against readings and against processor time, on a ground of `scheme`."""
    ground, _, grid = SCHEMES[scheme]
    with mpl.rc_context(ground_style(scheme)):
        figure = Figure(
            figsize=(9, max(3.8, 0.21 * len(lines) + 0.6)), layout="constrained", facecolor=ground
        )
        sides = figure.subplots(1, 2, sharey=True)
        for axes, by, words in zip(
            sides, ("readings", "ms"), ("readings", "processor time, ms"), strict=True
        ):
            axes.set_facecolor(ground)
            needed = np.concatenate([getattr(one, by) for one in lines])
            needed = needed[np.isfinite(needed) & (needed > 0)]
            at = np.geomspace(needed.min(), needed.max(), 200) if needed.size else np.ones(1)
            at = np.unique(np.ceil(at)) if by == "readings" else at
            for one in lines:
                colour, marker = look(one.number, scheme)
                share = [one.share(by, most) for most in at]
                entered = f" ({one.tasks})" * (max(line.tasks for line in lines) > 1)
                name = f"{shortened(one.label)}{entered}" if by == "readings" else None
                axes.plot(at, share, color=colour, lw=1.6, drawstyle="steps-post", label=name,
                          marker=marker, ms=6, markevery=[-1])  # fmt: skip
            axes.set(xscale="log", xlabel=words, ylim=(0, 1))
            plain_log(axes.xaxis)
            if by == "ms":  # of many decades
                axes.xaxis.set_major_locator(LogLocator())
            axes.grid(which="major", lw=0.5, color=grid)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
        sides[0].set_ylabel("share of (task, target) pairs solved")
        figure.legend(loc="outside right upper", frameon=False, fontsize=9)
        return as_bytes(figure, kind, dpi=160)
