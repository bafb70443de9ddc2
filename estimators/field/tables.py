"""A likelihood's tables, sampled on a lattice that fits a filter's states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.kernels import Sampled
from tactsim.estimators.likelihoods.likelihood import TaxelSum

_MOST_NODES = 50_000_000  # of all letters: 100 MB a table
# Nodes are whole numbers up to this: one more, by which a bound may be raised, still fits into 16 bits.
_LARGEST = 32_766


@dataclass(frozen=True, eq=False)
class Tables:
    """Log-likelihood tables of all letters on one lattice, for the kernels.

    nodes: (tables, letters, rows, columns) int16, contiguous, each times `unit` nats, less the value far away, so that
    they are 0 outside and at their rim. unit: a power of 2, the same for all, so that nothing is rounded when they are
    multiplied. The node [row, column] lies at origin + step * [column, row]. phases: (y, x) how many nodes fit into
    the spacing of the states; rows and columns are multiples of it. origin, step: [x, y] mm. outside: (tables, letters)
    the value far away, nats. lowest, highest: (tables,) nats, over all letters and places, far away included.
    """

    nodes: NDArray[np.int16]
    unit: float
    phases: tuple[int, int]
    origin: FloatArray
    step: FloatArray
    outside: FloatArray
    lowest: FloatArray
    highest: FloatArray

    @property
    def sampled(self) -> Sampled:
        """Give the nodes and where they are as `replay` reads them."""
        return Sampled(self.nodes, self.unit, np.concatenate([self.origin, self.step]))


def tabulate(
    likelihood: TaxelSum, labels: Sequence[str], spacing: tuple[float, float], finest: float
) -> Tables:
    """Sample a fitted likelihood where states with the given spacing in x and y (mm) can read it.

    The spacing is divided into the smallest whole number of steps that are at most `finest` mm. Values are rounded to
    whole numbers of a unit, which is at most 1/16,383 of the largest difference from a value far away. Rows and
    columns of nodes beyond which all are as far away are left out.

    Raises ValueError if a value is not finite, InputError for more than 50 million nodes.
    """
    low, high = likelihood.extent
    phases = [max(1, math.ceil(gap / finest - 1e-9)) for gap in spacing]
    step = np.array([gap / count for gap, count in zip(spacing, phases, strict=True)])
    # Two nodes more than the extent, so that the outermost ones are at the outside value.
    counts = [math.ceil((high[i] - low[i]) / step[i]) + 2 for i in (0, 1)]
    if counts[0] * counts[1] * len(labels) > _MOST_NODES:
        raise InputError(
            f"tables of {len(labels)} letters over {high[0] - low[0]:.3g} x {high[1] - low[1]:.3g} mm, for states "
            f"{spacing[0]:.3g} x {spacing[1]:.3g} mm apart, would have more than {_MOST_NODES:,} nodes; choose "
            "another reach, larger cells or another number of bins"
        )
    outside = np.stack([likelihood.log_tables(label, high + 1e6) for label in labels], axis=1)

    def sampled(letter: int, rows: Sequence[int], columns: Sequence[int]) -> FloatArray:
        """Sample the tables of a letter (tables, rows, columns), less the value far away."""
        xy = np.stack(
            np.meshgrid(low[0] + step[0] * np.array(columns), low[1] + step[1] * np.array(rows)), axis=-1
        )
        found = likelihood.log_tables(labels[letter], xy) - outside[:, letter, None, None]
        if not np.isfinite(found).all():
            raise ValueError(f"likelihood {type(likelihood).__name__} gives a value that is not finite")
        return found

    # All letters twice: until all were seen nobody knows the unit and where all are 0, and to keep until then what was
    # sampled would take as much memory again.
    rows, columns = range(counts[1]), range(counts[0])
    largest = [np.zeros(len(rows)), np.zeros(len(columns))]
    for letter in range(len(labels)):
        of_places = np.abs(sampled(letter, rows, columns)).max(axis=0)
        largest = [np.maximum(largest[axis], of_places.max(axis=1 - axis)) for axis in (0, 1)]
    # The smallest power of 2, at least 2^-100, of which at most `_LARGEST` are as much as the largest.
    share, exponent = math.frexp(largest[0].max() / _LARGEST)
    unit = 2.0 ** max(-100, exponent - (share == 0.5)) if share else 2.0**-100
    # The first and last row and column that are not 0 everywhere, and one of zeros on each side.
    filled = [np.flatnonzero(np.rint(part / unit)) for part in largest]
    rows, columns = (range(part[0], part[-1] + 1) if len(part) else range(1, 1) for part in filled)
    shape = (
        -(-(len(part) + 2) // phase) * phase for part, phase in ((rows, phases[1]), (columns, phases[0]))
    )
    nodes = np.zeros((*outside.shape, *shape), dtype=np.int16)
    for letter in range(len(labels)):
        within = nodes[:, letter, 1 : 1 + len(rows), 1 : 1 + len(columns)]
        within[:] = np.rint(sampled(letter, rows, columns) / unit)
    lowest = outside + unit * np.minimum(nodes.min(axis=(2, 3)), 0)
    highest = outside + unit * np.maximum(nodes.max(axis=(2, 3)), 0)
    return Tables(
        nodes=nodes,
        unit=unit,
        phases=(phases[1], phases[0]),
        origin=low + step * np.array([columns.start - 1, rows.start - 1]),
        step=step,
        outside=outside,
        lowest=lowest.min(axis=1),
        highest=highest.max(axis=1),
    )
