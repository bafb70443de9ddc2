"""`bench record`: record a letter press by press, or all that a pad says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactsim.bench.cli import pad_options as pads

if TYPE_CHECKING:
    from tactsim.core.source import Source
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import Device
    from tactsim.hardware.recording import Recorder
    from tactsim.hardware.session import Plan
    from tactsim.hardware.terminal_pictures import Covers

_TOUCH = 5.0  # standard deviations of the noisiest taxel above which a taxel is touched


def command(
    port: pads.Port,
    out: Annotated[
        Path,
        typer.Option(
            help="With --letter: the scan to write, .npz, its recording beside it. Else the recording, .tactrec."
        ),
    ],
    letter: Annotated[
        str | None,
        typer.Option(help="The letter to press: leads through its 4 x 4 x 12 presses.", show_default=False),
    ] = None,
    split: Annotated[str, typer.Option(help="What the presses are for: train or test.")] = "train",
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    resume: Annotated[bool, typer.Option(help="Go on with a session that was stopped.")] = False,
    poses: Annotated[
        str, typer.Option(help="The poses: grid (the paper's 192), or random:N off the grid.")
    ] = "grid",
    frames: Annotated[int, typer.Option(min=1, help="Readings whose mean is a press.")] = 20,
    force: Annotated[str, typer.Option(help="Least and most force of a press on the taxels, N.")] = "0.3:20",
    patience: Annotated[
        float | None,
        typer.Option(
            help="Seconds after which a press is taken as it is, for a machine that presses.",
            show_default=False,
        ),
    ] = None,
    seen: Annotated[
        str,
        typer.Option(
            help="behind: you see the object's back as you press it; front: the pad is pressed on it."
        ),
    ] = "behind",
    seconds: Annotated[
        float | None,
        typer.Option(help="Without --letter: for how long. Default: till Ctrl-C.", show_default=False),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of random poses.")] = 0,
) -> None:
    """Record a pad: with --letter a guided session that makes a scan, else all it says."""
    from tactsim.core.errors import InputError

    if seen not in ("behind", "front"):
        raise InputError(f"--seen {seen!r}: say behind or front")
    _check_name(out, ".tactrec" if letter is None else ".npz")
    described, correction = pads.load(device, calibration)
    if letter is None:
        _record_all(port, out, described, correction, seconds)
        return
    least, most = _force(force)
    noise = 0.0 if correction is None else sorted(correction.noise)[-1]
    plan = {
        "label": letter, "split": split, "poses": _poses(poses, seed), "frames": frames,
        "touch_kpa": max(described.touch_kpa, _TOUCH * noise), "least_force": least, "most_force": most,
        "patience": patience,
    }  # fmt: skip
    from tactsim.core.checking import checked
    from tactsim.hardware.session import Plan

    _record_session(
        port, out, described, correction, checked(Plan, plan, "session"), resume, seen == "behind"
    )


def _record_session(
    port: list[str],
    out: Path,
    device: Device,
    calibration: Calibration | None,
    plan: Plan,
    resume: bool,
    from_behind: bool,
) -> None:
    import time

    from tactsim.bench.console import plain_console
    from tactsim.bench.guide import lead
    from tactsim.bench.guide_screen import Screen
    from tactsim.bench.places import check_new_file
    from tactsim.core.errors import InputError
    from tactsim.hardware.recording import SUFFIX, Recorder, check_whole
    from tactsim.hardware.scans import read_session, scan_of_sessions
    from tactsim.hardware.session import Session

    check_new_file(out)
    journal = out.with_suffix(SUFFIX)
    presses, first = {}, 0
    if resume and check_whole(journal).records:  # without records, it was killed before it began
        before = read_session(journal)
        if before.plan.poses != plan.poses or before.plan.label != plan.label:
            raise InputError(
                f"{journal} is a session of {before.plan.label!r} with {len(before.plan.poses)} presses, not the "
                "one asked for; resume it with the same --letter and --poses"
            )
        if before.pad != device.pad:
            raise InputError(f"{journal} was recorded with another pad than {device.name!r}")
        plan, presses, first = before.plan, before.presses, before.readings
    console = plain_console()
    with Recorder(journal, append=resume) as recorder:
        recorder.segment(
            pads.segment(device, port, calibration, plan=plan.model_dump(mode="json")), time.monotonic()
        )
        with _open(port, device, calibration, recorder, new=not resume) as source:
            session = Session(plan, device.pad, presses)
            screen = Screen(session, source.taxel_xy, _shape(plan.label), from_behind, console)
            done = lead(session, source, recorder, first, screen, device.deadline)
            recorder.end(source.counters.as_dict(), time.monotonic())
    console.print(pads.counters_line(source.counters.as_dict()))
    if not done:
        console.print(
            f"{len(session.presses)} of {len(plan.poses)} presses are in {journal}; the same command with --resume "
            "goes on",
        )
        return
    scan = pads.with_letters(scan_of_sessions([journal]))
    scan.save(out)
    console.print(f"{len(scan)} readings of {plan.label} in {out}; the bytes are in {journal}")


def _record_all(
    port: list[str], out: Path, device: Device, calibration: Calibration | None, seconds: float | None
) -> None:
    import time

    from tactsim.bench.console import plain_console
    from tactsim.core.source import NoReading, SourceEnded
    from tactsim.hardware.recording import Recorder

    console = plain_console()
    count, silence = 0, None
    with Recorder(out) as recorder:
        start = time.monotonic()
        recorder.segment(pads.segment(device, port, calibration), start)
        with _open(port, device, calibration, recorder, new=True) as source:
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


def _open(
    port: list[str], device: Device, calibration: Calibration | None, recorder: Recorder, new: bool
) -> Source:
    """Open what is recorded. A recording that is new is removed if that fails, so that it can be tried again."""
    from tactsim.core.errors import InputError
    from tactsim.hardware.sources import open_source

    try:
        source = open_source(port, device, calibration, recorder)
        if source.pad != device.pad:
            source.close()
            raise InputError(f"{port[0]} has another pad than --device says")
    except InputError:
        if new:
            recorder.discard()
        raise
    return source


def _check_name(out: Path, suffix: str) -> None:
    """Refuse a name by which what is written would be taken for something else."""
    from tactsim.core.errors import InputError

    if out.suffix.lower() == suffix:
        return
    if suffix == ".npz":
        raise InputError(
            f"--out {out}: with --letter it names the scan, FILE.npz; its recording lies beside it"
        )
    also = "; `bench replay FILE.tactrec --csv` makes a table of it" if out.suffix.lower() == ".csv" else ""
    raise InputError(f"--out {out}: a recording is called FILE{suffix}{also}")


def _force(text: str) -> tuple[float, float]:
    from tactsim.core.errors import InputError

    try:
        least, most = (float(word) for word in text.split(":"))
    except ValueError:
        raise InputError(f"--force {text!r}: write it as LEAST:MOST in N, like 0.5:5") from None
    return least, most


def _poses(text: str, seed: int) -> list[tuple[float, ...]]:
    import numpy as np

    from tactsim.bench.config import whole_number
    from tactsim.core.errors import InputError
    from tactsim.press.scan_poses import grid_poses, random_poses

    if text == "grid":
        return [tuple(pose) for pose in grid_poses().tolist()]
    kind, _, number = text.partition(":")
    count = whole_number(number)
    if kind != "random" or count is None or not 1 <= count <= 100_000:
        raise InputError(f"--poses {text!r}: say grid, or random:N for N poses off the grid")
    return [tuple(pose) for pose in random_poses(np.random.default_rng(seed), count).tolist()]


def _shape(label: str) -> Covers | None:
    """Give the test for points on the letter of that name; None if there is no such letter."""
    from tactsim.models import letter, names
    from tactsim.press.clip import covers

    if label not in names():
        return None
    contours = letter(label).contours
    return lambda points: covers(contours, points)
