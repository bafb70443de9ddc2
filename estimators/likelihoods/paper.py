"""The paper's own measurement model: classes, looked up in the occupancy map (paper, section III-A)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify, threshold_of
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, sigmoid
from tactsim.estimators.options import MapOptions


class PaperOptions(MapOptions):
    """The parameters of eq. 7."""

    gamma: float = Field(0.1, ge=1e-300, lt=1, description="gamma of eq. 7: how often the classifier fails")
    failure: Literal["printed", "complement"] = Field(
        "printed", description="No Contact after a failure in eq. 7: p(m) as printed, or 1 - p(m)"
    )


class PaperLikelihood(TaxelSum):
    """Classes In Contact and No Contact, looked up in the occupancy map (paper, eq. 3 and 7)."""

    options_type = PaperOptions
    options: PaperOptions

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Keep the maps; eq. 7 has nothing to learn."""
        super().fit(scan, maps)
        self._threshold = threshold_of(self.options.threshold, scan.where("train").readings)

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate log p(No Contact | xy) and log p(In Contact | xy) of eq. 7: (2, ...).

        With probability gamma the class is random. Then eq. 7 prints p(m) for both classes; with
        `failure="complement"` No Contact gets 1 - p(m), so that the two sum to one.
        """
        gamma, prior = self.options.gamma, self.options.prior
        odds = self.maps[label].log_odds_at(xy)
        random_no_contact = prior if self.options.failure == "printed" else 1 - prior
        tables = np.empty((2, *odds.shape))
        tables[NO_CONTACT] = np.log(gamma * random_no_contact + (1 - gamma) * sigmoid(-odds))
        tables[CONTACT] = np.log(gamma * prior + (1 - gamma) * sigmoid(odds))
        return tables

    def evidence(self, reading: FloatArray) -> Evidence:
        """Classify the taxels; an Unknown one has likelihood 1 everywhere, hence no term."""
        return Evidence.of_classes(classify(reading, self._threshold, self.options.ratio), with_unknown=False)
