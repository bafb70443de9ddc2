"""Compare trials that were done again with what a bundle says of them: to the bit, or within what chance allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.placement import Properties
from tactsim.bench.score import errors
from tactsim.bench.trials import Trials
from tactsim.core.poses import FloatArray

CHANCE = 0.001  # how often an honest bundle is refused by the bound
DRAWS = 20_000
# What of a trial must be the same: all but the times.
COLUMNS = tuple(field.name for field in fields(Trials) if not field.name.endswith("_s"))


@dataclass(frozen=True)
class Difference:
    """The first thing that differs: in which trial, after which reading, in which column, and both values."""

    seed: int
    letter: str
    trial: int
    reading: int
    column: str
    stated: str
    again: str

    def __str__(self) -> str:
        """Say it in one line."""
        return (
            f"seed {self.seed}, letter {self.letter}, trial {self.trial}, reading {self.reading}: {self.column} is "
            f"{self.stated} in the bundle and {self.again} when it is done again"
        )


def alike(stated: Trials, again: Trials) -> NDArray[np.bool_]:
    """Tell of each trial (n,) whether all but the times is the same to the bit; NaN is NaN."""
    same = np.ones(len(stated.truth), dtype=bool)
    for name in COLUMNS:
        equal = _same(getattr(stated, name), getattr(again, name)).reshape(len(same), -1)
        same = np.logical_and(same, equal.all(axis=1))
    return same


def first_difference(stated: Trials, again: Trials, seeds: Sequence[int]) -> Difference | None:
    """Find the first trial that differs, and in it the first reading; None if none does. seeds: (n,)."""
    same = alike(stated, again)
    if same.all():
        return None
    n = int(np.flatnonzero(~same)[0])
    found = []
    for place, name in enumerate(COLUMNS):
        one, other = getattr(stated, name)[n], getattr(again, name)[n]
        equal = np.atleast_1d(_same(one, other))
        apart = np.flatnonzero(~equal.reshape(len(equal), -1).all(axis=1))
        if len(apart):
            found.append((int(apart[0]), place, one, other))
    reading, place, one, other = min(found, key=lambda entry: entry[:2])
    if np.ndim(one):
        one, other = one[reading], other[reading]
    return Difference(
        seeds[n],
        str(stated.truth[n]),
        int(stated.trial[n]),
        reading + 1,
        COLUMNS[place],
        _text(one),
        _text(other),
    )


def improbable(
    stated: Trials,
    again: Trials,
    seeds: Sequence[int],
    objects: Mapping[int, Mapping[str, Properties]],
    rng: np.random.Generator,
) -> str | None:
    """Say what differs more than chance allows between trials and the same trials done again; None if nothing does.

    seeds: (n,) of the trials. objects: of the run of each seed. rng: draws the signs.

    Of each trial three numbers are compared: the share of the readings after which the label is right, the mean
    placement error, and the mean probability of the right label. If both are draws of one method, each difference might
    as well have the other sign. So the mean difference is compared with that under random signs (the paired permutation
    test, Fisher 1935). A figure is improbable if at most CHANCE / 3 of the draws are as far from 0, so an honest bundle
    is refused once in 1 / CHANCE times at most.
    """
    figures = {
        "the share of right labels": (stated.right.mean(axis=1), again.right.mean(axis=1)),
        "the placement error in mm": (_errors(stated, seeds, objects), _errors(again, seeds, objects)),
        "the probability of the right label": (stated.p_truth.mean(axis=1), again.p_truth.mean(axis=1)),
    }
    signs = rng.choice([-1.0, 1.0], size=(DRAWS, len(stated.truth)))
    for what, (one, other) in figures.items():
        difference = one - other
        known = np.isfinite(difference)
        drawn = np.abs(signs[:, known] @ difference[known])
        # The draw that is the difference itself counts too; equal sums may differ by rounding.
        as_far = 1 + np.count_nonzero(drawn >= abs(difference[known].sum()) * (1 - 1e-9))
        if difference[known].any() and as_far / (DRAWS + 1) <= CHANCE / len(figures):
            return (
                f"{what} is {one[known].mean():.4g} in the bundle and {other[known].mean():.4g} when the "
                f"same {known.sum()} trials are done again; chance does that to one honest bundle in "
                f"{1 / CHANCE:,.0f} at most"
            )
    return None


def _errors(
    trials: Trials, seeds: Sequence[int], objects: Mapping[int, Mapping[str, Properties]]
) -> FloatArray:
    """Average each trial's placement errors, (n,) mm; NaN where the letter is not known."""
    found = np.empty(len(seeds))
    for seed in dict.fromkeys(seeds):
        of_run = np.array(seeds) == seed
        found[of_run] = errors(rows(trials, of_run), objects[seed]).mean(axis=1)
    return np.where(trials.known, found, np.nan)


def rows(trials: Trials, chosen: NDArray[Any]) -> Trials:
    """Select trials by their places or by a mask."""
    return Trials(**{field.name: getattr(trials, field.name)[chosen] for field in fields(Trials)})


def _same(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_]:
    same: NDArray[np.bool_] = np.asarray(one == other)
    return same | (np.isnan(one) & np.isnan(other)) if one.dtype.kind == "f" else same


def _text(value: object) -> str:
    return str(value.tolist() if isinstance(value, np.ndarray | np.generic) else value)
