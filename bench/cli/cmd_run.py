"""`bench run`: press, map, recognise and score with one estimator; with --port, on a real pad."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tactsim.bench import kinds
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import Words, is_typed, refuse_typed, with_options_of
from tactsim.bench.config import RunConfig, any_config, run_config
from tactsim.bench.console import kept_clear, plain_console
from tactsim.bench.places import results_folder, save_beside, saved
from tactsim.core.errors import InputError, counted

if TYPE_CHECKING:
    from rich.console import Console

# A person presses: fewer trials and readings than of a simulation.
_BY_HAND: dict[str, Any] = {"trials": 2, "readings": 10}


@with_options_of(RunConfig)
def command_run(
    words: Words,
    context: typer.Context,
    objects: shared.Objects = None,
    touches: shared.Touches = None,
    hand: shared.Hand = None,
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    out: Path | None = typer.Option(None, help="A new folder for the results. Default: results/runs/..."),
    verbose: bool = typer.Option(
        False,
        "--verbose",
        "-v",
        help="Print more readings, how sure the estimator was, times and counts of work.",
    ),
    as_json: shared.AsJson = False,
    port: list[str] | None = typer.Option(
        None,
        help="Measure the trials on the pad there, led press by press: --trials (2) of each letter, --readings "
        "(10) presses each, kept in --presses. simulated:hand shows it without a pad. Needs --train-scan.",
        rich_help_panel=shared.PAD_PANEL,
    ),
    calibration: Path | None = typer.Option(
        None, help="Calibration file of `bench tare`.", rich_help_panel=shared.PAD_PANEL
    ),
    frames: shared.Frames = 20,
    force: shared.Force = "0.3:20",
    patience: shared.Patience = None,
    seen: shared.Seen = "behind",
) -> None:
    """Press the letters, learn their maps, recognise them in random places and score every reading."""
    from tactsim.bench.experiment import perform
    from tactsim.bench.results import to_json
    from tactsim.bench.terminal import print_places, print_run, progress_bars

    if port is None:
        names = ("calibration", "frames", "force", "patience", "seen")
        refuse_typed(context, names, "is for a pad; say where that is with --port, or leave it out")
    elif other := next((name for name in ("task", "scan") if name in words), None):
        raise InputError(f"--port: a {other} has readings of its own; leave out --port or --{other}")
    # A task says the others
    words = {name: value for name, value in words.items() if is_typed(context, name)}
    others = {"objects": objects, "touches": touches, "hand": hand}
    known = kinds.of_task(words.get("task")).config.model_fields
    refuse_typed(context, [name for name in others if name not in known], shared.OUTSIDE)
    words |= {name: value for name, value in others.items() if value is not None}
    device = "emulated" if port is None else words.pop("pad", "emulated")
    if port is not None or "presses" in words:
        words = {**_BY_HAND, **words}
    config = any_config(**words)
    if "task" in words and config.task is None:
        look = f"a look at task {words['task']} and no result on it"
        why = "fewer trials or readings than it has, or a seed for development"
        plain_console(stderr=True).print(f"{look}: {why}")
    folder = results_folder(out, config.estimator)
    if port is not None:
        from tactsim.bench.cli import pad_options as pads
        from tactsim.bench.pad.guided import Station

        assert isinstance(config, RunConfig)  # a task has readings of its own
        if config.presses is None:
            config = run_config(**words, presses=folder.with_name(f"{folder.name}.presses"))
        described, correction = pads.load(device, calibration)
        settings = pads.plan_settings(port, described, correction, frames, force, patience)
        station = Station(port, described, correction, seen == "behind", plain_console(stderr=as_json))
        if not pads.measured(config, station, settings):
            return
    if config.shapes and isinstance(config, RunConfig):
        _print_shapes(config, plain_console(stderr=True))
    with kept_clear(as_json), progress_bars() as progress:
        run = perform(config, jobs=jobs, cache=cache, progress=progress)
    with saved(lambda: save_beside(run.save, folder)) as place:
        if as_json:
            typer.echo(to_json(run.as_json() | {"results": place and str(place)}), nl=False)
            return
        print_run(run, verbose)
        if place is not None:
            print_places(run, place)
        if port is not None:
            again = "`bench run --presses` tries other estimators on them"
            plain_console().print(f"presses  {run.config['presses']}; {again}")


def _print_shapes(config: RunConfig, console: Console) -> None:
    """Draw the user's own shapes as read, before they are pressed: a wrong unit or a lost hole shows at once."""
    import numpy as np

    from tactsim import models
    from tactsim.press.clip import covers

    for letter in (models.shape(path, rounding=config.scan_options.rounding) for path in config.shapes):
        left, low, right, high = letter.footprint.bounds()
        size = f"{right - left:.1f} x {high - low:.1f} mm, {letter.area:.0f} mm^2"
        console.print(f"{letter.name} as read: {size}, {counted(len(letter.contours), 'outline')}")
        cell = max(right - left, high - low) / 32  # mm; a character is twice as high as wide
        x = np.arange(left + cell / 2, right, cell)
        rows = max(1, round((high - low) / (2 * cell)))
        y = high - (np.arange(rows) + 0.5) * (high - low) / rows
        inside = covers(letter.contours, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
        for row in inside.reshape(len(y), len(x)):
            console.print("  " + "".join("#" if here else " " for here in row).rstrip(), markup=False)
