"""Recognition on the terminal while somebody presses: what is asked for, the pad, and what is believed."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from functools import partial

from rich.console import Console, Group
from rich.text import Text

from tactsim.bench.watching import PadReader, PadView
from tactsim.bench.watching.belief_words import BeliefWords
from tactsim.bench.watching.touch_leader import LiveView
from tactsim.bench.watching.watch_screen import (
    over_picture,
    pad_picture,
    scale_text,
    show,
    state_text,
    views,
)
from tactsim.core.errors import printable
from tactsim.core.poses import FloatArray

_KEYS = "space take it   r redo   s skip   n new object   t tare   q quit"


def live(
    reader: PadReader,
    words: BeliefWords,
    console: Console,
    *,
    readings: int | None,
    as_json: bool,
    page: str | None,
) -> None:
    """Show what is believed until q, Ctrl-C, the end of the source, or `readings` touches.

    Where nobody can begin anew, without keys and without a page, it ends when every pose was tried, too.
    as_json: print one JSON object a touch on standard output, and nothing else there.
    """
    on_terminal = console.is_terminal and not as_json

    def over(view: PadView) -> bool:
        failed = reader.error is not None or words.leading.error is not None
        now = words.leading.view()
        enough = readings is not None and len(now.belief.touches) >= readings
        ended = view.state == "ended" or (now.tried and not on_terminal)
        return failed or enough or (ended and page is None and words.leading.idle())

    try:
        if page is not None:
            console.print(page)
        if on_terminal:
            show(
                reader, console, over, lambda view: _screen(view, reader, words, console, page),
                lambda key, _: reader.tare() if key == "t" else words.leading.obey(key),
            )  # fmt: skip
        else:
            _in_lines(reader, words, console, as_json, over)
    except KeyboardInterrupt:
        pass
    if on_terminal:
        console.print(Text(printable(words.line(words.leading.view().belief))))
    if words.leading.recogniser.delays:
        console.print(Text(words.latency()), soft_wrap=True)


def _screen(
    view: PadView, reader: PadReader, words: BeliefWords, console: Console, page: str | None
) -> Group:
    now = words.leading.view()
    above = [
        state_text(view, frozen=False).append(f"   {page or ''}", "default"),
        asks(view, now),
        Text(words.where(now), "bold"),
        Text(printable(view.trouble or view.message or now.message), "red"),
    ]
    below = [
        scale_text(view, console, words.from_behind),
        Text(printable(words.line(now.belief)), "bold"),
        Text(_KEYS, "dim"),
    ]
    return over_picture(console, above, partial(pad_picture, view, reader, console, words.from_behind), below)


def asks(view: PadView, now: LiveView) -> Text:
    """Say in colour what is waited for; of a pad that is lost, nothing but that."""
    if view.state == "lost":
        return Text("the pad is lost", "bold red")
    text = Text(f"{now.phase}  ", "bold green")
    text.append(f"{100 * now.progress:3.0f} %  " if now.progress else "", "bold green")
    text.append(f"{view.force + 0.0:.2f} N" if view.pressures is not None else "")
    return text


def _in_lines(
    reader: PadReader, words: BeliefWords, console: Console, as_json: bool, over: Callable[[PadView], bool]
) -> None:
    """Say each touch once, where the next is asked for, and each trouble at most once a second."""
    said, trouble, spoke = 0, "", 0.0
    asked: FloatArray | None = None

    def say_new() -> None:
        nonlocal said
        for belief in words.leading.beliefs[said:]:
            said += 1
            if as_json:
                sys.stdout.write(json.dumps(words.json_of(belief), allow_nan=False) + "\n")
                sys.stdout.flush()
            else:
                console.print(Text(printable(words.line(belief))), soft_wrap=True)

    for view in views(reader, over):
        say_new()
        now = words.leading.view()
        if now.asked is not None and now.asked is not asked:
            asked = now.asked
            print(words.where(now), file=sys.stderr)
        wrong = view.trouble or now.message
        if wrong and wrong != trouble and time.monotonic() - spoke >= 1.0:
            trouble, spoke = wrong, time.monotonic()
            print(printable(wrong), file=sys.stderr)
    say_new()
