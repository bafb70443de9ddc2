"""What touches a hidden solid in a trial: one pad, or the pads of a hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.space.config import SpaceConfig
from tactsim.bench.space.trials import Touching
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.models import Solid
    from tactsim.press.space import SpacePress


@dataclass(frozen=True, eq=False)
class OnePad:
    """One pad that comes along its normal, with the errors and the noise of the scan's touches."""

    press: SpacePress

    def touch(
        self, label: str, start: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Touch from one start (7,) in the object frame; see `trials.Touching`."""
        touched = self.press.sensed(self.press.touch(label, start[None], rng), rng)
        return touched.readings, touched.stated, touched.met


def pads(solids: list[Solid], config: SpaceConfig) -> Touching:
    """Make what a run touches with."""
    from tactsim.press.space import SpacePress

    return OnePad(SpacePress(solids, config.scan_options))
