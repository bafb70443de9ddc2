"""`bench probe`: tell whether a pad speaks, how fast, and what it says."""

from __future__ import annotations

from typing import Annotated

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import is_typed
from tactsim.core.errors import InputError

_KEPT, _SHOWN = 1 << 18, 256  # bytes; some lines have 2,048 numbers and more


def command(
    context: typer.Context,
    port: pads.Port,
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    seconds: Annotated[float, shared.number("How long to listen.", least=0.1)] = 2.0,
    as_json: shared.AsJson = False,
) -> None:
    """Listen to a pad: show its rate, counters and mean reading, or the bytes that came if no reading did."""
    import json
    import time
    from contextlib import suppress

    import numpy as np

    from tactsim.bench.console import plain_console
    from tactsim.core.source import NoReading, SourceEnded, SourceError
    from tactsim.hardware.calibration import force
    from tactsim.hardware.recorded import open_text
    from tactsim.hardware.sources import open_source
    from tactsim.hardware.terminal_pictures import tactile_image

    described, correction = pads.load(device, calibration)
    heard = _Heard()
    try:
        opened = open_source(port, described, correction, log=heard)
    except SourceError:
        with suppress(SourceError, OSError), open_text(port[0].removeprefix("recording:")) as text:
            heard.received(0, text.read(_KEPT).encode(), 0.0)
            if heard.show(as_bytes=False) and not is_typed(context, "device"):
                raise InputError(
                    f"{port[0]}: no device file says of which pad it is; keep the one above, fill in what its owner "
                    "knows, and name it: --device FILE.toml"
                ) from None
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
                heard.show()
                raise
        counters = source.counters.as_dict()
    if not readings:
        heard.show()
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
    console.print(f"mean of the readings in kPa; the last one sums to {pads.rounded(answer['force_n'], 2)} N")
    console.print(tactile_image(values.mean(axis=0), source.taxel_xy))
    console.print(f"noise {np.median(values.std(axis=0)):.2f} kPa (median taxel)")


class _Heard:
    """A log that keeps the first bytes, to show them if they make no reading."""

    def __init__(self) -> None:
        self._first = b""

    def received(self, link: int, data: bytes, time: float) -> None:
        """Keep the first bytes."""
        self._first += data[: _KEPT - len(self._first)]

    def sent(self, link: int, data: bytes, time: float) -> None:
        """Ignore what was sent."""

    def lost(self, link: int, time: float) -> None:
        """Ignore a lost link."""

    def show(self, as_bytes: bool = True) -> bool:
        """Print the first bytes in lines of 16, as numbers and as text; of lines, also how they would be read.

        Returns whether a device file was printed.
        """
        from tactsim.hardware.codecs.guessed_lines import guess_lines, is_text

        for at in range(0, min(len(self._first), _SHOWN) if as_bytes else 0, 16):
            part = self._first[at : at + 16]
            text = "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in part)
            typer.echo(f"{at:4}  {part.hex(' '):47}  {text}", err=True)
        guess = guess_lines(self._first) if is_text(self._first) else None
        if guess is not None and guess.read:
            typer.echo(f"\nThe device prints {guess.describe()}. A device file that reads them:\n", err=True)
            typer.echo(f"{guess.device_file()}\n", err=True)
        elif guess is not None:
            typer.echo(f"\n{guess.refusal()}\n", err=True)
        elif is_text(self._first):
            typer.echo("\nThe device prints text, but no ended lines of numbers without units.\n", err=True)
        return guess is not None and guess.read
