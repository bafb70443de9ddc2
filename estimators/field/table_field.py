"""The field of a model that is a sum over taxels: its tables, sampled once, and the terms of all readings."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.kernels import LANES, Lattice, Named, Ranges, Sampled, Terms, record, replay
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum

_MOST_NODES = 50_000_000  # of all letters: 100 MB a table
_MOST_KEPT = 12_500_000  # values that are kept until they can be rounded: 100 MB
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
        return likelihood.log_tables(labels[letter], xy) - outside[:, letter, None, None]

    # Until all letters were seen nobody knows the unit and where all are 0. To keep until then what was sampled would
    # take four times the memory; of many letters all are sampled twice.
    rows, columns = range(counts[1]), range(counts[0])
    largest, kept = [np.zeros(len(rows)), np.zeros(len(columns))], dict[int, FloatArray]()
    for letter in range(len(labels)):
        found = sampled(letter, rows, columns)
        if outside.size * found[0].size <= _MOST_KEPT:
            kept[letter] = found
        of_places = np.maximum(found.max(axis=0), -found.min(axis=0))
        if not np.isfinite(of_places).all():
            raise ValueError(f"likelihood {type(likelihood).__name__} gives a value that is not finite")
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
        if letter in kept:
            found = kept.pop(letter)[:, rows.start : rows.stop, columns.start : columns.stop]
        else:
            found = sampled(letter, rows, columns)
        found *= 1 / unit
        within[:] = np.rint(found, out=found)
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


class TableField(LikelihoodField):
    """The fast lane: tables on a lattice, and the terms of all readings, for compiled code.

    tables: on the lattice. terms: of all readings.
    """

    def __init__(
        self,
        likelihood: TaxelSum,
        labels: Sequence[str],
        taxel_xy: FloatArray,
        spacing: tuple[float, float],
        finest: float,
    ) -> None:
        """Sample the tables for states `spacing` mm apart in x and y, with nodes at most `finest` mm apart.

        Raises ValueError if a table's value is not finite, InputError if there would be too many nodes.
        """
        super().__init__(labels)
        self._likelihood, self.taxel_xy = likelihood, np.array(taxel_xy, dtype=float)
        self.tables = tabulate(likelihood, labels, spacing, finest)
        self.terms = Terms(
            loads=likelihood.loads,
            start=np.zeros(64 * likelihood.loads + 1, dtype=np.int64),
            kind=np.zeros(4096, dtype=np.int64),
            xy=np.zeros((4096, 2)),
            weight=np.zeros(4096, dtype=np.float32),
            constant=np.zeros((64 * likelihood.loads, len(labels))),
            upper=np.zeros(65),
            slack=np.zeros(64),
        )
        self._ranges = Ranges(self.tables.outside, self.tables.lowest, self.tables.highest)
        self.reset()

    @cached_property
    def alike(self) -> NDArray[np.int64]:
        """Give for each letter (letters,) the number of the first whose tables are equal to its own, bit by bit.

        Such letters are one hypothesis: no reading can tell them apart.
        """
        first: dict[bytes, int] = {}
        nodes, outside = self.tables.nodes, self.tables.outside
        digests = [
            hashlib.sha256(nodes[:, letter].tobytes() + outside[:, letter].tobytes()).digest()
            for letter in range(len(self.labels))
        ]
        return np.array([first.setdefault(digest, letter) for letter, digest in enumerate(digests)])

    def append(self, reading: FloatArray, sensor_in_robot: FloatArray) -> None:
        """Add a reading (taxels,) kPa, taken at a pose [mm, mm, rad]."""
        self.add(self._likelihood.evidence(reading), sensor_in_robot)

    def add(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Add the terms of a reading taken at a pose [mm, mm, rad].

        Raises ValueError, and adds nothing, if the likelihood named a table or taxel that does not exist,
        or gave a weight that is negative or not finite.
        """
        if self._readings == len(self.terms.slack):
            self.terms = _with_room(self.terms, ("start", "constant", "upper", "slack"))
        filled = self.terms.start[self._readings * self.terms.loads]
        while filled + len(evidence.table) > len(self.terms.kind):
            self.terms = _with_room(self.terms, ("kind", "xy", "weight"))
        ends = np.full(self.terms.loads, len(evidence.table))
        if evidence.load is not None:
            ends = np.searchsorted(evidence.load, np.arange(self.terms.loads), side="right")
        named = Named(evidence.table, evidence.taxel, evidence.weight, ends)
        if not record(self.terms, self._readings, named, self.taxel_xy, sensor_in_robot, self._ranges):
            evidence.check(len(self.tables.highest), len(self.taxel_xy))
        self._readings += 1

    def log_p(
        self, letter: ArrayLike, state: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(z | letter, state) over some readings, see `LikelihoodField.log_p`."""
        log_p = np.zeros((1, state.shape[1]))
        return self._add(log_p, letter, state, first, self._readings if last is None else last)[0]

    def each(self, letter: ArrayLike, state: FloatArray, first: int, last: int) -> FloatArray:
        """Give log p(z | letter, state) of some readings, see `LikelihoodField.each`."""
        return self._add(np.zeros((last - first, state.shape[1])), letter, state, first, last)

    def _add(
        self, log_p: FloatArray, letter: ArrayLike, state: FloatArray, first: int, last: int
    ) -> FloatArray:
        letters = np.full(state.shape[1], letter, dtype=np.int64)
        replay(log_p, np.ascontiguousarray(state), letters, self.terms, first, last, self.tables.sampled)
        return log_p

    def bound(self, first: int = 0) -> float:
        """Give an upper bound of log p of readings first and later, nats, for any letter and state."""
        return float(self.terms.upper[self._readings] - self.terms.upper[first])

    def lattice(self, first: FloatArray, spacing: FloatArray) -> Lattice:
        """Lay out the tables for the planes of a grid of bins.

        first: [x, y] mm of the first bin's middle. spacing: of the bins in x and y, mm, as the field was made for.
        """
        tables, (phases_y, phases_x) = self.tables, self.tables.phases
        kinds, letters, rows, columns = tables.nodes.shape
        shape = kinds, letters, phases_y, phases_x, rows // phases_y, columns // phases_x
        split = tables.nodes.reshape(kinds, letters, shape[4], phases_y, shape[5], phases_x)
        flat = np.zeros(math.prod(shape[:5]) * (shape[5] + LANES) + LANES, dtype=np.int16)
        flat[:-LANES].reshape(*shape[:5], -1)[..., LANES:] = split.transpose(0, 1, 3, 5, 2, 4)
        place = np.concatenate([first - tables.origin, spacing])
        return Lattice(flat, tables.unit, np.array(shape), place)


def _with_room(terms: Terms, names: Sequence[str]) -> Terms:
    """Make arrays twice as long."""
    longer: dict[str, Any] = {
        name: np.concatenate([(old := getattr(terms, name)), np.zeros_like(old)]) for name in names
    }
    return terms._replace(**longer)
