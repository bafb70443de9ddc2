"""Options of the verbs that lead a person through presses, and the station that they describe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from tactsim.bench.pad.guided import Station
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import Device

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


def station(
    ports: list[str], device: Device, calibration: Calibration | None, seen: Side, console: Console
) -> Station:
    """Describe where a person presses."""
    from tactsim.bench.pad.guided import Station

    return Station(
        ports,
        device,
        calibration,
        lambda plan: pads.segment(device, ports, calibration, plan=plan.model_dump(mode="json")),
        seen == "behind",
        console,
    )


def _force(text: str) -> tuple[float, float]:
    least, most = (shared.finite_number(word) for word in text.partition(":")[::2])
    if least is None or most is None:
        raise InputError(f"--force {text!r}: write it as LEAST:MOST in N, like 0.5:5")
    return least, most
