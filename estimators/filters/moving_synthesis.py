"""Analysis by synthesis of an object that moves between touches: the moving belief, weighed by presses."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tactsim.core.forward import ForwardModel
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.moving import Moving
from tactsim.estimators.filters.states import WeightedStates
from tactsim.estimators.filters.synthesis import Synthesis


class MovingSynthesis(Moving):
    """`synthesis`, and beside it a belief that moves, from the reading on that says where the object is.

    Its states are weighed with presses at each of them, so that the forward model need not be linear as far as the
    object may have moved.
    """

    filter: Synthesis  # type: ignore[assignment]  # it has all that is asked of a filter here
    uses_forward_model = True

    def bring(self, forward: ForwardModel) -> None:
        """Take the forward model that predicts readings of the scan's objects, from `fit` on."""
        super().bring(forward)
        self.filter.bring(forward)

    @property
    def _located(self) -> bool:
        return self.filter.located

    @property
    def _touches(self) -> int:
        return self.filter.touches

    def _log_p(self, letter: int, state: FloatArray, touch: int) -> FloatArray:
        return self.filter.log_p(letter, state, touch)

    def _foretold(self, belief: WeightedStates, reading: ArrayLike, sensor_in_robot: ArrayLike) -> float:
        """Update the filter; returns how much its evidence grew, which its modes know without presses."""
        before = self.filter.log_evidence()
        self.filter.update(reading, sensor_in_robot)
        return self.filter.log_evidence() - before
