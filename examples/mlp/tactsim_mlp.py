"""A learned method as a plug-in: a neural network names the letter of a single reading, Bayes' rule does the rest.

The network is trained on virtual readings between the training poses, made of the tactile mosaics of `force`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators.baselines.nearest import ReadingClassifier
from tactsim.estimators.estimator import Options, check_order
from tactsim.estimators.likelihoods.folds import by_letter, folds, positions
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps_by
from tactsim.estimators.options import LikelihoodOptions

# Taxels, covered wholly, that a reading needs for what it says of pressure and slopes to be counted.
_COVERED = 3.0
# Virtual readings of a round, of all letters together.
_A_ROUND = 10_000
# The probability that a reading says nothing of the letter, whatever the network makes of it.
_OUTLIER = 0.01
# Between these the temperature is sought.
_COLDEST, _HOTTEST = 0.5, 20.0


class MlpOptions(Options):
    """What the network takes."""

    hidden: int = Field(256, ge=1, le=10_000, description="units of each of the two hidden layers")
    rounds: int = Field(
        60, ge=1, le=100_000, description="rounds of training, of 10,000 virtual readings each"
    )
    seed: int = Field(
        0, ge=0, le=2**32 - 1, description="seed of the first weights and of the virtual readings"
    )


class Mlp(ReadingClassifier):
    """Name the letter of each reading by a multilayer perceptron, and multiply the probabilities (naive Bayes).

    What the network sees is a reading divided by its scale. It is trained on virtual readings at random poses, rendered
    anew in every round from the mosaics of the training readings (`Rendered`), and its weights are averaged over the
    second half of the rounds (Polyak and Juditsky 1992). So all poses are summed out of p(letter | reading), and that
    of a sequence is ~ prod_t p(letter | z_t)^(1/T). The temperature T (Guo et al. 2017) is learned from a quarter of
    the training positions, by a second network that is trained without them.

    Poses are not looked at beyond the training.
    """

    options_type = MlpOptions
    options: MlpOptions

    def fit(self, scan: Scan) -> None:
        """Learn the mosaics, train the network on readings rendered from them, and find its temperature."""
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels, self.taxels = train.letters, train.readings.shape[1]
        # In the order of their names, so that it does not matter in which order letters were pressed.
        first = _first_alike(train)
        different = sorted(set(first.values()))
        self._number = np.array([different.index(first[label]) for label in self.labels])
        order = np.concatenate([np.flatnonzero(train.labels == label) for label in different])
        train = Scan(
            train.readings[order], train.poses[order], train.labels[order], train.split[order], train.taxel_xy,
            presses=None if train.presses is None else train.presses[order],
        )  # fmt: skip
        words = LikelihoodOptions(likelihood="force")
        self._model = ForceLikelihood(words)
        maps = learn_maps_by(words, train)
        self._model.fit(train, maps)
        self._net: Any = None
        self.temperature = 1.0
        if len(train.letters) > 1:
            rendered = learn_rendering(self._model, train)
            self._net = self._trained(rendered)
            self.temperature = self._learn_temperature(rendered, train)

    def _trained(self, rendered: Rendered) -> Any:
        """Train a network on readings that are rendered anew in every round."""
        from sklearn.neural_network import MLPClassifier  # imported here: it takes a second

        rng = np.random.default_rng(self.options.seed)
        net = MLPClassifier((self.options.hidden,) * 2, random_state=self.options.seed)
        letters = len(rendered.model.mosaics)
        first = self.options.rounds // 2  # of the rounds whose weights are averaged
        sums: list[Any] = []
        for number in range(self.options.rounds):
            readings, letter = rendered.draw(-(-_A_ROUND // letters), rng)
            net.partial_fit(self._seen(readings), letter, classes=range(letters))
            weights = [*net.coefs_, *net.intercepts_]
            if number == first:
                sums = [part.copy() for part in weights]
            elif number > first:
                sums = [total + part for total, part in zip(sums, weights, strict=True)]
        averaged = [total / (self.options.rounds - first) for total in sums]
        net.coefs_, net.intercepts_ = averaged[: len(net.coefs_)], averaged[len(net.coefs_) :]
        return net

    def _learn_temperature(self, rendered: Rendered, train: Scan) -> float:
        """Find the power of the network's probabilities that foretells the letters of left-out positions best."""
        from scipy.optimize import minimize_scalar

        gone = by_letter(folds, train) == 0
        if gone.all():
            return 1.0
        rest = self._model.without(train, gone, train.letters, whole_positions=True)
        log_p = self._log_p(self._trained(replace(rendered, model=rest)), train.readings[gone])
        truth = np.array([train.letters.index(label) for label in train.labels[gone].tolist()])

        def surprise(log_temperature: float) -> float:
            scaled = log_p / np.exp(log_temperature)
            named = scaled[np.arange(len(truth)), truth]
            return float((np.logaddexp.reduce(scaled, axis=1) - named).mean())

        bounds = np.log([_COLDEST, _HOTTEST])
        return float(np.exp(minimize_scalar(surprise, bounds=bounds, method="bounded").x))

    def _seen(self, readings: FloatArray) -> NDArray[np.float32]:
        """Give what the network sees of readings (n, taxels) kPa."""
        return self._model.relative(readings)[1].astype(np.float32)

    def _log_p(self, net: Any, readings: FloatArray) -> FloatArray:
        """Give log p(letter | reading) of readings (n, taxels) kPa: (n, letters that differ)."""
        p = np.asarray(net.predict_proba(self._seen(readings)), dtype=float)
        return np.log((1 - _OUTLIER) * p + _OUTLIER / p.shape[1])

    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        self._evaluated += 1
        if self._net is None:
            return np.zeros(len(self.labels))
        return np.asarray(self._log_p(self._net, reading[None])[0, self._number] / self.temperature)


def _first_alike(train: Scan) -> dict[str, str]:
    """Give for each letter the first by name with the same training readings: no network tells them apart."""
    first: dict[bytes, str] = {}
    alike = {}
    for label in sorted(train.letters):
        own = train.where(label=label)
        alike[label] = first.setdefault(own.readings.tobytes() + own.poses.tobytes(), label)
    return alike


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
