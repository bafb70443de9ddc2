"""Numerical stress cases: each varies one thing over many decades and measures the worst deviation.

Lives here: one file a topic, each a list of cases with a limit and the reason for it. `bench stress` runs them
all: it says when something breaks numerically. Does not live here: how exact a press or a bound is, faults of disks
and processes, and hostile files; those are tests.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module

from tactsim.bench.stress.case import Case, Outcome, run_case, run_cases
from tactsim.core.errors import unknown

TOPICS = ("frames", "maps", "filters", "press")
__all__ = ["TOPICS", "Case", "Outcome", "cases", "chosen_cases", "run_case", "run_cases"]


def cases() -> list[Case]:
    """List every case, by topic, in the order in which the files have them."""
    return [
        value
        for topic in TOPICS
        for value in vars(import_module(f"tactsim.bench.stress.{topic}_cases")).values()
        if isinstance(value, Case)
    ]


def chosen_cases(names: Iterable[str] = (), tags: Iterable[str] = ()) -> list[Case]:
    """List the cases with any of these names or tags; without names and tags, all.

    Raises InputError for a name or a tag that no case has.
    """
    every = cases()
    names, tags = set(names), set(tags)
    known_tags = dict.fromkeys(tag for one in every for tag in one.tags)
    for name in sorted(names - {one.name for one in every}):
        raise unknown("stress case", name, [one.name for one in every])
    for tag in sorted(tags - set(known_tags)):
        raise unknown("tag", tag, known_tags)
    if not names and not tags:
        return every
    return [one for one in every if one.name in names or tags & set(one.tags)]
