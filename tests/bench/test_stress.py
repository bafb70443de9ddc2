"""The stress command: that a fault fails a case, that every case can fail, and that none does."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from tactsim.bench.cli.app import app
from tactsim.bench.placement import distances
from tactsim.bench.stress import cases, chosen_cases, run_case
from tactsim.bench.stress.case import case, fit_once, refused
from tactsim.core.errors import InputError

EVERY = cases()
QUICK = chosen_cases(tags=["quick"])


def outcome_of(values, **options):
    made = case(
        "topic.name", varied="it", deviation="off", limit=options.pop("limit", 1.0), because="so", **options
    )
    return run_case(made(lambda worst: [worst.see(value, f"at {value}") for value in values]))


@pytest.mark.parametrize("values", [[0.0, math.inf], [[0.1, math.nan, 0.2], 0.3], [1.0001], []])
def test_what_is_too_large_no_number_or_not_measured_fails(values):
    assert not outcome_of(values).passed


def test_the_worst_is_kept_with_its_place():
    outcome = outcome_of([0.1, [0.2, 0.9], 0.3])
    assert outcome.passed
    assert (outcome.worst, outcome.at) == (0.9, "at [0.2, 0.9]")


def test_an_exception_or_a_warning_of_numpy_fails_the_case():
    def raises(worst):
        worst.see(0, "")
        raise InputError("no")

    def warns(worst):
        worst.see(0, "")
        np.log(np.zeros(1))

    for measure, message in ((raises, "InputError: no"), (warns, "RuntimeWarning")):
        outcome = run_case(case("a.b", varied="", deviation="", limit=1, because="")(measure))
        assert not outcome.passed
        assert message in outcome.at


def test_only_an_input_error_of_one_line_is_a_refusal():
    def fail(error):
        raise error

    assert refused(fail, InputError("one line"))
    assert not refused(fail, InputError("two\nlines"))
    assert not refused(len, [])
    with pytest.raises(ValueError, match="bug"):
        refused(fail, ValueError("bug"))


def test_cases_are_chosen_by_name_and_by_tag():
    assert chosen_cases() == EVERY
    names = [one.name for one in EVERY]
    assert len(set(names)) == len(names)
    assert [one.name for one in chosen_cases(["frames.wrap"])] == ["frames.wrap"]
    assert {one.name.partition(".")[0] for one in chosen_cases(tags=["maps"])} == {"maps"}
    assert 0 < len(QUICK) < len(EVERY)
    with pytest.raises(InputError, match="'quik': did you mean 'quick'"):
        chosen_cases(tags=["quik"])


# Each fits every estimator, or one many times: a minute for all of them. By default much of what they find is found by
# tests/estimators/test_registry.py: one letter, readings without contrast, poses far away; and by test_pad_fit.py.
LONG = (
    "filters.budget-of-one", "filters.order-of-letters", "filters.faulty-taxels", "filters.after-nonsense",
    "frames.angles-many-turns-away", "maps.without-information",
)  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(
    "chosen",
    [
        pytest.param(one, marks=[] if one.quick and one.name not in LONG else pytest.mark.slow)
        for one in EVERY
    ],
    ids=lambda one: one.name,
)
def test_case(chosen):
    outcome = run_case(chosen)
    assert outcome.passed, f"{outcome.worst} at {outcome.at}; the limit is {chosen.limit}: {chosen.because}"


# For each a fault in the code under it: what is replaced, and by what.
def without_symmetry(estimated, true, symmetry, *of):
    return distances(estimated, true, 1, *of)


PLANTED = {
    "frames.wrap": ("tactsim.bench.stress.frames_cases.wrap_angle", lambda angle: np.asarray(angle)),
    "frames.symmetric-objects": ("tactsim.bench.placement.distances", without_symmetry),
    "maps.peak-near-one": ("tactsim.estimators.likelihoods.occupancy._NOTHING", 0.5),
    "likelihood.gamma": (
        "tactsim.estimators.likelihoods.paper.sigmoid",
        lambda odds: np.exp(odds) / (1 + np.exp(odds)),
    ),
    "engines.balance": ("tactsim.press.collide._BALANCE", 1e-2),
}


@pytest.fixture
def own_fits():
    """Let nothing be taken that was fitted without the fault, and leave nothing behind that was fitted with it."""
    fit_once.cache_clear()
    yield
    fit_once.cache_clear()


@pytest.mark.long
@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_fails_the_case(monkeypatch, own_fits, name):
    place, fault = PLANTED[name]
    monkeypatch.setattr(place, fault)
    (chosen,) = chosen_cases([name])
    outcome = run_case(chosen)
    assert not outcome.passed
    assert "Error" not in outcome.at, "the fault was to be measured, not to crash"


def test_the_command_prints_a_table_or_json_and_says_by_its_status_whether_all_passed(monkeypatch):
    good = CliRunner().invoke(app, ["stress", "--case", "frames.wrap", "--json"])
    assert good.exit_code == 0
    (only,) = json.loads(good.stdout)["cases"]
    assert only["name"] == "frames.wrap"
    assert only["worst"] <= only["limit"]

    monkeypatch.setattr(
        "tactsim.bench.stress.frames_cases.wrap_angle", lambda angle: np.full(np.shape(angle), np.nan)
    )
    bad = CliRunner().invoke(app, ["stress", "--case", "frames.wrap", "--case", "frames.chain"])
    assert bad.exit_code == 1
    assert "FAILS" in bad.stdout
    bad = CliRunner().invoke(app, ["stress", "--case", "frames.wrap", "--json"])
    assert json.loads(bad.stdout)["cases"][0]["worst"] is None
