"""`bench replay`: read recordings again, show what they hold, and make a scan of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import refuse_typed
from tactsim.bench.config import whole_number
from tactsim.core.errors import InputError
from tactsim.core.provenance import poses_unknown

if TYPE_CHECKING:
    from tactsim.core import Scan
    from tactsim.core.source import Source


def command_replay(
    context: typer.Context,
    recordings: list[Path] = typer.Argument(..., help="Recordings (.tactrec), or a table of text (.csv)."),
    scan: Path | None = typer.Option(None, help="Write their presses as a scan, .npz, for `bench run`."),
    csv: Path | None = typer.Option(None, help="Write the readings of one recording as CSV, kPa."),
    marks: Path | None = typer.Option(
        None,
        help="For an unguided recording: a CSV of what was pressed, when and, where it was noted, at which pose.",
    ),
    letters: str | None = typer.Option(
        None,
        help="Which labels of --marks are letters of the catalogue, like AEIOU. Others are objects of your own.",
    ),
    shapes: pads.Shapes = None,
    moments: str | None = typer.Option(
        None,
        help="Take so many images of each training press, 2 to 20, at even shares of its load, auto, or off. So "
        "presses of other loads are recognised, too. Default: with --marks auto, where there is a rise.",
    ),
    at_load: str | None = typer.Option(
        None, help="Take the test presses at a share of their load, such as 75%, on the way there."
    ),
    cut: str | None = typer.Option(None, help="Cut readings of a large array into small touches, like 5x5."),
    stride: int = typer.Option(1, min=1, help="Taxels from one cut to the next."),
    rate: float | None = shared.number(
        "Readings a second of recordings that state no times.", default=None, metavar="HZ"
    ),
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    zero: pads.Zero = "auto",
    idle: pads.IdleFile = None,
) -> None:
    """Read recordings again, bit for bit: show what they hold, make a scan or a table of them."""
    from tactsim.bench.console import plain_console
    from tactsim.bench.pad import known_letter, taken_as_letters, with_letters, with_shapes
    from tactsim.bench.places import check_new_file
    from tactsim.bench.trials import check_labels
    from tactsim.core.idle import settled
    from tactsim.hardware.cutting import cut as cut_scan
    from tactsim.hardware.scans import read_intervals, scan_of_intervals, scan_of_sessions
    from tactsim.hardware.sources import Clocked, open_source
    from tactsim.models import parse_letters

    read = (*recordings, marks, calibration, *(shapes or ()))
    if scan is not None:
        check_new_file(scan, csv, *read, suffix=".npz", option="--scan")
    if csv is not None:
        check_new_file(csv, scan, *read, option="--csv")
    if len(recordings) > 1 and (csv is not None or marks is not None):
        raise InputError("--csv and --marks take one recording at a time")
    if letters is not None and marks is None:
        raise InputError("--letters says what labels of --marks are; guided sessions are of letters by name")
    if cut is None:
        refuse_typed(context, ("stride",), "says how far cuts are apart; say how large they are with --cut")
    if scan is None:
        refuse_typed(context, ("zero", "idle"), "is of the readings of a scan: name it with --scan")
    if (marks is not None or cut is not None or moments is not None or at_load is not None) and scan is None:
        raise InputError("--marks, --cut, --moments and --at-load make a scan: name it with --scan")
    described, correction = pads.load(device, calibration)
    window = None if cut is None else pads.window(cut)
    wanted, share = _moments(moments, marks), 1.0 if at_load is None else pads.share("--at-load", at_load)
    console = plain_console()
    if rate is not None and rate <= 0:
        raise InputError(f"--rate {rate:g}: give readings a second, above 0")

    def opened(path: Path) -> Source:
        source = open_source([f"recording:{path}"], described, correction)
        return source if rate is None else Clocked(source, rate)

    frames = pads.idle_frames(idle, opened)
    lines: list[str] = []
    try:  # the files come first: nobody need read to its end what is said of them
        for path in recordings:
            with opened(path) as source:
                lines += _contents(path, source)
        if csv is not None:
            with opened(recordings[0]) as source:
                _write_csv(source, csv)
            lines.append(f"readings in {csv}")
        if scan is None:
            return
        made: Scan
        if marks is None:
            made = scan_of_sessions(recordings, wanted, share)
        else:
            with opened(recordings[0]) as source:
                made = scan_of_intervals(source, read_intervals(marks), wanted, share)
        check_labels(made.letters)
        made, told = settled(made, zero, frames)
        drawn = {Path(each).stem for each in shapes or ()}
        called = [name for name in made.letters if known_letter(name) and name not in drawn]
        made = with_letters(made, parse_letters(letters) if letters else () if marks is not None else called)
        taken = taken_as_letters(made)
        made = with_shapes(made, shapes or ())
        if window is not None:
            made = cut_scan(made, *window, stride)
        made.save(scan)
        lines += (*taken, told, *_found(made))
        lines.append(
            f"{len(made):,} readings of {' '.join(made.letters)}, {made.readings.shape[1]} taxels, in {scan}"
        )
    finally:
        for line in lines:
            console.print(line)


def _contents(path: Path, source: Source) -> list[str]:
    """Read a recording through and say what is in it."""
    count, first, last = 0, 0.0, 0.0
    for reading in source:
        first = first if count else reading.host_time
        last, count = reading.host_time, count + 1
    lines = [f"{path}: {count:,} readings of {len(source.taxel_xy)} taxels in {last - first:.1f} s"]
    lines.append(f"  {pads.counters_line(source.counters.as_dict())}")
    return lines + [f"  {line}" for line in source.summary()]


def _write_csv(source: Source, path: Path) -> None:
    from tactsim.core.files import replacing

    with replacing(path) as stream:
        names = ",".join(f"taxel_{k}" for k in range(len(source.taxel_xy)))
        stream.write(f"s,host_s,device_s,index,{names}\n".encode())
        begin: float | None = None
        for reading in source:
            time = reading.host_time if reading.device_time is None else reading.device_time
            begin = time if begin is None else begin
            head = (time - begin, reading.host_time, reading.device_time, reading.index)
            words = ["" if value is None else repr(value) for value in head]
            stream.write((",".join([*words, *map(repr, reading.pressures.tolist())]) + "\n").encode())


def _moments(text: str | None, marks: Path | None) -> int | Literal["auto", "found"] | None:
    """Read how many moments are wanted, from 2 on. Raises InputError for anything else.

    A guided session makes the scan that was recorded, unless it is asked for more.
    """
    from tactsim.core.moments import MOST

    if text is None:
        return None if marks is None else "found"
    if text in ("auto", "off"):
        return "auto" if text == "auto" else None
    count = whole_number(text)
    if count is None or not 2 <= count <= MOST:
        raise InputError(f"--moments {text!r}: give a whole number from 2 to {MOST}, auto, or off")
    return count


def _found(scan: Scan) -> list[str]:
    """Say what was found in the recordings and how touches were cut."""
    lines = [f"taxel {taxel} is left out: {why}" for taxel, why in scan.meta.get("left_out", {}).items()]
    if poses_unknown(scan.meta):
        lines.append("the marks have no poses, so nobody noted them: a trial takes the readings of one press")
    if "moments" in scan.meta:
        said = scan.meta["moments"]
        shares = ", ".join(f"{share:.0%}" for share in said["shares"])
        lines.append(f"moments of {said['presses']:,} training presses at {shares} of their load")
    if "test_load" in scan.meta:
        lines.append(f"test presses are taken at {scan.meta['test_load']:.0%} of their load")
        if missing := scan.meta["test_load_missing"]:
            each = ", ".join(f"{label} {count} of {of}" for label, (count, of) in missing.items())
            gone = sum(count for count, _ in missing.values())
            lines.append(f"{gone:,} test presses have no such moment and are left out: {each}")
    if "cut" in scan.meta:
        said = scan.meta["cut"]
        if said["missing"]:
            lines.append(
                f"{said['missing']} taxels are missing; touches that would hold one are left out: "
                f"{said['windows']['train']} places to train and {said['windows']['test']} to test are whole"
            )
        if not said["apart"]:
            lines.append(
                "the array is too small for test touches at places of their own: they lie where training touches lie"
            )
    return lines
