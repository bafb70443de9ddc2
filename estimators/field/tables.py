"""A likelihood's tables, sampled on a lattice that fits a filter's states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.likelihood import Likelihood

_MOST_NODES = 50_000_000  # of all letters: 400 MB a table while they are made


@dataclass(frozen=True, eq=False)
class Tables:
    """Log-likelihood tables of all letters on one lattice, for the kernels.

    nodes: (tables, letters, rows, columns) float32, contiguous, less the value far away, so that they are 0 outside
    and at their rim. The node [row, column] lies at origin + step * [column, row]. phases: (y, x) how many nodes fit
    into the spacing of the states; rows and columns are multiples of it. origin, step: [x, y] mm. outside: (tables,
    letters) the value far away. lowest, highest: (tables,) over all letters and places, far away included.
    """

    nodes: NDArray[np.float32]
    phases: tuple[int, int]
    origin: FloatArray
    step: FloatArray
    outside: FloatArray
    lowest: FloatArray
    highest: FloatArray

    @property
    def lattice(self) -> FloatArray:
        """Give [x, y] of the first of `nodes` and the steps between them in x and y (4,), mm."""
        return np.concatenate([self.origin, self.step])


def tabulate(
    likelihood: Likelihood, labels: Sequence[str], spacing: tuple[float, float], finest: float
) -> Tables:
    """Sample a fitted likelihood where states with the given spacing in x and y (mm) can read it.

    The spacing is divided into the smallest whole number of steps that are at most `finest` mm.
    Raises ValueError if a value is not finite, InputError for more than 50 million nodes.
    """
    low, high = likelihood.extent
    phases = [max(1, math.ceil(gap / finest - 1e-9)) for gap in spacing]
    step = np.array([gap / count for gap, count in zip(spacing, phases, strict=True)])
    # Two nodes more than the extent, so that the outermost ones are at the outside value.
    counts = [
        math.ceil((math.ceil((high[i] - low[i]) / step[i]) + 2) / phases[i]) * phases[i] for i in (0, 1)
    ]
    if counts[0] * counts[1] * len(labels) > _MOST_NODES:
        raise InputError(
            f"tables of {len(labels)} letters over {high[0] - low[0]:.3g} x {high[1] - low[1]:.3g} mm, for states "
            f"{spacing[0]:.3g} x {spacing[1]:.3g} mm apart, would have more than {_MOST_NODES:,} nodes; choose "
            "another reach, larger cells or another number of bins"
        )
    axes = [low[i] + step[i] * np.arange(counts[i]) for i in (0, 1)]
    xy = np.stack(np.meshgrid(*axes), axis=-1)
    outside = np.stack([likelihood.log_tables(label, high + 1e6) for label in labels], axis=1)
    nodes = np.empty((*outside.shape, *xy.shape[:2]), dtype=np.float32)
    lowest, highest = outside.min(axis=1), outside.max(axis=1)
    for number, label in enumerate(labels):  # float64 for one letter at a time
        sampled = likelihood.log_tables(label, xy)
        if not (np.isfinite(sampled).all() and np.isfinite(outside[:, number]).all()):
            raise ValueError(f"likelihood {type(likelihood).__name__} gives a value that is not finite")
        nodes[:, number] = sampled - outside[:, number, None, None]
        lowest = np.minimum(lowest, sampled.min(axis=(1, 2)))
        highest = np.maximum(highest, sampled.max(axis=(1, 2)))
    return Tables(
        nodes=nodes,
        phases=(phases[1], phases[0]),
        origin=low,
        step=step,
        outside=outside,
        lowest=lowest,
        highest=highest,
    )


def pooled(tables: Tables, wide: int, tall: int) -> Tables:
    """Bound what blocks of wide x tall bins read: tables with the blocks' spacing.

    Each node gets the largest value of the nodes that the bins of a block beginning there can take
    for it. So a block's sum, interpolated as if it were one bin, is not below that of any of its bins.
    """
    (phases_y, phases_x), nodes = tables.phases, tables.nodes
    # Nodes a block spans, in y and x: it reaches the lattice from as far outside.
    spans = ((tall - 1) * phases_y + 1, (wide - 1) * phases_x + 1)
    for axis, (span, phases) in enumerate(zip(spans, (tall * phases_y, wide * phases_x), strict=True), 2):
        count = math.ceil((nodes.shape[axis] + span + 1) / phases) * phases
        frame = [(0, 0)] * 4
        frame[axis] = (span, count - nodes.shape[axis] - 1)
        nodes = _sliding_maximum(np.pad(nodes, frame), span, axis)
    return replace(
        tables,
        nodes=np.ascontiguousarray(nodes),
        phases=(tall * phases_y, wide * phases_x),
        origin=tables.origin - np.array(spans[::-1]) * tables.step,
    )


def _sliding_maximum(values: NDArray[np.float32], span: int, axis: int) -> NDArray[np.float32]:
    """Take the maximum over `span` neighbours along an axis: [i] becomes the largest of [i : i + span]."""
    values = np.moveaxis(values, axis, -1)
    reached = 1
    while reached < span:
        step = min(reached, span - reached)
        values = np.maximum(values[..., :-step], values[..., step:])
        reached += step
    return np.moveaxis(values, -1, axis)
