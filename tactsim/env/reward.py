"""`Reward`: what a touch costs, what information is worth, and what a label earns."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from tactsim.core.checking import Settings
from tactsim.core.poses import FloatArray


class Reward(Settings):
    """The weights of the reward.

    A touch earns `information * (H before - H after) - touch_cost`, H = -sum p log p being the entropy (nats) of the
    belief over the labels. An action that stops earns `right` if its label is the right one, else `-wrong`.

    The information is that of the belief, not of the truth: from its rewards a policy learns of the object only what
    it observes. Over an episode the information adds up to H(start) - H(end), whatever the order of the touches.
    """

    right: float = Field(1.0, ge=0, description="earned by the right label")
    wrong: float = Field(1.0, ge=0, description="lost by a wrong one")
    touch_cost: float = Field(0.02, ge=0, description="lost by each touch")
    information: float = Field(0.0, ge=0, description="earned for each nat; needs a belief")


def entropy(probabilities: FloatArray) -> FloatArray:
    """Compute the entropy (nats) of probabilities (..., labels)."""
    p = np.asarray(probabilities, dtype=float)
    return -np.where(p > 0, p * np.log(np.where(p > 0, p, 1.0)), 0.0).sum(axis=-1)
