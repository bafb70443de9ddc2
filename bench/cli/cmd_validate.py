"""`bench validate`: measure how far the simulation is from a recorded pad, and fit its options to that."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared


def command(
    simulated: Annotated[Path, typer.Option(help="A scan of `bench scan`.")],
    recorded: Annotated[
        Path, typer.Option(help="A scan of `bench record`, `bench replay --scan` or `bench import`.")
    ],
    estimator: Annotated[
        list[str] | None,
        typer.Option(help="An estimator that recognises; may be repeated. [default: refined, histogram]"),
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="An option of the estimators, key=value.")
    ] = None,
    trials: Annotated[int, typer.Option(min=1, help="Trials for each letter.")] = 10,
    out: Annotated[
        Path | None,
        typer.Option(
            help="A new folder for validation.json, presses.png and world.toml, for `bench scan --world`."
        ),
    ] = None,
    seed: shared.Seed = 0,
    as_json: shared.AsJson = False,
) -> None:
    """Compare a simulated with a recorded scan: readings, sensor parameters, recognition."""
    import json
    from functools import partial

    import tomli_w

    from tactsim.bench.cli.validation_report import show
    from tactsim.bench.config import key_values
    from tactsim.bench.console import kept_clear
    from tactsim.bench.pad import validation
    from tactsim.bench.pad.validation_picture import presses_figure
    from tactsim.bench.placement import load_scan
    from tactsim.bench.places import check_new_folder, save_beside, saved
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.files import new_folder

    if out is not None:
        check_new_folder(out)
    with kept_clear(as_json), progress_bars() as progress:
        result = validation.validate(
            load_scan(simulated), load_scan(recorded), estimators=estimator or ("refined", "histogram"),
            options=key_values(settings or (), "--set"), trials=trials, seed=seed, progress=progress,
        )  # fmt: skip
    answer = validation.as_json(result)

    def save(wanted: Path) -> Path:
        with new_folder(wanted) as folder:
            (folder / "validation.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
            (folder / "presses.png").write_bytes(presses_figure(result).png())
            (folder / "world.toml").write_bytes(tomli_w.dumps(result.parameters).encode())
        return wanted

    with saved(None if out is None else partial(save_beside, save, out)) as place:
        if as_json:
            typer.echo(json.dumps(answer))
        else:
            show(result, place, recorded)
