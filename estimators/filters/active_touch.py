"""Active touch: the next reading is the one that is expected to say most about letter and pose.

What a reading z at a sensor pose would say about the state s is their mutual information (Lindley 1956;
Cassandra, Kaelbling and Kurien 1996 for localisation),

    I = E_s E_z|s [ log p(z | s) - log E_t p(z | t) ],   s and t from the belief.

Both expectations over states are taken over the same sample of the belief, that over readings with one
reading drawn for each state. The classes of a reading's taxels are predicted with the calibrated
measurement model, which knows how often each of them comes, whatever model the filter itself uses.
"""

from __future__ import annotations

import math

import numpy as np
from numba import float32, int64, uint64
from numpy.typing import NDArray

from tactsim.core.compiling import Floats2D, Floats3D, Floats4D, Ints1D, Reals1D, Reals2D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.table_field import tabulate
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood

STATES = 256  # drawn from the belief for one choice
_DRAWN = 64  # of them, those for which a reading is drawn too
# All candidates are looked at with every fourth state, then the best quarter with all of them.
_SIFT = 4


@compiled(ordered=False)
def foresee(
    log_p: Floats2D, pose: Reals1D, drawn: Ints1D, letter: Ints1D, state: Reals2D, taxel_xy: Reals2D, nodes: Floats4D,
    lattice: Reals1D, chance: Floats3D,
) -> None:  # fmt: skip
    """Draw a reading at a sensor pose for some states s, and find log p of it for every state t: log_p[s, t].

    pose: sensor_in_robot. drawn: the states s. letter: (states,). state: (3, states) T_R^O. nodes: (letters,
    rows, columns, classes) log p. lattice: [x, y] of node (0, 0), then the step in x and y, mm. chance: (s, taxels,
    classes) of the standard Gumbel distribution: the class where log p + chance is largest is drawn.
    """
    _, rows, columns, classes = nodes.shape
    states, taxels = len(letter), len(taxel_xy)
    predicted = np.empty((taxels, classes, states), dtype=np.float32)
    last_column, last_row = columns - 1.000001, rows - 1.000001
    for t in range(states):
        angle = state[2, t] + pose[2]
        cos, sin = math.cos(angle), math.sin(angle)
        turn_cos, turn_sin = math.cos(state[2, t]), math.sin(state[2, t])
        x = state[0, t] + turn_cos * pose[0] - turn_sin * pose[1] - lattice[0]
        y = state[1, t] + turn_sin * pose[0] + turn_cos * pose[1] - lattice[1]
        for e in range(taxels):
            u = (x + cos * taxel_xy[e, 0] - sin * taxel_xy[e, 1]) / lattice[2]
            v = (y + sin * taxel_xy[e, 0] + cos * taxel_xy[e, 1]) / lattice[3]
            u, v = min(max(u, 0.0), last_column), min(max(v, 0.0), last_row)
            column, row = int64(u), int64(v)
            right, above = float32(u - column), float32(v - row)
            low, high = nodes[letter[t], row], nodes[letter[t], row + 1]
            for k in range(classes):
                lower = low[column, k] + right * (low[column + 1, k] - low[column, k])
                upper = high[column, k] + right * (high[column + 1, k] - high[column, k])
                predicted[e, k, t] = lower + above * (upper - lower)
    log_p[:] = 0
    for s in range(len(drawn)):
        total = log_p[s]
        for e in range(taxels):
            felt, highest = 0, -np.inf
            for k in range(classes):
                value = predicted[e, k, drawn[s]] + chance[s, e, k]
                if value > highest:
                    felt, highest = k, value
            as_felt = predicted[e, felt]
            for t in range(uint64(states)):
                total[t] += as_felt[t]


class Planner:
    """Choose sensor poses, given states drawn from a belief. model: what predicts the readings there."""

    def __init__(self, model: CalibratedLikelihood, taxel_xy: FloatArray) -> None:
        cell = model.options.cell
        tables = tabulate(model, tuple(model.maps), (cell, cell), cell)
        log_p = tables.nodes * np.float32(tables.unit) + tables.outside[:, :, None, None].astype(np.float32)
        # The classes of a node side by side: they are read together.
        self._nodes = np.ascontiguousarray(log_p.transpose(1, 2, 3, 0))
        self._lattice = tables.sampled.lattice
        self._taxel_xy = np.array(taxel_xy)

    def choose(
        self, candidates: FloatArray, letter: NDArray[np.int64], state: FloatArray, rng: np.random.Generator
    ) -> int:
        """Find the candidate whose reading should say most, for the arguments of `information`."""
        rough = self.information(candidates, letter[::_SIFT], state[:, ::_SIFT], rng)
        best = np.argsort(-rough, kind="stable")[: -(-len(candidates) // _SIFT)]
        return int(best[self.information(candidates[best], letter, state, rng).argmax()])

    def information(
        self, candidates: FloatArray, letter: NDArray[np.int64], state: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Estimate the expected information (nats) of a reading at each candidate: (n,).

        candidates: (n, 3) sensor_in_robot. letter: (states,), state: (3, states) T_R^O, equally probable.
        The estimate is at most log(states), and may fall a little below 0 by the chance of what is drawn. All
        candidates meet common random numbers: most of the chance cancels when they are compared.
        """
        letter, state = np.ascontiguousarray(letter), np.ascontiguousarray(state)
        drawn = np.arange(0, len(letter), max(1, len(letter) // _DRAWN))
        chance = rng.gumbel(size=(len(drawn), len(self._taxel_xy), self._nodes.shape[3])).astype(np.float32)
        log_p = np.empty((len(drawn), len(letter)), dtype=np.float32)
        nats = np.empty(len(candidates))
        for i, pose in enumerate(candidates):
            foresee(log_p, pose, drawn, letter, state, self._taxel_xy, self._nodes, self._lattice, chance)
            others = log_p - log_p[np.arange(len(drawn)), drawn][:, None]
            # p(z | s) is itself one of the averaged: the mean is at least its 1 / states.
            nats[i] = -np.log(np.exp(others).mean(axis=1)).mean()
        return nats
