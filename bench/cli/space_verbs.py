"""`--task solids` of `bench run` and `bench scan`: their options for objects in space, and what they then do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli.words import Words

TASK = "solids"  # the task whose objects are in space
PANEL = "Objects in space (--task solids)"

Objects = Annotated[
    str | None,
    typer.Option(
        help="Which objects: bolt,nut,key, or 30 for the first thirty (of 50), or none beside shapes. Default: 12.",
        rich_help_panel=PANEL,
        show_default=False,
    ),
]
Touches = Annotated[
    int | None, typer.Option(help="Touches a trial (20).", rich_help_panel=PANEL, show_default=False)
]
Hand = Annotated[
    Path | None,
    typer.Option(
        help="Several pads that touch at once: gripper, or a hand file (.toml).",
        rich_help_panel=PANEL,
        show_default=False,
    ),
]


OUTSIDE = (
    "is for objects in space; add --task solids, or leave it out"  # of an option, where the task is another
)


def run_in_space(words: Words, *, jobs: int, out: Path | None, as_json: bool) -> None:
    """Do `bench run --task solids` with the words that were typed."""
    from tactsim.bench.console import kept_clear
    from tactsim.bench.places import results_folder, save_beside, try_to_save
    from tactsim.bench.results import to_json
    from tactsim.bench.space.space_config import SpaceConfig, space_config, space_words
    from tactsim.bench.space.space_runner import perform_in_space
    from tactsim.bench.space.space_terminal import print_space_run
    from tactsim.bench.terminal import progress_bars

    config = space_config(**space_words(words, SpaceConfig, "run"))
    with results_folder(out, config.estimator) as folder:
        with kept_clear(as_json), progress_bars() as progress:
            run = perform_in_space(config, jobs=jobs, progress=progress)

        saved, failure = try_to_save(lambda: save_beside(run.save, folder))
        if as_json:
            typer.echo(to_json(run.as_json() | {"results": saved and str(saved)}), nl=False)
        else:
            print_space_run(run)
            if saved is not None:
                typer.echo(f"results  {saved}\npicture  {saved / 'touches.png'}")
        if failure is not None:
            raise failure


def scan_in_space(words: Words, *, out: Path) -> None:
    """Do `bench scan --task solids` with the words that were typed."""
    from tactsim.bench.places import check_new_file
    from tactsim.bench.space.space_config import SpaceWords, scan_words, space_words
    from tactsim.bench.terminal import progress_bars, work_line
    from tactsim.press.space import scan_solids

    check_new_file(out, suffix=".npz")
    options = scan_words(**space_words(words, SpaceWords, "scan")).scan_options
    with progress_bars() as progress:
        scan, work = scan_solids(options, progress=lambda done, total: progress("press", done, total))
    scan.save(out)
    typer.echo(
        f"{len(scan):,} touches of {' '.join(scan.objects)}, {scan.readings.shape[1]} taxels, in {out}\n"
        f"work  {work_line(work)}"
    )
