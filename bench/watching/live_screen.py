"""Recognition on the terminal while somebody presses: the pad, the object that is believed in, and how surely."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from tactsim.bench.watching.pad_view import PadReader, PadView
from tactsim.bench.watching.recogniser import Belief
from tactsim.bench.watching.told import Told
from tactsim.bench.watching.touch_leader import LiveView
from tactsim.bench.watching.watch_screen import REDRAW_S, pad_lines, show, state_text
from tactsim.core.errors import printable
from tactsim.core.poses import FloatArray, invert, transform
from tactsim.estimators import NONE
from tactsim.hardware.terminal_pictures import characters, in_rows, shade
from tactsim.press.clip import covers

_COMMANDS = {" ": "take", "r": "redo", "s": "skip", "n": "begin"}
_KEYS = "space take it   r redo   s skip   n new object   t tare   q quit"
_CELL = 1.0  # mm of one character, which is twice as high as wide
_SCENE = (40, 16)  # characters
_BAR = 20


def live(
    reader: PadReader, told: Told, console: Console, *, readings: int | None, as_json: bool, page: str | None
) -> None:
    """Show what is believed until q, Ctrl-C, the end of a recording, or `readings` touches.

    Where nobody can begin anew, without keys and without a page, it ends when every pose was tried, too.
    as_json: print one JSON object a touch on standard output, and nothing else there.
    """
    on_terminal = console.is_terminal and not as_json

    def over(view: PadView) -> bool:
        failed = reader.error is not None or told.leading.error is not None
        now = told.leading.view()
        enough = readings is not None and len(now.belief.touches) >= readings
        ended = view.state == "ended" or (now.tried and not on_terminal)
        return failed or enough or (ended and page is None and told.leading.idle())

    try:
        if page is not None:
            console.print(page)
        if on_terminal:
            show(
                reader, console, over, lambda view: _screen(view, reader, told, console, page),
                lambda key, _: _obey(key, told),
            )  # fmt: skip
        else:
            _in_lines(reader, told, console, as_json, over)
    except KeyboardInterrupt:
        pass
    if on_terminal:
        console.print(Text(printable(told.line(told.leading.view().belief))))
    if told.leading.recogniser.delays:
        console.print(Text(told.latency()), soft_wrap=True)


def _obey(key: str, told: Told) -> None:
    command = told.leading.commands().get(_COMMANDS.get(key, ""))
    if command is not None:
        command()


def _screen(view: PadView, reader: PadReader, told: Told, console: Console, page: str | None) -> Group:
    colours = console.color_system is not None and not console.no_color
    now = told.leading.view()
    belief = now.belief
    pad = pad_lines(view, reader, width=26, height=8, from_behind=told.from_behind, colours=colours)
    left: list[RenderableType] = [scene(told, belief, now.asked, colours)]
    right: list[RenderableType] = [*pad, Text(), *_bars(belief)]
    table = Table.grid(padding=(0, 1))
    table.add_row(Group(*left), Group(*right))
    lines: list[RenderableType] = [
        state_text(view, frozen=False).append(f"   {page or ''}", "default"),
        asks(view, now),
        Text(told.where(now), "bold"),
        Text(
            printable(view.trouble or now.message or view.message), "red", no_wrap=True, overflow="ellipsis"
        ),
        table,
        Text(printable(told.line(belief)), "bold"),
        Text(_KEYS if told.leading.commands() else "q quit", "dim", no_wrap=True),
    ]
    return Group(*lines)


def asks(view: PadView, now: LiveView) -> Text:
    """Say in colour what is waited for; of a pad that is lost, nothing but that."""
    if view.state == "lost":
        return Text("the pad is lost", "bold red")
    text = Text(f"{now.phase}  ", "bold green", no_wrap=True, overflow="ellipsis")
    text.append(f"{100 * now.progress:3.0f} %  " if now.progress else "", "bold green")
    text.append(f"{view.force + 0.0:.2f} N" if view.pressures is not None else "")
    return text


def scene(told: Told, belief: Belief, asked: FloatArray | None, colours: bool) -> Text:
    """Draw the most probable letter, the last touch on it in colours, and a frame of `o` where the next goes.

    A letter whose shape nobody knows is not drawn.
    """
    columns, rows = _SCENE
    points = characters(columns, rows, _CELL)
    marks = np.full(len(points), " ", dtype=object)
    styles = np.full(len(points), "", dtype=object)
    places = belief.sensor_in_object
    if belief.estimate is None or places is None:
        return Text("\n".join([" " * columns] * rows))
    if belief.estimate.label == NONE:
        words = "none of the known letters"
        return Text(
            "\n".join([words.center(columns) if row == rows // 2 else "" for row in range(rows)]), "bold"
        )
    pad = told.pad
    half = np.array([pad.column_edges.max(), pad.row_edges.max()])
    if outline := told.outlines[belief.estimate.label]:
        on_letter = covers(outline, points)
        marks[on_letter] = "#"
        styles[on_letter] = "dim"
    image = told.image(belief)
    felt = transform(invert(places[-1]), points)
    inside = (np.abs(felt) <= half).all(axis=1)
    if image is not None and inside.any():
        nearest = np.abs(felt[inside, None] - pad.taxel_xy[None]).max(axis=-1).argmin(axis=1)
        most = max(float(np.nanmax(image)), 1e-9)
        for at, value in zip(np.flatnonzero(inside), np.nan_to_num(image[nearest]), strict=True):
            ink = "black" if value > 0.6 * most else "white"
            styles[at] = f"{ink} on {shade(float(value) / most)}" if colours else "reverse"
    if asked is not None:
        wanted = transform(invert(told.in_object(belief, asked)), points)
        depth = (np.abs(wanted) - half).max(axis=1)
        frame = (depth <= 0) & (depth > -_CELL * 1.2)
        marks[frame], styles[frame & ~inside] = "o", "bold green"
    text = in_rows(marks.tolist(), styles.tolist(), columns)
    text.rstrip()
    return text


def _bars(belief: Belief, most: int = 7) -> list[Text]:
    if belief.estimate is None:
        return [Text("no touch yet", "dim")]
    ranked = sorted(belief.estimate.probabilities.items(), key=lambda item: -item[1])[:most]
    lines = []
    for label, p in ranked:
        line = Text(f"{printable(label)[:6]:>6} ", "bold" if label == belief.estimate.label else "")
        line.append("█" * round(_BAR * p), "cyan")
        line.append("·" * (_BAR - round(_BAR * p)), "dim")
        line.append(f" {p:.3f}")
        lines.append(line)
    return lines


def _in_lines(
    reader: PadReader, told: Told, console: Console, as_json: bool, over: Callable[[PadView], bool]
) -> None:
    """Say each touch once, where the next is asked for, and each trouble at most once a second."""
    said, trouble, spoke = 0, "", 0.0
    asked: FloatArray | None = None
    leads = bool(told.leading.commands())  # not a recording, which was touched where it was

    def say_new() -> None:
        nonlocal said
        for belief in told.leading.beliefs[said:]:
            said += 1
            if as_json:
                sys.stdout.write(json.dumps(told.json_of(belief), allow_nan=False) + "\n")
                sys.stdout.flush()
            else:
                console.print(Text(printable(told.line(belief))), soft_wrap=True)

    view = reader.view()
    while not over(view):
        say_new()
        now = told.leading.view()
        if leads and now.asked is not None and now.asked is not asked:
            asked = now.asked
            print(told.where(now), file=sys.stderr)
        wrong = view.trouble or now.message
        if wrong and wrong != trouble and time.monotonic() - spoke >= 1.0:
            trouble, spoke = wrong, time.monotonic()
            print(printable(wrong), file=sys.stderr)
        time.sleep(REDRAW_S)
        view = reader.view()
    say_new()
