"""The force domain's measurement model: what it learns where pressures are known, and odd readings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from synthetic import make_scan, pressures, scores

from tactsim import estimators
from tactsim.core import Scan, transform
from tactsim.estimators.field.tables import tabulate
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.force import lehmer_mean
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions
from tactsim.press import ScanOptions, scan_letters


def fitted(scan, **options):
    model = likelihood.create(LikelihoodOptions(likelihood="force", **options))
    model.fit(scan, learn_maps(scan))
    return model


def rescaled(scan, factors):
    """Multiply each reading by a factor (n,), or each taxel by one (taxels,)."""
    return Scan(scan.readings * factors, scan.poses, scan.labels, scan.split, scan.taxel_xy)


def forces(scan):
    """Draw how hard each reading was pressed: (n, 1), from half to four times."""
    return np.exp(np.random.default_rng(7).uniform(np.log(0.5), np.log(4), (len(scan.readings), 1)))


@pytest.fixture(scope="module")
def quiet():
    return make_scan("EL", noise=0.3)


@pytest.fixture(scope="module")
def model(quiet):
    return fitted(quiet)


def told(model, label, xy, reading):
    """Sum a reading's terms at places (..., taxels, 2): (...)."""
    evidence = model.evidence(reading)
    tables = model.log_tables(label, xy[..., evidence.taxel, :])
    terms = np.arange(len(evidence.taxel))
    return (tables[evidence.table, ..., terms] * evidence.weight.reshape(-1, *[1] * (xy.ndim - 2))).sum(
        axis=0
    )


@settings(max_examples=30, deadline=None)
@given(arrays(float, 5, elements=st.floats(-50, 100)), st.floats(0.01, 100))
def test_the_scale_follows_the_pressure(reading, factor):
    assert lehmer_mean(factor * reading) == pytest.approx(factor * lehmer_mean(reading))


def test_the_mosaic_is_the_blurred_shape_however_hard_it_was_pressed(quiet, model):
    # But for its unit: a scale is the mean of what is pressed, not the most that there could be.
    pressed = fitted(rescaled(quiet, forces(quiet)))
    rng = np.random.default_rng(3)
    for label in "EL":
        xy = rng.uniform(-11, 11, (2000, 2))
        true = pressures(label, xy)
        for one in (model, pressed):
            value, _ = one.mosaics[label](xy)
            unit = (value @ true) / (true @ true)
            assert 1 < unit < 1.3
            assert np.abs(value - unit * true).mean() < 0.03  # the weights' own blur


def test_readings_that_cover_no_taxel_wholly_do_not_spoil_the_mosaic(quiet):
    # A letter that is felt at its rim alone has its own scale wrong; the pressure makes up for it.
    factors = np.ones((len(quiet.readings), 1))
    rim = quiet.readings.max(axis=1) < 18
    factors[rim] = 10
    assert rim.mean() > 0.02
    xy = np.random.default_rng(3).uniform(-14, 14, (3000, 2))
    value, _ = fitted(rescaled(quiet, factors)).mosaics["L"](xy)
    true = pressures("L", xy)
    assert np.abs(value - true * (value @ true) / (true @ true)).max() < 0.25


def test_gains_and_dead_taxels_are_found(quiet):
    true = np.random.default_rng(5).uniform(0.6, 1.4, 36)
    true[[4, 20]] = 0
    model = fitted(rescaled(quiet, true))
    assert model.gain == pytest.approx(true / true.mean(), abs=0.1)
    reading = quiet.readings[0] * true
    assert not {4, 20} & set(model.evidence(reading).taxel.tolist())
    spoilt = reading.copy()
    spoilt[[4, 20]] = 300
    assert model.evidence(spoilt).weight == pytest.approx(model.evidence(reading).weight)


def test_its_densities_are_what_new_readings_show(scan):
    model = fitted(scan)
    fresh = make_scan(seed=2).where("test")
    inside, total = [], []
    for label in fresh.letters:
        mine = fresh.where(label=label)
        xy = transform(mine.poses, mine.taxel_xy)
        scale, felt = model.relative(mine.readings)
        predicted, _ = model.mosaics[label](xy)
        of_class = np.searchsorted(model.bounds, scale)
        tables = model.log_tables(label, xy).reshape(4, 16, len(mine), 36)
        levels = model.deviations[0].levels
        p = np.exp(tables[of_class, :, np.arange(len(mine))])
        p /= p.sum(axis=1, keepdims=True)
        mean = (p * levels[:, None]).sum(axis=1)
        sd = np.sqrt((p * levels[:, None] ** 2).sum(axis=1) - mean**2)
        assert np.abs(mean - np.clip(predicted, levels[0], levels[-1])).mean() < 0.03
        inside.append((np.abs(felt - mean) < 1.5 * sd).ravel())
        total.append(((felt - mean) / sd).ravel())
    assert 0.84 < np.concatenate(inside).mean() < 0.94  # 0.866 of a Gaussian; strays widen sd
    assert 0.8 < np.concatenate(total).std() < 1.05


def test_a_reading_is_likeliest_where_it_was_taken(quiet, model):
    test = quiet.where("test", "E")
    for i in range(0, len(test), 17):
        if test.readings[i].max() < 15:
            continue
        away = np.array([[0, 0, 0], [1.2, 0, 0], [-1.2, 0, 0], [0, 1.2, 0], [0, -1.2, 0]])
        log_p = told(model, "E", transform(test.poses[i] + away, test.taxel_xy), test.readings[i])
        assert log_p[0] > log_p[1:].min() + 2
        assert log_p[0] > log_p[1:].max() - 1


def over_the_extent(model, tables):
    """The values of one letter on a lattice as large as the extent: tables leave out what is as far away."""
    low, high = model.extent
    columns, rows = np.ceil((high - low) / tables.step).astype(int) + 2
    values = np.tile(tables.outside[:, :1, None], (1, rows, columns))
    left, below = np.rint((tables.origin - low) / tables.step).astype(int)
    _, _, tall, wide = tables.nodes.shape
    inside = values[:, below : below + tall, left : left + wide]
    inside += tables.unit * tables.nodes[:, 0, : inside.shape[1], : inside.shape[2]]
    return values


@pytest.mark.long
def test_finer_tables_say_nearly_the_same(scan):
    # Between nodes log p is interpolated; off the nodes the filters see this, per taxel.
    model = fitted(scan.where(label="E"))
    coarse, fine = (over_the_extent(model, tabulate(model, "E", (cell, cell), cell)) for cell in (0.4, 0.1))
    middle = (coarse[:, 1:, 1:] + coarse[:, :-1, :-1] + coarse[:, 1:, :-1] + coarse[:, :-1, 1:]) / 4
    rows, columns = middle.shape[1:]
    exact = fine[:, 2 : 4 * rows : 4, 2 : 4 * columns : 4]
    likely = np.exp(exact)
    gap = np.abs(middle[:, : exact.shape[1], : exact.shape[2]] - exact)
    assert (gap * likely).sum() / likely.sum() < 0.05  # nats


@pytest.mark.slow
@pytest.mark.parametrize(("test_poses", "least", "most"), [("same", 1.0, 0.20), ("random", 0.99, 0.30)])
def test_500_trials_are_placed_exactly_after_10_readings(test_poses, least, most):
    scan = scan_letters(ScanOptions(test_poses=test_poses), cache=False)[0]
    estimator = estimators.create("force-mosaic")
    estimator.fit(scan)
    right, off = scores(scan, estimator, trials=100, last=10)
    assert right[:, 2:].all(axis=1).mean() >= 0.95  # settled by the third
    assert right[:, 9].mean() >= least
    assert off[:, 9].mean() <= most
