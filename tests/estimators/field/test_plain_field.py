"""Any function as a measurement model: the slow lane against the fast one, and what is refused of it."""

import pickle

import numpy as np
import pytest
from synthetic import draw_trial, follow, make_scan, model_of, paper_poses

from tactsim.core import InputError, plug_ins
from tactsim.estimators import Likelihood, create
from tactsim.estimators.contract import LIKELIHOOD_CHECKS, LikelihoodCase
from tactsim.estimators.field.plain_field import PlainField
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.trust import Trust
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.paper import PaperLikelihood, PaperOptions

FILTERS = {
    "histogram": {"split": "10x10x16"},  # five cells of a map to a bin, so that all tables have their nodes
    "refined": {"split": "10x10x12", "cells": 20},
    "particle": {"particles": 1500},
}


class Asked(Likelihood):
    """The paper's model as any function: it asks a field of tables, one reading at a time."""

    options_type = PaperOptions

    def fit(self, scan, maps):
        super().fit(scan, maps)
        self._inner = PaperLikelihood(self.options)
        self._inner.fit(scan, maps)
        cell = self.options.cell
        self._field = TableField(self._inner, tuple(maps), scan.taxel_xy, (cell, cell), cell)

    def log_p(self, reading, pose, label, states):
        self._field.reset()
        self._field.append(reading, pose)
        return self._field.log_p(self._field.labels.index(label), np.ascontiguousarray(states.T))

    def most(self, reading):
        self._field.reset()
        self._field.append(reading, np.zeros(3))
        return self._field.bound()


class Odd(Likelihood):
    """Answers what `answer` gives for so many states; that the first state is likelier to a reading of zeros."""

    answer = staticmethod(lambda count: np.zeros(count))

    def log_p(self, reading, pose, label, states):
        return Odd.answer(len(states)) if reading.any() else np.linspace(0, -3, len(states))


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    """Stand in for a package that brings both models."""
    from importlib.metadata import EntryPoint

    points = tuple(EntryPoint(name, f"{__name__}:{name}", likelihood.GROUP) for name in ("Asked", "Odd"))
    monkeypatch.setattr(plug_ins, "plug_ins", lambda group: points if group == likelihood.GROUP else ())


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(4, 6))


def fitted(name, scan, **options):
    made = create(name, **FILTERS[name], **options)
    made.fit(scan)
    made.trust = Trust() if name == "refined" else made.trust  # as learned of no model but tables
    return made


@pytest.mark.parametrize("name", FILTERS)
def test_a_filter_says_the_same_in_both_lanes(scan, name):
    readings, poses, _ = draw_trial(scan, "L", 7, np.random.default_rng(3))
    fast, plain = (
        follow(fitted(name, scan, likelihood=model), readings, poses) for model in ("paper", "Asked")
    )
    for ours, other in zip(fast, plain, strict=True):
        assert ours.label == other.label
        assert ours.robot_in_object == pytest.approx(other.robot_in_object, abs=1e-3)
        assert ours.probabilities == pytest.approx(other.probabilities, abs=1e-3)


@pytest.mark.parametrize("name", likelihood.BUILT_IN)
@pytest.mark.parametrize("check", LIKELIHOOD_CHECKS)
def test_every_built_in_model_keeps_the_contract_of_likelihoods(name, check):
    kind = likelihood.kind_of(name)
    check(LikelihoodCase(lambda: kind(kind.options_type())))


@pytest.mark.parametrize("name", ["paper", "calibrated"])
def test_tables_come_to_log_p_as_their_lattice_gets_finer(scan, name):
    model, rng, off = model_of(name, scan), np.random.default_rng(0), []
    state = rng.uniform([[-6], [-6], [-3]], [[6], [6], [3]], (3, 60))
    for finest in (0.8, 0.2):
        field = TableField(model, scan.letters, scan.taxel_xy, (finest, finest), finest)
        field.append(scan.readings[30], np.array([1.0, -2.0, 0.4]))
        plain = PlainField(model, scan.letters)
        plain.append(scan.readings[30], np.array([1.0, -2.0, 0.4]))
        off.append(np.abs(field.log_p(1, state) - plain.log_p(1, state)).mean())
    assert off[1] < off[0] / 4


@pytest.mark.parametrize(
    ("answer", "said"),
    [(lambda count: np.zeros((count, 1)), "has shape"), (lambda count: 0.0, "has shape"),
     (lambda count: np.full(count, np.nan), "a NaN, inf"),
     (lambda count: np.full(count, np.inf), "a NaN, inf"), (lambda count: np.full(count, "1"), "a NaN, inf")],
)  # fmt: skip
@pytest.mark.parametrize("name", FILTERS)
def test_an_answer_that_is_none_is_refused_and_the_model_named(scan, monkeypatch, name, answer, said):
    made = fitted(name, scan, likelihood="Odd")
    made.reset(np.random.default_rng(0))
    monkeypatch.setattr(Odd, "answer", staticmethod(answer))
    with pytest.raises(InputError, match=f"likelihood Odd: .*{said}"):
        made.update(scan.readings[0], np.zeros(3))


@pytest.mark.parametrize("name", FILTERS)
def test_a_reading_that_is_impossible_everywhere_says_nothing_and_is_counted(scan, monkeypatch, name):
    made = fitted(name, scan, likelihood="Odd")
    made.reset(np.random.default_rng(0))
    made.update(np.zeros(36), np.zeros(3))
    before = made.estimate()
    monkeypatch.setattr(Odd, "answer", staticmethod(lambda count: np.full(count, -np.inf)))
    made.update(scan.readings[1], np.zeros(3))
    after = made.estimate()
    assert made.work["ignored_readings"] == 1
    if name != "particle":  # which resamples, whatever is felt
        assert after.probabilities == pytest.approx(before.probabilities, abs=1e-9)
    assert np.isfinite(after.robot_in_object).all()


def test_a_filter_has_its_models_options_and_no_others():
    assert create("histogram", gamma=0.3).options.gamma == 0.3
    assert create("histogram", likelihood="calibrated", quantiles=7).options.quantiles == 7
    with pytest.raises(InputError, match="unknown option 'gamma'"):
        create("refined", gamma=0.3)
    with pytest.raises(InputError, match="unknown likelihood 'papr': did you mean 'paper'"):
        create("histogram", likelihood="papr")
    options = create("refined", quantiles=7, fit="auto").options
    again = pickle.loads(pickle.dumps(options))
    assert again == options
    assert again.model_fields_set == options.model_fields_set
