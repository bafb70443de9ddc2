"""`bench tasks`, `submit`, `verify` and `leaderboard`: frozen questions, and who answers them how well."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import dotted
from tactsim.bench.console import plain_console, plain_grid
from tactsim.bench.places import check_new_file, saved
from tactsim.core.errors import InputError, counted, printable

if TYPE_CHECKING:
    from tactsim.bench.leaderboard import Best
    from tactsim.bench.tasks import Task


def command_tasks(
    name: str | None = typer.Argument(None, metavar="NAME|FILE.toml", help="Only this task, whole."),
    hash_data: bool = typer.Option(
        False,
        "--hash",
        help="Press the data of every seed and compare their hashes with those that the task states; "
        "exit status 1 if one differs.",
    ),
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    as_json: shared.AsJson = False,
) -> None:
    """List the frozen tasks with sizes and the best known results, or show one whole; --hash presses its data."""
    from tactsim.bench import tasks
    from tactsim.bench.leaderboard import best_known
    from tactsim.bench.results import to_json
    from tactsim.bench.tasks import data
    from tactsim.bench.terminal import progress_bars

    if name is None and hash_data:
        raise InputError("--hash: name the task, as in `bench tasks letters-v1 --hash`")
    best = best_known()
    if name is None:
        found = [tasks.task(one) for one in tasks.names()]
        if as_json:
            typer.echo(to_json({"tasks": [_content(one, best.get(one.name)) for one in found]}), nl=False)
        else:
            _print_list(found, best)
        return
    one, hashes = tasks.task(name), None
    if hash_data:
        with progress_bars() as progress:
            hashes = [data.hash_data(one, of, jobs=jobs, cache=cache, progress=progress) for of in one.seeds]
    if as_json:
        pressed = {} if hashes is None else {"pressed": hashes}
        typer.echo(to_json(_content(one, best.get(one.name)) | pressed), nl=False)
    else:
        _print_whole(one, best.get(one.name))
        if hashes is not None:
            _print_hashes(one, hashes)
    if hashes is not None and one.hashes and hashes != list(one.hashes):
        raise typer.Exit(1)


def _content(one: Task, best: Best | None) -> dict[str, Any]:
    more = {"letters": list(one.letters), "data": one.data, "best": best and best.model_dump()}
    return one.model_dump(mode="json") | more


def _print_list(found: list[Task], best: dict[str, Best]) -> None:

    rows = [
        row
        for one in found
        for row in ((one.name, one.line), ("", f"{_size(one)}; best {_best(best.get(one.name))}"))
    ]
    plain_console().print(plain_grid(rows))


def _size(one: Task) -> str:
    letters = f"{counted(len(one.letters), 'object')}, " if one.letters else ""
    readings, seeds = counted(one.readings, "reading"), counted(len(one.seeds), "seed")
    return f"{letters}{counted(one.trials, 'trial')} each, {readings}, {seeds}"


def _best(best: Best | None) -> str:
    if best is None:
        return "not known yet"
    default = "" if best.default is None else f"; the default estimator: {best.default:.4g}"
    return f"{best.figure} {best.value:.4g}: --estimator {best.words} (commit {best.commit[:12]}){default}"


def _print_whole(one: Task, best: Best | None) -> None:

    held_out = one.held_out
    rows = [
        (one.name, one.line),
        ("size", _size(one)),
        ("letters", " ".join(one.letters) or "those of the file"),
        *([("held out", " ".join(held_out))] if held_out else []),
        ("seeds", " ".join(map(str, one.seeds))),
        *([("to develop on", " ".join(map(str, one.development)))] if one.development else []),
        ("options", "\n".join(dotted(one.words))),
        ("scored by", ", ".join(one.scored)),
        ("best", _best(best)),
        ("data", one.data or "not stated"),
    ]
    plain_console().print(plain_grid(rows))


def _print_hashes(one: Task, hashes: list[str]) -> None:
    """Print the hashes as a task's file has them; those that are not as it states are marked."""
    console = plain_console()
    console.print("hashes = [", markup=False)
    differ = 0
    for found, stated in zip(hashes, one.hashes or hashes, strict=True):
        other = "" if found == stated else f"  # the task states {stated}"
        differ += found != stated
        console.print(f'  "{found}",{other}', markup=False, soft_wrap=True)
    console.print("]", markup=False)
    if one.hashes:
        said = f"{differ} of {len(hashes)} differ from what the task states"
        console.print(said if differ else "as the task states")


def command_submit(
    task: str = typer.Argument(..., metavar="TASK", help="A frozen task; `bench tasks` names them all."),
    estimator: str = typer.Option(..., help="The estimator; `bench list` names them all."),
    out: Path = typer.Option(..., help="The bundle, a file that is to be written."),
    options: list[str] | None = typer.Option(
        None, "--set", help="An option of the estimator, key=value; repeat for several."
    ),
    title: str | None = typer.Option(None, help="How tables call the method. Default: its name and options."),
    reproducible: bool = typer.Option(
        True,
        "--reproducible/--not-reproducible",
        help="Whether the same seeds give the same answers to the bit.",
    ),
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    as_json: shared.AsJson = False,
) -> None:
    """Do all runs of a task with a method, and write one file that others can check; exit status 1 without a score."""
    from tactsim.bench.config import key_values
    from tactsim.bench.leaderboard.bundle import DONE, SUFFIX, figures_of, write_bundle
    from tactsim.bench.leaderboard.submit import Method, submit
    from tactsim.bench.results import to_json
    from tactsim.bench.runs.pooled import cell
    from tactsim.bench.tasks import task as read_task
    from tactsim.bench.terminal import progress_bars

    check_new_file(out, Path(task), suffix=SUFFIX)
    method = Method(estimator, key_values(options or [], "--set"))
    with progress_bars() as progress:
        bundle, output = submit(
            task, method, title=title, reproducible=reproducible, jobs=jobs, cache=cache, progress=progress
        )
    done = bundle.status == DONE
    scored = figures_of(bundle, read_task(task).scored) if done else {}

    def save() -> Path:
        write_bundle(bundle, out)
        return out

    with saved(save) as place:
        if output:
            plain_console(stderr=True).print(output)
        if as_json:
            said = {"task": bundle.task, "method": bundle.method, "status": bundle.status, "figures": scored}
            typer.echo(to_json(said | {"bundle": place and str(place)}), nl=False)
        else:
            console = plain_console()
            console.print(f"{bundle.method} on {bundle.task}", style="bold")
            for figure in scored:
                console.print(f"{figure}  {cell(bundle.pooled, figure)}")
            console.print(f"status  {bundle.status}")
            if place is not None:
                console.print(f"bundle  {place}")
    if not done:
        raise typer.Exit(1)


def command_verify(
    bundle: Path = typer.Argument(..., metavar="BUNDLE", help="A file that `bench submit` wrote."),
    full: bool = typer.Option(False, "--full", help="Do all trials again."),
    share: float = shared.number(
        "The share of the trials that is done again, at least 20 trials.", default=0.05, least=0, most=1
    ),
    seed: int | None = typer.Option(
        None, min=0, help="Seed of which trials are done again. Default: a new one each time."
    ),
    fresh: bool = typer.Option(
        False, "--fresh", help="Also do one more run, with a seed that nobody could have prepared for."
    ),
    record: bool = typer.Option(
        False, "--record", help="Write what was found beside the bundle, for `bench leaderboard`."
    ),
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
) -> None:
    """Do some trials of a bundle again and compare them; exit status 1 if it cannot be confirmed."""
    import secrets
    from dataclasses import asdict
    from datetime import UTC, datetime

    import numpy as np

    from tactsim.bench.leaderboard.bundle import Record, bundle_hash, read_bundle, write_record
    from tactsim.bench.leaderboard.verify import verify
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.source_digest import git_commit

    read = read_bundle(bundle)
    chosen = secrets.randbelow(2**32) if seed is None else seed
    try:
        with progress_bars() as progress:
            asked: dict[str, Any] = {
                "share": share,
                "full": full,
                "fresh": fresh,
                "jobs": jobs,
                "cache": cache,
            }
            verdict = verify(read, rng=np.random.default_rng(chosen), progress=progress, **asked)
    except InputError as error:
        raise InputError(f"bundle {bundle}: {error}") from error

    def save() -> Path:
        found = {name: of for name, of in asdict(verdict).items() if name in Record.model_fields}
        found |= {"said": printable(verdict.said), "seed": None if full else chosen, "commit": git_commit()}
        made = datetime.now(UTC).isoformat(timespec="seconds")
        return write_record(Record(bundle=bundle_hash(bundle), made=made, **found), bundle)

    # What other code does not confirm is not refuted.
    counts = verdict.verified or not verdict.other_code
    with saved(save if record and counts else None) as place:
        console = plain_console()
        console.print(f"{read.method} on {read.task}", style="bold")
        for note in verdict.notes:
            console.print(f"note      {note}")
        if verdict.again:
            again = f"{verdict.again} of {verdict.trials} trials"
            console.print(f"again     {again}" + ("" if full else f", chosen with --seed {chosen}"))
        console.print(f"{'verified' if verdict.verified else 'NOT VERIFIED'}  {verdict.said}")
        if place is not None:
            console.print(f"record    {place}")
    if not verdict.verified:
        raise typer.Exit(1)


def command_leaderboard(
    folder: Path = typer.Argument(..., metavar="FOLDER", help="The folder of bundles (*.tar.xz)."),
    out: Path | None = typer.Option(
        None,
        metavar="SITE",
        help="The site's folder; a site that stands there is replaced. Default: site in FOLDER.",
    ),
) -> None:
    """Rank the methods of a folder of bundles, task by task, and write a page of them."""
    from tactsim.bench.cli.app import FAILED
    from tactsim.bench.leaderboard.site import check_out, write_site
    from tactsim.bench.leaderboard.standings import read_folder
    from tactsim.bench.terminal import progress_bars

    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; name one of bundles")
    target = out or folder / "site"
    check_out(target)
    with progress_bars() as progress:
        found = read_folder(folder, progress=progress)
    write_site(found, target)
    typer.echo(printable(f"site  {target / 'index.html'}"))
    for path, why in found.unreadable:
        typer.echo(printable(f"unreadable  {path.name}: {why}"), err=True)
    if found.unreadable:
        raise typer.Exit(FAILED)
