"""Options that the verbs of the real pad share: which port, device and calibration, and how a person presses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import refuse_typed
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from tactsim.core.source import Source
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import Device

Port = Annotated[
    list[str],
    typer.Option(
        help="Where the pad is: a serial port, socket://HOST:PORT, recording:FILE, or simulated:A@x,y,theta. "
        "Repeat for a pad on several ports, in their order."
    ),
]

DeviceName = Annotated[
    str,
    typer.Option(
        "--pad",
        "--device",
        help="The pad: a device file (.toml), or a built-in one; `bench devices` names them. For what is simulated a "
        "file of its measures will do.",
    ),
]

CalibrationFile = Annotated[
    Path | None, typer.Option("--calibration", help="Calibration file of `bench tare`.")
]

Web = Annotated[bool, typer.Option("--web", help="Show it also as a page on localhost.")]

WebPort = Annotated[
    int, typer.Option(min=0, max=65535, help="The port of that page; 0 takes any that is free.")
]


def refuse_without_page(context: typer.Context, web: bool) -> None:
    """Raise InputError if the user typed the port of a page that is not asked for."""
    if not web:
        refuse_typed(context, ("web_port",), "is the port of the page that --web shows; give that, too")


def load(name: str, calibration: Path | None = None) -> tuple[Device, Calibration | None]:
    """Read the device file and the calibration, if one is given."""
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import load_device

    return load_device(name), None if calibration is None else Calibration.load(calibration)


def played(source: Source, device: Device) -> tuple[Source, Device]:
    """Play a recording at the speed and on the device of its time; other sources are left as they are."""
    from tactsim.hardware.recorded import CsvReplay, Replay
    from tactsim.hardware.sources import Paced

    return (Paced(source), source.device) if isinstance(source, Replay | CsvReplay) else (source, device)


def counters_line(counters: dict[str, int]) -> str:
    """List the counters that are not zero."""
    from tactsim.core.counters import counter_words

    return ", ".join(f"{counter_words(name)} {count:,}" for name, count in counters.items() if count)


PANEL = "On a real pad"
Side: TypeAlias = Literal["behind", "front"]
Frames = Annotated[int, typer.Option(min=1, help="Readings whose mean is a press.", rich_help_panel=PANEL)]

Force = Annotated[
    str, typer.Option(help="Least and most force of a press on the taxels, N.", rich_help_panel=PANEL)
]

Patience = Annotated[
    float | None,
    shared.number(
        "Seconds after which a press is taken as it is, for a machine that presses.", rich_help_panel=PANEL
    ),
]

Seen = Annotated[
    Side,
    typer.Option(
        help="behind: you see the object's back as you press it; front: the pad is pressed on it.",
        rich_help_panel=PANEL,
    ),
]


def plan_settings(
    ports: list[str],
    device: Device,
    calibration: Calibration | None,
    frames: int,
    force: str,
    patience: float | None,
) -> dict[str, Any]:
    """Give the fields of a session's plan that options and pad decide; a simulated hand has its own.

    Raises InputError for another simulated pad: a session would wait without end for its letter to be lifted.
    """
    from tactsim.bench.pad import simulated_hand
    from tactsim.bench.pad.simulated_hand import touch_above

    if ports != [simulated_hand.PLACE] and any(port.startswith("simulated:") for port in ports):
        raise InputError(
            f"--port {' '.join(ports)}: a letter that lies on the simulated pad is never lifted, so no press begins; "
            f"say {simulated_hand.PLACE}"
        )

    least, most = _force(force)
    noise = 0.0 if calibration is None else max(calibration.noise)
    settings = {
        "frames": frames, "touch_kpa": max(device.touch_kpa, touch_above(noise)), "least_force": least,
        "most_force": most, "patience": patience,
    }  # fmt: skip
    if ports == [simulated_hand.PLACE]:
        settings |= simulated_hand.settings() | ({} if patience is None else {"patience": patience})
    return settings


def _force(text: str) -> tuple[float, float]:
    least, most = (shared.finite_number(word) for word in text.partition(":")[::2])
    if least is None or most is None:
        raise InputError(f"--force {text!r}: write it as LEAST:MOST in N, like 0.5:5")
    return least, most
