"""What every registered estimator, built in or plugged in, must keep."""

import sys

import pytest
from plugging import install_plug_in
from synthetic import CHEAPER, quick_first

from tactsim import estimators
from tactsim.bench.new import contents
from tactsim.estimators.contract import CHECKS, Case

SPACE = ("space-refined",)  # it has a contract of its own: tests/solids
# The last is by `bench new`, as a stranger would install it.
NAMES = [name for name in (*estimators.names(), "my-estimator") if name not in SPACE]


@pytest.fixture(scope="module", autouse=True)
def plug_in(tmp_path_factory):
    """Install the estimator that `bench new` makes as a package of its own, for these tests."""
    place = tmp_path_factory.mktemp("site")
    for path, text in contents("estimator", "my-estimator").items():
        if path.startswith("src/"):
            target = place / path.removeprefix("src/")
            target.parent.mkdir(exist_ok=True)
            target.write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        install_plug_in(place, patch, **{"my-estimator": "my_estimator:MyEstimator"})
        yield
        sys.modules.pop("my_estimator", None)  # it is installed no longer


@pytest.fixture(scope="module", params=quick_first(NAMES))
def case(request):
    return Case(lambda: estimators.create(request.param, **CHEAPER.get(request.param, {})))


@pytest.mark.parametrize("check", CHECKS)
def test_an_estimator_keeps_its_contract(check, case):
    check(case)
