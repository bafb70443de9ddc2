"""Do the runs that a task asks of a method, and put them into a bundle."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tactsim.bench import experiment
from tactsim.bench.leaderboard.bundle import DONE, Bundle, kept
from tactsim.bench.leaderboard.limited import Limits, NoScore, Wanted, limited_runs
from tactsim.bench.machine import machine, versions
from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import pool
from tactsim.bench.tasks import Task, task
from tactsim.bench.tasks.data import check_data
from tactsim.bench.trials import Progress, source_of_trials
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.errors import short, unknown
from tactsim.core.plug_ins import plug_ins
from tactsim.core.source_digest import git_commit, source_digest
from tactsim.estimators import create, names
from tactsim.estimators.registry import BUILT_IN, GROUP


@dataclass(frozen=True)
class Method:
    """What is tried: an estimator's registered name and its options."""

    estimator: str
    options: Mapping[str, Any]

    @property
    def plug_in(self) -> bool:
        """Tell whether it comes from an installed package; it is then imported in its own process only."""
        return self.estimator not in BUILT_IN


def submit(
    task_name: str,
    method: Method,
    *,
    title: str | None = None,
    reproducible: bool = True,
    jobs: int = 1,
    cache: bool = True,
    limits: Limits | None = None,
    progress: Progress = experiment.silent,
) -> tuple[Bundle, str]:
    """Do all runs of a task, one a seed, in a process of their own; a method that fails gets a status, and no score.

    task_name: of a frozen task, or a FILE.toml of one's own. title: how tables call the method; by default its name and
    options. reproducible: whether the same seeds give the same bits. Returns the bundle, and the last that the method
    printed if it failed.

    Raises InputError for an unknown task, estimator or option, and if this machine presses other data than the task's.
    """
    asked, hashes = stated(task_name)
    if title is not None and not (title.isprintable() and 0 < len(title) <= 200):
        raise InputError(f"title {short(title)}: give 1 to 200 printable characters")
    if method.estimator not in names():
        raise unknown("estimator", method.estimator, names())
    if not method.plug_in:
        create(method.estimator, **method.options)  # a wrong option is reported before the work
    check_data(asked, jobs=jobs, cache=cache, progress=_of("press", progress))
    words = {"estimator": method.estimator, "set": dict(method.options), "task": asked.name, "bound": True}
    wanted = [Wanted({**words, "seed": seed}) for seed in asked.seeds]
    status, output, runs = DONE, "", list[Run]()
    try:
        runs = limited_runs(wanted, jobs=jobs, cache=cache, limits=limits, progress=progress)
    except NoScore as error:
        status, output = error.status, error.output
    bundled = kept(runs)
    options = [method.estimator, *(f"{name} {value}" for name, value in method.options.items())]
    said = {
        "task": Path(asked.name).name,
        "task_data": hashes,
        "method": title or (pool(bundled)[0].label if runs else ", ".join(options)),
        "estimator": method.estimator,
        "options": runs[0].about["settings"] if runs else dict(method.options),
        "reproducible": reproducible,
        "status": status,
        "versions": versions(),
        "source_hash": source_of(method),
        "machine": machine(),
        "commit": git_commit(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "package": package_of(method),
        "runs": bundled,
    }
    return checked(Bundle, said, "bundle"), output


def stated(task_name: str) -> tuple[Task, str]:
    """Give a task and the hash of its data. Raises InputError for an unknown task, and for one that states none."""
    asked = task(task_name)
    if asked.data is None:
        raise InputError(
            f"task {asked.name} states no hashes of its data, so nobody could check a result; "
            "`bench tasks FILE --check` prints them"
        )
    return asked, asked.data


def source_of(method: Method) -> str:
    """Hash the source code that trials of a method depend on.

    Of a plug-in these are tactsim's and all files of the plug-in's own package, such as weights.
    """
    if not method.plug_in:
        return source_of_trials(method.estimator)
    (module, *_) = [point.module for point in plug_ins(GROUP) if point.name == method.estimator]
    content = hashlib.sha256(source_digest(module).encode())
    spec = find_spec(module.partition(".")[0])
    for place in (spec.submodule_search_locations or ()) if spec else ():
        folder = Path(place)
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix not in (".py", ".pyc"):
                with path.open("rb") as stream:
                    found = hashlib.file_digest(stream, "sha256").hexdigest()
                content.update(f"{path.relative_to(folder)} {found}\n".encode())
    return content.hexdigest()


def package_of(method: Method) -> str | None:
    """Name the distribution that a plug-in came in, with its version; None for a built-in estimator."""
    found = [point.dist for point in plug_ins(GROUP) if point.name == method.estimator and method.plug_in]
    return next((f"{dist.name} {dist.version}" for dist in found if dist is not None), None)


def _of(stage: str, progress: Progress) -> Progress:
    """Report one stage only."""
    return lambda at, done, total: progress(at, done, total) if at == stage else None
