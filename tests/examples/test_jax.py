"""The example that learns from trials, where JAX is installed: it keeps the contract, and does better than chance."""

import sys
from pathlib import Path

import pytest

import tactsim
from tactsim.estimators.contract import CHECKS, Case
from tactsim.estimators.contract.checks import letters_that_are_one_share_its_probability

pytest.importorskip("jax")
pytest.importorskip("optax")
sys.path.insert(0, str(Path(tactsim.__file__).parents[1] / "examples" / "jax"))
from deep_set import DeepSet, DeepSetOptions

# A network that learns from trials drawn at random prefers one of equal letters by chance.
KEPT = [check for check in CHECKS if check is not letters_that_are_one_share_its_probability]


@pytest.mark.parametrize("check", KEPT, ids=lambda check: check.__name__)
def test_it_keeps_the_contract_of_every_estimator(check):
    check(Case(lambda: DeepSet(DeepSetOptions(hidden=32, steps=400))))


def test_it_learns_which_letter_it_is():
    scan = tactsim.scan(letters="IO")
    run = tactsim.run(scan, estimator=DeepSet(DeepSetOptions(hidden=64, steps=300)), trials=10, readings=10)
    assert run.accuracy[-1] > 0.8
