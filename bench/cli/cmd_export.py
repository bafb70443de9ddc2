"""`bench export`: write a scan, or the trials of a run, in a format of others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared


def command(
    source: Annotated[Path, typer.Argument(metavar="SCAN|RUN", help="A scan, .npz, or the folder of a run.")],
    to: Annotated[str, typer.Option(metavar="FORMAT", help="The format: parquet or hdf5.")],
    out: Annotated[Path, typer.Option(help="The new folder (parquet) or the file (.h5) to write.")],
    licence: shared.Licence = None,
) -> None:
    """Write a scan, or the trials of a run, in a format of others: Parquet or HDF5."""
    from tactsim.bench import formats
    from tactsim.bench.console import plain_console
    from tactsim.bench.places import check_new_file, check_new_folder
    from tactsim.bench.results import Run
    from tactsim.core import InputError, Scan

    form = formats.find(to)
    if form.suffixes:
        check_new_file(out, source)
    else:
        check_new_folder(out)
    what = Run.load(source) if source.is_dir() else Scan.load(source)
    if licence is not None:
        if isinstance(what, Run):
            raise InputError("--licence is of a scan; the trials of a run state none")
        what = what.licensed(licence)
    formats.write(what, out, to)
    if isinstance(what, Run):
        said = f"{what.trials.label.size:,} estimates of {len(what.trials.truth):,} trials"
    else:
        said = f"{len(what):,} readings of {' '.join(what.letters)}, {what.readings.shape[1]} taxels"
    plain_console().print(f"{said}, as {to} in {out}")
