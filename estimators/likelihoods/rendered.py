"""Virtual readings between the training poses, made of the tactile mosaics: what a network is trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.folds import by_letter, folds, positions
from tactsim.estimators.likelihoods.force import ForceLikelihood

# Taxels, covered wholly, that a reading needs for what it says of pressure and slopes to be counted.
_COVERED = 3.0


@dataclass(frozen=True, eq=False)
class Rendered:
    """Draws readings at random poses of every letter, as they would have been pressed.

    model: the mosaics, and the taxels' gains. positions: for each letter (n, 2) mm, where the training presses lay;
    each stands for a square around it. gap: mm, the side of the square: how far the next position is. pressure: kPa,
    where one taxel is covered. falls: the power of the covered taxels with which it falls: 1 if every press has
    the same load, 0 if every press is as deep. slopes: (presses, 2) mm^-1, how much training presses leant: relative
    change of the pressure along x and y. noise: kPa, rms, of a taxel.
    """

    model: ForceLikelihood
    taxel_xy: FloatArray
    positions: tuple[FloatArray, ...]
    gap: float
    pressure: float
    falls: float
    slopes: FloatArray
    noise: float

    def draw(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, NDArray[np.int64]]:
        """Draw readings (n, taxels) kPa and their letters (n,): `count` of each letter, one letter after another."""
        from scipy.ndimage import map_coordinates  # imported here: only a fit needs it

        covered = []
        for letter, mosaic in enumerate(self.model.mosaics.values()):
            near = self.positions[letter][rng.integers(len(self.positions[letter]), size=count)]
            place = near + rng.uniform(-self.gap / 2, self.gap / 2, (count, 2))
            poses = np.column_stack([place, rng.uniform(-np.pi, np.pi, count)])
            nodes = (transform(poses, self.taxel_xy) - mosaic.origin) / mosaic.cell
            row_column = np.moveaxis(nodes[..., ::-1], -1, 0)
            covered.append(map_coordinates(mosaic.plane[..., 0], row_column, order=1, mode="nearest"))
        cover = np.maximum(np.concatenate(covered), 0)
        slopes = self.slopes[rng.integers(len(self.slopes), size=len(cover))]
        cover *= np.maximum(1 + slopes @ self.taxel_xy.T, 0)
        pressure = self.pressure / np.maximum(cover.sum(axis=1), 1) ** self.falls
        readings = self.model.gain * pressure[:, None] * cover + self.noise * rng.standard_normal(cover.shape)
        return readings, np.repeat(np.arange(len(covered)), count)


def learn_rendering(model: ForceLikelihood, train: Scan) -> Rendered:
    """Learn what training readings have besides the mosaics: pressure, slopes and noise.

    model: fitted to `train`, all of whose letters are rendered. Each training reading is compared with mosaics without
    the presses at its position; a plane times the prediction is fitted to it. What it leaves is noise.
    """
    even = train.readings / np.where(model.gain > 0, model.gain, np.inf)
    predicted, part = np.empty(even.shape), by_letter(folds, train)
    for number in np.unique(part):
        rest = model.without(train, part == number, train.letters, whole_positions=True)
        for label, mosaic in rest.mosaics.items():
            mine = (part == number) & (train.labels == label)
            predicted[mine] = np.maximum(mosaic(transform(train.poses[mine], train.taxel_xy))[0], 0)
    columns = np.column_stack([np.ones(len(train.taxel_xy)), train.taxel_xy])
    design = predicted[:, :, None] * columns
    # A ridge of one taxel 1 mm away: a reading that says nothing of a slope has none.
    normal = np.einsum("nti,ntj->nij", design, design) + np.diag([1e-3, 1, 1])
    plane = np.linalg.solve(normal, np.einsum("nti,nt->ni", design, even)[..., None])[..., 0]
    left = even - np.einsum("nti,ni->nt", design, plane)
    cover = predicted.sum(axis=1)
    pressed = (cover >= _COVERED) & (plane[:, 0] > model.least)
    pressure, falls, slopes = 2 * model.least, 0.0, np.zeros((1, 2))
    if pressed.sum() > 1:
        slopes = plane[pressed, 1:] / plane[pressed, :1]
        logs = np.log(cover[pressed]), np.log(plane[pressed, 0])
        spread = logs[0] - logs[0].mean()
        falls = float(np.clip(-(spread @ logs[1]) / max(spread @ spread, 1e-9), 0, 1))
        pressure = float(np.exp(logs[1].mean() + falls * logs[0].mean()))
    return Rendered(
        model=model,
        taxel_xy=train.taxel_xy,
        positions=tuple(train.where(label=label).poses[:, :2] for label in train.letters),
        gap=_gap(train),
        pressure=pressure,
        falls=falls,
        slopes=slopes,
        noise=float(np.sqrt((left**2).mean())),
    )


def _gap(train: Scan) -> float:
    """Give the median distance, mm, from a position of presses to the next; 0 if there is one only."""
    from scipy.spatial import cKDTree  # imported here: only a fit needs it

    which = positions(train)
    places = np.array(
        [train.poses[which == number, :2].mean(axis=0) for number in range(int(which.max()) + 1)]
    )
    return float(np.median(cKDTree(places).query(places, 2)[0][:, 1])) if len(places) > 1 else 0.0
