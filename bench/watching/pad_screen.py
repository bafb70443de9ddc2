"""A screen that is drawn anew while a pad is read, and obeys keys: what watching and recognising share."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console, RenderableType
from rich.live import Live

from tactsim.bench.pad.keyboard import keys
from tactsim.bench.watching.pad_view import PadReader, PadView

REDRAW_S = 0.05


def show(
    reader: PadReader,
    console: Console,
    over: Callable[[PadView], bool],
    draw: Callable[[PadView], RenderableType],
    obey: Callable[[str, PadView], None],
) -> None:
    """Draw each view that the reader has on the whole screen, until `over` says so or q is typed.

    t takes the tare. Every other key is passed to `obey` with the view on the screen.
    """
    with keys() as typed, Live(console=console, auto_refresh=False, screen=True) as live:
        view = reader.view()
        while not over(view):
            for key in typed():
                if key == "q":
                    return
                if key == "t":
                    reader.tare()
                else:
                    obey(key, view)
            live.update(draw(view), refresh=True)
            time.sleep(REDRAW_S)
            view = reader.wait(view.number, REDRAW_S)
