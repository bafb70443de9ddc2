"""The log-likelihood of one sequence of readings as a field over letters and poses."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.field.replay import replay
from tactsim.estimators.field.slices import Layout, Slices, laid_out, layout_of
from tactsim.estimators.field.tables import Tables, pooled, tabulate
from tactsim.estimators.field.term_vectors import Vectors, most_vectors, no_vectors, put_in_vectors
from tactsim.estimators.field.terms import Terms, record
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood


class LikelihoodField:
    """log p(readings | letter, T_R^O) for the readings of a sequence so far (paper, eq. 7, summed).

    It holds a likelihood's tables, sampled once, and the terms of all readings; filters ask it and keep
    neither themselves. `len` is the number of readings.

    labels: the letters. taxel_xy: (taxels, 2) mm. tables: on the lattice. terms: of all readings, for
    compiled code. longest: terms of the longest reading.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        labels: Sequence[str],
        taxel_xy: FloatArray,
        spacing: tuple[float, float],
        finest: float,
    ) -> None:
        """Sample the tables for states `spacing` mm apart in x and y, with nodes at most `finest` mm apart.

        Raises ValueError if a table's value is not finite, InputError if there would be too many nodes.
        """
        self.labels, self.taxel_xy = tuple(labels), np.array(taxel_xy, dtype=float)
        self.tables = tabulate(likelihood, labels, spacing, finest)
        self.terms = Terms(
            start=np.zeros(65, dtype=np.int64),
            kind=np.zeros(4096, dtype=np.int64),
            xy=np.zeros((4096, 2)),
            weight=np.zeros(4096, dtype=np.float32),
            constant=np.zeros((64, len(labels))),
            upper=np.zeros(65),
            slack=np.zeros(64),
        )
        self._vectors = no_vectors(64, 512)
        self.reset()

    def __len__(self) -> int:
        return self._readings

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

    def reset(self) -> None:
        """Forget all readings."""
        self._readings = self.longest = self._in_vectors = 0

    def append(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Add the terms of a reading taken at a pose [mm, mm, rad].

        Raises ValueError, and adds nothing, if the likelihood named a table or taxel that does not exist,
        or gave a weight that is negative or not finite.
        """
        count, tables = len(evidence.table), self.tables
        self._make_room(count)
        if not record(
            self.terms, self._readings, evidence.table, evidence.taxel, evidence.weight, self.taxel_xy,
            sensor_in_robot, tables.outside, tables.lowest, tables.highest,
        ):  # fmt: skip
            evidence.check(len(tables.highest), len(self.taxel_xy))
        self._readings += 1
        self.longest = max(self.longest, count)

    def log_p(
        self, letter: ArrayLike, state: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(z | letter, state) over readings first, ..., last - 1, by default all: (n,) nats.

        letter: (n,) or one for all, index into `labels`. state: (3, n) T_R^O mm, mm, rad.
        """
        count = state.shape[1]
        letters = np.full(count, letter, dtype=np.int64)
        log_p = np.zeros(count)
        replay(
            log_p, np.ascontiguousarray(state), letters, self.terms, first,
            self._readings if last is None else last, self.tables.sampled,
        )  # fmt: skip
        return log_p

    @property
    def vectors(self) -> Vectors:
        """Give the terms of all readings in vectors. They are put there only if somebody asks for it."""
        if self._in_vectors < self._readings:
            self._make_room_for_vectors()
            nodes = self.tables.nodes
            put_in_vectors(
                self._vectors, self.terms, self._in_vectors, self._readings, self.tables.unit, nodes[0].size
            )
            self._in_vectors = self._readings
        return self._vectors

    def layout(self, first: FloatArray, spacing: tuple[float, float]) -> Layout:
        """Say where a grid of bins finds what it reads. Arguments as for `slices`."""
        return _layout(self.tables, first, spacing)

    def slices(self, first: FloatArray, spacing: tuple[float, float], wide: int = 1, tall: int = 1) -> Slices:
        """Lay out the tables for a grid of bins, or for upper bounds of blocks of wide x tall bins.

        first: [x, y] mm of the first bin's middle. spacing: of the bins in x and y, mm, as the field was made for.
        """
        tables = self.tables if wide == tall == 1 else pooled(self.tables, wide, tall)
        outside = np.zeros(len(tables.nodes), dtype=tables.nodes.dtype)
        nodes = laid_out(tables.nodes, tables.nodes.shape, tables.phases, outside)
        return Slices(nodes, tables.unit, _layout(tables, first, (wide * spacing[0], tall * spacing[1])))

    def _make_room(self, count: int) -> None:
        terms = self.terms
        if self._readings == len(terms.slack):
            by_reading = ("start", "constant", "upper", "slack")
            terms = terms._replace(**{name: _doubled(getattr(terms, name)) for name in by_reading})
        while terms.start[self._readings] + count > len(terms.kind):
            by_term = ("kind", "xy", "weight")
            terms = terms._replace(**{name: _doubled(getattr(terms, name)) for name in by_term})
        self.terms = terms

    def _make_room_for_vectors(self) -> None:
        vectors, start = self._vectors, self.terms.start
        new = np.diff(start[self._in_vectors : self._readings + 1])
        while len(vectors.places) <= self._readings:
            vectors = vectors._replace(places=_doubled(vectors.places), terms=_doubled(vectors.terms))
        filled = max(vectors.places[self._in_vectors], vectors.terms[self._in_vectors])
        while len(vectors.at_place) < filled + sum(most_vectors(int(count)) for count in new):
            by_vector = ("at_place", "x", "y", "factor", "table")
            vectors = vectors._replace(**{name: _doubled(getattr(vectors, name)) for name in by_vector})
        self._vectors = vectors


def _layout(tables: Tables, first: FloatArray, spacing: tuple[float, float]) -> Layout:
    return layout_of(tables.nodes.shape, tables.phases, np.concatenate([first - tables.origin, spacing]))


def _doubled(array: np.ndarray) -> np.ndarray:
    return np.concatenate([array, np.zeros_like(array)])
