"""Touches as sequences: what the moments of a touch say together, and how much that counts."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, make_scan, paper_poses

from tactsim.core import InputError
from tactsim.core.moments import felt_moments
from tactsim.estimators.field.field import LikelihoodField

POSES = paper_poses(positions=4, angles=6)
RISE = np.concatenate([np.arange(1, 8) / 8, np.ones(8)])


def with_sequences(scan, rise=RISE):
    """Let each reading rise in proportion to its load."""
    images = scan.readings[:, None] * rise[:, None]
    return replace(
        scan, sequence=images.astype(np.float32), sequence_times=np.arange(1, len(rise) + 1) / 200,
        sequence_force=np.tile(2 * rise, (len(scan), 1)).astype(np.float32),
    )  # fmt: skip


@pytest.fixture(scope="module")
def scan():
    return with_sequences(make_scan("EIL", poses=POSES))


@pytest.fixture(scope="module")
def few():
    return with_sequences(make_scan("EI", poses=paper_poses(positions=3, angles=4)))


def learned(scan, **options):
    return fitted_anew("refined", scan, **({"bins": 600, "cells": 40, "halvings": 2, "moments": 2} | options))


@pytest.fixture(scope="module")
def two(scan):
    return learned(scan)


def touches(scan, label="E", count=4):
    """Draw a trial's touches: their sequences, last images and poses."""
    numbered = replace(scan, readings=np.tile(np.arange(len(scan))[:, None], 36).astype(float))
    chosen, poses = draw_trial(numbered, label, count, np.random.default_rng(3))[:2]
    rows = chosen[:, 0].astype(int)
    return scan.sequence[rows].astype(float), scan.readings[rows], poses


@pytest.mark.parametrize("name", ["calibrated", pytest.param("force", marks=pytest.mark.long)])
def test_log_p_is_the_weighted_sum_over_the_moments(few, name):
    scan = few
    filter = learned(scan, likelihood=name)
    model = filter.likelihood
    sequences, _, poses = touches(scan, count=2)
    filter.reset(np.random.default_rng(0))
    found, images = felt_moments(sequences, model.shares)
    assert found.all()
    rng = np.random.default_rng(1)
    states = np.array([rng.uniform(-8, 8, 50), rng.uniform(-8, 8, 50), rng.uniform(-3, 3, 50)])
    cell = model.options.cell
    expected = 0
    for k, of_moment in enumerate(model.of_load):
        field = LikelihoodField(of_moment, filter.labels, scan.taxel_xy, (cell, cell), cell)
        for image, pose in zip(images[:, k], poses, strict=True):
            field.append(of_moment.evidence(image), pose)
        expected = expected + model.counts * field.log_p(1, states)
    together = LikelihoodField(model, filter.labels, scan.taxel_xy, (cell, cell), cell)
    for sequence, pose in zip(sequences, poses, strict=True):
        together.append(model.evidence(sequence), pose)
    # The lattices begin elsewhere where the maps of the moments differ in size.
    assert together.log_p(1, states) == pytest.approx(expected, rel=0.02, abs=0.5)


def test_one_image_and_a_touch_that_never_rests_count_as_the_last_image(scan, two):
    model, image = two.likelihood, scan.readings[10]
    last = model.of_load[-1].evidence(image)
    before = len(model.of_load[0].log_tables("E", [0.0, 0.0]))
    unsteady = np.outer([0.2, 1.0, 0.3, 0.0, 0.8, 1.0], image)
    for touch in (image, image[None], unsteady, np.zeros((9, 36))):
        terms = model.evidence(touch)
        if touch.any():
            assert terms.table.tolist() == (last.table + before).tolist()
        assert len(terms.table) == len(last.table)
        assert terms.weight.tolist() == last.weight.tolist()


def test_what_is_no_sequence_is_refused(scan, two):
    bare = replace(scan, sequence=None, sequence_times=None, sequence_force=None)
    with pytest.raises(InputError, match="one image of each press"):
        learned(bare)
    sudden = with_sequences(make_scan("EIL", poses=POSES), rise=np.array([0.0, 1, 1, 1, 1]))
    with pytest.raises(InputError, match="no training press of 'E' shows 50% of its load"):
        learned(sudden)
    two.reset(np.random.default_rng(0))
    for wrong in (np.zeros((0, 36)), np.zeros((3, 35)), np.zeros((2, 3, 36))):
        with pytest.raises(InputError, match="36 taxels"):
            two.update(wrong, np.zeros(3))
    with pytest.raises(InputError, match=r"reading\[0, 4\]"):
        two.update(np.where(np.arange(36) == 4, np.nan, np.zeros((2, 36))), np.zeros(3))
    alone = learned(scan, moments=1)
    alone.reset(np.random.default_rng(0))
    with pytest.raises(InputError, match="36 taxels"):
        alone.update(np.zeros((3, 36)), np.zeros(3))
