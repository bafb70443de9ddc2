"""Pictures for the terminal: where a letter has to lie on the pad, and what the pad feels."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray, invert, transform

Covers = Callable[[FloatArray], NDArray[np.bool_]]

# Colours from nothing to the largest pressure, one brighter than the other (after matplotlib's inferno).
_STOPS = np.array([(20, 18, 46), (87, 16, 110), (188, 55, 84), (249, 142, 9), (252, 255, 164)], dtype=float)
_SIGNS = " .:-=+*#%@"  # the same where there is no colour
# From where a pad is seen, whose picture is exchanged left and right where that is its face (`from_behind`).
SEEN = {True: "the pad's face, seen from above", False: "the pad's back, seen through it"}
_NUMBERED = 4  # characters of a taxel with its number


def placement(
    sensor_in_object: FloatArray,
    pad: Pad,
    covers: Covers | None,
    from_behind: bool,
    reach: float = 27.0,
    cell: float = 1.0,
) -> Text:
    """Draw where the object lies on the pad: `#` on taxels that are read, `+` beside them, `.` the pad.

    covers(points): which of the points (n, 2) mm of the object's frame lie on the object; None draws its origin `o` and
    its x axis `->` instead. from_behind: the object is pressed face down and seen from its back, so left and right are
    exchanged. The drawing reaches `reach` mm to all sides; a character is `cell` mm wide and twice as high.
    """
    size = np.array([cell, 2 * cell])
    columns, rows = (int(2 * reach / side + 1e-9) for side in size)
    x = (np.arange(columns) - (columns - 1) / 2) * (-cell if from_behind else cell)
    y = ((rows - 1) / 2 - np.arange(rows)) * 2 * cell  # the upper row first
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    half = np.array([pad.column_edges.max(), pad.row_edges.max()])
    on_pad = (np.abs(points) <= half).all(axis=1)
    marks = np.where(on_pad, ".", " ")
    if covers is not None:
        on_object = covers(transform(sensor_in_object, points))
        marks = np.where(on_object, np.where(on_pad, "#", "+"), marks)
    else:
        axis = np.column_stack([np.arange(13.0), np.zeros(13)])
        for step, place in enumerate(transform(invert(sensor_in_object), axis)):
            near = int(np.argmin(np.abs((points - place) / size).max(axis=1)))
            marks[near] = "o" if step == 0 else ">" if step == 12 else "-"
    styles = {"#": "bold yellow", "+": "dim", ".": "blue", "o": "bold", "-": "bold", ">": "bold", " ": ""}
    text = Text()
    for row in marks.reshape(rows, columns).tolist():
        for mark in row:
            text.append(mark, styles[mark])
        text.append("\n")
    return text


def where(sensor_in_object: FloatArray, from_behind: bool) -> str:
    """Say in words where the object's origin lies on the pad and how it is turned."""
    x, y, angle = invert(sensor_in_object)
    if from_behind:
        x, angle = -x, -angle
    degrees = float(np.rad2deg(angle)) % 360
    across = f"{abs(x):.1f} mm {'right' if x > 0 else 'left'}"
    along = f"{abs(y):.1f} mm {'up' if y > 0 else 'down'}"
    turned = round(degrees) % 360
    return f"centre {across}, {along} of the pad's, {turned} degrees counter-clockwise"


def on_template(sensor_in_object: FloatArray) -> str:
    """Say which marks of the sheets of `bench template` belong together."""
    x, y, theta = sensor_in_object
    degrees = round(float(np.rad2deg(theta)), 1) % 360
    return f"template: x {round(x, 1) + 0.0:g}, y {round(y, 1) + 0.0:g}, arrow at {degrees:g}"


def tactile_image(
    pressures: FloatArray | None,
    taxel_xy: FloatArray,
    from_behind: bool = False,
    room: tuple[int, int] | None = None,
    *,
    scale: float | None = None,
    marks: Mapping[int, str] | None = None,
    largest: tuple[int, int] = (_NUMBERED, 1),
    colours: bool = True,
) -> Text:
    """Draw pressures (taxels,) kPa where the taxels (taxels, 2) mm lie, the numbers in whole kPa.

    pressures: None where they are not known, as of a pad that is lost; NaN of a taxel that is left out. room:
    characters across and down that there are. Where the numbers do not fit, the colours alone are drawn, two rows of
    taxels a line; where these do not fit, the largest of neighbouring taxels stands for them. scale: kPa of the
    brightest colour; by default the largest. marks: signs of taxels, drawn with their numbers. largest: characters
    across and down that a taxel takes where there is room. colours: whether there are any; else signs stand for them.
    """
    xs, columns = np.unique(np.round(taxel_xy[:, 0], 3), return_inverse=True)
    ys, rows = np.unique(np.round(taxel_xy[:, 1], 3), return_inverse=True)
    taxels = np.full((len(ys), len(xs)), -1)
    taxels[rows, columns] = np.arange(len(taxel_xy))
    if from_behind:
        taxels = taxels[:, ::-1]
    taxels = taxels[::-1]
    wide, high = largest
    if room is not None:
        wide, high = min(room[0] // len(xs), wide), min(room[1] // len(ys), high)
    numbered = wide >= _NUMBERED and high >= 1
    if pressures is None and not numbered:
        return Text("?\n", "dim")
    known = np.full(len(taxel_xy), np.nan) if pressures is None else pressures
    if room is None and not np.isnan(known).all():
        wide = max(wide, 1 + max(len(f"{value:.0f}") for value in (np.nanmin(known), np.nanmax(known))))
    values = np.where(taxels < 0, np.nan, known[taxels])
    shares = values / max(float(np.nanmax(known, initial=0.0)) if scale is None else scale, 1e-9)
    if room is not None and not numbered:
        return _without_numbers(shares, room, colours)
    text = Text()
    for row, taxels_of_row in enumerate(taxels.tolist()):
        for line in range(1 - high, 1):
            for column, taxel in enumerate(taxels_of_row):
                sign = "-" if taxel < 0 else (marks or {}).get(taxel, "")
                value, share = float(values[row, column]), float(shares[row, column])
                if np.isnan(value):
                    text.append(f"{(sign or '?') if line == 0 else '':>{wide}}", "dim")
                    continue
                word = f"{sign}{round(value) + 0}" if line == 0 else ""  # the integer 0 has no sign
                ink = "black" if share > 0.6 else "white"
                text.append(f"{word:>{wide}}", f"{ink} on {shade(share)}" if colours else "")
            text.append("\n")
    return text


def scale_bar(scale: float, width: int, colours: bool = True) -> Text:
    """Draw what the colours mean: from 0 to `scale` kPa, `width` characters with the numbers."""
    last = f" {scale:g} kPa"
    text = Text("0 ")
    for share in np.linspace(0, 1, max(width - 2 - len(last), 2)).tolist():
        text.append(" ", f"on {shade(share)}") if colours else text.append(_sign(share))
    return text.append(last)


def shade(share: float) -> str:
    """Give the colour of a pressure, as its share of the largest; below 0 and above 1 is cut, NaN is black."""
    if np.isnan(share):
        return "black"
    place = share * (len(_STOPS) - 1)
    colour = [round(float(np.interp(place, range(len(_STOPS)), channel))) for channel in _STOPS.T]
    return f"rgb({','.join(map(str, colour))})"


def _sign(share: float) -> str:
    return " " if np.isnan(share) else _SIGNS[round(min(max(share, 0.0), 1.0) * (len(_SIGNS) - 1))]


def _without_numbers(shares: FloatArray, room: tuple[int, int], colours: bool) -> Text:
    """Draw a character for two taxels, one above the other; without colours one for each. NaN: there is none."""
    rows, columns = shares.shape
    in_line = 2 if colours else 1  # a half block has two colours
    # Taxels a side that share a place.
    every = max(1, -(-columns // room[0]), -(-rows // (in_line * room[1])))
    filled = np.full((-(-rows // (in_line * every)) * in_line * every, -(-columns // every) * every), -np.inf)
    filled[:rows, :columns] = np.nan_to_num(shares, nan=-np.inf)
    places = filled.reshape(len(filled) // every, every, -1, every).max(axis=(1, 3))
    places[np.isinf(places)] = np.nan
    text = Text()
    for lines in places.reshape(-1, in_line, places.shape[1]).tolist():
        for taxels in zip(*lines, strict=True):
            if colours:
                upper, lower = taxels
                text.append("\u2580", f"{shade(upper)} on {shade(lower)}")
            else:
                text.append(_sign(taxels[0]))
        text.append("\n")
    return text
