"""The paper's equations written down once more, slowly and without anything the estimators use."""

import math

import numpy as np

CONTACT, NO_CONTACT, UNKNOWN = "contact", "no contact", "unknown"


def classify(reading, threshold=2.0, ratio=0.3):
    """Eq. 3, taxel by taxel."""
    largest = max(reading)
    classes = []
    for taxel in reading:
        if taxel > threshold and taxel > ratio * largest:
            classes.append(CONTACT)
        elif taxel <= threshold and taxel <= ratio * largest:
            classes.append(NO_CONTACT)
        else:
            classes.append(UNKNOWN)
    return classes


def place(outer, points):
    """Map points (n, 2) by the pose `outer`."""
    x, y, angle = outer
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(points) @ turn.T + [x, y]


def interpolate(grid, origin, step, x, y, outside):
    """Interpolate bilinearly between the nodes grid[row][column]; nodes that do not exist are `outside`."""
    u, v = (x - origin[0]) / step[0], (y - origin[1]) / step[1]
    left, below = math.floor(u), math.floor(v)
    total = 0.0
    for column, share_x in ((left, 1 - (u - left)), (left + 1, u - left)):
        for row, share_y in ((below, 1 - (v - below)), (below + 1, v - below)):
            there = 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]
            total += share_x * share_y * (grid[row, column] if there else outside)
    return total


def log_p(kind, log_odds, gamma, prior):
    """Eq. 7 for one taxel, as printed."""
    occupied = 1 / (1 + math.exp(-log_odds)) if log_odds > -700 else 0.0
    if kind == UNKNOWN:
        return 0.0
    return math.log(gamma * prior + (1 - gamma) * (occupied if kind == CONTACT else 1 - occupied))


def log_likelihood(chart, state, reading, sensor_in_robot, taxel_xy, gamma=0.1):
    """Eq. 7 for one reading at one T_R^O: the log-odds are interpolated, then turned into log p."""
    in_object = place(state, place(sensor_in_robot, taxel_xy))
    prior_odds = math.log(chart.prior / (1 - chart.prior))
    step = (chart.cell, chart.cell)
    return sum(
        log_p(kind, interpolate(chart.log_odds, chart.origin, step, x, y, prior_odds), gamma, chart.prior)
        for kind, (x, y) in zip(classify(reading), in_object, strict=True)
    )


def tabulated_log_likelihood(tables, letter, state, reading, sensor_in_robot, taxel_xy):
    """Eq. 7 for one reading at one T_R^O, with log p interpolated between the nodes of `Tables`."""
    total = 0.0
    in_object = place(state, place(sensor_in_robot, taxel_xy))
    for kind, (x, y) in zip(classify(reading), in_object, strict=True):
        if kind == UNKNOWN:
            continue
        table = 1 if kind == CONTACT else 0
        value = interpolate(tables.nodes[table, letter].astype(float), tables.origin, tables.step, x, y, 0.0)
        total += tables.unit * value + tables.outside[table, letter]
    return total
