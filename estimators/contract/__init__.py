"""The contract of every estimator, as checks that any package can run on its own one.

Lives here: the checks, and the readings of bars that they are made with. A test of a package says

    @pytest.fixture(scope="module")
    def case():
        return Case(lambda: create("my-estimator"))

    @pytest.mark.parametrize("check", CHECKS)
    def test_contract(check, case):
        check(case)
"""

from tactsim.estimators.contract.checks import CHECKS, Case

__all__ = ["CHECKS", "Case"]
