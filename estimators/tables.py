"""A likelihood's tables, sampled on a lattice that fits a filter's states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.likelihood import Likelihood
from tactsim.poses import FloatArray


@dataclass(frozen=True, eq=False)
class Tables:
    """Log-likelihood tables of all letters on one lattice, for the kernels.

    values: (tables, letters, phases_y, phases_x, rows, columns) float32, contiguous, less the value
    far away, so that they are 0 outside and at their rim. The lattice node [row * phases_y + phase_y,
    column * phases_x + phase_x] lies at origin + step * [that column, that row]: nodes one bin apart
    are neighbours in memory. origin, step: [x, y] mm. outside: (tables, letters) the value far away.
    lowest, highest: (tables,) over all letters and places, far away included.
    """

    values: NDArray[np.float32]
    origin: FloatArray
    step: FloatArray
    outside: FloatArray
    lowest: FloatArray
    highest: FloatArray


def tabulate(
    likelihood: Likelihood, labels: Sequence[str], spacing: tuple[float, float], finest: float
) -> Tables:
    """Sample a fitted likelihood where states with the given spacing in x and y (mm) can read it.

    The spacing is divided into the smallest whole number of steps that are at most `finest` mm.
    Raises ValueError if a value is not finite.
    """
    low, high = likelihood.extent
    phases = [max(1, math.ceil(gap / finest - 1e-9)) for gap in spacing]
    step = np.array([gap / count for gap, count in zip(spacing, phases, strict=True)])
    # Two nodes more than the extent, so that the outermost ones are at the outside value.
    counts = [
        math.ceil((math.ceil((high[i] - low[i]) / step[i]) + 2) / phases[i]) * phases[i] for i in (0, 1)
    ]
    axes = [low[i] + step[i] * np.arange(counts[i]) for i in (0, 1)]
    xy = np.stack(np.meshgrid(*axes), axis=-1)
    sampled = np.stack([likelihood.log_tables(label, xy) for label in labels], axis=1)
    outside = np.stack([likelihood.log_tables(label, high + 1e6) for label in labels], axis=1)
    if not (np.isfinite(sampled).all() and np.isfinite(outside).all()):
        raise ValueError(f"likelihood {type(likelihood).__name__} gives a value that is not finite")
    values = (sampled - outside[:, :, None, None]).astype(np.float32)
    return Tables(
        values=_by_phase(values, phases[1], phases[0]),
        origin=low,
        step=step,
        outside=outside,
        lowest=np.minimum(sampled.min(axis=(1, 2, 3)), outside.min(axis=1)),
        highest=np.maximum(sampled.max(axis=(1, 2, 3)), outside.max(axis=1)),
    )


def _by_phase(values: NDArray[np.float32], phases_y: int, phases_x: int) -> NDArray[np.float32]:
    """Bring nodes that are one bin apart together: (..., rows, columns) to (..., py, px, rows, columns)."""
    kinds, labels, rows, columns = values.shape
    split = values.reshape(kinds, labels, rows // phases_y, phases_y, columns // phases_x, phases_x)
    return np.ascontiguousarray(split.transpose(0, 1, 3, 5, 2, 4))
