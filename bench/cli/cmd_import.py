"""`bench import`: make a scan of what was exported, or of arrays and tables of other people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import refuse_typed


def command(
    context: typer.Context,
    source: Annotated[
        Path,
        typer.Argument(metavar="FILE|FOLDER", help="A folder of Parquet, or a .h5, .npz, .mat or .csv file."),
    ],
    out: Annotated[Path, typer.Option(help="The scan to write, .npz.")],
    pad: Annotated[
        str | None,
        typer.Option(
            "--pad",
            "--device",
            metavar="FILE|NAME",
            help="Of .npz, .mat, .h5 and .csv files: the pad, a file of its measures or of a device (.toml), or a "
            "built-in name; `bench devices` names them.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(help="Of .npz, .mat, .h5 and .csv files: what the readings are in: kPa, N, V or count."),
    ] = None,
    readings: Annotated[
        str, typer.Option(help="Of arrays: what the readings are called in the file.")
    ] = "readings",
    poses: Annotated[
        str, typer.Option(help="What the poses are called: sensor in object, mm, mm, rad.")
    ] = "poses",
    labels: Annotated[str, typer.Option(help="What the names of the objects are called.")] = "labels",
    split: Annotated[
        str | None,
        typer.Option(help="What says train or test is called. Default: all presses are to train on."),
    ] = None,
    shapes: shared.Shapes = None,
    licence: shared.Licence = None,
    zero: shared.Zero = "auto",
    idle: shared.IdleFile = None,
) -> None:
    """Make a scan of what `bench export` wrote, bit for bit, of arrays (.npz, .mat, .h5) or of presses in a CSV."""
    from tactsim.bench import formats
    from tactsim.bench.console import plain_console
    from tactsim.bench.formats.arrays_file import SUFFIXES, read_arrays
    from tactsim.bench.formats.csv_file import TABLES, read_press_table
    from tactsim.bench.pad.measured import with_shapes
    from tactsim.bench.places import check_new_file
    from tactsim.core import InputError, Scan
    from tactsim.core.idle import settled
    from tactsim.hardware.device import load_device

    check_new_file(out, source, None if pad is None else Path(pad), *(shapes or ()), suffix=".npz")
    names = ("readings", "poses", "labels", "split")
    table, hdf5 = source.suffix.lower() in TABLES, formats.find("hdf5")
    foreign = source.suffix.lower() in hdf5.suffixes and hdf5.load().is_foreign(source)
    if table or foreign or source.suffix.lower() in SUFFIXES:
        if pad is None or unit is None:
            try:
                Scan.load(source)
            except InputError:
                if not source.exists():
                    raise InputError(f"cannot read {source}: there is no such file") from None
                missing = [name for name, given in (("--pad", pad), ("--unit", unit)) if given is None]
                raise InputError(
                    f"{source} does not say its pad and unit; give {' and '.join(missing)}"
                ) from None
            raise InputError(
                f"{source} is a scan already; use it as it is, as in `bench run --scan {source}`"
            )
        measures = load_device(pad).pad
        if table:
            refuse_typed(context, names, "is of .npz, .mat and .h5 files; a table has columns of fixed names")
            scan = read_press_table(source, measures, unit)
        else:
            called = {"readings": readings, "poses": poses, "labels": labels} | (
                {"split": split} if split else {}
            )
            scan = read_arrays(source, called, measures, unit)
        scan, told = settled(scan, zero, shared.idle_frames(idle))
    else:
        formats.guess(source)  # a file of no format is refused for that
        if pad is not None or unit is not None:
            formats.read(source)  # and one that `bench export` did not write for that
            raise InputError(
                f"{source} says its pad and unit itself; --pad and --unit are of .npz, .mat and .csv files"
            )
        refuse_typed(context, names, f"is of .npz and .mat files; {source} has names of its own")
        refuse_typed(
            context,
            ("zero", "idle"),
            f"is of .npz, .mat and .csv files; {source} is a scan as it was exported",
        )
        scan, told = formats.read(source), ""
    scan = with_shapes(scan, shapes or ())
    if licence is not None:
        scan = scan.licensed(licence)
    scan.save(out)
    if told:
        plain_console().print(told)
    plain_console().print(
        f"{len(scan):,} readings of {' '.join(scan.letters)}, {len(scan.where('train')):,} to train on and "
        f"{len(scan.where('test')):,} to test with, {scan.readings.shape[1]} taxels, in {out}"
    )
