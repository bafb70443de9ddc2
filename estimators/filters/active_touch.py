"""Active touch around a filter: it proposes the reading that should say most about its belief."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import check_candidates, check_order
from tactsim.estimators.filters.doubts import Doubts
from tactsim.estimators.filters.information import STATES, Planner
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.wrapper import Wrapper
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood


class ActiveTouch(Wrapper):
    """A filter that also proposes readings. Its estimates are the same whether it is asked to or not."""

    def __init__(self, filter: MapFilter | Wrapper) -> None:
        super().__init__(filter)
        self._planner: Planner | None = None
        self._planning: np.random.Generator | None = None

    def fit(self, scan: Scan) -> None:
        """Learn from the training readings, and keep them if a proposal will need what was not learned yet."""
        self.filter.fit(scan)
        self.fitted_to(scan)

    def without(self, letter: str, scan: Scan) -> ActiveTouch:
        """Wrap the filter without the letter."""
        other = copy.copy(self)
        other.filter = self.filter.without(letter, scan)
        other.fitted_to(scan.untrained([letter]))
        return other

    def fitted_to(self, scan: Scan) -> None:
        """Forget what was learned for proposals; the filter was fitted to this scan."""
        self._planner, self._planning = None, None
        self._train = scan.where("train") if self.filter.calibrated is None else None

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        self.filter.reset(rng)
        # Proposals have a random stream of their own. So the filter draws the same numbers whether proposals
        # are asked for or not, and proposals do not depend on how many numbers the filter draws.
        self._planning = rng.spawn(1)[0]

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the sensor_in_robot pose (n, 3) whose reading should say most about the state."""
        check_order(self._planning is not None, "reset" if self.maps else "fit", "propose")
        assert self._planning is not None
        poses = check_candidates(candidates)
        if self._planner is None:
            model = self._calibrated()
            self._planner = Planner(model, self.taxel_xy)
            self._doubts = Doubts(model, self.taxel_xy)
        letter, state = self.weighted_states().draw(STATES, self._planning)
        besides = self.filter.information_on_none(self._doubts, poses)
        return self._planner.choose(poses, letter, state, self._planning, besides)

    def _calibrated(self) -> CalibratedLikelihood:
        """Give the calibrated model that the filter has learned, or learn it and let go of the readings."""
        known: CalibratedLikelihood | None = self.filter.calibrated
        if known is not None:
            return known
        assert self._train is not None
        model = CalibratedLikelihood(self.options)
        model.fit(self._train, self.maps)
        self._train = None
        return model
