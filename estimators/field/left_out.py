"""What a measurement model says of training readings that it has not seen: weights and trust are learned from that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tactsim.core import Scan
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.likelihoods.folds import LeftOut, folds, presses
from tactsim.estimators.likelihoods.likelihood import Likelihood, TaxelSum


def unseen(
    likelihood: Likelihood, train: Scan, labels: Sequence[str], whole_positions: bool
) -> Iterator[tuple[TableField, str, int]]:
    """Yield a field, a letter and the number of its training reading, which the field has last and its maps have not.

    Of each reading the taxels count that lie where others were felt. train: what the likelihood was fitted to. labels:
    the letters to ask, and the field's. whole_positions: whether all presses at its position are left out with a
    reading, or as few as may be. Nothing is yielded of a likelihood that cannot leave readings out, or is no sum
    over taxels.
    """
    out = LeftOut.of(train, folds if whole_positions else presses)
    for gone in out:
        rest = likelihood.without(train, gone, labels, whole_positions)
        if not isinstance(rest, TaxelSum):
            return
        cell = rest.options.cell
        field = TableField(rest, labels, train.taxel_xy, (cell, cell), cell)
        for label in labels:
            for k in np.flatnonzero(gone & (train.labels == label)).tolist():
                field.add(rest.evidence(train.readings[k]).of_taxels(out.known[k]), np.array(train.poses[k]))
                yield field, label, k
