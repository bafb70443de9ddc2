"""Active touch in space: the next touch is the one whose outcome should say most about object and pose.

What the outcome z of a touch would say of the state s is their mutual information (Lindley 1956),

    I = E_s E_z|s [ log p(z | s) - log E_t p(z | t) ],   s and t from the belief.

Both expectations are taken over one sample of the belief, that over outcomes at the outcome foreseen for s: how far the
pad travels, and what it reads. An outcome's own width is taken as the same for all states.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.solids.field import SpaceField

STATES = 48  # drawn from the belief for one choice
_TRAVEL = 1.0  # mm by which a pad's travel may be off what is foreseen
_IMAGE = 0.2  # of the usual largest pressure, by which a taxel may be off; neighbours share errors
_PLACES = 4.0  # taxels that are as good as independent


def information(
    field: SpaceField, label: NDArray[np.int64], pose: FloatArray, candidates: FloatArray
) -> FloatArray:
    """Estimate the expected information (k,) nats of touches that start at sensor_in_robot poses (k, 7).

    label: (states,), pose: (states, 7) object_in_robot, equally probable. It is at most log(states).
    """
    count = len(candidates)
    travel, image = [], []
    for one, place in zip(label.tolist(), pose, strict=True):
        gone, seen = field.foresee(one, np.broadcast_to(place, (count, 7)), candidates)
        travel.append(gone)
        image.append(seen)
    gone, seen = np.stack(travel, axis=1), np.stack(image, axis=1)  # (k, states), (k, states, taxels)
    largest = seen.max(axis=2)
    width = _IMAGE * float(np.median(largest[largest > 0])) if (largest > 0).any() else 1.0
    squares = (seen**2).sum(axis=2)
    apart = np.maximum(
        squares[:, :, None] + squares[:, None, :] - 2 * np.einsum("kst,kut->ksu", seen, seen), 0.0
    )
    off = ((gone[:, :, None] - gone[:, None, :]) / _TRAVEL) ** 2
    off += apart * (_PLACES / seen.shape[2] / width**2)
    return np.asarray(-np.log(np.exp(-0.5 * off).mean(axis=2)).mean(axis=1), dtype=float)
