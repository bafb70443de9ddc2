"""`bench tasks`: list the frozen tasks, show one whole, and hash the data that this machine presses for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import dotted
from tactsim.core.errors import InputError, counted

if TYPE_CHECKING:
    from tactsim.bench.leaderboard.best_known import Best
    from tactsim.bench.tasks import Task


def command(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME|FILE.toml", help="Only this task, whole.")
    ] = None,
    hash_data: Annotated[
        bool,
        typer.Option(
            "--hash",
            help="Press the data of every seed and compare their hashes with those that the task states; "
            "exit status 1 if one differs.",
        ),
    ] = False,
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    as_json: shared.AsJson = False,
) -> None:
    """List the frozen tasks with sizes and the best known results, or show one whole; --hash presses its data."""
    from tactsim.bench import tasks
    from tactsim.bench.leaderboard.best_known import best_known
    from tactsim.bench.results import to_json

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
    one = tasks.task(name)
    hashes = _hashes(one, jobs, cache) if hash_data else None
    if as_json:
        pressed = {} if hashes is None else {"pressed": hashes}
        typer.echo(to_json(_content(one, best.get(one.name)) | pressed), nl=False)
    else:
        _print_whole(one, best.get(one.name))
        if hashes is not None:
            _print_hashes(one, hashes)
    if hashes is not None and one.hashes and hashes != list(one.hashes):
        raise typer.Exit(1)


def _hashes(one: Task, jobs: int, cache: bool) -> list[str]:
    from tactsim.bench.tasks.data import hash_data
    from tactsim.bench.terminal import progress_bars

    with progress_bars() as progress:
        return [hash_data(one, seed, jobs=jobs, cache=cache, progress=progress) for seed in one.seeds]


def _content(one: Task, best: Best | None) -> dict[str, Any]:
    content = one.model_dump(mode="json")
    return content | {
        "letters": list(one.letters),
        "data": one.data,
        "best": None if best is None else best.model_dump(),
    }


def _print_list(found: list[Task], best: dict[str, Best]) -> None:
    from tactsim.bench.console import plain_console, plain_grid

    rows = [
        row
        for one in found
        for row in ((one.name, one.line), ("", f"{_size(one)}; best {_best(best.get(one.name))}"))
    ]
    plain_console().print(plain_grid(rows))


def _size(one: Task) -> str:
    letters = f"{counted(len(one.letters), 'letter')}, " if one.letters else ""
    readings, seeds = counted(one.readings, "reading"), counted(len(one.seeds), "seed")
    return f"{letters}{counted(one.trials, 'trial')} each, {readings}, {seeds}"


def _best(best: Best | None) -> str:
    if best is None:
        return "not known yet"
    default = "" if best.default is None else f"; the default estimator: {best.default:.4g}"
    return f"{best.figure} {best.value:.4g}: --estimator {best.words} (commit {best.commit[:12]}){default}"


def _print_whole(one: Task, best: Best | None) -> None:
    from tactsim.bench.console import plain_console, plain_grid

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
    from tactsim.bench.console import plain_console

    console = plain_console()
    console.print("hashes = [", markup=False)
    for number, found in enumerate(hashes):
        other = (
            f"  # the task states {one.hashes[number]}" if one.hashes and one.hashes[number] != found else ""
        )
        console.print(f'  "{found}",{other}', markup=False, soft_wrap=True)
    console.print("]", markup=False)
    if one.hashes:
        differ = sum(found != stated for found, stated in zip(hashes, one.hashes, strict=True))
        console.print(
            f"{differ} of {len(hashes)} differ from what the task states" if differ else "as the task states"
        )
