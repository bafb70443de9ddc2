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
_CELL = (1.0, 2.0)  # mm of one character: twice as high as wide


def placement(
    sensor_in_object: FloatArray, pad: Pad, covers: Covers | None, from_behind: bool, reach: float = 27.0
) -> Text:
    """Draw where the object lies on the pad: `#` on taxels that are read, `+` beside them, `.` the pad.

    covers(points): which of the points (n, 2) mm of the object's frame lie on the object; None draws its
    origin `o` and its x axis `->` instead. from_behind: the object is pressed face down and seen from
    its back, so left and right are exchanged. The drawing reaches `reach` mm to all sides.
    """
    x = np.arange(-reach + _CELL[0] / 2, reach, _CELL[0])
    y = np.arange(reach - _CELL[1] / 2, -reach, -_CELL[1])
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
            near = int(np.argmin(np.abs((points - place) / _CELL).max(axis=1)))
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
    return f"centre {across} and {along} of the pad's middle, turned {turned} degrees counter-clockwise"


def tactile_image(pressures: FloatArray, taxel_xy: FloatArray, from_behind: bool = False) -> Text:
    """Draw pressures (taxels,) kPa where the taxels (taxels, 2) mm lie, the numbers in whole kPa."""
    xs, columns = np.unique(np.round(taxel_xy[:, 0], 3), return_inverse=True)
    ys, rows = np.unique(np.round(taxel_xy[:, 1], 3), return_inverse=True)
    taxels = np.full((len(ys), len(xs)), -1)
    taxels[rows, columns] = np.arange(len(taxel_xy))
    if from_behind:
        taxels = taxels[:, ::-1]
    largest = max(float(np.max(pressures, initial=0.0)), 1e-9)
    text = Text()
    for row in taxels[::-1]:
        for taxel in row:
            if taxel < 0:
                text.append("   -")
                continue
            share = min(max(float(pressures[taxel]) / largest, 0.0), 1.0)
            shade = _SCALE[round(share * (len(_SCALE) - 1))]
            whole = round(float(pressures[taxel])) + 0  # the integer 0 has no sign
            text.append(f"{whole:4d}", f"{'black' if share > 0.5 else 'white'} on {shade}")
        text.append("\n")
    return text
