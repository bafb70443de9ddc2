"""The contract of every estimator, as checks that any package can run on its own one.

Lives here: the checks, and the readings of bars that they are made with. A test of a package says

    @pytest.fixture(scope="module")
    def case():
        return Case(lambda: create("my-estimator"))

    @pytest.mark.parametrize("check", CHECKS)
    def test_contract(check, case):
        check(case)

and one of a measurement model `LikelihoodCase(make)` with LIKELIHOOD_CHECKS.
"""

from tactsim.estimators.contract.checks import CHECKS, Case
from tactsim.estimators.contract.likelihood_checks import LIKELIHOOD_CHECKS, LikelihoodCase

__all__ = ["CHECKS", "LIKELIHOOD_CHECKS", "Case", "LikelihoodCase"]
