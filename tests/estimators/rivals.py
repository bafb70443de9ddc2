"""What one would write or install instead: eq. 7 and 13 for many states, in the usual ways.

All take the maps that the estimators learned, and the same readings. States are (n, 3) T_R^O; all
maps are evaluated at all of them.
"""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import expit

from tactsim.core import transform
from tactsim.estimators.likelihoods.classifier import CONTACT, UNKNOWN, classify

GAMMA, PRIOR = 0.1, 0.2


class Rival:
    """A likelihood of one reading for all maps and states: `log_likelihood` gives (maps, states)."""

    def __init__(self, maps, states, taxel_xy):
        self.made_of = maps, states, taxel_xy
        charts = list(maps.values())
        self.log_odds = np.stack([chart.log_odds for chart in charts])
        self.origin, self.cell = charts[0].origin, charts[0].cell
        self.states, self.taxel_xy = states, taxel_xy
        p = expit(self.log_odds)
        self.tables = np.stack(
            [np.log(GAMMA * PRIOR + (1 - GAMMA) * (1 - p)), np.log(GAMMA * PRIOR + (1 - GAMMA) * p)], axis=1
        ).astype(np.float32)

    def places(self, reading, pose):
        """Classes of the decided taxels, and where every state puts them, in cells (states, taxels)."""
        classes = classify(reading)
        decided = classes != UNKNOWN
        xy = transform(pose, self.taxel_xy)[decided]
        cos, sin = np.cos(self.states[:, 2:]), np.sin(self.states[:, 2:])
        rows, columns = self.log_odds.shape[1:]
        x = (self.states[:, :1] + cos * xy[:, 0] - sin * xy[:, 1] - self.origin[0]) / self.cell
        y = (self.states[:, 1:2] + sin * xy[:, 0] + cos * xy[:, 1] - self.origin[1]) / self.cell
        return classes[decided] == CONTACT, np.clip(x, 0, columns - 1.001), np.clip(y, 0, rows - 1.001)

    def log_likelihood(self, reading, pose):
        raise NotImplementedError

    def of_log_odds(self, odds, contact):
        p = expit(odds)
        return np.log(GAMMA * PRIOR + (1 - GAMMA) * np.where(contact, p, 1 - p)).sum(axis=1)


class Gather(Rival):
    """Plain NumPy: fancy indexing, bilinear interpolation of the log-odds, sigmoid, logarithm."""

    def log_likelihood(self, reading, pose):
        contact, x, y = self.places(reading, pose)
        column, row = x.astype(int), y.astype(int)
        right, above = x - column, y - row
        return np.stack(
            [
                self.of_log_odds(
                    (1 - above) * ((1 - right) * chart[row, column] + right * chart[row, column + 1])
                    + above * ((1 - right) * chart[row + 1, column] + right * chart[row + 1, column + 1]),
                    contact,
                )
                for chart in self.log_odds
            ]
        )


class GatherTables(Rival):
    """NumPy by someone who has thought: log p tabulated, float32, one flat index for all four nodes."""

    def log_likelihood(self, reading, pose):
        contact, x, y = self.places(reading, pose)
        column, row = x.astype(int), y.astype(int)
        right, above = (x - column).astype(np.float32), (y - row).astype(np.float32)
        shares = ((1 - above) * (1 - right), (1 - above) * right, above * (1 - right), above * right)
        rows, columns = self.log_odds.shape[1:]
        at = (contact * rows + row) * columns + column
        totals = []
        for table in self.tables.reshape(len(self.tables), -1):
            nodes = (at, at + 1, at + columns, at + columns + 1)
            totals.append(
                sum(share * table[node] for share, node in zip(shares, nodes, strict=True)).sum(axis=1)
            )
        return np.stack(totals)


class MapCoordinates(Rival):
    """SciPy's `ndimage.map_coordinates` of the log-odds, order 1."""

    def log_likelihood(self, reading, pose):
        contact, x, y = self.places(reading, pose)
        return np.stack(
            [self.of_log_odds(map_coordinates(chart, [y, x], order=1), contact) for chart in self.log_odds]
        )
