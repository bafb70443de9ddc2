"""Options that the verbs of the real pad share: which port, which device, which calibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactsim.bench.cli.words import refuse_typed

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


def segment(device: Device, ports: list[str], calibration: Calibration | None, **more: Any) -> dict[str, Any]:
    """Describe a segment of a recording: the device, its calibration and ports, and the versions."""
    from datetime import UTC, datetime

    from tactsim.bench.machine import versions

    return {
        "device": device.as_json(),
        "calibration": None if calibration is None else calibration.model_dump(mode="json"),
        "urls": list(ports),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        **more,
    }


def rounded(value: float, digits: int, sign: str = "") -> str:
    """Write a number with so many decimals; what rounds to nothing has no minus. sign: "+" writes a plus, too."""
    return f"{round(value, digits) + 0.0:{sign}.{digits}f}"


def counters_line(counters: dict[str, int]) -> str:
    """List the counters that are not zero."""
    from tactsim.core.counters import counter_words

    return ", ".join(f"{counter_words(name)} {count:,}" for name, count in counters.items() if count)
