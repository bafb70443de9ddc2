"""The picture of one press through time: what the pad felt on the way, and the contact force."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from tactsim.bench.report.outlines import taxel_size
from tactsim.bench.runs.figures import as_bytes
from tactsim.core import Scan
from tactsim.core.errors import printable

_IMAGES = 8
_BLUE, _GREY = "#1f6fb2", "#666666"


def press_shown(scan: Scan) -> int:
    """Choose the press to draw: of those that touched, the one with the most taxels in contact."""
    images, _, force = _sequence(scan)
    rest = images[:, -1]
    felt = np.count_nonzero(rest > 0.3 * rest.max(axis=1, keepdims=True), axis=1)
    return int(np.argmax(np.where(force[:, -1] > 0, felt, -1)))


def images_shown(force: NDArray[Any]) -> list[int]:
    """Choose the frames to draw: from the one before touch until the force stays within 2 % of its end."""
    first = max(int(np.argmax(force > 0)) - 1, 0)
    away = np.flatnonzero(np.abs(force - force[-1]) > 0.02 * force[-1])
    last = min(int(away[-1]) + 1 if len(away) else 0, len(force) - 1)
    return sorted({round(k) for k in np.linspace(first, max(last, first), _IMAGES)})


def press_figure(scan: Scan) -> Figure:
    """Draw the images of the press to draw in small, and its force with a mark for each of them."""
    press = press_shown(scan)
    every, times, forces = _sequence(scan)
    images, force, ms = every[press], forces[press], 1e3 * times
    shown = images_shown(force)
    width, height = taxel_size(scan)
    figure = Figure(figsize=(10, 4.4), layout="constrained", facecolor="white")
    grid = figure.add_gridspec(2, len(shown), height_ratios=(1, 1.7))
    top = float(max(images[shown].max(), 1e-9))
    corners = scan.taxel_xy - (width / 2, height / 2)
    low, high = corners.min(axis=0), corners.max(axis=0) + (width, height)
    patches = None
    for column, frame in enumerate(shown):
        axes = figure.add_subplot(grid[0, column])
        patches = PatchCollection([Rectangle(tuple(at), width, height) for at in corners], cmap="Blues", lw=0)
        patches.set_array(images[frame])
        patches.set_clim(0, top)
        axes.add_collection(patches)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
        axes.set_title(f"{ms[frame]:.0f} ms", fontsize=9)
        axes.spines[:].set_color("#bbbbbb")
    if patches is not None:
        figure.colorbar(patches, ax=figure.axes, label=scan.meta.get("unit", "kPa"), pad=0.01, aspect=12)
    below = figure.add_subplot(grid[1, :])
    below.plot(ms, force, color=_BLUE, lw=1.6)
    below.plot(ms[shown], force[shown], "o", color=_BLUE, ms=5)
    below.axhline(force[-1], color=_GREY, lw=0.8, ls=":")
    below.set(xlabel="ms since the letter began to move", ylabel="contact force, N", ylim=(0, None))
    below.set_xlim(0, ms[min(shown[-1] + max(3, len(ms) // 10), len(ms) - 1)])
    below.grid(lw=0.4, alpha=0.6)
    below.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title(scan, press), fontsize=10, parse_math=False)
    return figure


def _sequence(scan: Scan) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    if scan.sequence is None or scan.sequence_times is None or scan.sequence_force is None:
        raise ValueError("the scan has no sequence")
    return scan.sequence, scan.sequence_times, scan.sequence_force


def title(scan: Scan, press: int) -> str:
    """Say in words which press it is."""
    x, y, angle = scan.poses[press]
    return f"{printable(scan.labels[press])} at x = {x:.1f} mm, y = {y:.1f} mm, {angle:.2f} rad"


def as_data(figure: Figure) -> str:
    """Give a figure as the address of an image that holds it. Equal figures give equal text."""
    return f"data:image/png;base64,{base64.b64encode(as_bytes(figure, dpi=110)).decode()}"
