"""`bench emulate`: a pad without hardware, pressed by the physics, on a pty or a TCP port."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import refuse_typed
from tactsim.bench.config import key_values, scan_options, slip_of_world, whole_number
from tactsim.bench.console import plain_console
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from tactsim.hardware.device import Device
    from tactsim.hardware.emulator import Emulated, Faults
    from tactsim.hardware.emulator.emulated import Pressures
    from tactsim.hardware.emulator.hand import Timing
    from tactsim.press import ScanOptions


def command_emulate(
    context: typer.Context,
    port: str = typer.Option(
        "pty", help="Where to serve: pty, pty:LINK (a name that stays), tcp or tcp:[HOST:]PORT."
    ),
    device: pads.DeviceName = "emulated",
    letter: str | None = typer.Option(None, help="Press this letter, again and again."),
    pose: str = typer.Option("0,0,0", help="Where: sensor in object, x,y,theta in mm and rad."),
    follow: Path | None = typer.Option(
        None, help="The recording of a guided session: press what that session asks for."
    ),
    plan: Path | None = typer.Option(
        None,
        help="What a robot presses, once: a CSV with the columns label, split, x_mm, y_mm, theta_rad "
        "(or theta_deg). Recorded to --out, without waiting.",
    ),
    out: Path | None = typer.Option(
        None, help="With --plan: the recording, .tactrec, or .csv as the PPS tool writes."
    ),
    marks: Path | None = typer.Option(
        None, help="With --plan: write what was pressed when, for `bench replay --marks`."
    ),
    shapes: list[Path] | None = typer.Option(
        None,
        "--shape",
        help="A shape that the plan, or the session that is followed, names; repeat for several.",
    ),
    world: str = typer.Option(
        "default", help="How the pad is pressed and what it reads: a world's name, or a file."
    ),
    hold: float = shared.number("Seconds that a press lasts.", default=2.0, least=0.01),
    lift: float = shared.number("Seconds between presses.", default=0.5, least=0.01),
    rate: float = shared.number("Frames a second.", default=100.0, least=0.01, most=100_000),
    scan_set: shared.ScanSet = None,
    drop: float = shared.number("Probability that a byte is lost.", default=0.0, least=0, most=1),
    flip: float = shared.number("Probability that a byte is changed.", default=0.0, least=0, most=1),
    torn: float = shared.number("Probability that a frame breaks off.", default=0.0, least=0, most=1),
    garbage: float = shared.number(
        "Probability of a burst of random bytes before a frame.", default=0.0, least=0, most=1
    ),
    drift: float = shared.number("kPa a second by which the zero moves.", default=0.0),
    disconnect: float = shared.number(
        "Seconds after which the line is cut, again and again; 0: never.", default=0.0, least=0
    ),
    jitter: float = shared.number(
        "How unevenly frames come, as a share of the time between two.", default=0.0, least=0, most=1
    ),
    seed: shared.Seed = 0,
) -> None:
    """Present a simulated pad as a device that speaks its codec's bytes, or record one with --plan."""
    import numpy as np

    from tactsim.hardware.device import load_device
    from tactsim.hardware.emulator import Faults, emulate
    from tactsim.hardware.emulator.hand import Timing
    from tactsim.press.simulated_source import sensing

    described = load_device(device)
    if described.ports > 1:
        raise InputError(f"{described.name} has {described.ports} ports; only pads on one port are emulated")
    if letter is not None and follow is not None:
        raise InputError("--follow takes the letter from the session; leave --letter out")
    if plan is None and (out or marks):
        raise InputError("--out and --marks belong to --plan, which says what a robot presses")
    if plan is None and follow is None and shapes:
        raise InputError("--shape is what --plan or the session of --follow names")
    if plan is not None and (letter is not None or follow is not None or out is None):
        raise InputError(
            "--plan says what is pressed, --out where it is recorded; leave out --letter, --follow"
        )
    if letter is None:
        refuse_typed(context, ("pose",), "is where a letter is pressed; say which one with --letter")
    if letter is None and follow is None and plan is None:
        why = "times presses, and nothing is pressed; say what with --letter, --follow or --plan"
        refuse_typed(context, ("hold", "lift"), why)
    words = {"world": world, "scan_set": key_values(scan_set or (), "--scan-set"), "seed": seed}
    options = scan_options(**words, pad=device, letters="none" if shapes else None, shapes=shapes or ())
    if not slip_of_world(world).still:
        plain_console(stderr=True).print("the world's slip moves nothing here: what is pressed lies still")
    rng = np.random.default_rng(seed)
    faults = Faults(drop, flip, torn, garbage, drift, disconnect)

    def felt(pressing: Pressures) -> Emulated:
        return emulate(described, faults.drifted(sensing(pressing, options, rng)), rate, jitter=jitter)

    if plan is not None and out is not None:
        _record(plan, out, marks, Timing(hold, lift), described, felt, faults, options, rng)
    else:
        _serve(port, felt(_pressing(letter, pose, follow, Timing(hold, lift), options, rng)), faults, rng)


def _record(
    plan: Path,
    out: Path,
    marks: Path | None,
    timing: Timing,
    device: Device,
    felt: Callable[[Pressures], Emulated],
    faults: Faults,
    options: ScanOptions,
    rng: np.random.Generator,
) -> None:
    """Record what a robot presses by its plan."""
    import numpy as np

    from tactsim.bench.pad.guided import segment
    from tactsim.bench.places import check_new_file
    from tactsim.core.files import replacing
    from tactsim.hardware.codecs.pps_csv import CsvFormat
    from tactsim.hardware.emulator.hand import SHARES, read_plan, record, write_marks
    from tactsim.hardware.recording import SUFFIX, Recorder
    from tactsim.models import letter as of_the_catalogue
    from tactsim.press.scanning import letters_of
    from tactsim.press.simulated_source import rising_table

    read = (plan, *map(Path, options.shapes))
    check_new_file(out, marks, *read)
    if marks is not None:
        check_new_file(marks, out, *read, option="--marks")
    if out.suffix != SUFFIX and not (out.suffix == ".csv" and isinstance(device.codec, CsvFormat)):
        raise InputError(
            f"--out {out}: name it FILE{SUFFIX}, or FILE.csv for a device with the codec 'pps-csv'"
        )
    presses = read_plan(plan)
    shapes = {shape.name: shape for shape in letters_of(options)} if options.shapes else {}
    table = np.zeros((len(presses), len(SHARES), device.pad.taxels))
    for label in dict.fromkeys(press.label for press in presses):
        rows = [row for row, press in enumerate(presses) if press.label == label]
        pressed = shapes.get(label) or of_the_catalogue(label)
        poses = np.array([presses[row].pose for row in rows])
        table[rows] = rising_table(pressed, poses, options, rng, SHARES)
    emulated, seconds = felt(timing.pressing(table)), timing.period * len(presses) + timing.lift
    if out.suffix == ".csv":
        with replacing(out) as stream:
            record(emulated, seconds, lambda data, _: stream.write(data), faults, rng)
    else:
        recorder = Recorder(out)
        try:
            recorder.segment(segment(device, [f"emulated:{plan}"], None), 0.0)
            record(emulated, seconds, lambda data, time: recorder.received(0, data, time), faults, rng)
            recorder.end({}, seconds)
        except BaseException:  # half of what the plan says is of no use
            recorder.discard()
            raise
    if marks is not None:
        write_marks(timing.intervals(presses), marks)
    plain_console().print(f"{len(presses):,} presses in {seconds:,.1f} s, in {out}")


def _pressing(
    letter: str | None,
    pose: str,
    follow: Path | None,
    timing: Timing,
    options: ScanOptions,
    rng: np.random.Generator,
) -> Pressures:
    """Choose what presses on the pad: nothing, one letter by the clock, or what a session asks for."""
    import numpy as np

    from tactsim.hardware.emulator.hand import SHARES, Follower, Pressing
    from tactsim.models import shape
    from tactsim.press.simulated_source import parse_pose, press_table, rising_table

    if letter is not None:
        table = rising_table(letter, parse_pose(pose)[None], options, rng, SHARES)
        return timing.pressing(table, again=True)
    own = {of.name: of for of in map(shape, options.shapes)}
    if follow is None:
        nothing = np.zeros(options.pad.taxels)
        return lambda now: nothing

    def table_of(plan: Any) -> np.ndarray:
        return press_table(own.get(plan.label, plan.label), np.array(plan.poses), options, rng)

    return Pressing(options.pad.taxels, Follower(follow, table_of, timing.hold, timing.lift))


def _serve(port: str, emulated: Emulated, faults: Faults, rng: np.random.Generator) -> None:
    from tactsim.hardware.emulator import serve_pty, serve_tcp

    kind, _, place = port.partition(":")
    if kind == "pty":
        serve_pty(emulated, faults, rng, link=Path(place) if place else None, ready=typer.echo)
    elif kind == "tcp":
        host, _, word = place.rpartition(":")
        number = whole_number(word) if place else 0
        if number is None:
            raise InputError(f"--port {port!r}: write it as tcp:[HOST:]PORT")
        serve_tcp(emulated, faults, rng, host=host or "127.0.0.1", port=number, ready=typer.echo)
    else:
        raise InputError(f"--port {port!r}: say pty, pty:LINK, tcp or tcp:[HOST:]PORT")
