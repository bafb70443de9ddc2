"""`bench tare`: take the zero of every taxel, and, under an even load, its gain."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.core.errors import InputError


def command(
    port: pads.Port,
    out: Annotated[Path, typer.Option(help="The calibration file to write, .toml.")],
    device: pads.DeviceName = "emulated",
    frames: Annotated[
        int, typer.Option(min=40, max=100_000, help="Frames that the zero is the median of.")
    ] = 100,
    calibration: Annotated[
        Path | None, typer.Option(help="With --load: the tare that the gains are added to.")
    ] = None,
    load: Annotated[
        str | None,
        typer.Option(
            help="An even load lies on the pad now: its pressure in kPa, or 'even' if that is not known. "
            "Fits the taxels' gains."
        ),
    ] = None,
) -> None:
    """Calibrate a pad: nothing may touch it, or, with --load, an even load must lie on it."""
    from tactsim.bench.console import plain_console
    from tactsim.bench.places import check_new_file
    from tactsim.hardware.calibration import take_tare, with_gain
    from tactsim.hardware.sources import open_source

    check_new_file(out)
    if (load is None) != (calibration is None):
        raise InputError("gains need both --load and --calibration, the tare that they are added to")
    pressure = None if load in (None, "even") else _pressure(str(load))
    described, tare = pads.load(device, calibration)
    with open_source(port, described) as source:
        readings = [source.read() for _ in range(frames)]
        counters = source.counters.as_dict()
    result = (
        take_tare(readings, described, " ".join(port))
        if tare is None
        else with_gain(tare, readings, pressure)
    )
    result.save(out)
    console = plain_console()
    low, high = (pads.rounded(end, 2) for end in (min(result.tare), max(result.tare)))
    console.print(f"{len(result.tare)} taxels: zero {low} to {high} kPa, from {result.frames} frames")
    console.print(f"noise {sorted(result.noise)[len(result.noise) // 2]:.2f} kPa (median taxel)")
    if tare is not None:
        console.print(f"gain {min(result.gain):.3f} to {max(result.gain):.3f}")
    for name, taxels in (("stuck", result.stuck), ("dead", result.dead)):
        if taxels:
            console.print(f"{name} and left out: taxels {', '.join(map(str, taxels))}")
    if result.loaded:
        said = ", ".join(f"{taxel} ({result.tare[taxel]:.1f} kPa)" for taxel in result.loaded)
        console.print(f"always loaded, though nothing touches the pad, and left out: taxels {said}")
    console.print(pads.counters_line(counters))
    console.print(f"written to {out}")


def _pressure(text: str) -> float:
    pressure = shared.finite_number(text)
    if pressure is None or pressure <= 0:
        raise InputError(f"--load {text!r}: give the pressure in kPa, or 'even' if it is not known")
    return pressure
