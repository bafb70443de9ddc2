"""A neural network that names the letter of a single reading, and Bayes' rule over the readings."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import InputError, Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Options, check_order
from tactsim.estimators.filters.reading_classifier import ReadingClassifier
from tactsim.estimators.likelihoods.folds import by_letter, folds
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps_by
from tactsim.estimators.likelihoods.rendered import Rendered, learn_rendering
from tactsim.estimators.options import LikelihoodOptions

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

    def __init__(self, options: MlpOptions) -> None:
        super().__init__(options)
        if find_spec("sklearn") is None:
            raise InputError(
                "estimator mlp needs scikit-learn, the extra learned: pip install 'tactsim[learned]'"
            )

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
        from sklearn.neural_network import MLPClassifier  # imported here: it takes a second, and is an extra

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
