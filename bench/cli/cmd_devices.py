"""`bench devices`, `probe` and `tare`: which pads there are, what one sends, and its readings under no load."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import is_typed
from tactsim.bench.console import plain_console, rounded
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from tactsim.core.plug_ins import Listed


def command_devices(as_json: shared.AsJson = False) -> None:
    """List ports, sources of readings, codecs and device files, each with its status."""
    import json

    from rich.table import Table

    found = _found()
    if as_json:
        typer.echo(json.dumps(found, indent=1))
        return
    console = plain_console()
    for heading, rows in found.items():
        table = Table(title=heading.replace("_", " "), title_justify="left", box=None, pad_edge=False)
        for column in ("name", "what", "status"):
            table.add_column(column, overflow="fold")
        for row in rows:
            table.add_row(*(row[column] for column in ("name", "what", "status")))
        if not rows:
            table.add_row("none found", "", "")
        console.print(table)
        console.print()


def _found() -> dict[str, list[dict[str, Any]]]:
    from tactsim.hardware import sources
    from tactsim.hardware.codecs import codec_registry as registry
    from tactsim.hardware.device import built_in_devices, load_device

    return {
        "ports": _ports(),
        "sources": _rows(sources.listing()),
        "codecs": _rows(registry.listing()),
        "device_files": [
            {"name": name, "what": load_device(name).name, "status": "built in"}
            for name in built_in_devices()
        ],
    }


def _rows(listed: list[Listed]) -> list[dict[str, Any]]:
    return [{"name": row.name, "what": row.summary, "status": row.status} for row in listed]


def _ports() -> list[dict[str, Any]]:
    """List serial ports without opening any, because opening would restart an Arduino."""
    import os

    from serial.tools.list_ports import comports

    rows = []
    for port in sorted(comports()):
        readable = os.access(port.device, os.R_OK | os.W_OK)
        status = "may be opened" if readable else "no permission; join the group that owns it"
        what = port.description if port.description not in (None, "n/a") else ""
        rows.append({"name": port.device, "what": what, "status": status})
    return rows


_KEPT, _SHOWN = 1 << 18, 256  # bytes; some lines have 2,048 numbers and more
_FAR = 9.0  # times the typical distance of a taxel's zero from the middle of all: six standard deviations


def command_probe(
    context: typer.Context,
    port: pads.Port,
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    seconds: float = shared.number("How long to listen.", default=2.0, least=0.1),
    seen: shared.Seen = "behind",
    as_json: shared.AsJson = False,
) -> None:
    """Listen to a pad: show its rate, counters and mean reading, or the bytes that came if no reading did."""
    import json
    import time
    from contextlib import suppress

    import numpy as np

    from tactsim.core.source import NoReading, SourceEnded, SourceError
    from tactsim.hardware.calibration import force
    from tactsim.hardware.recorded import open_text
    from tactsim.hardware.sources import open_source, taxels_of
    from tactsim.hardware.terminal_pictures import SEEN, tactile_image

    described, correction = pads.load(device, calibration)
    heard, named = _Heard(as_json), is_typed(context, "device")
    try:
        opened = open_source(port, described, correction, log=heard)
    except SourceError:
        with suppress(SourceError, OSError), open_text(port[0].removeprefix("recording:")) as text:
            heard.received(0, text.read(_KEPT).encode(), 0.0)
            heard.explain(port[0], named, as_bytes=False)
        raise
    with opened as source:
        readings = []
        try:
            readings.append(source.read())
            start = time.monotonic()
            while time.monotonic() - start < seconds:
                readings.append(source.read())
        except SourceEnded:
            pass
        except NoReading:
            if not readings:
                heard.explain(port[0], named)
                raise
        counters = source.counters.as_dict()
    if not readings:
        heard.explain(port[0], named)
        raise NoReading(f"{port[0]} has no readings")
    values = np.array([reading.pressures for reading in readings])
    times = [
        reading.host_time if reading.device_time is None else reading.device_time for reading in readings
    ]
    span = times[-1] - times[0]
    answer = {
        "device": described.name,
        "taxels": values.shape[1],
        "readings": len(readings),
        "readings_per_s": (len(readings) - 1) / span if span > 0 else None,
        "force_n": round(float(force(values[-1], source.pad)), 6) + 0.0,
        "mean_kpa": (values.mean(axis=0).round(3) + 0.0).tolist(),  # -0.0 + 0.0 is 0.0
        "noise_kpa": values.std(axis=0).round(3).tolist(),
        "counters": counters,
    }
    if as_json:
        typer.echo(json.dumps(answer))
        return
    console = plain_console()
    rate = f"{answer['readings_per_s']:.1f} a second" if span > 0 else "one"
    console.print(f"{described.name}: {values.shape[1]} taxels, {len(readings):,} readings, {rate}")
    console.print(pads.counters_line(counters))
    console.print(f"mean of the readings in kPa; the last one sums to {rounded(answer['force_n'], 2)} N")
    console.print(tactile_image(values.mean(axis=0), source.taxel_xy, seen == "behind"))
    largest, kpa = int(values.mean(axis=0).argmax()), values.mean(axis=0).max()
    taxel = described.called(int(taxels_of(source)[largest]))
    console.print(f"{SEEN[seen == 'behind']}; the most, {kpa:.1f} kPa, reads taxel {taxel}")
    console.print(f"noise {np.median(values.std(axis=0)):.2f} kPa (median taxel)")


class _Heard:
    """A log that keeps the first bytes, to show them if they make no reading."""

    def __init__(self, as_json: bool) -> None:
        self._first, self._as_json = b"", as_json

    def received(self, link: int, data: bytes, time: float) -> None:
        """Keep the first bytes."""
        self._first += data[: _KEPT - len(self._first)]

    def sent(self, link: int, data: bytes, time: float) -> None:
        """Ignore what was sent."""

    def lost(self, link: int, time: float) -> None:
        """Ignore a lost link."""

    def explain(self, port: str, named: bool, as_bytes: bool = True) -> None:
        """Print the first bytes in lines of 16, as numbers and as text; of lines, also how they would be read.

        The device file goes to standard output, unless that is for JSON. Raises InputError that asks for it where
        nobody has `named` a pad, and what came is known.
        """
        from tactsim.hardware.codecs.fields import packing_of
        from tactsim.hardware.codecs.lines import guess_lines, is_text

        for at in range(0, min(len(self._first), _SHOWN) if as_bytes else 0, 16):
            part = self._first[at : at + 16]
            text = "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in part)
            typer.echo(f"{at:4}  {part.hex(' '):47}  {text}", err=True)
        guess, packing = guess_lines(self._first) if is_text(self._first) else None, packing_of(self._first)
        if guess is not None and guess.read:
            typer.echo(f"\nThe device prints {guess.describe()}. A device file that reads them:\n", err=True)
            typer.echo(f"{guess.device_file()}\n", err=self._as_json)
        elif guess is not None:
            typer.echo(f"\n{guess.refusal()}\n", err=True)
        elif is_text(self._first):
            typer.echo("\nThe device prints text, but no ended lines of numbers without units.\n", err=True)
        elif packing is not None:
            typer.echo(
                f"\nThe device sends packets in {packing}, which no device file reads: let it send them as they are, "
                "behind a header such as AA 55.\n",
                err=True,
            )
        if named or (packing is None and not is_text(self._first)):
            return
        if guess is None or not guess.read:
            raise InputError(f"{port}: no device file reads what came as it is; above is why")
        raise InputError(
            f"{port}: no device file says of which pad it is; keep the one above, fill in what its owner knows, and "
            "name it: --device FILE.toml"
        )


def command_tare(
    port: pads.Port,
    out: Path = typer.Option(..., help="The calibration file to write, .toml."),
    device: pads.DeviceName = "emulated",
    frames: int = typer.Option(100, min=40, max=100_000, help="Frames that the zero is the median of."),
    calibration: Path | None = typer.Option(None, help="With --load: the tare that the gains are added to."),
    load: str | None = typer.Option(
        None,
        help="An even load lies on the pad now: its pressure in kPa, or 'even' if that is not known. "
        "Fits the taxels' gains.",
    ),
    force: bool = typer.Option(False, "--force", help="Replace the file, such as this morning's tare."),
) -> None:
    """Calibrate a pad: nothing may touch it, or, with --load, an even load must lie on it."""
    import numpy as np

    from tactsim.bench.pad.simulated_hand import touch_above
    from tactsim.bench.places import check_new_file
    from tactsim.bench.watching.watch_screen import counters_shown
    from tactsim.hardware.calibration import take_tare, with_gain
    from tactsim.hardware.sources import open_source

    if out.is_file() and not force:
        raise InputError(f"--out {out} exists; name another file, or replace it by --force")
    if not out.is_file():
        check_new_file(out)
    if (load is None) != (calibration is None):
        raise InputError("gains need both --load and --calibration, the tare that they are added to")
    pressure = None if load in (None, "even") else _pressure(str(load))
    described, tare = pads.load(device, calibration)
    with open_source(port, described) as source:
        readings = [source.read()]
        before = source.counters.as_dict()  # what came ahead of the first frame is no fault
        readings += [source.read() for _ in range(frames - 1)]
        counters = {name: count - before[name] for name, count in source.counters.as_dict().items()}
    result = (
        take_tare(readings, described, " ".join(port))
        if tare is None
        else with_gain(tare, readings, pressure)
    )
    result.save(out)
    console = plain_console()
    low, high = (rounded(end, 2) for end in (min(result.tare), max(result.tare)))
    noise = sorted(result.noise)[len(result.noise) // 2]
    touch = max(described.touch_kpa, touch_above(max(result.noise)))
    console.print(
        f"zero of {len(result.tare)} taxels: {low} to {high} kPa, from {result.frames} readings, noise {noise:.2f} "
        f"kPa: a session takes a touch for one from {touch:.1f} kPa on",
        soft_wrap=True,
    )
    if tare is not None:
        console.print(f"gain {min(result.gain):.3f} to {max(result.gain):.3f}")
    for name, taxels in (("stuck", result.stuck), ("dead", result.dead)):
        if taxels:
            console.print(f"{name} and left out: taxels {described.called(*taxels)}")
    if result.loaded:
        said = ", ".join(
            f"{described.called(taxel)}, {result.tare[taxel]:.1f} kPa" for taxel in result.loaded
        )
        console.print(f"always loaded, though nothing touches the pad, and left out: taxels {said}")
    kept = np.flatnonzero(result.kept)
    level = np.array(result.tare)[kept]
    above = level - np.median(level)
    far = kept[above > max(described.touch_kpa, _FAR * float(np.median(np.abs(above))))]
    if tare is None and len(far):
        console.print(
            f"far above the others: {described.called(*far)}; if something lies there, take it off and tare again",
            soft_wrap=True,
        )
    if wrong := counters_shown(counters):
        console.print(f"on the line: {wrong}")
    console.print(f"written to {out}; the other verbs take it by --calibration {out}", soft_wrap=True)


def _pressure(text: str) -> float:
    pressure = shared.finite_number(text)
    if pressure is None or pressure <= 0:
        raise InputError(f"--load {text!r}: give the pressure in kPa, or 'even' if it is not known")
    return pressure
