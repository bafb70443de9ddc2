"""`bench record` and `template`: keep what a pad sends, and sheets that say where to press."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import refuse_typed
from tactsim.bench.config import scan_options, whole_number
from tactsim.bench.console import plain_console
from tactsim.bench.places import check_new_file
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from tactsim.core.pad import Pad
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import Device
    from tactsim.hardware.session import Plan
    from tactsim.models import Letter


def command_record(
    context: typer.Context,
    port: pads.Port,
    out: Path = typer.Option(
        ...,
        help="With --letter or --shape: the scan to write, .npz, its recording beside it. Else the recording, "
        ".tactrec.",
    ),
    letter: str | None = typer.Option(
        None,
        help="The letter to press: leads through its 4 x 4 x 12 presses. Or a label of your own: through those with "
        "its origin on the pad.",
    ),
    shape_file: Path | None = typer.Option(
        None,
        "--shape",
        help="An object of your own to press, a drawing or mesh whose name is the label: leads through the presses "
        "of the grid that touch it.",
    ),
    split: str = typer.Option("train", help="What the presses are for: train or test."),
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    resume: bool = typer.Option(False, help="Go on with a session that was stopped."),
    poses: str = typer.Option(
        "grid", help="The poses: grid (the paper's 192), spread:N of it far apart, or random:N off it."
    ),
    frames: shared.Frames = 20,
    force: shared.Force = "0.3:20",
    patience: shared.Patience = None,
    seen: shared.Seen = "behind",
    seconds: float | None = shared.number(
        "Without --letter: for how long. Default: till Ctrl-C.", default=None, least=0.1
    ),
    seed: int = typer.Option(0, min=0, help="Seed of poses that are drawn."),
) -> None:
    """Record a pad: with --letter or --shape a guided session that makes a scan, else all it says."""
    from tactsim.models import shape

    if letter is not None and shape_file is not None:
        raise InputError(f"--shape {shape_file} is called after its file; leave --letter out, or rename it")
    pressed = None if shape_file is None else shape(shape_file)
    letter = letter if pressed is None else pressed.name
    if letter is None:
        names = ("split", "resume", "poses", "frames", "force", "patience", "seen", "seed")
        why = "is for a guided session; say what is pressed with --letter or --shape, or leave it out"
        refuse_typed(context, names, why)
    else:
        why = "is for a recording of all that a pad says; a session of --letter or --shape ends by itself"
        refuse_typed(context, ("seconds",), why)
    _check_name(out, ".tactrec" if letter is None else ".npz")
    described, correction = pads.load(device, calibration)
    if letter is None:
        _record_all(port, out, described, correction, seconds)
        return
    from tactsim.bench.pad import known_letter
    from tactsim.core.checking import checked
    from tactsim.hardware.session import Plan

    settings = pads.plan_settings(port, described, correction, frames, force, patience)
    asked = _poses(poses, seed, described.pad, pressed or known_letter(letter))
    plan = {"label": letter, "split": split, "poses": asked} | settings
    _record_session(port, out, described, correction, checked(Plan, plan, "session"), resume, seen, pressed)


def _record_session(
    port: list[str],
    out: Path,
    device: Device,
    calibration: Calibration | None,
    plan: Plan,
    resume: bool,
    seen: shared.Side,
    pressed: Letter | None,
) -> None:
    from tactsim.bench.pad import known_letter, taken_as_letters, with_letters, with_objects
    from tactsim.bench.pad.guided import Station, record
    from tactsim.hardware.recording import SUFFIX
    from tactsim.hardware.scans import scan_of_sessions

    check_new_file(out)
    journal, console = out.with_suffix(SUFFIX), plain_console()
    if pressed is None and known_letter(plan.label) is None:
        console.print(
            f"{plan.label!r} is no letter of the catalogue: it is a label of your own, and the guide draws its origin "
            "and x axis alone, and asks for presses with the origin on the pad; --shape FILE draws an object",
            soft_wrap=True,
        )
    station = Station(port, device, calibration, seen == "behind", console)
    sitting = record(station, plan, journal, resume=resume, pressed=pressed)
    console.print(pads.counters_line(sitting.counters))
    if not sitting.done:
        console.print(
            f"{sitting.presses} of {len(plan.poses)} presses are in {journal}; the same command with --resume goes on"
        )
        return
    scan = scan_of_sessions([journal])
    scan = with_letters(scan) if pressed is None else with_objects(scan, [pressed])
    scan.save(out)
    console.print(f"{len(scan)} readings of {plan.label} in {out}; the bytes are in {journal}")
    for line in taken_as_letters(scan) if pressed is None else ():
        console.print(line)


def _record_all(
    port: list[str], out: Path, device: Device, calibration: Calibration | None, seconds: float | None
) -> None:
    import time

    from tactsim.bench.pad.guided import open_recorded, segment
    from tactsim.core.source import NoReading, SourceEnded
    from tactsim.hardware.recording import Recorder

    console = plain_console()
    count, silence = 0, None
    with Recorder(out) as recorder:
        recorder.segment(segment(device, port, calibration), time.monotonic())
        with open_recorded(port, device, calibration, recorder, new=True) as source:
            start = time.monotonic()  # a pad that takes a second to open is recorded for as long as was asked
            try:
                while seconds is None or time.monotonic() - start < seconds:
                    try:
                        source.read()
                        count, silence = count + 1, None
                    except NoReading as error:
                        if not count:
                            raise
                        if silence is None:
                            console.print(f"{error}; waiting for it, Ctrl-C ends the recording")
                        silence = error
            except (KeyboardInterrupt, SourceEnded):
                pass
            finally:
                if not count:
                    recorder.discard()
            counters = source.counters.as_dict()
            if not count:
                raise NoReading(f"no reading came from {port[0]}; nothing was recorded")
            recorder.end(counters, time.monotonic())
    console.print(f"{count:,} readings in {out}\n{pads.counters_line(counters)}")
    if silence is not None:
        raise silence


def _check_name(out: Path, suffix: str) -> None:
    """Refuse a name by which what is written would be taken for something else."""
    if out.suffix.lower() == suffix:
        return
    if suffix == ".npz":
        raise InputError(
            f"--out {out}: with --letter or --shape it names the scan, FILE.npz; its recording lies beside it"
        )
    also = "; `bench replay FILE.tactrec --csv` makes a table of it" if out.suffix.lower() == ".csv" else ""
    raise InputError(f"--out {out}: a recording is called FILE{suffix}{also}")


def _poses(text: str, seed: int, pad: Pad, pressed: Letter | None) -> list[tuple[float, ...]]:
    import numpy as np

    from tactsim.bench.pad import on_object, touching
    from tactsim.core.making import spread_out
    from tactsim.press.scan_poses import grid_poses, stage_for

    poses = grid_poses(stage_for(pad, pressed))
    poses = poses[on_object(poses, pad, pressed)]
    kind, _, number = text.partition(":")
    count = whole_number(number)
    if kind == "spread" and count is not None and 1 <= count <= len(poses):
        poses = np.random.default_rng(seed).permutation(poses)
        poses = poses[spread_out(poses, count)]
    elif kind == "random" and count is not None and 1 <= count <= 100_000:
        poses = touching(np.random.default_rng(seed), count, pad, pressed)
    elif text != "grid":
        raise InputError(
            f"--poses {text!r}: say grid, spread:N for N of its {len(poses)} poses, or random:N for N off the grid"
        )
    return [tuple(pose) for pose in poses.tolist()]


def command_template(
    out: Path = typer.Option(..., help="The file to write, .pdf."),
    letters: str | None = typer.Option(
        None, help="Which letters: AEIOU, A-Z0-9, A,E,I. Default: AEIOU, or none beside shapes."
    ),
    shape: list[Path] | None = typer.Option(None, help="A shape of your own; repeat for several."),
    device: pads.DeviceName = "emulated",
    seen: shared.Seen = "behind",
    paper: str = typer.Option("a4", help="The paper: a4 or letter."),
) -> None:
    """Print the pad's sheet and one for each letter or shape, 1:1, with the positions and angles of the scan."""
    from tactsim.bench.pad.template import PAPERS, Sheets, as_pdf, draw_sheets
    from tactsim.core.files import write_bytes
    from tactsim.hardware.device import load_device
    from tactsim.press.scanning import letters_of

    if paper not in PAPERS:
        raise InputError(f"--paper {paper!r}: say {' or '.join(PAPERS)}")
    check_new_file(out, picture=".pdf")
    sheets = Sheets(paper, load_device(device).pad, seen == "behind")
    letters = letters or ("none" if shape else "AEIOU")
    pressed = letters_of(scan_options(letters=letters, shapes=shape or ()))
    write_bytes(out, as_pdf(draw_sheets(pressed, sheets)))
    plain_console().print(
        f"{1 + len(pressed)} pages in {out}: the pad's sheet, then {' '.join(letter.name for letter in pressed)}; "
        "print at 100 % and check the rulers"
    )
