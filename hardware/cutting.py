"""Cut the readings of a large array into touches of a small window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray, compose
from tactsim.core.scan import SPLITS, Scan

_ALIKE = 1e-3  # mm


def cut(
    scan: Scan, rows: int, columns: int, stride: int = 1, touching: tuple[int, float] | None = None
) -> Scan:
    """Cut each reading of a large array into windows of `rows` x `columns` taxels, as a small pad feels them.

    Each window becomes a reading of its own, at the pose of its middle. Windows lie on a lattice: one every `stride`
    taxels along both axes. Those of test readings lie between those of training readings, half a stride on along each
    axis, because an object that was not moved would else be felt twice at the same poses, as it never is in use. With
    stride 1 training readings take the white fields of a chessboard and test readings the black ones. Where the array
    has room for one lattice only, both take that, and `meta["cut"]["apart"]` is false.

    The array may lack taxels, as a masked one does: a window that would hold a missing taxel is left out, so that all
    have the same taxels and no reading is made up. touching: a number of taxels and a reading in the scan's unit; a
    window in which fewer taxels read more than that is left out, too. `meta["cut"]` says how many taxels are missing
    and how many windows a press gives in each split. Loads stay the whole press's, and `presses` says which it was;
    sequences are left out.

    Raises InputError if the window does not fit, the taxels are not evenly spaced, or no window is whole.
    """
    presses = scan.press_numbers
    scan = replace(scan, presses=presses, sequence=None, sequence_times=None, sequence_force=None)
    grid = taxel_grid(scan.taxel_xy)
    if not (1 <= rows <= grid.shape[0] and 1 <= columns <= grid.shape[1] and stride >= 1):
        raise InputError(
            f"a window of {rows}x{columns}, stride {stride}, cannot be cut from {grid.shape[0]}x{grid.shape[1]} "
            "taxels"
        )
    places, apart = _places(grid.shape[0] - rows + 1, grid.shape[1] - columns + 1, stride)
    pieces, windows_of, layout = [], {}, None
    for split in SPLITS:
        windows = [grid[r : r + rows, c : c + columns].ravel() for r, c in places[split]]
        windows = [window for window in windows if (window >= 0).all()]
        windows_of[split] = len(windows)
        half = scan.where(split)
        for window in windows:
            xy = scan.taxel_xy[window]
            middle = xy.mean(axis=0)
            layout = xy - middle if layout is None else layout
            if np.abs(xy - middle - layout).max() > _ALIKE:
                raise InputError(
                    "the taxels are not evenly spaced, so windows of them differ; cut one array at a time"
                )
            felt = half
            if touching is not None:
                felt = half.chosen((half.readings[:, window] > touching[1]).sum(axis=1) >= touching[0])
            poses = compose(felt.poses, [*middle, 0.0])
            pieces.append(replace(felt, readings=felt.readings[:, window], poses=poses, taxel_xy=layout))
        if len(half) and not windows:
            raise InputError(
                f"no window of {rows}x{columns} taxels is whole in the {split}ing readings: "
                f"{np.count_nonzero(grid < 0)} of {grid.size} taxels are missing; cut smaller windows"
            )
    assert layout is not None  # a split without a window was refused above
    about = {
        "rows": rows, "columns": columns, "stride": stride, "readings": len(scan), "apart": apart,
        "windows": windows_of, "missing": int(np.count_nonzero(grid < 0)),
    }  # fmt: skip
    whole = {
        name: np.concatenate([getattr(piece, name) for piece in pieces])
        for name in Scan.PER_READING
        if getattr(scan, name) is not None
    }
    pad = scan.about["pad"]
    if isinstance(pad, dict):  # of an array that is not described nothing is known of a window, either
        pad = {**pad, "rows": rows, "columns": columns, "seam": None, "unread_columns": 0, "unread_rows": 0}
    return Scan(taxel_xy=layout, meta={**scan.meta, "cut": about, "pad": pad}, **whole)


def _places(down: int, along: int, stride: int) -> tuple[dict[str, list[tuple[int, int]]], bool]:
    """List where windows begin, [row, column], for each split, of `down` x `along` places; and whether they differ."""
    if stride == 1:
        every = [(r, c) for r in range(down) for c in range(along)]
        train, test = ([place for place in every if sum(place) % 2 == odd] for odd in (0, 1))
    else:
        train = [(r, c) for r in range(0, down, stride) for c in range(0, along, stride)]
        # An axis without room for half a stride keeps its places; the other one sets the splits apart.
        first = [stride // 2 if stride // 2 < room else 0 for room in (down, along)]
        test = [(r, c) for r in range(first[0], down, stride) for c in range(first[1], along, stride)]
    apart = bool(test) and not set(train) & set(test)
    return {"train": train, "test": test if apart else train}, apart


def taxel_grid(taxel_xy: FloatArray) -> NDArray[np.int64]:
    """Arrange taxels (n, 2) mm in rows (along +y) and columns (along +x): their numbers, -1 where one is missing."""
    (x, column), (y, row) = (_lines(taxel_xy[:, axis]) for axis in (0, 1))
    grid = np.full((y, x), -1, dtype=np.int64)
    grid[row, column] = np.arange(len(taxel_xy))
    return grid


def _lines(places: FloatArray) -> tuple[int, NDArray[np.int64]]:
    """Say how many lines taxels at places (n,) mm along an axis lie on, and on which: also lines that all lack.

    Lines are one pitch apart, which is the smallest distance between two; where they are not, as beside a seam, only
    those that are there count.
    """
    found, which = np.unique(np.round(places, 4), return_inverse=True)
    which = which.reshape(-1).astype(np.int64)
    if len(found) > 1:
        least = np.diff(found).min()
        steps = np.diff(found) / least
        if np.abs(steps - np.round(steps)).max() * least < _ALIKE and steps.sum() < 2 * len(found):
            number = np.concatenate([[0], np.cumsum(np.round(steps))]).astype(np.int64)
            return int(number[-1]) + 1, number[which]
    return len(found), which
