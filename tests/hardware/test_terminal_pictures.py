"""Pictures for the terminal: which taxel is drawn where, and what becomes of those for which there is no room."""

import numpy as np
import pytest
from rich.console import Console

from tactsim.core.pad import Pad
from tactsim.hardware.terminal_pictures import on_template, placement, tactile_image, where

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


def test_the_largest_of_neighbours_stands_for_them():
    drawn = colours(tactile_image(pressed(3, 5), PAD.taxel_xy, room=(3, 1)))
    assert drawn == [[(DARK, DARK), (DARK, DARK), (BRIGHT, DARK)]]


def test_a_masked_taxel_is_black():
    drawn = colours(tactile_image(np.zeros(23), PAD.taxel_xy[1:], room=(6, 2)))
    assert drawn[1][0] == (DARK, "black")


def test_numbers_stand_where_there_is_room():
    text = tactile_image(pressed(0, 0), PAD.taxel_xy, room=(24, 4)).plain
    assert text.splitlines()[3] == "  50   0   0   0   0   0"
    assert tactile_image(None, PAD.taxel_xy, room=(24, 4)).plain.splitlines() == ["   ?" * 6] * 4
    assert tactile_image(None, PAD.taxel_xy, room=(6, 2)).plain == "?\n"


@pytest.mark.parametrize("cell", [1.0, 1.5, 2.3])
def test_the_placement_reaches_as_far_as_it_is_said(cell):
    lines = placement(np.zeros(3), PAD, lambda points: points[:, 0] > 0, False, 27.0, cell).plain.splitlines()
    assert {len(line) for line in lines} == {int(54 / cell + 1e-9)}
    assert len(lines) == int(27 / cell + 1e-9)
    middle = len(lines[0]) // 2
    assert all(set(line[:middle]) <= set(" .") for line in lines)
    assert all(set(line[-middle:]) <= set("+#") for line in lines)


def test_the_words_say_what_the_drawing_shows():
    pose = np.array([3.4, -10.2, np.deg2rad(330)])
    assert on_template(pose) == "template: x 3.4, y -10.2, arrow at 330"
    assert on_template(np.array([-0.001, 0, 2 * np.pi - 1e-9])) == "template: x 0, y 0, arrow at 0"
    assert where(np.zeros(3) + [2.0, 0, 0], True) == (
        "centre 2.0 mm right, 0.0 mm down of the pad's, 0 degrees counter-clockwise"
    )
    assert len(where(np.array([-11.9, -11.9, 2.9]), False)) <= 80
