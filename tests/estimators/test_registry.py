import sys

import pytest
from plugging import install_plug_in
from synthetic import CHEAPER, quick_first

from tactsim import estimators
from tactsim.bench.new import contents
from tactsim.core import InputError
from tactsim.estimators.contract import CHECKS, Case
from tactsim.estimators.registry import BUILT_IN, listing, load

GOOD = """
from tactsim.estimators import Estimator
class Unfinished(Estimator):
    def fit(self, scan): ...
class Good(Estimator):
    '''Does nothing well.

    And more.
    '''
    def fit(self, scan): ...
    def reset(self, rng): ...
    def update(self, reading, sensor_in_robot): ...
    def estimate(self): ...
"""


@pytest.fixture
def site(tmp_path):
    (tmp_path / "good_estimators.py").write_text(GOOD)
    (tmp_path / "broken_estimators.py").write_text("import a_package_that_nobody_has")
    (tmp_path / "exiting_estimators.py").write_text("raise SystemExit(3)")
    return tmp_path


def test_an_unknown_estimator_is_named_with_the_known_ones():
    with pytest.raises(InputError, match="unknown estimator 'kalmann'"):
        estimators.create("kalmann")


def test_what_went_says_what_to_take_instead():
    with pytest.raises(InputError, match="tempered is no longer built in: take refined"):
        estimators.create("tempered")
    with pytest.raises(InputError, match="no option kld_error: particles is"):
        estimators.create("particle", kld_error=0.1)


def test_an_unknown_option_is_named():
    with pytest.raises(InputError, match="unknown option 'bin': did you mean 'bins'"):
        estimators.create("histogram", bin=5)


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_is_made_listed_and_documented(name, request):
    assert type(estimators.create(name)) is load(name)
    row = next(row for row in listing() if row.name == name)
    assert row.status == "built in"
    assert row.summary
    text = (request.config.rootpath / "docs" / "estimators.md").read_text()
    assert f"`{name}`" in text
    for option, field in load(name).options_type.model_fields.items():
        assert field.description, option  # the page of options is made of them


def test_a_plug_in_is_found_made_and_listed(site, monkeypatch):
    install_plug_in(site, monkeypatch, good="good_estimators:Good")
    assert "good" in estimators.names()
    assert type(estimators.create("good")).__name__ == "Good"
    row = next(row for row in listing() if row.name == "good")
    assert (row.summary, row.status) == ("Does nothing well.", "from plugged")
    with pytest.raises(InputError, match="unknown option 'x'"):
        estimators.create("good", x=1)
    monkeypatch.setattr(load("good"), "__init__", lambda self, options: None)
    with pytest.raises(InputError, match=r"must call super\(\).__init__"):
        estimators.create("good")


@pytest.mark.parametrize(
    ("point", "said"),
    [("broken_estimators:Any", "a_package_that_nobody_has"), ("good_estimators:Missing", "Missing"),
     ("json:dumps", "no subclass of estimators.Estimator"), ("exiting_estimators:Any", "broken"),
     ("good_estimators:Unfinished", "does not define estimate, reset, update")],
)  # fmt: skip
def test_a_broken_plug_in_is_a_status_and_hurts_nobody_else(site, monkeypatch, point, said):
    install_plug_in(site, monkeypatch, bad=point, good="good_estimators:Good")
    rows = {row.name: row for row in listing()}
    assert said in rows["bad"].status
    assert "\n" not in rows["bad"].status
    assert rows["good"].status == "from plugged"
    assert estimators.create("histogram", bins=10).grid.bins == 10
    with pytest.raises(InputError, match="plug-in 'bad'"):
        estimators.create("bad")


def test_a_plug_in_does_not_replace_a_built_in(site, monkeypatch):
    install_plug_in(site, monkeypatch, histogram="good_estimators:Good")
    assert isinstance(estimators.create("histogram"), load("histogram"))
    assert estimators.names().count("histogram") == 1
    statuses = [row.status for row in listing() if row.name == "histogram"]
    assert statuses == ["built in", "hidden by the built-in of that name"]


SPACE = ("space-refined",)  # it has a contract of its own: tests/solids
# The last is by `bench new`, as a stranger would install it.
NAMES = [name for name in (*estimators.names(), "my-estimator") if name not in SPACE]


@pytest.fixture(scope="module")
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
def case(request, plug_in):
    return Case(lambda: estimators.create(request.param, **CHEAPER.get(request.param, {})))


@pytest.mark.parametrize("check", CHECKS)
def test_an_estimator_keeps_its_contract(check, case):
    check(case)
