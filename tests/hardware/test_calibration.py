import numpy as np
import pytest
from made_pads import calibration, small_device

from tactsim.core import InputError, Pad
from tactsim.core.reading import Reading
from tactsim.hardware.calibration import (
    Calibration,
    Correction,
    find_dead,
    find_stuck,
    force,
    take_tare,
    with_gain,
)
from tactsim.hardware.device import load_device


def readings(values):
    return [Reading(row, k * 0.01) for k, row in enumerate(np.asarray(values, dtype=float))]


def noisy(rng, frames=60, offset=0.0, sd=1.0):
    return offset + sd * rng.standard_normal((frames, 6))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_the_tare_is_the_median_so_outliers_do_not_move_it(rng):
    values = noisy(rng, 101, offset=np.arange(6))
    values[40, 2] = 9.0
    tare = take_tare(readings(values), small_device(), "here")
    assert tare.tare == tuple(np.median(values, axis=0))
    assert np.allclose(tare.noise, values.std(axis=0, ddof=1))
    assert (tare.frames, tare.port, tare.device) == (101, "here", "small")
    assert tare.read_by == small_device().read_by()


def test_a_tare_takes_at_least_40_frames(rng):
    with pytest.raises(InputError, match="at least 40 frames, not 39"):
        take_tare(readings(noisy(rng, 39)), small_device(), "")


@pytest.mark.parametrize(
    ("touch", "message"),
    [
        (lambda values: values + np.array([0, 0, 0, 15, 0, 0]), "taxel 3 reads 1[45].. kPa"),
        # laid on half way, and a finger that comes and goes
        (
            lambda values: values + np.linspace(0, 4, len(values))[:, None] * [0, 0, 0, 0, 1, 0],
            "taxel 4 went by",
        ),
        (
            lambda values: values + 30.0 * (np.arange(len(values)) == 20)[:, None] * [1, 0, 0, 0, 0, 0],
            "taxel 0",
        ),
    ],
)
def test_a_tare_is_refused_while_touched(rng, touch, message):
    with pytest.raises(InputError, match=message):
        take_tare(readings(touch(noisy(rng))), small_device(), "")


@pytest.mark.parametrize("sd", [0.1, 4.0])
@pytest.mark.parametrize("frames", [40, 400])
def test_an_untouched_pad_is_tared_whatever_its_noise(sd, frames):
    for seed in range(20):
        values = np.round(noisy(np.random.default_rng(seed), frames, 2.0, sd) / 0.7) * 0.7
        assert len(take_tare(readings(values), small_device(), "").tare) == 6


def test_a_calibration_comes_back_from_its_file(rng, tmp_path):
    tare = take_tare(readings(noisy(rng)), small_device(), 'a "port"\nof two lines')
    tare.save(tmp_path / "tare.toml")
    assert Calibration.load(tmp_path / "tare.toml") == tare
    with pytest.raises(InputError, match=r"tare.toml is a calibration, and no device file"):
        load_device(tmp_path / "tare.toml")
    (tmp_path / "pad.toml").write_text("[pad]\nrows = 2\n")
    with pytest.raises(InputError, match=r"pad.toml is a device file, and no calibration"):
        Calibration.load(tmp_path / "pad.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [({"dead": (6,)}, "does not have"), ({"stuck": (0, 1, 2, 3, 4, 5)}, "every taxel is dead or stuck"),
     ({"tare": (float("nan"),) * 6}, "finite")],
)  # fmt: skip
def test_a_calibration_that_makes_no_sense_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        calibration(**change)


def test_readings_are_tared_scaled_and_masked():
    pad = small_device().pad
    correction = Correction(calibration(gain=(2.0, 1, 1, 1, 1, 1), stuck=(2,), dead=(5,)), pad)
    reading = correction.apply(Reading(np.arange(6.0) + 3, 1.5, 0.5, 7))
    assert reading.pressures.tolist() == [4.0, 3.0, 5.0, 6.0]
    assert (reading.host_time, reading.device_time, reading.index) == (1.5, 0.5, 7)
    assert np.array_equal(correction.taxel_xy, pad.taxel_xy[[0, 1, 3, 4]])


def test_a_calibration_of_another_pad_is_refused():
    with pytest.raises(InputError, match="has 6 taxels, the pad has 36"):
        Correction(calibration(), Pad())


def test_gains_make_an_even_load_even(rng):
    true = np.array([0.8, 1.0, 1.2, 1.1, 0.9, 1.0])
    tare = take_tare(readings(noisy(rng, sd=0.1)), small_device(), "")
    loaded = readings(noisy(rng, sd=0.1) + 50 * true)
    known = with_gain(tare, loaded, pressure=50.0)
    assert np.allclose(known.gain, 1 / true, rtol=0.01)
    assert np.allclose(with_gain(tare, loaded).gain, 1 / true, rtol=0.03)


def test_a_dead_taxel_is_found_under_load_and_masked(rng):
    tare = take_tare(readings(noisy(rng, sd=0.1)), small_device(), "")
    load = noisy(rng, sd=0.1) + 50 * np.array([1, 1, 0, 1, 1, 1])
    assert with_gain(tare, readings(load)).dead == (2,)
    with pytest.raises(InputError, match="hardly more than the noise"):
        with_gain(tare, readings(noisy(rng, sd=0.1)))


def test_a_stuck_taxel_is_one_that_never_changes_while_others_do(rng):
    values = np.round(noisy(rng))
    values[:, 4] = 3.0
    assert find_stuck(values).tolist() == [4]
    assert take_tare(readings(values), small_device(), "").stuck == (4,)
    values = 0.1 * np.round(noisy(rng))  # the mean of 100 times -20.3 is rounded
    values[:, 4] = -20.3
    assert find_stuck(values).tolist() == [4]
    quiet = np.round(noisy(rng, sd=0.05))  # less noise than a step: all are constant
    quiet[3, 1] = 1.0
    assert find_stuck(quiet).tolist() == []


def test_an_taxel_that_never_answers_is_dead():
    values = np.array([[10.0, 0, 0.2], [0, 20, 0.1]])
    assert find_dead(values).tolist() == [2]
    assert find_dead(np.zeros((3, 4))).tolist() == []


def large_pad(rng, loaded=(), frames=60):
    device = small_device().model_copy(update={"pad": Pad(rows=8, columns=8)})
    values = rng.standard_normal((frames, 64))
    values[:, list(loaded)] += 40
    return device, values


def test_a_taxel_that_is_always_loaded_is_masked_and_named(rng):
    device, values = large_pad(rng, loaded=(9, 10, 44))
    tare = take_tare(readings(values), device, "here")
    assert tare.loaded == (9, 10, 44)
    assert np.flatnonzero(~tare.kept).tolist() == [9, 10, 44]
    assert Calibration.model_validate(tare.model_dump()) == tare


@pytest.mark.parametrize("loaded", [(9, 10, 11), (0, 2, 16, 18)])
def test_an_object_on_the_pad_is_no_loaded_taxel(rng, loaded):
    device, values = large_pad(rng, loaded)
    with pytest.raises(InputError, match=r"something touches the pad: taxel \d+ reads 4"):
        take_tare(readings(values), device, "")


def test_gains_leave_a_loaded_taxel_alone(rng):
    device, values = large_pad(rng, (9,))
    tare = take_tare(readings(values), device, "")
    values[:, :] += 50
    values[:, 9] = 40
    gained = with_gain(tare, readings(values))
    assert gained.dead == ()
    assert gained.loaded == (9,)
    assert gained.gain[9] == 1


def test_force_is_the_sum_of_pressures_over_areas():
    # 36 taxels of 3.24 mm^2 at 10 kPa: 36 * 3.24e-6 m^2 * 1e4 Pa
    assert force(np.full(36, 10.0), Pad()) == pytest.approx(1.1664)
    assert force(np.ones((5, 36)), Pad()).shape == (5,)
