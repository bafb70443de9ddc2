"""Time benchmarks in turns with an earlier commit's code, and decide which have become slower.

The reference of a benchmark is the same benchmark with the code of an earlier commit. Two processes, one with
each code, take turns on this machine, so whatever else goes on here slows both alike. A round is a fixed
number of calls of either side in small portions, and gives one ratio of processor times, new / base.

Rounds are added until Wald's sequential probability ratio test (A. Wald, Sequential tests of statistical
hypotheses, 1945) decides. It counts the rounds whose ratio is above THRESHOLD, so it takes no distribution of
times for granted, only that rounds are independent. A benchmark whose median ratio is at most THRESHOLD is
called slower with a probability of at most LEVEL / benchmarks, whenever the test stops (J. Ville's
inequality). So one check of unchanged code raises a false alarm with a probability of at most LEVEL over all
benchmarks. What two processes do not share, such as where their code lies in memory, is not independent from
round to round: a benchmark is slower only if a second pair of processes finds so too.
"""

from __future__ import annotations

import io
import json
import math
import os
import statistics
import subprocess
import sys
import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tactsim.core.errors import InputError

SLOWER = 1.25  # the ratio of times that is to be found
THRESHOLD = math.sqrt(SLOWER)  # a round above it speaks for "slower"
LEVEL = 0.05  # probability of a false alarm in one check, over all benchmarks
SHARE_ABOVE = 0.9  # share of rounds above THRESHOLD that a benchmark slower by SLOWER has at least
MISSED = 0.05  # probability that one pair of processes misses a benchmark with that share
MOST_ROUNDS = 40
PORTIONS = 4  # of either side in a round, in the order new base, base new, base new, new base
SHORTEST = 0.1  # s that a round of either side takes at least

_WORKER = Path(__file__).with_name("regression_worker.py")
_SERIAL = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "NUMBA")}


@dataclass(frozen=True)
class Timing:
    """The rounds of one benchmark. ratios: processor times, new / base. slower: what the test decided."""

    ratios: tuple[float, ...]
    slower: bool

    @property
    def ratio(self) -> float:
        """Give the median ratio."""
        return statistics.median(self.ratios)


def decide(round_: Callable[[], float], benchmarks: int) -> Timing:
    """Add rounds until the test decides (Wald 1945) or MOST_ROUNDS are done, which is no alarm.

    round_: measures one round and gives its ratio, new / base. benchmarks: how many share LEVEL.
    """
    alarm, rest = math.log(benchmarks / LEVEL), math.log(MISSED)
    evidence = 0.0
    ratios: list[float] = []
    while len(ratios) < MOST_ROUNDS and rest < evidence < alarm:
        ratios.append(round_())
        evidence += math.log(2 * (SHARE_ABOVE if ratios[-1] > THRESHOLD else 1 - SHARE_ABOVE))
    return Timing(tuple(ratios), slower=evidence >= alarm)


class Side:
    """A process that runs the benchmarks with one version of the code."""

    def __init__(self, tree: Path, benchmarks: Path) -> None:
        """Start it. tree: the root of that version. benchmarks: the file of benchmarks, below any root."""
        self.tree = tree.resolve()
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(_WORKER.resolve()), str(self.tree / benchmarks)],
            cwd=self.tree,
            env=os.environ | _SERIAL | {"PYTHONPATH": str(self.tree), "PYTHONHASHSEED": "0"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Side:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def names(self) -> list[str]:
        """Name the benchmarks; the first question. Raises RuntimeError if it imported another version's code."""
        greeting = self.answer()
        for file in greeting["modules"]:
            if not Path(file).resolve().is_relative_to(self.tree):
                raise RuntimeError(f"{file} was imported to time the code in {self.tree}")
        names: list[str] = greeting["benchmarks"]
        return names

    def ask(self, question: dict[str, Any]) -> None:
        """Send a question (see tactsim.bench.regression_worker) without waiting for its answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()

    def answer(self) -> dict[str, Any]:
        """Wait for the next answer. Raises InputError if the process has ended instead."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise InputError(f"a benchmark failed with the code in {self.tree}; its traceback is above")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def figures(self, name: str) -> dict[str, float]:
        """Prepare a benchmark and give the figures of its result."""
        self.ask({"prepare": name})
        figures: dict[str, float] = self.answer()["figures"]
        return figures

    def seconds(self, calls: int) -> float:
        """Time so many calls of the benchmark that was prepared last: seconds of processor time."""
        self.ask({"calls": calls})
        return float(self.answer()["seconds"])


@dataclass(frozen=True)
class Measured:
    """What the benchmarks gave: figures of the new code; of those that the base has too, its figures and timings."""

    figures: dict[str, dict[str, float]]
    base_figures: dict[str, dict[str, float]]
    timings: dict[str, Timing]


def measure(
    new: Path,
    base: Path,
    benchmarks: Path,
    *,
    slowed: bool = False,
    progress: Callable[[str, Timing], None] = lambda name, timing: None,
) -> Measured:
    """Run every benchmark with both codes; time what looks slower again, in new processes.

    new, base: roots of the two versions. benchmarks: the file of benchmarks, relative to either. slowed:
    whether the new side does a quarter more calls of each, to see whether that is found. progress(name,
    timing): called after each timing. Raises InputError if a benchmark fails.
    """
    found = Measured({}, {}, {})
    only: list[str] | None = None  # the first time all
    for _ in range(2):
        with Side(new, benchmarks) as new_side, Side(base, benchmarks) as base_side:
            names, in_base = new_side.names(), base_side.names()
            for name in names if only is None else only:
                if name not in in_base:
                    found.figures[name] = new_side.figures(name)
                    continue
                for side in (new_side, base_side):
                    side.ask({"prepare": name})
                prepared = base_side.answer()
                found.figures[name], found.base_figures[name] = (
                    new_side.answer()["figures"],
                    prepared["figures"],
                )
                calls = max(1, math.ceil(SHORTEST / PORTIONS / max(prepared["seconds"], 1e-6)))
                timing = decide(partial(_round, new_side, base_side, calls, slowed), len(names))
                found.timings[name] = timing
                progress(name, timing)
        only = [name for name, timing in found.timings.items() if timing.slower]
        if not only:
            break
    return found


def _round(new: Side, base: Side, calls: int, slowed: bool) -> float:
    """Measure one round: time of the new code over the base's. calls: of a side in a portion."""
    extra = round((SLOWER - 1) * PORTIONS * calls) if slowed else 0
    new_time = base_time = 0.0
    for portion in range(PORTIONS):
        more = extra if portion == 0 else 0
        if portion in (0, PORTIONS - 1):
            new_time += new.seconds(calls + more)
            base_time += base.seconds(calls)
        else:
            base_time += base.seconds(calls)
            new_time += new.seconds(calls + more)
    return new_time / base_time


def commit_of(root: Path, *, but: Path | None = None) -> str:
    """Name the commit whose files are those below `root`. Raises InputError if they are not exactly.

    but: a file that may differ.
    """
    pathspec = [] if but is None else ["--", ".", f":(exclude){but}"]
    changed = git(root, "status", "--porcelain", *pathspec).decode().split("\n")[0]
    if changed:
        raise InputError(f"{changed[3:]} has changes that are in no commit; commit them first")
    return git(root, "rev-parse", "HEAD").decode().strip()


def tree_of(commit: str, root: Path, folder: Path) -> Path:
    """Give the files of a commit in a folder below `folder`, unpacked there the first time.

    Raises InputError if the commit is not in the repository of `root`.
    """
    tree = folder / commit
    if not tree.is_dir():
        try:
            archive = git(root, "archive", commit)
        except InputError as error:
            raise InputError(
                f"the baseline's commit {commit[:12]} is not here ({error}); fetch it, or make a new baseline with "
                "`make bench-baseline`"
            ) from error
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder) as made:
            with tarfile.open(fileobj=io.BytesIO(archive)) as files:
                # Python 3.11.3 and older have no filters; the archive is git's own.
                files.extraction_filter = getattr(tarfile, "data_filter", None)
                files.extractall(Path(made, "tree"))
            Path(made, "tree").rename(tree)
    return tree


def git(root: Path, *words: str) -> bytes:
    """Run git in a folder and give what it says. Raises InputError if it fails."""
    try:
        return subprocess.run(["git", "-C", str(root), *words], check=True, capture_output=True).stdout
    except FileNotFoundError as error:
        raise InputError(
            "git is not installed; the code of the baseline's commit is fetched with it"
        ) from error
    except subprocess.CalledProcessError as error:
        raise InputError(error.stderr.decode(errors="replace").strip().splitlines()[-1]) from error
