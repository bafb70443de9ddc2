"""`bench import`: make a scan of what was exported, or of arrays and tables of other people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import is_typed, refuse_typed


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
            help="Of data of other people: the pad, a file of its measures or of a device (.toml), or a "
            "built-in name; `bench devices` names them.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            help="Of data of other people: what readings are in: kPa, N, V, count, or Pa, mbar, psi, mmHg"
        ),
    ] = None,
    readings: Annotated[
        str, typer.Option(help="Of arrays: what the readings are called in the file.")
    ] = "readings",
    poses: Annotated[
        str, typer.Option(help="What the poses are called: sensor in object, mm, mm, rad.")
    ] = "poses",
    labels: Annotated[
        str,
        typer.Option(help="What the names of the objects are called; of a folder of frames: folder or name."),
    ] = "labels",
    split: Annotated[
        str | None,
        typer.Option(help="What says train or test is called. Default: all presses are to train on."),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(help="What columns of a table are called: x_mm=position,label=:cable,taxels=pil*_fz."),
    ] = None,
    files: Annotated[str, typer.Option(help="Of a folder of frames: which files are read, *.txt.")] = "*",
    test: Annotated[
        list[str] | None,
        typer.Option(
            help="What is to test with: a share of each object's presses, 25%, or of a folder files, S13/*."
        ),
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
    from tactsim.bench.formats.csv_file import TABLES, columns_of, read_press_table
    from tactsim.bench.formats.press_files import read_press_folder, with_last_to_test
    from tactsim.bench.pad.measured import with_shapes
    from tactsim.bench.places import check_new_file
    from tactsim.core import InputError, Scan
    from tactsim.core.idle import settled
    from tactsim.hardware.device import load_device

    check_new_file(out, source, None if pad is None else Path(pad), *(shapes or ()), suffix=".npz")
    names = ("readings", "poses", "labels", "split")
    frames = source.is_dir() and not any((source / one).exists() for one in ("scan.json", "run.json"))
    patterns = [one for one in test or () if not one.endswith("%")]
    shares = [shared.share("--test", one) for one in test or () if one.endswith("%")]
    if len(shares) > 1 or (shares and (patterns or split)):
        raise InputError("--test: give one share of the presses, or files, and with --split neither")
    if patterns and not frames:
        raise InputError(f"--test {patterns[0]} names files of a folder; of a file give a share, such as 25%")
    table, hdf5 = source.suffix.lower() in TABLES, formats.find("hdf5")
    foreign = source.suffix.lower() in hdf5.suffixes and hdf5.load().is_foreign(source)
    if columns is not None and not table:
        raise InputError("--columns is of a table (.csv, .tsv, .txt)")
    if frames or table or foreign or source.suffix.lower() in SUFFIXES:
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
        if frames:
            refuse_typed(context, ("readings", "poses", "split"), "is of arrays; a folder has a press a file")
            by = labels if is_typed(context, "labels") else None
            scan = read_press_folder(source, measures, unit, by, files, patterns)
        elif table:
            refuse_typed(
                context, names, "is of .npz, .mat and .h5 files; of a table --columns names the columns"
            )
            scan = read_press_table(source, measures, unit, columns_of(columns) if columns else None)
        else:
            called = {"readings": readings, "poses": poses, "labels": labels} | (
                {"split": split} if split else {}
            )
            scan = read_arrays(source, called, measures, unit)
        if shares:
            scan = with_last_to_test(scan, shares[0])
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
            ("zero", "idle", "test"),
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
