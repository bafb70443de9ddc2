"""`bench scan`, and `data`, `import`, `export` and `align`: readings of others, in and out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from tactsim.bench import kinds
from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import Words, dotted, is_typed, refuse_typed, with_options_of
from tactsim.bench.config import ScanWords, scan_options, slip_of_world, whole_number
from tactsim.bench.console import kept_clear, plain_console
from tactsim.bench.places import check_new_file, check_new_folder
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from tactsim.bench.formats.public_recordings import Recording


@with_options_of(ScanWords)
def command_scan(
    words: Words,
    context: typer.Context,
    out: Path = typer.Option(..., help="The file to write, .npz."),
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    sequence: bool = typer.Option(
        False,
        "--sequence",
        help="Keep the images of every press on its way to rest; press.dynamics must be full.",
    ),
    task: str | None = typer.Option(
        None,
        metavar="solids",
        help="Touch objects in space instead of letters in the plane.",
        rich_help_panel=shared.SOLIDS_PANEL,
    ),
    objects: shared.Objects = None,
) -> None:
    """Press the letters at 192 poses, twice (training and test), and write the readings."""
    from tactsim.bench.terminal import progress_bars, work_line
    from tactsim.press import scan_letters

    check_new_file(out, suffix=".npz")
    if task is None:
        refuse_typed(context, ["objects"], shared.OUTSIDE)
        options = scan_options(**words)
    else:
        refuse_typed(context, ["sequence"], "is for letters in the plane; leave it out with --task solids")
        words = {name: value for name, value in words.items() if is_typed(context, name)}
        words |= {} if objects is None else {"objects": objects}
    with progress_bars() as progress:
        if task is None:
            scan, work = scan_letters(
                options, jobs=jobs, cache=cache, sequence=sequence, progress=partial(progress, "press")
            )
        else:
            scan, work = kinds.load(task).scanned(words, jobs=jobs, cache=cache, progress=progress)
    scan.save(out)
    lines = [
        f"{len(scan):,} {kinds.load(scan.kind).touches} of {' '.join(scan.letters)}, {scan.readings.shape[1]} taxels, "
        f"in {out}",
        f"work  {work_line(work)}",
    ]
    if "settle_time" in work:
        median, longest = (1e3 * work["settle_time"][name] for name in ("median", "longest"))
        lines.append(
            f"settled {median:.0f} ms after touch (median; longest {longest:.0f} ms), overshoot at most "
            f"{100 * work['overshoot']:.1f} %"
        )
    slip = slip_of_world(words.get("world", "default"))  # of letters alone
    if not slip.still:
        given = " ".join(f"--slip {word}" for word in dotted(slip.model_dump(exclude_defaults=True)))
        lines.append(f"the world's slip is in no reading: `bench run --scan {out} {given}` moves the object")
    if scan.sequence_times is not None:
        lines.append(f"{len(scan.sequence_times):,} images of each press, {scan.sequence_times[-1]:.3f} s")
    plain_console().print("\n".join(lines))


def command_data(
    action: str | None = typer.Argument(None, metavar="[get]", help="Download, check and import one."),
    name: str | None = typer.Argument(None, metavar="[NAME]", help="Which one."),
    source: Path | None = typer.Option(
        None, "--from", help="Download nothing: the file, or the folder that holds the files."
    ),
    out: Path | None = typer.Option(None, help="The scan to write. [default: NAME.npz]"),
    as_json: shared.AsJson = False,
) -> None:
    """List public recordings of real pads, or `get` one: download, check and import it as a scan."""
    import json

    from tactsim.bench.formats import public_recordings as public

    if action is None:
        if source is not None or out is not None:
            raise InputError("--from and --out are of `bench data get NAME`")
        known = public.recordings()
        if as_json:
            typer.echo(json.dumps({name: one.model_dump(mode="json") for name, one in known.items()}))
            return
        for name, recording in known.items():
            plain_console().print("\n".join([name, *_lines(recording)]), soft_wrap=True)
        return
    if action != "get" or name is None:
        raise InputError(f"bench data {action}: give `bench data`, or `bench data get NAME`")
    recording = public.known_recording(name)
    out = Path(f"{name}.npz") if out is None else out
    check_new_file(out, source, suffix=".npz")
    with kept_clear(as_json):
        scan = public.scan_of(recording, public.files_of(name, recording, source))
        scan.save(out)
    if as_json:
        typer.echo(json.dumps({"scan": str(out), "readings": len(scan), "letters": scan.letters}))
        return
    plain_console().print(
        f"{len(scan):,} readings of {' '.join(scan.letters)}, {scan.readings.shape[1]} taxels, in {out}\n"
        f"terms     {recording.terms}\ncite      {recording.citation}",
        soft_wrap=True,
    )


def _lines(recording: Recording) -> list[str]:
    files = len(recording.files)
    return [
        f"  what      {recording.what}",
        f"  size      {recording.size / 1e6:.1f} MB in {files} file{'s' * (files > 1)}, each with its SHA-256 (--json)",
        f"  licence   {recording.licence or 'none stated'}; {recording.terms}",
        f"  cite      {recording.citation}",
        f"  address   {recording.repository} at commit {recording.commit}",
        f"  unsaid    {recording.unverified}; poses: {recording.poses}",
    ]


def command_export(
    source: Path = typer.Argument(..., metavar="SCAN|RUN", help="A scan, .npz, or the folder of a run."),
    to: str = typer.Option(..., metavar="FORMAT", help="The format: parquet, hdf5, or of a scan csv."),
    out: Path = typer.Option(..., help="The new folder (parquet) or the file (.h5, .csv) to write."),
    licence: pads.Licence = None,
) -> None:
    """Write a scan, or the trials of a run, in a format of others: Parquet, HDF5 or CSV."""
    from tactsim.bench import formats
    from tactsim.bench.formats.csv_file import write_press_table
    from tactsim.bench.results import Run
    from tactsim.core import Scan
    from tactsim.core.files import replacing

    form = None if to == "csv" else formats.find(to)
    if form is None or form.suffixes:
        check_new_file(out, source, suffix=".csv" if form is None else "")
    else:
        check_new_folder(out)
    if form is None and source.is_dir():
        raise InputError(f"the trials of a run are a table already: {source / 'trials.csv'}")
    what = Run.load(source) if source.is_dir() else Scan.load(source)
    if licence is not None:
        if isinstance(what, Run):
            raise InputError("--licence is of a scan; the trials of a run state none")
        what = what.licensed(licence)
    if form is None and isinstance(what, Scan):  # a table, which does not say its pad, does not come back
        with replacing(out) as stream:
            write_press_table(what, stream)
    else:
        formats.write(what, out, to)
    if isinstance(what, Run):
        said = f"{what.trials.label.size:,} estimates of {len(what.trials.truth):,} trials"
    else:
        said = f"{len(what):,} readings of {' '.join(what.letters)}, {what.readings.shape[1]} taxels"
    plain_console().print(f"{said}, as {to} in {out}")


def command_import(
    context: typer.Context,
    source: Path = typer.Argument(
        ..., metavar="FILE|FOLDER", help="A folder of Parquet, or a .h5, .npz, .mat or .csv file."
    ),
    out: Path = typer.Option(..., help="The scan to write, .npz."),
    pad: str | None = typer.Option(
        None,
        "--pad",
        "--device",
        metavar="FILE|NAME",
        help="Of data of other people: the pad, a file of its measures or of a device (.toml), or a "
        "built-in name; `bench devices` names them.",
    ),
    unit: str | None = typer.Option(
        None, help="Of data of other people: what readings are in: kPa, N, V, count, or Pa, mbar, psi, mmHg"
    ),
    readings: str = typer.Option("readings", help="Of arrays: what the readings are called in the file."),
    poses: str = typer.Option(
        "poses",
        help="What the poses are called: sensor in object, mm, mm, rad. Of any file none: nobody noted them.",
    ),
    labels: str = typer.Option(
        "labels", help="What the names of the objects are called; of a folder of frames: folder or name."
    ),
    split: str | None = typer.Option(
        None, help="What says train or test is called. Default: all presses are to train on."
    ),
    columns: str | None = typer.Option(
        None, help="What columns of a table are called: x_mm=position,label=:cable,taxels=pil*_fz."
    ),
    files: str = typer.Option("*", help="Of a folder of frames: which files are read, *.txt."),
    test: list[str] | None = typer.Option(
        None, help="What is to test with: a share of each object's presses, 25%, or of a folder files, S13/*."
    ),
    shapes: pads.Shapes = None,
    licence: pads.Licence = None,
    zero: pads.Zero = "auto",
    idle: pads.IdleFile = None,
) -> None:
    """Make a scan of what `bench export` wrote, bit for bit, of arrays (.npz, .mat, .h5) or of presses in a CSV."""
    from tactsim.bench import formats
    from tactsim.bench.formats.arrays_file import SUFFIXES, read_arrays
    from tactsim.bench.formats.csv_file import TABLES, columns_of, read_press_table
    from tactsim.bench.formats.press_files import read_press_folder, with_last_to_test
    from tactsim.bench.pad import with_shapes
    from tactsim.core import Scan
    from tactsim.core.idle import settled
    from tactsim.core.making import without_poses
    from tactsim.hardware.device import load_device

    check_new_file(out, source, None if pad is None else Path(pad), *(shapes or ()), suffix=".npz")
    noted = poses != "none"
    names = ("readings", "poses") if noted else ("readings",)
    frames = source.is_dir() and not any((source / one).exists() for one in ("scan.json", "run.json"))
    patterns = [one for one in test or () if not one.endswith("%")]
    shares = [pads.share("--test", one) for one in test or () if one.endswith("%")]
    if len(shares) > 1 or (shares and (patterns or split)):
        raise InputError("--test: give one share of the presses, or files, and with --split neither")
    if patterns and not frames:
        raise InputError(f"--test {patterns[0]} names files of a folder; of a file give a share, such as 25%")
    table, hdf5 = source.suffix.lower() in TABLES, formats.find("hdf5")
    foreign = source.suffix.lower() in hdf5.suffixes and hdf5.load().is_foreign(source)
    if columns is not None and not table:
        raise InputError("--columns is of a table (.csv, .tsv, .txt)")
    own = not frames and source.suffix.lower() == ".npz" and _is_own_scan(source)
    others, told = frames or table or foreign or (source.suffix.lower() in SUFFIXES and not own), ""
    if others:
        if pad is None or unit is None:
            if not source.exists():
                raise InputError(f"cannot read {source}: there is no such file")
            missing = [name for name, given in (("--pad", pad), ("--unit", unit)) if given is None]
            raise InputError(f"{source} does not say its pad and unit; give {' and '.join(missing)}")
        measures = load_device(pad).pad
        if frames:
            refuse_typed(context, (*names, "split"), "is of arrays; a folder has a press a file")
            by = labels if is_typed(context, "labels") else None
            scan = read_press_folder(source, measures, unit, by, files, patterns)
        elif table:
            why = (
                "is of .npz, .mat and .h5 files; of a table --columns says it, as in x_mm=position,label=kind"
            )
            refuse_typed(context, (*names, "labels", "split"), why)
            called = columns_of(columns) if columns else None
            scan = read_press_table(source, measures, unit, called, noted=noted)
        else:
            called = {"readings": readings, "poses": poses, "labels": labels}
            called |= {"split": split} if split else {}
            scan = read_arrays(source, called, measures, unit)
        if shares:
            scan = with_last_to_test(scan, shares[0])
        scan, told = settled(scan, zero, pads.idle_frames(idle))
    else:
        if own:
            scan = Scan.load(source)
            if noted:
                raise InputError(
                    f"{source} is a scan already; use it as it is, as in `bench run --scan {source}`"
                )
        else:
            formats.guess(source)  # a file of no format is refused for that
            scan = formats.read(source)  # and one that `bench export` did not write for that
        if pad is not None or unit is not None:
            raise InputError(
                f"{source} says its pad and unit itself; --pad and --unit are of files of other programs"
            )
        why = f"is of files of other programs; {source} has names of its own"
        refuse_typed(context, (*names, "labels", "split"), why)
        why = f"is of files of other programs; {source} is a scan already"
        refuse_typed(context, ("zero", "idle", "test"), why)
        scan = scan if noted else without_poses(scan)
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


def _is_own_scan(source: Path) -> bool:
    """Tell whether a .npz is a scan of tactsim's own, of objects in the plane or in space.

    Raises InputError if it is not a whole .npz file.
    """
    from tactsim.core.npz import MissingArrayError, read_npz

    if not source.exists():
        return False
    try:
        return bool(read_npz(source, ("taxel_xy", "meta")))
    except MissingArrayError as error:
        return {"taxel_points", "meta"} <= error.there.keys()
    except InputError as error:
        raise InputError(f"cannot read {source}: {error}") from error


def command_align(
    context: typer.Context,
    scan: Path = typer.Argument(..., help="A scan of presses that each hold most of an object."),
    out: Path = typer.Option(..., help="The scan to write, .npz, for `bench run --scan`."),
    poses: Literal["unknown"] | None = typer.Option(
        None, help="Withhold the poses that the scan states, to see what is found without them."
    ),
    cut: str | None = typer.Option(None, help="Then cut presses into small touches, like 6x6."),
    stride: int = typer.Option(1, min=1, help="Taxels from one cut to the next."),
    touching: str | None = typer.Option(
        None, help="Keep cuts of which so many taxels at least read more than that: 3:24."
    ),
    as_json: shared.AsJson = False,
) -> None:
    """Find how presses lie of which nobody noted the poses, by laying those of each object over each other."""
    import json
    from functools import partial

    from tactsim.bench.pad.alignment import align
    from tactsim.bench.terminal import progress_bars
    from tactsim.core import Scan
    from tactsim.hardware.cutting import cut as cut_scan

    check_new_file(out, scan, suffix=".npz")
    if cut is None:
        refuse_typed(context, ("stride", "touching"), "is of cuts; say how large they are with --cut")
    window = None if cut is None else pads.window(cut)
    least = None if touching is None else _touching(touching)
    read = Scan.load(scan)
    with kept_clear(as_json), progress_bars() as progress:
        made, _ = align(read, withheld=poses is not None, progress=partial(progress, "align"))
    if window is not None:
        made = cut_scan(made, *window, stride, least)
    made.save(out)
    said = made.meta["aligned"]
    if as_json:
        typer.echo(json.dumps({"scan": str(out), "readings": len(made), "objects": said}))
        return
    lines = []
    for label, of in said.items():
        counts = " and ".join(map(str, of["presses"]))
        several = f" in {len(of['presses'])} views" if len(of["presses"]) > 1 else ""
        alike = f"which resemble their picture by {of['resemblance']:.2f}"
        lines.append(f"{label}: {counts} presses{several}, {alike}")
    if any(len(of["presses"]) > 1 for of in said.values()):
        lines.append("an object of several views lies on one side or another; two under one label do, too")
    lines.append(f"{len(made):,} readings, {made.readings.shape[1]} taxels, in {out}")
    plain_console().print("\n".join(lines), soft_wrap=True)


def _touching(text: str) -> tuple[int, float]:
    """Read a count and a reading, COUNT:READING. Raises InputError for another text."""
    count, _, level = text.partition(":")
    taxels, reading = whole_number(count), shared.finite_number(level)
    if not taxels or reading is None:
        raise InputError(f"--touching {text!r}: write it as COUNT:READING, like 3:24")
    return taxels, reading
