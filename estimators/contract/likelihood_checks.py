"""The checks of a measurement model: each takes a `LikelihoodCase`, and raises AssertionError if it breaks its word."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from tactsim.core import compose, invert
from tactsim.core.poses import FloatArray
from tactsim.estimators.contract.checks import make_scan, paper_poses
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.likelihoods.likelihood import Likelihood, TaxelSum
from tactsim.estimators.likelihoods.occupancy import learn_maps_by

_STEP = 0.95  # mm, of nodes that the taxels of the bars' pad lie on: it has a pitch of twice that


class LikelihoodCase:
    """A measurement model to check: how it is made, what it learns from, and one that has learned."""

    def __init__(self, make: Callable[[], Likelihood]) -> None:
        """Take a function that makes a new model each time, as `lambda: Cosine(CosineOptions())` does."""
        self.make = make
        self.scan = make_scan("EIL", poses=paper_poses(positions=4, angles=6))

    @cached_property
    def learned(self) -> Likelihood:
        """Give a model that is fitted to the scan, the same one for all checks."""
        model = self.make()
        model.fit(self.scan, learn_maps_by(model.options, self.scan))
        return model

    def asked(self, seed: int, states: int = 40) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw a test reading (taxels,), a pose (3,), and states (n, 3), of which the first is the true one."""
        rng, test = np.random.default_rng(seed), self.scan.where("test", "E")
        robot_in_object = rng.uniform([-10, -10, -np.pi], [10, 10, np.pi], (states, 3))
        number = int(rng.integers(len(test)))
        pose = compose(invert(robot_in_object[0]), test.poses[number])
        return test.readings[number], pose, robot_in_object


def _hold(held: object, message: str) -> None:
    if not held:
        raise AssertionError(message)


def options_are_described(case: LikelihoodCase) -> None:
    """Describe every option; `bench list likelihoods NAME` shows it."""
    for name, field in type(case.make()).options_type.model_fields.items():
        _hold(field.description, f"the option {name} has no description")


def a_state_has_one_finite_number(case: LikelihoodCase) -> None:
    """Give (n,) nats of n states, none included; -inf may be, NaN and inf may not, whatever was felt."""
    taxels = len(case.scan.taxel_xy)
    for count in (0, 1, 7):
        reading, pose, states = case.asked(count, max(count, 1))
        for felt in (reading, np.zeros(taxels), np.full(taxels, 1e4), -np.ones(taxels)):
            log_p = case.learned.log_p(felt, pose, "I", states[:count])
            _hold(np.shape(log_p) == (count,), f"log_p of {count} states has shape {np.shape(log_p)}")
            _hold(not (np.isnan(log_p) | np.isposinf(log_p)).any(), f"log_p gives a NaN or inf: {log_p}")


def a_state_does_not_depend_on_its_neighbours(case: LikelihoodCase) -> None:
    """Give each state what it gets by itself, and the same again."""
    reading, pose, states = case.asked(1)
    together = case.learned.log_p(reading, pose, "L", states)
    again = case.learned.log_p(reading, pose, "L", states[::-1])[::-1]
    alone = [float(case.learned.log_p(reading, pose, "L", state[None])[0]) for state in states]
    _hold(np.allclose(together, again, rtol=1e-9, atol=1e-9), "another order of states gives another log_p")
    _hold(np.allclose(together, alone, rtol=1e-9, atol=1e-9), "a state by itself gets another log_p")


def what_is_given_is_not_written_to(case: LikelihoodCase) -> None:
    """Leave reading, pose and states as they are."""
    given = case.asked(2)
    kept = [array.copy() for array in given]
    case.learned.log_p(given[0], given[1], "E", given[2])
    same = all(np.array_equal(*pair) for pair in zip(given, kept, strict=True))
    _hold(same, "log_p writes to what it is given")


def a_bound_is_a_bound(case: LikelihoodCase) -> None:
    """Give by `most` what no state gets more than."""
    for seed in range(5):
        reading, pose, states = case.asked(seed)
        most = case.learned.most(reading)
        highest = max(case.learned.log_p(reading, pose, label, states).max() for label in case.scan.letters)
        _hold(highest <= most + 1e-9, f"a state gets {highest} nats, and most says {most}")


def the_true_state_says_more_than_others(case: LikelihoodCase) -> None:
    """Give the true state more than other states have in the mean, in three of four readings."""
    ahead = []
    for seed in range(40):
        reading, pose, states = case.asked(seed)
        log_p = np.maximum(case.learned.log_p(reading, pose, "E", states), -1e9)
        ahead.append(log_p[0] > log_p[1:].mean())
    _hold(np.mean(ahead) >= 0.75, f"the true state is ahead in {np.mean(ahead):.0%} of the readings")


def tables_say_what_log_p_says(case: LikelihoodCase) -> None:
    """Give by the tables of a sum over taxels, at their nodes, what `log_p` gives, but for the rounding to 16 bits."""
    model = case.learned
    if not isinstance(model, TaxelSum):
        return
    field = TableField(model, ("E",), case.scan.taxel_xy, (_STEP, _STEP), _STEP)
    steps = np.stack(np.meshgrid(np.arange(0, 40, 3), np.arange(0, 40, 3)), axis=-1).reshape(-1, 2)
    states = np.column_stack([field.tables.origin + _STEP * (steps + 1), np.zeros(len(steps))])
    for reading in case.scan.readings[:10]:
        field.reset()
        field.append(reading, np.zeros(3))
        fast, plain = (
            field.log_p(0, np.ascontiguousarray(states.T)),
            model.log_p(reading, np.zeros(3), "E", states),
        )
        weight = float(model.evidence(reading).weight.sum())
        allowed = weight * field.tables.unit / 2 + 1e-5 * (1 + np.abs(plain).max())
        worst = float(np.abs(fast - plain).max())
        _hold(worst <= allowed, f"tables are off by {worst} nats at their nodes, {allowed} is rounding")


LIKELIHOOD_CHECKS: tuple[Callable[[LikelihoodCase], Any], ...] = (
    options_are_described,
    a_state_has_one_finite_number,
    a_state_does_not_depend_on_its_neighbours,
    what_is_given_is_not_written_to,
    a_bound_is_a_bound,
    the_true_state_says_more_than_others,
    tables_say_what_log_p_says,
)
