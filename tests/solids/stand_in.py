"""An estimator of objects in space that is quick and knows little: which training touches felt alike."""

from typing import ClassVar

import numpy as np

from tactsim.core import rigid
from tactsim.estimators import Estimate, Estimator, PoseSamples


class AlikeTouches(Estimator):
    """Compare sorted pressures with those of the training touches; the pose is a guess from its random numbers."""

    KIND = "solids"
    POSE = rigid.POSE
    made: ClassVar[list] = []

    def fit(self, scan):
        self.labels = scan.objects
        train = scan.where("train")
        self.known = [np.sort(train.where(label=label).readings, axis=1) for label in self.labels]
        self.count = 0

    def reset(self, rng):
        self.log_p = np.zeros(len(self.labels))
        self.pose = np.concatenate([rng.normal(size=3), rigid.random_rotations(1, rng)[0]])

    def update(self, reading, sensor_in_robot):
        for one in np.sort(np.atleast_2d(reading), axis=1):
            self.log_p -= [np.abs(known - one).mean(axis=1).min() for known in self.known]
            self.count += 1

    def propose(self, candidates):
        return len(candidates) - 1

    def estimate(self):
        p = np.exp(self.log_p - self.log_p.max())
        p /= p.sum()
        samples = PoseSamples(self.pose[None], np.ones(1))
        return Estimate(
            self.labels[int(p.argmax())], dict(zip(self.labels, p.tolist(), strict=True)), self.pose, samples
        )

    @property
    def work(self):
        return {"likelihood_evaluations": self.count, "skipped": {}}
