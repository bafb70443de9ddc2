import numpy as np
import pytest

from tactsim.press import ScanOptions, SensorOptions
from tactsim.press.sensor import gains, sense

IDEAL = np.random.default_rng(0).uniform(0, 60, (400, 36))
OFF = {"noise": 0.0, "resolution": 0.0}


def sensed(ideal=IDEAL, seed=1, **options):
    settings = SensorOptions(**{**OFF, **options})
    return sense(ideal, settings, gains(ScanOptions(sensor=settings)), np.random.default_rng(seed))


def test_with_everything_off_it_reads_the_pressure():
    assert np.array_equal(sensed(), IDEAL)


def test_noise_has_the_stated_deviation_and_no_bias():
    error = sensed(noise=2.0) - IDEAL
    assert error.std() == pytest.approx(2.0, rel=0.02)
    assert abs(error.mean()) < 4 * 2.0 / np.sqrt(error.size)
    columns = np.corrcoef(error.T) - np.eye(36)
    assert np.abs(columns).max() < 5 / np.sqrt(len(error))


def test_readings_are_whole_steps():
    steps = sensed(resolution=0.7, noise=2.0) / 0.7
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert np.abs(sensed(resolution=0.7) - IDEAL).max() <= 0.35 + 1e-9


def test_saturation_is_the_most_that_is_read():
    readings = sensed(saturation=30.0)
    assert readings.max() == 30.0
    assert np.array_equal(readings[IDEAL < 30], IDEAL[IDEAL < 30])


def test_gains_spread_and_stay():
    gain = gains(ScanOptions(sensor=SensorOptions(gain_spread=0.1)))
    assert 0.05 < gain.std() < 0.2
    assert sensed(gain_spread=0.1) == pytest.approx(IDEAL * gain)


def test_gains_lie_about_1_and_none_is_below_zero():
    sensor = SensorOptions(gain_spread=1.0)
    gain = np.concatenate([gains(ScanOptions(seed=seed, sensor=sensor)) for seed in range(40)])
    # Shares of a normal distribution, within five standard deviations.
    assert gain.min() == 0
    for limit, share in ((0, 0.1587), (0.5, 0.3085), (1, 0.5), (2, 0.8413)):
        assert (gain <= limit).mean() == pytest.approx(share, abs=2.5 / np.sqrt(len(gain)))


def test_hysteresis_keeps_a_share_of_the_last_reading():
    ideal = np.zeros((4, 36))
    ideal[0] = 10.0
    readings = sensed(ideal, hysteresis=0.5)
    assert readings[:, 0] == pytest.approx([10, 5, 2.5, 1.25])
    assert sensed(np.ones((4, 36)), hysteresis=0.5) == pytest.approx(1)


def test_drift_moves_the_zero_from_reading_to_reading():
    assert sensed(np.zeros((3, 36)), drift=0.5)[:, 0] == pytest.approx([0.5, 1.0, 1.5])


def test_dead_taxels_read_zero():
    readings = sensed(dead_taxels=(3, 35), noise=2.0)
    assert not readings[:, [3, 35]].any()
    assert readings[:, 4].all()


def test_random_taxels_are_as_many_as_asked_for_and_half_of_them_look_like_contact():
    readings = sensed(random_taxels=0.2)
    changed = readings != IDEAL
    assert changed.mean() == pytest.approx(0.2, abs=0.01)
    largest = IDEAL.max(axis=1, keepdims=True)
    assert (readings > 0.3 * largest)[changed].mean() == pytest.approx(0.5, abs=0.03)


def test_random_taxels_of_a_reading_without_pressure_are_zero():
    below = sensed(np.zeros((50, 36)), random_taxels=0.5, drift=-0.01)
    assert ((below == 0) | (below < -0.005)).all()
    assert 0.4 < (below == 0).mean() < 0.6
    faint = sensed(np.full((50, 36), 0.1), random_taxels=0.5)
    assert faint.max() == 0.1
    assert 0.4 < (faint < 0.06).mean() < 0.6


def test_an_effect_does_not_change_what_another_draws():
    quiet = sensed(noise=2.0) - IDEAL
    busy = sensed(noise=2.0, random_taxels=0.3)
    kept = np.isclose(busy, IDEAL + quiet)
    assert 0.6 < kept.mean() < 0.8


@pytest.mark.parametrize(
    "wrong",
    [
        {"noise": -1},
        {"noise": float("nan")},
        {"psf_sigma": 0.1},
        {"saturation": 0},
        {"hysteresis": 1},
        {"gian": 1},
    ],
)
def test_a_value_out_of_bounds_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SensorOptions(**wrong)
