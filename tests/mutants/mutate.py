"""Mutate the formulas of core, press and estimators; tell which mutants the tests notice (docs/developers/mutants.md).

Run as `make mutants`. All happens in a copy of the working tree. Results are kept in .venv/mutants, so that an
interrupted run goes on; after a change of code or tests it begins anew. Tests of a file are those that import or
mirror it, or else those of its folder.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from cosmic_ray.commands import execute
from cosmic_ray.config import ConfigDict
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkItem, WorkResult
from mutations import mutants_of

from tactsim.bench.score import wilson

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("tactsim/core", "tactsim/press", "estimators")
RESULTS = ROOT / ".venv" / "mutants"
AIM = 0.8


class Tried(NamedTuple):
    """What became of a module's mutants: `possible` is how many there are, `results` those that were tried."""

    module: str
    possible: int
    results: list[WorkResult]

    @property
    def killed(self) -> int:
        """Count the mutants that a test noticed, by failing or by never ending."""
        return sum(result.is_killed for result in self.results)


def main() -> int:
    """Try the mutants that the command line names; 1 if fewer than AIM of them are killed."""
    chosen = _arguments()
    tests = {
        str(path.relative_to(ROOT)): tests_of(path)
        for room in ROOMS
        for path in sorted((ROOT / room).rglob("*.py"))
    }
    if unknown := set(chosen.modules) - set(tests):
        sys.exit(f"{min(unknown)} is no file of {', '.join(ROOMS)}")
    RESULTS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Path(folder) / "tree"
        _copy_tree(copy)
        os.chdir(copy)  # Cosmic Ray takes paths from here
        os.environ |= _environment(Path(folder), copy)
        subprocess.run([sys.executable, "-m", "tactsim.bench.compile_kernels"], check=True)
        done = []
        print(
            "| module | mutants | tried | killed | of these timed out | survived | share | 95 % |\n|"
            + "---|" * 8
        )
        content = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(copy.rglob("*.py"))))
        for module in chosen.modules or tests:
            if mutants := mutants_of(Path(module)):
                session = RESULTS / f"{module.replace('/', '.')}-{content.hexdigest()[:12]}.sqlite"
                done.append(_try_module(module, mutants, tests[module], chosen, session))
                print(_row(done[-1]), flush=True)
    if not done:
        sys.exit("nothing to mutate there")
    total = Tried("all", sum(one.possible for one in done), [r for one in done for r in one.results])
    print(_row(total), end="\n\n")
    for one in done:
        for result in one.results:
            if not result.is_killed:
                print(_changed(one.module, result))
    return int(total.killed < AIM * len(total.results))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="mutate.py", description=__doc__)
    parser.add_argument("modules", nargs="*", help="such as tactsim/press/clip.py; all if none is named")
    parser.add_argument("--sample", type=int, default=25, help="mutants drawn from each module (25)")
    parser.add_argument("--all", action="store_true", help="try every mutant instead of a sample: many hours")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (0)")
    return parser.parse_args()


def _copy_tree(target: Path) -> None:
    """Copy what Git tracks or would track, links as links: those in tactsim/ then lead to the copied rooms."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        source = ROOT / name
        if source.is_file() or source.is_symlink():  # Git also names what was removed and not yet committed
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target / name, follow_symlinks=False)


def _environment(folder: Path, copy: Path) -> dict[str, str]:
    """Let tests import the copy and keep nothing outside the temporary folder."""
    return {
        "PYTHONPATH": os.pathsep.join([str(copy), str(copy / "tests" / "mutants")]),
        "NUMBA_CACHE_DIR": str(folder / "numba"),
        "TACTSIM_CACHE_DIR": str(folder / "readings"),
        "OPENBLAS_NUM_THREADS": "1",
    }


def tests_of(path: Path) -> list[str]:
    """List the test files that import a file of the code or mirror it, or, if none does, those of its folder."""
    name = ".".join(["tactsim", *path.relative_to(ROOT).with_suffix("").parts]).replace(
        "tactsim.tactsim", "tactsim"
    )
    room, _, stem = name.removesuffix(".__init__").rpartition(".")
    imported = re.compile(rf"{re.escape(room)}\.{stem}\b|from {re.escape(room)} import .*\b{stem}\b")
    folder = "/".join(["tests", *name.split(".")[1:-1]])
    tests = {
        str(test.relative_to(ROOT)): test.read_text("utf-8") for test in (ROOT / "tests").rglob("test_*.py")
    }
    near = [
        test for test, text in tests.items() if test == f"{folder}/test_{stem}.py" or imported.search(text)
    ]
    return sorted(near or [test for test in tests if test.startswith(f"{folder}/")])


def _try_module(
    module: str, mutants: list[WorkItem], tests: list[str], chosen: argparse.Namespace, session: Path
) -> Tried:
    """Try a sample of a module's mutants, or all, but for those whose result is known."""
    random.Random(f"{chosen.seed} {module}").shuffle(mutants)  # a larger sample holds the smaller one
    wanted = mutants if chosen.all else mutants[: chosen.sample]
    with use_db(session, WorkDB.Mode.create) as work:
        results = dict(work.results)
        # Of an interrupted run, what is neither known nor wanted must not be tried either.
        known = [item for item in work.work_items if item.job_id in results]
        missing = [item for item in wanted if item.job_id not in results]
        if missing:
            kept = [(item, results[item.job_id]) for item in known]
            work.clear()
            work.add_work_items([*(item for item, _ in kept), *missing])
            for item, result in kept:
                work.set_result(item.job_id, result)
            execute(work, _settings(tests))
        results = dict(work.results)
    made = (
        results[item.job_id] for item in wanted
    )  # but for what Cosmic Ray cannot write, such as `except a.b`
    return Tried(module, len(mutants), [one for one in made if one.test_outcome != TestOutcome.INCOMPETENT])


def _settings(tests: list[str]) -> ConfigDict:
    """Configure Cosmic Ray, after the tests have passed without a mutation."""
    command = f"{sys.executable} -m pytest -q -x -p no:cacheprovider -p no:xdist -p same_examples "
    command += " ".join(tests)
    begin = time.monotonic()
    run = subprocess.run(shlex.split(command), capture_output=True, text=True)
    seconds = time.monotonic() - begin
    if run.returncode:
        sys.exit(f"the tests fail without a mutation:\n{run.stdout}{run.stderr}")
    return ConfigDict(
        {
            "test-command": command,
            "timeout": 20 + 3 * seconds,
            "distributor": ConfigDict({"name": "local"}),
        }
    )


def _row(one: Tried) -> str:
    count = len(one.results)
    low, high = wilson(one.killed, count)
    interval = f"{100 * low:.0f} to {100 * high:.0f} %" if count < one.possible else "all tried"
    late = sum(result.output == "timeout" for result in one.results)
    return (
        f"| {one.module} | {one.possible} | {count} | {one.killed} | {late} | {count - one.killed} "
        f"| {100 * one.killed / count:.0f} % | {interval} |"
    )


def _changed(module: str, result: WorkResult) -> str:
    """Show what a surviving mutant changes: the line's number, and the lines before and after."""
    lines = (result.diff or "").splitlines()
    place = next((line.split()[1].split(",")[0] for line in lines if line.startswith("@@")), "")
    changed = [line for line in lines if line[:1] in "+-" and line[:3] not in ("---", "+++")]
    return f"{module} after line {place.lstrip('-')}\n  " + "\n  ".join(changed)


if __name__ == "__main__":
    sys.exit(main())
