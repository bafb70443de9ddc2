"""Pictures for the terminal: where a letter has to lie on the pad, and what the pad feels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray, invert, transform

Covers = Callable[[FloatArray], NDArray[np.bool_]]

# Colours from nothing to the largest pressure, and one for taxels below zero or not read.
_SCALE = ("#1b1b3a", "#2d2f73", "#27568f", "#1f7f8c", "#2fa36b", "#8ac926", "#ffca3a", "#ff924c", "#ff595e")
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

    covers(points): which of the points (n, 2) mm of the object's frame lie on the object; None draws its
    origin `o` and its x axis `->` instead. from_behind: the object is pressed face down and seen from
    its back, so left and right are exchanged. The drawing reaches `reach` mm to all sides; a character is
    `cell` mm wide and twice as high.
    """
    size = np.array([cell, 2 * cell])
    columns, rows = (int(2 * reach / side + 1e-9) for side in size)
    x = (np.arange(columns) - (columns - 1) / 2) * size[0]
    y = ((rows - 1) / 2 - np.arange(rows)) * size[1]
    points = np.stack(np.meshgrid(-x if from_behind else x, y), axis=-1).reshape(-1, 2)
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
    styles = {"#": "bold yellow", "+": "dim", ".": "blue", "o": "bold", "-": "bold", ">": "bold"}
    text = Text()
    for row in marks.reshape(len(y), len(x)):
        for mark in row:
            text.append(mark, styles.get(mark))
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
) -> Text:
    """Draw pressures (taxels,) kPa where the taxels (taxels, 2) mm lie, the numbers in whole kPa.

    pressures: None where they are not known, as of a pad that is lost. room: characters across and down that there
    are. Where the numbers do not fit, the colours alone are drawn, two rows of taxels a line; where these do not fit,
    the largest of neighbouring taxels stands for them.
    """
    xs, columns = np.unique(np.round(taxel_xy[:, 0], 3), return_inverse=True)
    ys, rows = np.unique(np.round(taxel_xy[:, 1], 3), return_inverse=True)
    taxels = np.full((len(ys), len(xs)), -1)
    taxels[rows, columns] = np.arange(len(taxel_xy))
    if from_behind:
        taxels = taxels[:, ::-1]
    taxels = taxels[::-1]
    numbered = room is None or (_NUMBERED * len(xs) <= room[0] and len(ys) <= room[1])
    if pressures is None:
        return Text(("   ?" * len(xs) + "\n") * len(ys) if numbered else "?\n", "dim")
    share = np.clip(pressures / max(float(np.max(pressures, initial=0.0)), 1e-9), 0.0, 1.0)
    if room is not None and not numbered:
        return _half_blocks(np.where(taxels < 0, np.nan, share[taxels]), room)
    text = Text()
    for row in taxels.tolist():
        for taxel in row:
            if taxel < 0:
                text.append("   -")
                continue
            whole = round(float(pressures[taxel])) + 0  # the integer 0 has no sign
            text.append(
                f"{whole:4d}", f"{'black' if share[taxel] > 0.5 else 'white'} on {_shade(share[taxel])}"
            )
        text.append("\n")
    return text


def _shade(share: float) -> str:
    return "black" if np.isnan(share) else _SCALE[round(float(share) * (len(_SCALE) - 1))]


def _half_blocks(shares: FloatArray, room: tuple[int, int]) -> Text:
    """Draw a character for two taxels, one above the other; black where there is none (NaN)."""
    rows, columns = shares.shape
    every = max(1, -(-columns // room[0]), -(-rows // (2 * room[1])))  # taxels a side that share a place
    filled = np.full((-(-rows // (2 * every)) * 2 * every, -(-columns // every) * every), -1.0)
    filled[:rows, :columns] = np.nan_to_num(shares, nan=-1.0)
    places = filled.reshape(len(filled) // every, every, -1, every).max(axis=(1, 3))
    places[places < 0] = np.nan
    text = Text()
    for above, below in zip(places[::2], places[1::2], strict=True):
        for upper, lower in zip(above, below, strict=True):
            text.append("\u2580", f"{_shade(upper)} on {_shade(lower)}")
        text.append("\n")
    return text
