"""`bench run`: press, map, recognise and score with one estimator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    from tactsim.bench.run import Run


def command(
    estimator: Annotated[str, typer.Option(help="Which one; `bench list` names them.")] = "refined",
    bins: Annotated[
        int | None,
        typer.Option(
            help="Histogram bins for each letter: 100, 1000, 10000 (Table I) or any count.",
            show_default=False,
        ),
    ] = None,
    particles: Annotated[
        int | None, typer.Option(help="Particles over all letters (n_P).", show_default=False)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="An option of the estimator, key=value; repeat for several.", show_default=False
        ),
    ] = None,
    letters: shared.Letters = None,
    shape: shared.Shape = None,
    hold_out: Annotated[
        str | None,
        typer.Option(
            help="Letters to try without training on them, A,E: right is 'none' (see `--set unknown`).",
            show_default=False,
        ),
    ] = None,
    trials: Annotated[int, typer.Option(help="Trials for each letter.")] = 10,
    readings: Annotated[int, typer.Option(help="Readings a trial, without replacement.")] = 60,
    test_poses: shared.TestPoses = "same",
    explore: Annotated[
        str, typer.Option(help="Order of the readings: random, or information (the estimator proposes).")
    ] = "random",
    world: shared.World = "default",
    noise: shared.Noise = None,
    scan_set: shared.ScanSet = None,
    seed: shared.Seed = 0,
    jobs: shared.Jobs = 1,
    scan: Annotated[
        Path | None, typer.Option(help="Readings from a file instead of the press.", show_default=False)
    ] = None,
    train_scan: Annotated[
        Path | None,
        typer.Option(
            help="Training readings from another file (train on simulated, test on recorded).",
            show_default=False,
        ),
    ] = None,
    cache: shared.Cache = True,
    out: Annotated[
        Path | None,
        typer.Option(help="A new folder for the results. Default: results/runs/...", show_default=False),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
    ] = False,
) -> None:
    """Press the letters, learn their maps, recognise them in random places and score every reading."""
    from tactsim.bench.config import key_values, run_config
    from tactsim.bench.places import check_new_folder, new_place
    from tactsim.bench.results import to_json
    from tactsim.bench.runner import perform
    from tactsim.bench.terminal import print_run, progress_bars

    config = run_config(
        estimator=estimator,
        bins=bins,
        particles=particles,
        set=key_values(settings or (), "--set"),
        letters=letters,
        hold_out=hold_out,
        shapes=shape or (),
        trials=trials,
        readings=readings,
        test_poses=test_poses,
        explore=explore,
        world=world,
        noise=noise,
        scan_set=key_values(scan_set or (), "--scan-set"),
        seed=seed,
        scan=scan,
        train_scan=train_scan,
    )
    folder = out or new_place(estimator)
    check_new_folder(folder)
    with progress_bars() as progress:
        run = perform(config, jobs=jobs, cache=cache, progress=progress)
    run.save(folder)
    if as_json:
        typer.echo(to_json(public(run) | {"results": str(folder)}), nl=False)
    else:
        print_run(run, folder)


def public(run: Run) -> dict[str, Any]:
    """Put a run into the one flat object that `--json` prints."""
    config, about = run.config, run.about
    asked = ("estimator", "trials", "readings", "seed", "explore", "hold_out")
    found = ("letters", "options", "description", "protocol", "classifier_agreement", "versions", "machine")
    return {
        **run.summary,
        **{name: config[name] for name in asked},
        **{name: about[name] for name in found},
        "seconds": run.times["seconds"],
        "peak_memory_mb": run.times["peak_memory_mb"],
        "work": run.work,
    }
