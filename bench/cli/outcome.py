"""How a verb that tries an estimator ends: the run is saved, and printed for people or as JSON."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from tactsim.bench.run import Run
    from tactsim.bench.space.space_run import SpaceRun


def save_and_print(
    run: Run | SpaceRun, folder: Path, *, as_json: bool, show: Callable[[Path | None], None]
) -> None:
    """Save a run in a new folder, and print it even if that fails, as JSON or by `show`.

    show: prints it for people; it is given the folder, None if nothing could be saved. Raises InputError if the run
    cannot be saved.
    """
    from tactsim.bench.places import save_and_show, save_beside
    from tactsim.bench.results import to_json

    def shown(place: Path | None) -> None:
        if as_json:
            typer.echo(to_json(run.as_json() | {"results": place and str(place)}), nl=False)
        else:
            show(place)

    save_and_show(lambda: save_beside(run.save, folder), shown)
