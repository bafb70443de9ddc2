"""The eight halves of cells of a grid (compiled)."""

from __future__ import annotations

from numba import void

from tactsim.core.compiling import INTS, INTS_2D, REALS, REALS_2D, Ints, Reals, compiled


@compiled(void(INTS_2D, REALS_2D, INTS, INTS, INTS, INTS, REALS))
def halve(
    half: Ints, state: Reals, letter: Ints, cell: Ints, which: Ints, counts: Ints, spacing: Reals
) -> None:
    """Find the halves, in x, y and angle, of cells of a grid, and the states in their middles.

    cell: (cells,) flat index into (letters, angles, rows, columns). which: (n,) of them, those to halve.
    half: (cells, 8), of which the rows `which` are overwritten with the halves' indices in the grid of their
    size. state: (3, 8 * n) mm, mm, rad, and letter: (8 * n,) are overwritten. counts: columns, rows, angles
    of the grid of the cells. spacing: their size, mm, mm, rad; the grid is centred at 0.
    """
    columns, rows, angles = 2 * counts[0], 2 * counts[1], 2 * counts[2]
    dx, dy, da = spacing[0] / 2, spacing[1] / 2, spacing[2] / 2
    for i in range(len(which)):
        rest, column = divmod(cell[which[i]], counts[0])
        rest, row = divmod(rest, counts[1])
        of, angle = divmod(rest, counts[2])
        for part in range(8):
            x, y, turn = 2 * column + (part & 1), 2 * row + (part >> 1 & 1), 2 * angle + (part >> 2)
            half[which[i], part] = ((of * angles + turn) * rows + y) * columns + x
            k = 8 * i + part
            state[0, k], state[1, k] = (x + 0.5 - columns / 2) * dx, (y + 0.5 - rows / 2) * dy
            state[2, k], letter[k] = (turn + 0.5 - angles / 2) * da, of
