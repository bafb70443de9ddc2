"""By how much single readings move a belief about the place: the infinitesimal jackknife (compiled).

If a reading counted a little more, the mean of the belief would move by the covariance of the place and the reading's
log p, times the weight that log p has. Summed over the readings, the squares of these moves are the variance of the
mean that the readings themselves show (Giordano and Broderick 2023, The Bayesian infinitesimal jackknife for variance).
A belief that is as wide as it should be has that variance.
"""

from __future__ import annotations

import math

import numpy as np

from tactsim.core.compiling import Ints1D, Ints2D, Reals1D, Reals2D, compiled

# Moves with less than this of the belief of the likeliest, nats below it, are left out of a sequence's belief.
_NEGLIGIBLE = 12.0
# Nats below the largest; what has less adds nothing to a sum of doubles.
_NOTHING = 50.0


@compiled()
def influence(log_p: Reals2D, weight: Reals1D, place: Reals2D) -> float:
    """Average over readings the squared move of the mean, in units of the belief's variance; nan if it has none.

    log_p: (readings, n) of states. weight: (n,) of the states in the belief, of any unit. place: (2 or more, n) of the
    object, mm. A move is per unit of the weight of log p. Its square is Mahalanobis' distance squared, half of it for
    an axis.
    """
    total = mean_x = mean_y = 0.0
    for k in range(len(weight)):
        total += weight[k]
        mean_x += weight[k] * place[0, k]
        mean_y += weight[k] * place[1, k]
    mean_x, mean_y = mean_x / total, mean_y / total
    x, y = np.empty(len(weight)), np.empty(len(weight))
    xx = xy = yy = 0.0
    for k in range(len(weight)):
        away_x, away_y, share = place[0, k] - mean_x, place[1, k] - mean_y, weight[k] / total
        x[k], y[k] = share * away_x, share * away_y
        xx, xy, yy = xx + x[k] * away_x, xy + x[k] * away_y, yy + y[k] * away_y
    determinant, squared = xx * yy - xy * xy, 0.0
    if not determinant > 1e-12 * (xx + yy) ** 2:
        return math.nan
    for reading in range(len(log_p)):
        along_x = along_y = 0.0
        for k in range(len(weight)):
            along_x += x[k] * log_p[reading, k]
            along_y += y[k] * log_p[reading, k]
        squared += (yy * along_x**2 - 2 * xy * along_x * along_y + xx * along_y**2) / determinant
    return squared / (2 * len(log_p))


@compiled()
def influence_in_sequences(
    log_p: Reals2D,
    drawn: Ints2D,
    mirrored: Ints2D,
    sums: Reals2D,
    weight: float,
    log_volume: Reals1D,
    shift: Reals2D,
) -> float:
    """Average `influence` over sequences of readings drawn from log p (readings, moves).

    drawn, mirrored, sums: what `sums_of_readings` takes and gives. weight: of log p. log_volume:
    (moves,) of what a move stands for. shift: (2, moves) mm.
    """
    sequences, count = drawn.shape
    half, belief = log_p.shape[1] // 2, np.empty(log_p.shape[1])
    squared, counted = 0.0, 0
    for sequence in range(sequences):
        for move in range(len(belief)):
            belief[move] = weight * sums[sequence, move] + log_volume[move]
        highest = belief.max()
        held = np.flatnonzero(belief > highest - _NEGLIGIBLE)
        some, share, place = np.empty((count, len(held))), np.empty(len(held)), np.empty((2, len(held)))
        back = (held + half) % len(belief)
        for i in range(len(held)):
            share[i] = math.exp(belief[held[i]] - highest)
            place[0, i], place[1, i] = shift[0, held[i]], shift[1, held[i]]
        for k in range(count):
            of_reading = log_p[drawn[sequence, k]]
            at = back if mirrored[sequence, k] else held
            for i in range(len(held)):
                some[k, i] = of_reading[at[i]]
        found = influence(some, share, place)
        if not math.isnan(found):
            squared, counted = squared + found, counted + 1
    return squared / counted if counted else math.nan


@compiled()
def sums_of_readings(log_p: Reals2D, drawn: Ints2D, mirrored: Ints2D) -> Reals2D:
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


@compiled(ordered=False, summed_in_order=False)
def mostly_held(
    log_p: Reals2D, order: Ints1D, weight: float, log_volume: Reals1D, shift: Reals2D, share: float
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
            below = belief[move] - largest
            belief[move] = math.exp(below) if below > -_NOTHING else 0.0
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
