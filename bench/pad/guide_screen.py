"""The screen of a guided session: where to press and what the pad feels, side by side, within 80 x 24 characters."""

from __future__ import annotations

import re
from functools import partial

import numpy as np
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from tactsim.bench.watching import PadView
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.hardware.calibration import force
from tactsim.hardware.session import Phase, Press, Session, count_taken
from tactsim.hardware.terminal_pictures import Covers, on_template, placement, tactile_image, where
from tactsim.models import Letter
from tactsim.press.clip import covers

_KEYS = "space take it as it is   r redo the last   s skip   t tare   q stop (it goes on later)"
_AROUND = 6  # lines above and below the pictures: title, place, state, a message of two lines, keys
_REACH = 27.0  # mm from the pad's middle that the drawing shows at least: a letter may lie beside the pad
_BESIDE = 5.0  # mm that it shows beside a larger pad
_NUMBERS = re.compile(r"[\d.,]+")  # a message that differs in numbers alone is not said again


class Screen:
    """What the person sees: on a terminal one picture that changes, otherwise a line for each press.

    taxel_xy: (taxels, 2) mm of the readings that the session takes; some of the pad's may be left out.
    """

    def __init__(
        self,
        session: Session,
        from_behind: bool,
        console: Console,
        title: str = "",
        pressed: Letter | None = None,
    ) -> None:
        """Show a session. title: what stands before the object's name. pressed: the object, if its shape is known."""
        self._session, self.taxel_xy = session, session.pad.taxel_xy
        self._covers: Covers | None = None if pressed is None else partial(covers, pressed.contours)
        self._from_behind, self._console, self._title = from_behind, console, title
        self._said: set[tuple[int, str]] = set()  # without a picture: what was said of which press

    def draw(self, view: PadView) -> Group | None:
        """Draw what is asked for and what the pad feels; without a terminal, say what is wrong."""
        # For how long nothing came is not what is wrong.
        late, _, why = view.trouble.partition(": ")
        lost = (why or late) if view.state == "lost" else ""
        if self._session.phase is Phase.DONE:
            return None
        if self._console.is_terminal:
            return self._picture(view, lost)
        self._say(f"the pad is lost: {lost}" if lost else self._session.message)
        return None

    def note(self, press: Press) -> None:
        """Print what became of a press, if no picture shows it."""
        if self._console.is_terminal:
            return
        line = f"{self._title}press {self._number(press.number)}: {press.what}"
        if press.what == "taken" and self._session.image is not None:
            line += f", {float(force(self._session.image, self._session.pad)):.2f} N"
        self._console.print(line)

    def _say(self, message: str) -> None:
        said = self._session.current, _NUMBERS.sub("", message)
        if message and said not in self._said:
            self._console.print(f"{self._title}press {self._number(self._session.current)}: {message}")
            self._said.add(said)

    def _number(self, press: int) -> str:
        plan = self._session.plan
        if plan.enough is None:
            return f"{press + 1} of {len(plan.poses)}"
        mark = self._session.presses.get(press)
        counts = mark is not None and mark.what == "taken"
        return f"{count_taken(self._session.presses) + (not counts)} of {plan.enough}"

    def _picture(self, view: PadView, lost: str) -> Group:
        session, plan = self._session, self._session.plan
        pose = np.array(plan.poses[session.current])
        title = f"{self._title}{plan.label} ({plan.split}), press {self._number(session.current)}"
        if plan.enough is None:
            title += f", {len(session.presses)} done"
        heading = Text(title, "bold")
        heading.append(f"   {on_template(pose)}", "not bold")
        if lost:
            state = Text("THE PAD IS LOST", "bold white on red")
            message = f"{lost}. It goes on when the pad is back"
        else:
            state = Text(
                f"{session.phase.value}  {view.force + 0.0:5.2f} N  {100 * session.progress:3.0f} %",
                "bold green",
            )
            message = view.message or session.message
        width, height = self._console.size
        return Group(
            _line(heading),
            _line(Text(where(pose, self._from_behind))),
            self._pictures(view, pose, width, height - _AROUND),
            state,
            _two_lines(message, width),
            _line(Text(_KEYS, "dim")),
        )

    def _pictures(self, view: PadView, pose: FloatArray, width: int, height: int) -> Table:
        """Draw where to press, and beside it what the pad feels and felt last, in `width` x `height` characters."""
        session, reach = self._session, _reach(self._session.pad)
        cell = max(1.0, reach / max(height, 1))  # mm of a character along x; along y it is twice as much
        drawing = placement(pose, session.pad, self._covers, self._from_behind, reach, cell)
        drawing.right_crop()  # the last line's end
        room = width - int(2 * reach / cell) - 3, max((height - 2) // 2, 1)
        now = tactile_image(view.pressures, session.pad.taxel_xy, self._from_behind, room)
        images = [Text(f"the pad now, its {'face' if self._from_behind else 'back'}\n"), now]
        if session.image is not None:
            last = tactile_image(session.image, self.taxel_xy, self._from_behind, room)
            room_left = now.plain.count("\n") + last.plain.count("\n") + 3 <= height
            images += [Text("\n" * room_left + "the last press that was taken\n"), last]
        beside = Text().join(images)
        beside.right_crop()
        table = Table.grid(padding=(0, 3, 0, 0))
        table.add_column(no_wrap=True, overflow="crop")
        table.add_column(no_wrap=True, overflow="crop")
        table.add_row(drawing, beside)
        return table


def _reach(pad: Pad) -> float:
    return max(_REACH, float(pad.column_edges.max()) + _BESIDE, float(pad.row_edges.max()) + _BESIDE)


def _line(text: Text) -> Text:
    text.no_wrap, text.overflow = True, "ellipsis"
    return text


def _two_lines(message: str, width: int) -> Text:
    """Break a message into exactly two lines, so that nothing below it jumps."""
    lines = Text(message, "bold red").wrap(Console(width=width), width)
    if len(lines) > 2:
        lines[1].truncate(width - 1)
        lines[1].append("…")
    return Text("\n").join([*lines[:2], *[Text()] * (2 - len(lines))])
