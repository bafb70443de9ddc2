"""The face for Python: `tactsim.scan` and `tactsim.run`, with the options of the command line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel

from tactsim.bench import kinds
from tactsim.bench.config import RunConfig, ScanWords, any_config, scan_options
from tactsim.bench.experiment import perform, silent
from tactsim.bench.results import Run
from tactsim.bench.tasks import task
from tactsim.bench.trials import Progress
from tactsim.core import InputError, Scan
from tactsim.core.errors import short
from tactsim.core.making import train_on
from tactsim.estimators import Estimator
from tactsim.press import scan_letters

if TYPE_CHECKING:
    from tactsim.bench.compare import Difference
    from tactsim.bench.leaderboard.bundle import Bundle

Function = TypeVar("Function", bound=Callable[..., Any])


def _spelled_out(model: type[BaseModel]) -> Callable[[Function], Function]:
    """Show the fields of a configuration, with their defaults, in the signature of a function that takes `words`."""

    def spell(function: Function) -> Function:
        stated = inspect.signature(function)
        own = [one for one in stated.parameters.values() if one.kind != inspect.Parameter.VAR_KEYWORD]
        keyword = inspect.Parameter.KEYWORD_ONLY
        words = [
            inspect.Parameter(name, keyword, default=field.default, annotation=field.annotation)
            for name, field in model.model_fields.items()
            if name not in (*stated.parameters, "given")
        ]
        function.__signature__ = stated.replace(parameters=[*own, *words])  # type: ignore[attr-defined]
        return function

    return spell


@_spelled_out(ScanWords)
def scan(
    letters: str | Iterable[str] | None = None,
    *,
    jobs: int = 1,
    cache: bool = True,
    sequence: bool = False,
    progress: bool = False,
    **words: Any,
) -> Scan:
    """Press letters at 192 poses, twice (training and test), and return the readings.

    letters: such as "AEIOU", "A-Z0-9" or a list of names. words: the options of `bench scan` with underscores:
    shapes, test_poses, world, noise, scan_set (a table) and seed. jobs: processes; the readings do not depend
    on their number. cache: whether readings may be read from the cache and kept there. sequence: whether the
    images of every press on its way to rest are kept, which takes full dynamics. progress: show a bar. A world's
    slip is in no reading: `run` moves the object.

    Raises InputError for a letter, shape or option that does not exist, and if a press does not settle.
    """
    _check_jobs(jobs)
    options = scan_options(letters=letters, **words)
    with _reporting(progress) as report:
        pressing = partial(report, "press")
        return scan_letters(options, jobs=jobs, cache=cache, sequence=sequence, progress=pressing)[0]


@_spelled_out(RunConfig)
def run(
    scan: Scan | str | Path | None = None,
    *,
    train_scan: Scan | str | Path | None = None,
    estimator: str | Estimator | None = None,
    jobs: int = 1,
    cache: bool = True,
    progress: bool = False,
    **words: Any,
) -> Run:
    """Fit an estimator, let it recognise letters in random places, score every reading, and return the run.

    scan: a Scan, or the file that holds one; without it letters are pressed. train_scan: the same, to train on instead
    of the scan's own training readings; a Scan only if `scan` is a Scan, too. estimator: a registered name, or
    an `Estimator` of your own, made with its options; None: that of `bench run`. words: the options of `bench run` with
    underscores: bins, particles, set (a table), letters, hold_out, trials, readings, explore, slip, seed, presses, and,
    if no scan is given, shapes, test_poses, world, noise and scan_set; or a task, which says all but the estimator's
    own; with task="solids" the options for objects in space: objects, touches and hand.
    jobs: processes; the trials do not depend on their number. With more than one a script calls this under
    `if __name__ == "__main__":`, since worker processes import it. cache: whether readings may be read from the cache
    and kept there. progress: show bars.

    `tactsim.run(**run.config)` does a run again; one on readings that were given asks for them, as `scan`.

    Raises InputError for a wrong option or value, and, with more than one job, for an estimator that cannot be
    sent to worker processes.
    """
    _check_jobs(jobs)
    if not isinstance(estimator, str | Estimator | None):
        raise InputError(
            f"estimator is {short(estimator)}; give a registered name or an Estimator, made with its options"
        )
    for name, readings in (("scan", scan), ("train_scan", train_scan)):
        if not isinstance(readings, Scan | str | Path | None):
            raise InputError(f"{name} is {short(readings)}; give a Scan, or the path of its file")
        if isinstance(readings, Scan) and readings.kind != kinds.PLANE:
            raise InputError(
                f"the scan is of {readings.kind}; save it, and give its file as scan, and task={readings.kind!r}"
            )
    given = scan if isinstance(scan, Scan) else None
    if isinstance(train_scan, Scan):
        if given is None:
            raise InputError(
                "train_scan is a Scan, so scan has to be one, too; or give the file that train_scan was saved to"
            )
        given = train_on(train_scan, given)
    elif train_scan is not None:
        words["train_scan"] = train_scan
    digest = words.pop("given", None)
    if digest is not None and (given is None or given.digest != digest):
        raise InputError("the run was on readings that were given in Python; give the same again, as `scan`")
    if given is not None:
        words["given"] = given.digest
    elif scan is not None:
        words["scan"] = scan
    own = estimator if isinstance(estimator, Estimator) else None
    if isinstance(estimator, str):
        words["estimator"] = estimator
    elif own is not None and not own.proposes and (asked := words.get("task")) not in (None, *kinds.names()):
        # As a task does for an estimator that is named.
        words |= {"explore": "blind", **words} if task(str(asked)).chosen else {}
    config = any_config(**words)
    with _reporting(progress) as report:
        return perform(config, scan=given, estimator=own, jobs=jobs, cache=cache, progress=report)


def sweep(
    source: str | Path, out: str | Path, *, jobs: int = 1, cache: bool = True, progress: bool = False
) -> list[Run]:
    """Do the runs of a suite or of a sweep's file that the folder `out` does not hold yet; returns all of them.

    source: a suite's name, such as "paper", or the path of a TOML file. jobs: processes; with more than one a script
    calls this under `if __name__ == "__main__":`. Raises InputError as `bench sweep` does.
    """
    from tactsim.bench import sweep as sweeps
    from tactsim.bench.runs.saved import load

    _check_jobs(jobs)
    _, configs = sweeps.read(str(source))
    with _reporting(progress) as report:
        places = sweeps.perform(configs, Path(out), jobs=jobs, cache=cache, progress=report)
    return list(map(load, places))


def compare(base: Run | str | Path, new: Run | str | Path) -> list[Difference]:
    """Compare two runs, or the folders that hold them, trial by trial, each figure with its interval.

    Raises InputError if they do not have the same trials.
    """
    from tactsim.bench import compare as comparing

    before, after = (one if isinstance(one, Run) else Run.load(one) for one in (base, new))
    return comparing.compare(before, after)


def submit(
    task: str | Path,
    estimator: str,
    out: str | Path,
    *,
    title: str | None = None,
    reproducible: bool = True,
    jobs: int = 1,
    cache: bool = True,
    progress: bool = False,
    **options: Any,
) -> Bundle:
    """Do all runs of a frozen task with a registered estimator and its options, and write the bundle to the file `out`.

    Returns the bundle; `bundle.status` says how it ended. Raises InputError as `bench submit` does.
    """
    from tactsim.bench.leaderboard import bundle as bundles
    from tactsim.bench.leaderboard.submit import Method
    from tactsim.bench.leaderboard.submit import submit as submitted
    from tactsim.bench.places import check_new_file

    _check_jobs(jobs)
    check_new_file(Path(out), Path(task), suffix=bundles.SUFFIX)
    with _reporting(progress) as report:
        bundle, _ = submitted(
            str(task), Method(estimator, options), title=title, reproducible=reproducible, jobs=jobs, cache=cache,
            progress=report,
        )  # fmt: skip
    bundles.write_bundle(bundle, Path(out))
    return bundle


def _check_jobs(jobs: int) -> None:
    if not isinstance(jobs, int) or isinstance(jobs, bool) or jobs < 1:
        raise InputError(f"jobs is {short(jobs)}; give a number of processes, 1 or more")


@contextmanager
def _reporting(wanted: bool) -> Iterator[Progress]:
    if not wanted:
        yield silent
        return
    from tactsim.bench.terminal import progress_bars

    with progress_bars() as report:
        yield report
