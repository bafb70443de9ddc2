"""The inner loops of `trust`: sum the log-likelihoods of sequences, and ask how often a region holds no move at all."""

from __future__ import annotations

import math

import numpy as np
from numba import boolean, float64

from tactsim.core.compiling import INTS, INTS_2D, REALS, REALS_2D, Ints, Reals, compiled
from tactsim.estimators.field.series import small_exp

# Nats below the largest; what has less counts as so much, which adds nothing to a sum of doubles.
_LEAST = 50.0


@compiled(REALS_2D(REALS_2D, INTS_2D, INTS_2D))
def sums_of_readings(log_p: Reals, drawn: Ints, mirrored: Ints) -> Reals:
    """Sum log p (readings, moves) over the readings that are drawn (sequences, count): (sequences, moves).

    In a mirrored (sequences, count) reading, 1 and not 0, every move is the other way: moves come in two halves.
    """
    moves = log_p.shape[1]
    half = moves // 2
    sums = np.zeros((len(drawn), moves))
    for sequence in range(len(drawn)):
        there, back = sums[sequence, :half], sums[sequence, half:]
        for k in range(drawn.shape[1]):
            of_reading, first = log_p[drawn[sequence, k]], half * mirrored[sequence, k]
            as_it_is, other_way = of_reading[first : first + half], of_reading[half - first : moves - first]
            for move in range(half):
                there[move] += as_it_is[move]
                back[move] += other_way[move]
    return sums


@compiled(boolean(REALS_2D, INTS, float64, REALS, REALS_2D, float64), ordered=False, summed_in_order=False)
def mostly_held(
    log_p: Reals, order: Ints, weight: float, log_volume: Reals, shift: Reals, share: float
) -> bool:
    """Tell whether in more than a share of sequences the region with that share of the belief holds no move at all.

    log_p: (sequences, moves) of sequences, counted with a weight. order: (sequences,) in which they are looked at;
    those whose region leaves no move out come to its front, because they do so with another weight too, and few of
    them decide. log_volume: (moves,) of what a move stands for. shift: (2, moves) mm, along x and y. A region is all
    shifts that are nearer to their mean than a distance.
    """
    sequences, belief = len(log_p), np.empty(len(log_volume))
    along_x, along_y = shift[0], shift[1]
    left_out = 0
    for looked_at in range(sequences):
        of_sequence = log_p[order[looked_at]]
        largest = -math.inf
        for move in range(len(belief)):
            belief[move] = weight * of_sequence[move] + log_volume[move]
            largest = max(largest, belief[move])
        for move in range(len(belief)):
            belief[move] = small_exp(max(belief[move] - largest, -_LEAST))
        total = sum_x = sum_y = 0.0
        for move in range(len(belief)):
            total += belief[move]
            sum_x += belief[move] * along_x[move]
            sum_y += belief[move] * along_y[move]
        twice_x, twice_y, nearer = 2 * sum_x / total, 2 * sum_y / total, 0.0
        for move in range(len(belief)):
            # A shift s is nearer to the mean m than no move at all is, |s - m| < |m|, if |s|^2 < 2 s m.
            x, y = along_x[move], along_y[move]
            near = x * (x - twice_x) + y * (y - twice_y) < 0
            nearer += belief[move] if near else 0.0
        if nearer >= share * total:
            order[left_out], order[looked_at] = order[looked_at], order[left_out]
            left_out += 1
            if sequences - left_out <= share * sequences:
                return False
    return sequences - left_out > share * sequences
