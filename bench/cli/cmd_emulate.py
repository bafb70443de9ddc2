"""`bench emulate`: a pad without hardware, pressed by the physics, on a pty or a TCP port."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    import numpy as np

    from tactsim.hardware.emulator import Emulated, Faults
    from tactsim.hardware.emulator.hand import Wanted
    from tactsim.press import ScanOptions


def command(
    port: Annotated[
        str,
        typer.Option(help="Where to serve: pty, pty:LINK (a name that stays), tcp or tcp:[HOST:]PORT."),
    ] = "pty",
    device: pads.DeviceName = "emulated",
    letter: Annotated[
        str | None, typer.Option(help="Press this letter, again and again.", show_default=False)
    ] = None,
    pose: Annotated[str, typer.Option(help="Where: sensor in object, x,y,theta in mm and rad.")] = "0,0,0",
    follow: Annotated[
        Path | None,
        typer.Option(
            help="The recording of a guided session: press what that session asks for.", show_default=False
        ),
    ] = None,
    hold: Annotated[float, typer.Option(min=0.01, help="Seconds that a press lasts.")] = 2.0,
    lift: Annotated[float, typer.Option(min=0.01, help="Seconds between presses.")] = 0.5,
    rate: Annotated[float, typer.Option(min=0.01, max=100_000, help="Frames a second.")] = 100.0,
    scan_set: shared.ScanSet = None,
    drop: Annotated[float, typer.Option(min=0, max=1, help="Probability that a byte is lost.")] = 0.0,
    flip: Annotated[float, typer.Option(min=0, max=1, help="Probability that a byte is changed.")] = 0.0,
    torn: Annotated[
        float, typer.Option(min=0, max=1, help="Probability that a frame breaks off in its middle.")
    ] = 0.0,
    garbage: Annotated[
        float, typer.Option(min=0, max=1, help="Probability of a burst of random bytes before a frame.")
    ] = 0.0,
    drift: Annotated[float, typer.Option(help="kPa a second by which the zero moves.")] = 0.0,
    disconnect: Annotated[
        float, typer.Option(min=0, help="Seconds after which the line is cut, again and again; 0: never.")
    ] = 0.0,
    seed: shared.Seed = 0,
) -> None:
    """Present a simulated pad as a device that speaks its codec's bytes; ends with Ctrl-C."""
    import numpy as np

    from tactsim.bench.config import key_values, scan_options
    from tactsim.core.errors import InputError
    from tactsim.hardware.device import load_device
    from tactsim.hardware.emulator import Faults, emulate
    from tactsim.hardware.emulator.hand import Pressing
    from tactsim.press.simulated_source import on_pad_of, sensing

    if not np.isfinite([hold, lift, rate, drift, disconnect]).all():
        raise InputError("--hold, --lift, --rate, --drift and --disconnect take finite numbers")
    described = load_device(device)
    if described.ports > 1:
        raise InputError(f"{described.name} has {described.ports} ports; only pads on one port are emulated")
    if letter is not None and follow is not None:
        raise InputError("--follow takes the letter from the session; leave --letter out")
    options = on_pad_of(described, scan_options(scan_set=key_values(scan_set or (), "--scan-set"), seed=seed))
    rng = np.random.default_rng(seed)
    wanted = _wanted(letter, pose, follow, hold, lift, options, rng)
    faults = Faults(drop=drop, flip=flip, torn=torn, garbage=garbage, drift=drift, disconnect=disconnect)
    pressing = sensing(Pressing(described.pad.taxels, wanted), options, rng)
    emulated = emulate(described, faults.drifting(pressing), rate)
    _serve(port, emulated, faults, rng)


def _wanted(
    letter: str | None,
    pose: str,
    follow: Path | None,
    hold: float,
    lift: float,
    options: ScanOptions,
    rng: np.random.Generator,
) -> Wanted:
    """Choose what presses on the pad: nothing, one letter by the clock, or what a session asks for."""
    import numpy as np

    from tactsim.hardware.emulator.hand import Follower, by_the_clock
    from tactsim.press.simulated_source import parse_pose, press_table

    if follow is not None:
        return Follower(
            follow, lambda plan: press_table(plan.label, np.array(plan.poses), options, rng), hold, lift
        )
    if letter is not None:
        return by_the_clock(press_table(letter, parse_pose(pose)[None], options, rng), hold, lift)
    return lambda now: None


def _serve(port: str, emulated: Emulated, faults: Faults, rng: np.random.Generator) -> None:
    from tactsim.bench.config import whole_number
    from tactsim.core.errors import InputError
    from tactsim.hardware.emulator import serve_pty, serve_tcp

    def ready(name: str) -> None:
        typer.echo(name)

    kind, _, place = port.partition(":")
    if kind == "pty":
        serve_pty(emulated, faults, rng, link=Path(place) if place else None, ready=ready)
    elif kind == "tcp":
        host, _, word = place.rpartition(":")
        number = whole_number(word) if place else 0
        if number is None:
            raise InputError(f"--port {port!r}: write it as tcp:[HOST:]PORT")
        serve_tcp(emulated, faults, rng, host=host or "127.0.0.1", port=number, ready=ready)
    else:
        raise InputError(f"--port {port!r}: say pty, pty:LINK, tcp or tcp:[HOST:]PORT")
