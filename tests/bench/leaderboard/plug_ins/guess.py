"""A plug-in that behaves: it remembers the mean pressure of each letter's readings."""

import numpy as np
from pydantic import Field

from tactsim.estimators import Estimate, Estimator, Options


class GuessOptions(Options):
    spread: float = Field(1.0, gt=0, description="kPa")


class Guess(Estimator):
    """Compare mean pressures."""

    options_type = GuessOptions

    def fit(self, scan):
        self.letters = scan.letters
        self.means = np.array([scan.where("train", letter).readings.mean() for letter in scan.letters])

    def reset(self, rng):
        self.log_p, self.rng = np.zeros(len(self.letters)), rng

    def update(self, reading, sensor_in_robot):
        noise = self.rng.normal(0, 0.01)
        self.log_p -= np.abs(self.means - np.mean(reading) + noise) / self.options.spread
        self.pose = np.array([*sensor_in_robot[:2], 0.0])

    def estimate(self):
        p = np.exp(self.log_p - np.logaddexp.reduce(self.log_p))
        return Estimate(
            self.letters[int(p.argmax())], dict(zip(self.letters, p.tolist(), strict=True)), self.pose
        )
