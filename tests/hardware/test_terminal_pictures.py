"""Pictures for the terminal: which taxel is drawn where, and what becomes of those for which there is no room."""

import numpy as np
import pytest
from rich.console import Console

from tactsim.core.pad import Pad
from tactsim.hardware.terminal_pictures import tactile_image

PAD = Pad(rows=4, columns=6, seam=None, unread_columns=0)
DARK, BRIGHT = "rgb(20,18,46)", "rgb(252,255,164)"  # nothing, and the largest pressure


def colours(text):
    """The ink and paper of each character, line by line."""
    lines = Console(width=200, color_system="truecolor").render_lines(text, pad=False)
    return [
        [
            (segment.style.color.name, segment.style.bgcolor.name)
            for segment in line
            for _ in segment.text
            if segment.style
        ]
        for line in lines
        if any(segment.text.strip() for segment in line)
    ]


def pressed(row, column):
    values = np.zeros(PAD.taxels)
    values[6 * row + column] = 50.0
    return values


@pytest.mark.parametrize(("behind", "column"), [(False, 1), (True, 4)])
def test_half_blocks_show_two_rows_a_line(behind, column):
    drawn = colours(tactile_image(pressed(2, 1), PAD.taxel_xy, behind, room=(6, 2)))
    assert [len(line) for line in drawn] == [6, 6]
    bright = [
        (2 * line + half, at)
        for line, row in enumerate(drawn)
        for at, character in enumerate(row)
        for half in (0, 1)
        if character[half] == BRIGHT
    ]
    assert bright == [(1, column)]  # row 2 from below is the second from above


@pytest.mark.parametrize(("least", "most"), [(0, 9), (790, 1023), (-1023, 12)])
def test_numbers_of_any_length_stand_apart(least, most):
    values = np.linspace(least, most, PAD.taxels).round()
    rows = [list(map(int, line.split())) for line in tactile_image(values, PAD.taxel_xy).plain.splitlines()]
    assert np.array_equal(rows[::-1], values.reshape(4, 6))


def test_the_largest_of_neighbours_stands_for_them():
    drawn = colours(tactile_image(pressed(3, 5), PAD.taxel_xy, room=(3, 1)))
    assert drawn == [[(DARK, DARK), (DARK, DARK), (BRIGHT, DARK)]]


def test_a_masked_taxel_is_black():
    drawn = colours(tactile_image(np.zeros(23), PAD.taxel_xy[1:], room=(6, 2)))
    assert drawn[1][0] == (DARK, "black")
