"""An estimator that answers batches of trials, of two functions: it keeps the contract of every estimator."""

import numpy as np
import pytest

import tactsim
from tactsim.estimators import BatchEstimator, Options
from tactsim.estimators.contract import CHECKS, Case


class MeanReading(BatchEstimator):
    """Name the letter whose mean training reading is most like the mean of what was felt."""

    def learn(self, train):
        self.means = np.array([train.where(label=label).readings.mean(axis=0) for label in self.labels])

    def answer(self, readings, sensor_in_robot):
        count = np.arange(1, readings.shape[1] + 1)[:, None]
        felt = readings.cumsum(axis=1) / count
        off = ((felt[:, :, None] - self.means) ** 2).mean(axis=-1)
        p = np.exp(off.min(axis=-1, keepdims=True) - off).astype(
            np.float32
        )  # as networks answer, not normalised
        return p, np.zeros((*p.shape[:2], 3))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_two_functions_keep_the_contract_of_every_estimator(check):
    check(Case(lambda: MeanReading(Options())))


def test_a_run_asks_for_many_trials_at_once():
    scan = tactsim.scan(letters="IO")
    run = tactsim.run(scan, estimator=MeanReading(Options()), trials=10, readings=10)
    assert run.accuracy[-1] > 0.6
