"""The force domain's measurement model: what it learns where pressures are known, and odd readings."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import make_scan, model_of, pressures

from tactsim.core import transform


def forces(scan):
    """Draw how hard each reading was pressed: (n, 1), from half to four times."""
    return np.exp(np.random.default_rng(7).uniform(np.log(0.5), np.log(4), (len(scan.readings), 1)))


def told(model, label, xy, reading):
    """Sum a reading's terms at places (..., taxels, 2): (...)."""
    evidence = model.evidence(reading)
    tables = model.log_tables(label, xy[..., evidence.taxel, :])
    terms = np.arange(len(evidence.taxel))
    return (tables[evidence.table, ..., terms] * evidence.weight.reshape(-1, *[1] * (xy.ndim - 2))).sum(
        axis=0
    )


@pytest.fixture(scope="module")
def quiet():
    return make_scan("EL", noise=0.3)


@pytest.fixture(scope="module")
def model(quiet):
    return model_of("force", quiet)


def test_the_mosaic_is_the_blurred_shape_however_hard_it_was_pressed(quiet, model):
    # But for its unit: a scale is the mean of what is pressed, not the most that there could be.
    pressed = model_of("force", replace(quiet, readings=quiet.readings * forces(quiet)))
    rng = np.random.default_rng(3)
    for label in "EL":
        xy = rng.uniform(-11, 11, (2000, 2))
        true = pressures(label, xy)
        for one in (model, pressed):
            value, _ = one.mosaics[label](xy)
            unit = (value @ true) / (true @ true)
            assert 1 < unit < 1.3
            assert np.abs(value - unit * true).mean() < 0.03  # the weights' own blur


def test_gains_and_dead_taxels_are_found(quiet):
    true = np.random.default_rng(5).uniform(0.6, 1.4, 36)
    true[[4, 20]] = 0
    model = model_of("force", replace(quiet, readings=quiet.readings * true))
    assert model.gain == pytest.approx(true / true.mean(), abs=0.1)
    reading = quiet.readings[0] * true
    assert not {4, 20} & set(model.evidence(reading).taxel.tolist())
    spoilt = reading.copy()
    spoilt[[4, 20]] = 300
    assert model.evidence(spoilt).weight == pytest.approx(model.evidence(reading).weight)


def test_its_densities_are_what_new_readings_show(scan):
    model = model_of("force", scan)
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
