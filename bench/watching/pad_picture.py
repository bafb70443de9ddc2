"""A pad's pressures as a picture of characters: numbers on colours, or colours alone where the pad is too large."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray

# Colours from nothing to the largest pressure, one brighter than the other (after matplotlib's inferno).
_STOPS = np.array([(20, 18, 46), (87, 16, 110), (188, 55, 84), (249, 142, 9), (252, 255, 164)], dtype=float)
_SIGNS = " .:-=+*#%@"  # the same where there is no colour
_LEFT_OUT, _STUCK, _LOST = "x", "=", "·"


def shade(share: float) -> tuple[int, int, int]:
    """Give the colour (red, green, blue) of a pressure, as its share of the largest; below 0 and above 1 is cut."""
    place = min(max(share, 0.0), 1.0) * (len(_STOPS) - 1)
    low = min(int(place), len(_STOPS) - 2)
    red, green, blue = np.rint(_STOPS[low] + (place - low) * (_STOPS[low + 1] - _STOPS[low])).astype(int)
    return int(red), int(green), int(blue)


def pad_picture(
    pressures: FloatArray | None,
    pad: Pad,
    scale: float,
    *,
    marks: dict[int, str],
    width: int,
    height: int,
    from_behind: bool,
    colours: bool = True,
) -> Text:
    """Draw the pressures (taxels,) kPa of a pad within `width` x `height` characters, its row 0 at the bottom.

    pressures: None draws an empty pad. scale: kPa of the brightest colour. marks: taxel to sign, of those that are
    left out or stuck. from_behind: left and right are exchanged. Taxels that there is no room for are drawn together,
    as the largest of their pressures.
    """
    numbers = np.arange(pad.taxels).reshape(pad.rows, pad.columns)[::-1]
    if from_behind:
        numbers = numbers[:, ::-1]
    wide, high = min(width // pad.columns, 6), min(height // pad.rows, 2)
    if wide >= 4 and high >= 1:
        return _with_numbers(pressures, numbers, scale, marks, wide, high, colours)
    return _without_numbers(pressures, numbers, scale, width, height, colours)


def scale_bar(scale: float, width: int, colours: bool = True) -> Text:
    """Draw what the colours mean: from 0 to `scale` kPa, `width` characters with the numbers."""
    last = f" {scale:g} kPa"
    text = Text("0 ")
    for place in np.linspace(0, 1, max(width - 2 - len(last), 2)):
        text.append(*_cell(float(place), " ", colours))
    return text.append(last)


def marked(left_out: tuple[int, ...], stuck: tuple[int, ...]) -> dict[int, str]:
    """Give each taxel that is left out, or stuck, its sign."""
    return dict.fromkeys(stuck, _STUCK) | dict.fromkeys(left_out, _LEFT_OUT)


def _with_numbers(
    pressures: FloatArray | None,
    numbers: NDArray[np.int64],
    scale: float,
    marks: dict[int, str],
    wide: int,
    high: int,
    colours: bool,
) -> Text:
    text = Text()
    for row in numbers.tolist():
        for line in range(high):
            for taxel in row:
                sign = marks.get(taxel, "")
                value = np.nan if pressures is None else float(pressures[taxel])
                if np.isnan(value):
                    text.append(f"{(sign or _LOST) if line == high - 1 else '':>{wide}}", "dim")
                    continue
                word = f"{sign}{round(value) + 0}" if line == high - 1 else ""  # the integer 0 has no sign
                share = value / scale
                text.append(f"{word:>{wide}}", _style(share, "white" if share < 0.6 else "black", colours))
            text.append("\n")
    return text


def _without_numbers(
    pressures: FloatArray | None,
    numbers: NDArray[np.int64],
    scale: float,
    width: int,
    height: int,
    colours: bool,
) -> Text:
    if pressures is None:
        return Text(_LOST * min(width, numbers.shape[1]), "dim")
    lines = 2 * height if colours else height  # a half block has two colours
    together = max(-(-numbers.shape[1] // width), -(-numbers.shape[0] // lines), 1)
    shares = np.nan_to_num(pressures, nan=0.0)[numbers] / scale
    rows, columns = (-(-size // together) for size in numbers.shape)
    padded = np.full((rows * together, columns * together), -np.inf)
    padded[: shares.shape[0], : shares.shape[1]] = shares
    largest = padded.reshape(rows, together, columns, together).max(axis=(1, 3))
    text = Text()
    if not colours:
        for row in largest:
            for share in row:
                text.append(*_cell(float(share), " ", colours))
            text.append("\n")
        return text
    if rows % 2:
        largest = np.vstack([largest, np.full(columns, -np.inf)])
    for upper, lower in zip(largest[::2], largest[1::2], strict=True):
        for above, below in zip(upper, lower, strict=True):
            style = _style(float(below), "", colours) if np.isfinite(below) else ""
            text.append("▀", f"rgb({','.join(map(str, shade(float(above))))}) {style}")
        text.append("\n")
    return text


def _cell(share: float, sign: str, colours: bool) -> tuple[str, str]:
    if colours:
        return sign, _style(share, "", colours)
    return _SIGNS[round(min(max(share, 0.0), 1.0) * (len(_SIGNS) - 1))], ""


def _style(share: float, ink: str, colours: bool) -> str:
    return f"{ink} on rgb({','.join(map(str, shade(share)))})" if colours else ""
