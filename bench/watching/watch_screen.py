"""A pad on the terminal: one picture that changes, or, where there is no terminal, a line a second."""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from tactsim.bench.console import rounded
from tactsim.bench.watching import PadReader, PadView
from tactsim.core.counters import counter_words
from tactsim.core.errors import printable
from tactsim.hardware.terminal_pictures import SEEN, scale_bar, tactile_image

REDRAW_S = 0.05
_LINE_S = 1.0
_BARS = " ▁▂▃▄▅▆▇█"
_KEYS = "f freeze   t tare   q quit"
_MOST_COUNTERS = 6
_MOMENT = 4  # values of the history
STATES = {"waiting": "yellow", "live": "bold green", "lost": "bold white on red", "ended": "yellow"}


def show(
    reader: PadReader,
    console: Console,
    over: Callable[[PadView], bool],
    draw: Callable[[PadView], RenderableType | None],
    obey: Callable[[str, PadView], None],
) -> None:
    """Draw each view that the reader has on the whole screen, until `over` says so or q is typed.

    Every other key is passed to `obey` with the view on the screen. Where there is no terminal, no picture is shown:
    `draw` then says what it has to say, and returns nothing.
    """
    picture = Live(console=console, auto_refresh=False, screen=True) if console.is_terminal else None
    with keys() as typed, picture or nullcontext():
        for view in views(reader, over):
            for key in typed():
                if key == "q":
                    return
                obey(key, view)
            drawn = draw(view)
            if picture is not None and drawn is not None:
                picture.update(drawn, refresh=True)


def watch(
    reader: PadReader, console: Console, *, from_behind: bool, seconds: float | None, page: str | None
) -> None:
    """Show what the pad says until q, Ctrl-C, the end of a recording, or for `seconds`.

    page: the address of the page that shows the same; a page goes on when a recording has ended.
    """
    until = None if seconds is None else time.monotonic() + seconds

    def over(view: PadView) -> bool:
        late = until is not None and time.monotonic() >= until
        return late or reader.error is not None or (view.state == "ended" and page is None)

    try:
        if page is not None:
            console.print(page)
        if console.is_terminal:
            _on_terminal(reader, console, from_behind, page, over)
        else:
            _in_lines(reader, console, over)
    except KeyboardInterrupt:
        pass
    console.print(Text(status_line(reader.view())))
    if line := counters_shown(reader.view().counters):
        console.print(Text(line))


def views(reader: PadReader, over: Callable[[PadView], bool]) -> Iterator[PadView]:
    """Give the latest view again and again, new ones as they come, until `over` says so.

    Raises KeyboardInterrupt also where one was raised before that ended nothing.
    """
    view = reader.view()
    while not over(view):
        check_interrupted()
        yield view
        time.sleep(REDRAW_S)
        view = reader.wait(view.number, REDRAW_S)


def check_interrupted() -> None:
    """Raise KeyboardInterrupt if one was raised before that ended nothing."""
    if getattr(signal.getsignal(signal.SIGINT), "came", False):
        raise KeyboardInterrupt


def status_line(view: PadView) -> str:
    """Say in one line how the pad is."""
    parts: list[str] = [view.state]
    if view.state == "live" and view.pressures is not None:
        largest = float(np.nanmax(view.pressures))
        parts += [f"force {rounded(view.force, 2)} N", f"largest {rounded(largest, 1)} kPa"]
    parts.append(f"{view.rate:.1f} readings/s, {view.readings:,} so far")
    if view.trouble:
        parts.append(view.trouble)
    return printable(", ".join(parts))


def counters_shown(counters: dict[str, int]) -> str:
    """List what went wrong between device and reading, the counters that are not zero."""
    plain = ("bytes", "frames", "readings")
    wrong = {name: count for name, count in counters.items() if count and name not in plain}
    told = [f"{counter_words(name)} {count:,}" for name, count in wrong.items()]
    return ", ".join(told[:_MOST_COUNTERS]) + (" ..." if len(told) > _MOST_COUNTERS else "")


def sparkline(forces: list[float | None], width: int) -> str:
    """Draw the last forces as `width` characters; a gap of more than a moment is a gap."""
    shown = forces[-width:]
    for place in range(1, len(shown)):
        if shown[place] is None and any(value is not None for value in shown[place + 1 : place + _MOMENT]):
            shown[place] = shown[place - 1]
    most, top = max([0.05, *(value for value in shown if value is not None)]), len(_BARS) - 1
    bars = (" " if value is None else _BARS[max(round(top * value / most), 0)] for value in shown)
    return "".join(bars).rjust(width)


def over_picture(
    console: Console, above: Sequence[Text], picture: Callable[[int], RenderableType], below: Sequence[Text]
) -> Group:
    """Set words above and below a picture, which is given how many lines of the screen they leave: no word is cut."""
    used = sum(len(words.wrap(console, console.width)) for words in (*above, *below))
    return Group(*above, picture(max(console.height - used, 1)), *below)


def pad_picture(view: PadView, reader: PadReader, console: Console, from_behind: bool, height: int) -> Text:
    """Draw what the pad feels in at most `height` lines."""
    picture = tactile_image(
        view.pressures, reader.pad.taxel_xy, from_behind, (console.width - 1, height), scale=view.scale,
        marks=dict.fromkeys(view.left_out, "x"), largest=(6, 2), colours=_coloured(console),
    )  # fmt: skip
    picture.rstrip()
    return picture


def scale_text(view: PadView, console: Console, from_behind: bool) -> Text:
    """Say what the picture's colours mean, and from where the pad is seen."""
    bar = scale_bar(view.scale, min(console.width - 1, 40), _coloured(console))
    return bar.append(f"  {SEEN[from_behind]}", "dim")


def _coloured(console: Console) -> bool:
    return console.color_system is not None and not console.no_color


def _on_terminal(
    reader: PadReader, console: Console, from_behind: bool, page: str | None, over: Callable[[PadView], bool]
) -> None:
    frozen: PadView | None = None

    def obey(key: str, view: PadView) -> None:
        nonlocal frozen
        if key == "t":
            reader.tare()
        elif key == "f":
            frozen = None if frozen is not None else view

    show(reader, console, over, lambda view: _screen(view, frozen, reader, console, from_behind, page), obey)


def _screen(
    view: PadView,
    frozen: PadView | None,
    reader: PadReader,
    console: Console,
    from_behind: bool,
    page: str | None,
) -> Group:
    shown = view if frozen is None else frozen
    left_out = f"x left out: {reader.device.called(*shown.left_out)}" if shown.left_out else ""
    curve = sparkline(reader.history(), max(console.width - 18, 1))
    above = [
        Text(printable(f"{reader.device.name} at {reader.name}"), "bold"),
        state_text(view, frozen is not None),
        Text(printable(view.trouble), "red"),
        Text(f"force {rounded(shown.force, 2):>6} N  {curve}"),
    ]
    below = [
        scale_text(shown, console, from_behind),
        Text(left_out, "dim"),
        Text(counters_shown(view.counters), "dim"),
        Text(printable(view.message), "yellow"),
        Text(_KEYS + (f"   {page}" if page else ""), "dim"),
    ]
    return over_picture(console, above, partial(pad_picture, shown, reader, console, from_behind), below)


def state_text(view: PadView, frozen: bool) -> Text:
    """Say in colour whether the pad speaks and how fast; a picture that is frozen is called so."""
    text = Text(f" {view.state} ", STATES[view.state])
    text.append(f"  {view.rate:.1f} readings/s, {view.readings:,} so far", "default")
    if not view.tared:
        text.append("  not tared", "default")
    if frozen:
        text.append("  ")
        text.append(" FROZEN: the picture is an earlier one ", "bold black on yellow")
    return text


def _in_lines(reader: PadReader, console: Console, over: Callable[[PadView], bool]) -> None:
    said = 0.0
    for view in views(reader, over):
        now = time.monotonic()
        if now - said >= _LINE_S:
            said = now
            console.print(Text(status_line(view)), soft_wrap=True)


@contextmanager
def keys() -> Iterator[Callable[[], list[str]]]:
    """Give a function that returns the keys typed since its last call; none if standard input is no terminal."""
    if not sys.stdin.isatty():
        yield lambda: []
        return
    if sys.platform == "win32":
        yield _typed_on_windows
        return
    try:
        import termios
        import tty
    except ImportError:  # a Python without terminals
        yield lambda: []
        return
    settings = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield _typed
    finally:
        with suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)


def _typed() -> list[str]:
    typed: list[str] = []
    while select.select([sys.stdin], [], [], 0)[0]:
        try:
            key = os.read(sys.stdin.fileno(), 1)
        except OSError:
            key = b""
        if not key:  # the terminal is gone
            return [*typed, "q"]
        typed.append(key.decode(errors="replace").lower())
    return typed


def _typed_on_windows() -> list[str]:
    typed: list[str] = []
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            typed.append(msvcrt.getwch().lower())
    return typed
