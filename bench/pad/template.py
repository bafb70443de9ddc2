"""Sheets to print 1:1, by which a person puts a letter and the pad together at a stated pose.

There is a sheet for the pad, with a line every 5 degrees through the pad's middle, and one for each letter, with lines
across it for the positions of the scan. A position's two lines cross at the point that lies over the pad's middle. When
the arrow is at the stated angle, both lie on lines of the pad's sheet. The sheet that lies on top is cut to a square.
All is drawn as the person sees it: from behind, x of the letter and of the pad runs to the left.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from tactsim.core.errors import InputError
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.models import Letter
from tactsim.press.scan_poses import ANGLES, stage_for

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # mm
RULER = 100.0  # mm
_INCH, _POINT = 25.4, 25.4 / 72  # mm
_HALF = 50.0  # mm from its middle to the edge of the sheet that lies on top
_MARGIN = 14.0  # mm of the paper's width beside the sheet that lies below
_MARKS = 8.0  # mm: how long the marks of whole mm are on the sheet on top
_ROOM = _HALF - _MARKS  # mm from its middle that a pad or a letter may reach
_FINE, _MEDIUM, _BOLD = 0.1, 0.2, 0.35  # mm, widths of lines
_INK, _FAINT = "black", "#888888"
_INNER = 0.35  # of the way out: where the lines of the pad's sheet begin, unless the pad reaches as far
_REACH = 15  # mm to each side that whole mm are marked


@dataclass(frozen=True)
class Sheets:
    """What the sheets are made for. from_behind: whether the letter is pressed face down on a pad that faces up."""

    paper: str
    pad: Pad
    from_behind: bool

    @property
    def size(self) -> tuple[float, float]:
        """Give width and height of the paper, mm."""
        return PAPERS[self.paper]

    @property
    def side(self) -> float:
        """Give the direction on paper of +x: -1 from behind."""
        return -1.0 if self.from_behind else 1.0

    @property
    def reach(self) -> float:
        """Say how far from its middle the lines of the sheet below go, mm."""
        return min(self.size) / 2 - _MARGIN

    @property
    def middle(self) -> FloatArray:
        """Give the middle of a sheet's drawing on the paper, mm from its lower left corner."""
        width, height = self.size
        return np.array([width / 2, height - width / 2 - 14])


def draw_sheets(letters: Sequence[Letter], sheets: Sheets) -> list[Figure]:
    """Draw the pad's sheet and then each letter's, as figures of the paper's size.

    Raises InputError if the pad or a letter does not fit on its sheet.
    """
    x_low, x_high, y_low, y_high = sheets.pad.load_bounds
    corner = float(np.hypot(max(-x_low, x_high), max(-y_low, y_high)))
    reaches = [("the pad", corner)]
    for letter in letters:
        reaches.append((repr(letter.name), max(float(np.abs(contour).max()) for contour in letter.contours)))
    for what, far in reaches:
        if far > _ROOM:
            raise InputError(
                f"{what} reaches {far:.0f} mm from its middle; its sheet has room for {_ROOM:.0f} mm"
            )
    return [_pad_sheet(sheets), *(_letter_sheet(letter, sheets) for letter in letters)]


def as_pdf(figures: Sequence[Figure]) -> bytes:
    """Write figures as the pages of a PDF of the same size; equal figures give equal bytes."""
    content = BytesIO()
    about = {"CreationDate": None, "Creator": f"tactsim {version('tactsim')}", "Producer": None}
    with PdfPages(content, metadata=about) as pages:
        for figure in figures:
            pages.savefig(figure)
    return content.getvalue()


def _pad_sheet(sheets: Sheets) -> Figure:
    on_top = not sheets.from_behind
    axes = _page(sheets, f"The pad: {sheets.pad.rows} x {sheets.pad.columns} taxels", _pad_words(sheets))
    outer = _HALF if on_top else sheets.reach
    x_low, x_high, y_low, y_high = sheets.pad.load_bounds
    corners = np.array([[x_low, y_low], [x_high, y_low], [x_high, y_high], [x_low, y_high], [x_low, y_low]])
    beyond = float(np.hypot(*corners.T).max()) + 1  # mm: no line crosses the pad
    for degrees in range(0, 360, 5):
        bold = degrees % (360 // ANGLES) == 0
        # Where the line called `degrees` is on paper: as the arrow turns, or, on a sheet that turns itself, against it.
        at = np.deg2rad(90 - degrees if on_top else 90 + degrees)
        along = np.array([np.cos(at), np.sin(at)])
        start = max((_INNER if bold else 0.6) * outer, beyond)
        _line(axes, sheets.middle + start * along, sheets.middle + outer * along, _BOLD if bold else _FINE)
        if bold:
            # On the sheet that is cut the names stand inside the cut.
            place = sheets.middle + (outer - 3 if on_top else outer + 4) * along
            _text(axes, place, f"{degrees}", 8, box=on_top)
    _polygon(axes, _on_paper(sheets, corners), _BOLD, _INK)
    for x in sheets.pad.column_edges:
        for y in sheets.pad.row_edges:
            taxel = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]], [x[0], y[0]]])
            _polygon(axes, _on_paper(sheets, taxel), _FINE, _FAINT)
    first = np.array([[x_low, y_low]])
    _text(axes, _on_paper(sheets, first)[0] - (0, 2.5), "taxel 0", 6)
    _cross(axes, sheets.middle, 3.0)
    if on_top:
        _crop(axes, sheets.middle)
    return axes.figure  # type: ignore[return-value]


def _letter_sheet(letter: Letter, sheets: Sheets) -> Figure:
    on_top = sheets.from_behind
    axes = _page(sheets, letter.name, _letter_words(letter, sheets))
    outer = _HALF if on_top else sheets.reach
    inner = outer - _MARKS if on_top else 0.4 * outer
    along_x, along_y = np.array([sheets.side, 0.0]), np.array([0.0, 1.0])
    positions = stage_for(sheets.pad, letter).positions
    for across, along, name in ((along_x, along_y, "x"), (along_y, along_x, "y")):
        for mm in range(-_REACH, _REACH + 1):
            begin = inner if mm % 5 == 0 or not on_top else outer - _MARKS / 2
            for end in (-1, 1):
                ends = [sheets.middle + mm * across + end * at * along for at in (begin, outer)]
                _line(axes, ends[0], ends[1], _FINE if mm % 5 or on_top else _MEDIUM)
        for position in positions:
            ends = [sheets.middle + position * across + at * along for at in (-outer, outer)]
            _line(axes, ends[0], ends[1], _BOLD)
            for at in (11 - outer, outer - 11):
                place = sheets.middle + position * across + at * along
                _text(axes, place, f"{name} {position:.4g}", 5, box=True)
    for contour in letter.contours:
        closed = np.vstack([contour, contour[:1]])
        _polygon(axes, _on_paper(sheets, closed), _BOLD, _INK)
    _cross(axes, sheets.middle, 2.0)
    x, y = sheets.middle
    arrow = {"arrowstyle": "-|>", "color": _INK, "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, y + outer - 2), (x, y + outer - 16), arrowprops=arrow)
    if on_top:
        _crop(axes, sheets.middle)
    return axes.figure  # type: ignore[return-value]


def _pad_words(sheets: Sheets) -> str:
    if sheets.from_behind:
        return (
            "Fix this sheet to the table. Cut the pad's outline out and set the pad in, face up, taxel 0 as marked. "
            "The object's sheet comes on top."
        )
    return (
        "Cut along the corners. Fix the pad under this sheet, face down, its middle under the cross. The object's "
        "sheet lies below."
    )


def _letter_words(letter: Letter, sheets: Sheets) -> str:
    positions = stage_for(sheets.pad, letter).positions
    scan = (
        f"The scan's positions: x and y at {', '.join(f'{at:.4g}' for at in positions)} mm; its angles: every "
        f"{360 // ANGLES} degrees. Edge rounded by {letter.rounding:g} mm, {letter.height:g} mm high."
    )
    if sheets.from_behind:
        return (
            "Cut along the corners, and the outline out: set the object in from below, face down, and tape "
            "its back to the sheet. Where the lines of x and y cross comes over the pad's middle; the arrow points to "
            "the angle. " + scan
        )
    return (
        "Fix this sheet to the table and the object on its outline, face up. The middle of the pad's sheet comes over "
        "the place where the lines of x and y cross; its line of the angle points along the arrow. " + scan
    )


def _page(sheets: Sheets, title: str, words: str) -> Axes:
    """Begin a page: axes in mm from its lower left corner, title, what to do, and a ruler along both axes."""
    width, height = sheets.size
    figure = Figure(figsize=(width / _INCH, height / _INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    seen = "from behind" if sheets.from_behind else "from the front"
    _text(axes, np.array([15, height - 10]), f"{title}, 1:1, seen {seen}", 12, align="left")
    _text(axes, np.array([15, 52]), "\n".join(textwrap.wrap(words, 115)), 8, align="left", above=False)
    ruler = np.array([(width - RULER) / 2, 18.0])
    _ruler(axes, ruler, np.array([1.0, 0.0]))
    _ruler(axes, np.array([width - 12, 27.0]), np.array([0.0, 1.0]))
    use = f"Print at 100 % (actual size). Both rulers must measure {RULER:g} mm; if not, this sheet is of no use."
    _text(axes, ruler + (RULER / 2, -6), use, 8)
    return axes


def _ruler(axes: Axes, start: FloatArray, along: FloatArray) -> None:
    across = along[::-1]
    _line(axes, start, start + RULER * along, _BOLD)
    for at in range(0, int(RULER) + 1, 5):
        tick = start + at * along
        _line(axes, tick, tick + (4 if at % 10 == 0 else 2) * across)
    for at in (0, 50, 100):
        _text(axes, start + at * along + 6 * across, f"{at}", 6)


def _crop(axes: Axes, middle: FloatArray) -> None:
    """Mark the corners of the square that is cut out."""
    for x in (-1, 1):
        for y in (-1, 1):
            corner = middle + (x * _HALF, y * _HALF)
            _line(axes, corner, corner + (x * 6, 0))
            _line(axes, corner, corner + (0, y * 6))


def _cross(axes: Axes, at: FloatArray, arm: float) -> None:
    _line(axes, at - (arm, 0), at + (arm, 0))
    _line(axes, at - (0, arm), at + (0, arm))


def _on_paper(sheets: Sheets, points: FloatArray) -> FloatArray:
    """Bring points (n, 2) mm of the letter or the pad onto the paper."""
    return sheets.middle + points * (sheets.side, 1.0)


def _line(axes: Axes, start: FloatArray, end: FloatArray, width: float = _FINE) -> None:
    _polygon(axes, np.array([start, end]), width, _INK)


def _polygon(axes: Axes, points: FloatArray, width: float, colour: str) -> None:
    axes.plot(points[:, 0], points[:, 1], lw=width / _POINT, color=colour, solid_capstyle="butt", snap=False)


def _text(
    axes: Axes,
    at: FloatArray,
    words: str,
    size: float,
    *,
    align: str = "center",
    above: bool = True,
    box: bool = False,
) -> None:
    axes.text(
        at[0], at[1], words, fontsize=size, ha=align, va="center" if above else "top", parse_math=False,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5} if box else None,
    )  # fmt: skip
