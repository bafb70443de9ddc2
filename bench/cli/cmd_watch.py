"""`bench watch`: a pad at its frame rate, on the terminal and as a page on localhost."""

from __future__ import annotations

from typing import Annotated

import typer

from tactsim.bench.cli import guide_options as guiding
from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared


def command(
    context: typer.Context,
    port: pads.Port,
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    web: pads.Web = False,
    web_port: pads.WebPort = 8737,
    seen: guiding.Seen = "behind",
    seconds: Annotated[
        float | None, shared.number("For how long. Default: till q, Ctrl-C or a recording's end.", least=0)
    ] = None,
) -> None:
    """Watch a pad: pressures, force, rate and what goes wrong; f freezes the picture, t takes a tare."""
    from contextlib import nullcontext

    from tactsim.bench.console import plain_console
    from tactsim.bench.watching.pad_view import PadReader
    from tactsim.bench.watching.watch_screen import watch
    from tactsim.bench.watching.web import WebPage
    from tactsim.hardware.sources import open_source

    pads.refuse_without_page(context, web)
    described, correction = pads.load(device, calibration)
    console = plain_console()
    with open_source(port, described) as opened:
        source, played = pads.played(opened, described)
        reader = PadReader(source, played, " ".join(port), correction)
        page = WebPage(reader, web_port, from_behind=seen == "behind") if web else None
        with reader, page or nullcontext():
            watch(
                reader,
                console,
                from_behind=seen == "behind",
                seconds=seconds,
                page=None if page is None else page.url,
            )
        reader.check()
