"""Fill the line of a page that says that every case keeps to its limit: `python docs/tools/page_stress.py PAGE`.

What stands between two comments is replaced:

    <!-- stress: all cases -->
    <!-- end of stress -->
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from page_blocks import asked_for, fill_blocks, fill_one

from tactsim.bench.machine import machine, versions
from tactsim.bench.stress import cases, run_cases
from tactsim.bench.stress.case import Outcome
from tactsim.bench.terminal import progress_bars
from tactsim.core import InputError
from tactsim.core.source_digest import git_commit, short_commit

_ALL = "all cases"


def check(text: str) -> None:
    """Raise InputError unless a page has one such line with an end, and asks for all cases."""
    found = asked_for(text, "stress")
    if found != [_ALL]:
        raise InputError(f"it lacks `<!-- stress: {_ALL} -->`, or has several")


def fill(text: str, outcomes: Sequence[Outcome]) -> str:
    """Say on a page that no case failed. Raises InputError, naming a case, if one does not keep to its limit."""
    check(text)
    for one in outcomes:
        case = one.case
        if not one.passed:
            raise InputError(f"the case {case.name} fails at {one.at}: see `bench stress --case {case.name}`")
    minutes = sum(one.seconds for one in outcomes) / 60
    known, on = versions(), machine()
    libraries = f"Python {known['python']}, NumPy {known['numpy']}, MuJoCo {known['mujoco']}"
    origin = (
        f"*`make stress`: {len(outcomes)} cases in {minutes:.0f} minutes, none failed; {libraries}, {on['cores']} cores"
        f" of {on['processor']}; commit {short_commit(git_commit())}.*"
    )
    return fill_blocks(text, "stress", lambda _: f"{origin}\n")


def _fill_anew(text: str) -> str:
    check(text)  # a wrong page is reported before the work
    with progress_bars() as progress:
        return fill(text, run_cases(cases(), progress))


def main(words: Sequence[str]) -> int:
    """Fill the page `words[0]`; returns the exit status."""
    return fill_one("stress", words, _fill_anew)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
