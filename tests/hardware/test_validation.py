import numpy as np
import pytest

from tactsim.core import InputError, Pad, compose, transform
from tactsim.hardware.sensor_fit import Guess, fit_sensor
from tactsim.hardware.taxel_fit import taxel_error


class Bumps:
    """A world in closed form: an object of Gaussian bumps, which a point spread only makes wider."""

    def __init__(self, rng, presses=60):
        self.bumps = rng.uniform(-12, 12, (40, 2))
        self.width = 1.5  # mm
        self.poses = np.column_stack([rng.uniform(-8, 8, (presses, 2)), rng.uniform(0, 6.28, presses)])
        self.taxel_xy = Pad().taxel_xy

    def __call__(self, guess, errors):
        sigma = guess.psf_sigma
        points = transform(compose(self.poses, errors[:, :3]), self.taxel_xy)
        along_x, along_y = (points[..., axis, None] - self.bumps[:, axis] for axis in (0, 1))
        square = along_x**2 + along_y**2
        width = self.width**2 + sigma**2
        return 40 / width * np.exp(-square / (2 * width)).sum(axis=-1)


STATED = Guess(1.0, 1000.0, np.inf)
BENDING = 200.0  # mm^4


def read(world, sigma, errors):
    return world(Guess(sigma, 1000.0, np.inf), np.asarray(errors))


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_known_parameters_are_found_again(rng):
    world = Bumps(rng)
    errors = rng.standard_normal((60, 3)) * [0.4, 0.4, 0.03] + [0.5, -0.3, 0.05]
    gains = 1 + 0.05 * rng.standard_normal(36)
    recorded = 1.3 * gains * read(world, 0.8, errors) + 0.3 * rng.standard_normal((60, 36))
    fit = fit_sensor(recorded, world, STATED, BENDING)
    assert fit.psf_sigma == pytest.approx(0.8, abs=0.05)
    low, high = fit.psf_sigma_range
    assert low < 0.8 < high
    assert high - low < 0.2
    assert fit.gain == pytest.approx(1.3 * gains.mean(), rel=0.03)
    assert fit.response_range[0] < 1 < fit.response_range[1]
    assert fit.load_spread < 0.03
    assert fit.gains_saved[0] > 2 * fit.gains_saved[1]
    assert np.corrcoef(fit.gain_per_taxel, gains)[0, 1] > 0.9
    assert fit.offset == pytest.approx([0.5, -0.3, 0.05], abs=0.15)
    assert fit.placement_mm == pytest.approx(0.4, rel=0.25)
    assert fit.placement_rad == pytest.approx(0.03, rel=0.4)
    assert fit.misfit == pytest.approx(0.3, rel=0.25)


@pytest.mark.long
def test_response_and_loads_are_found_whatever_the_unit(rng):
    """The pad bends pressures, presses have loads of their own, and readings come in thousandths."""
    world, unit, response = Bumps(rng), 1e-3, 0.5
    errors = rng.standard_normal((60, 3)) * [0.3, 0.3, 0.03]
    loads = np.exp(0.25 * rng.standard_normal(60))
    image = loads[:, None] * read(world, 0.8, errors)
    recorded = unit * (10 * (image / 10) ** response + 0.1 * rng.standard_normal((60, 36)))
    fit = fit_sensor(recorded, world, STATED, BENDING)
    low, high = fit.response_range
    assert abs(fit.response - response) < high - low  # twice as far as one of 20 is
    assert fit.response == pytest.approx(response, rel=0.05)
    assert fit.load_spread == pytest.approx(0.25, rel=0.3)
    assert np.corrcoef(np.log(fit.loads), np.log(loads))[0, 1] > 0.97
    assert np.polyfit(np.log(loads), np.log(fit.loads), 1)[0] == pytest.approx(1, rel=0.15)
    assert fit.psf_sigma == pytest.approx(0.8, abs=0.1)
    same = fit_sensor(recorded / unit, world, STATED, BENDING)
    assert fit.psf_sigma == pytest.approx(same.psf_sigma, rel=1e-6)
    assert fit.gain == pytest.approx(unit * same.gain, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(("own", "contact"), [(0.0, 0.0), (0.2, 0.4)])
def test_what_no_fit_explains_is_the_spread_of_gains_and_the_texture(own, contact):
    """Single presses are patterns of their own here: of each, other presses tell only what is the taxel's."""
    rng = np.random.default_rng(8)
    world = Bumps(rng, presses=120)
    gain = np.maximum(1 + own * rng.standard_normal(36), 0)
    factor = np.maximum(gain + contact * rng.standard_normal((120, 36)), 0)
    recorded = factor * read(world, 0.8, np.zeros((120, 3))) + 0.3 * rng.standard_normal((120, 36))
    fit = fit_sensor(recorded, world, STATED, BENDING)
    assert fit.gain_spread == pytest.approx(own, abs=0.12)
    assert fit.texture == pytest.approx(contact, abs=0.12)


@pytest.mark.long
def test_a_point_spread_on_its_bound_has_no_tight_interval(rng):
    """What is recorded is sharper than the sharpest point spread that is tried."""
    world = Bumps(rng)
    fit = fit_sensor(read(world, 0.05, np.zeros((60, 3))), world, STATED, BENDING)
    assert fit.psf_sigma == pytest.approx(0.3, abs=0.01)
    assert fit.psf_sigma_range[0] == 0


def test_what_readings_say_nothing_of_is_not_identified(rng):
    def half(sigma, errors):
        return np.tile(np.linspace(20, 60, 30)[:, None], (1, 10))

    fit = fit_sensor(half(1.0, None) + rng.standard_normal((30, 10)), half, STATED, BENDING)
    assert fit.psf_sigma_range == (0, np.inf)


@pytest.mark.long
def test_held_out_presses_are_judged_by_the_others(rng):
    """Gains of a recording that are another in every group of presses fit it, and predict none of it."""
    world, fold = Bumps(rng), np.arange(60) % 6
    gains = 1 + 0.3 * rng.standard_normal((6, 36))
    recorded = gains[fold] * read(world, 0.8, np.zeros((60, 3)))
    fit = fit_sensor(recorded, world, STATED, BENDING, fold)
    assert fit.gains_saved[0] < 2 * fit.gains_saved[1]
    fitted = fit.answered(read(world, fit.psf_sigma, fit.placement))
    left = [np.sqrt(((recorded - one) ** 2).mean()) for one in (fitted, fit.held_out_placed, fit.held_out)]
    assert left[0] < left[1]
    assert left[0] < left[2]


def test_readings_that_follow_nothing_are_refused(rng):
    world = Bumps(rng)
    with pytest.raises(InputError, match="do not follow the simulated ones"):
        fit_sensor(-read(world, 1.0, np.zeros((60, 3))), world, STATED, BENDING)


def test_noise_is_what_untouched_taxels_say(rng):
    def half(sigma, errors):
        values = np.zeros((200, 10))
        values[:, 5:] = np.linspace(20, 60, 200)[:, None]
        return values

    recorded = half(1.0, None) + 1.7 * rng.standard_normal((200, 10))
    assert fit_sensor(recorded, half, STATED, BENDING).noise == pytest.approx(1.7, rel=0.1)


def test_errors_are_counted_by_hand():
    predicted = np.array([[10.0, 0.0], [0.0, 30.0]])
    recorded = predicted + np.array([[3.0, 0.0], [0.0, -1.0]])
    error = taxel_error(recorded, predicted)
    assert error.rms == pytest.approx(np.sqrt(10 / 4))
    assert error.bias == pytest.approx(0.5)
    assert error.relative == pytest.approx(np.sqrt(2.5) / 20)  # touched: 10 and 30
    assert error.per_taxel == pytest.approx([np.sqrt(4.5), np.sqrt(0.5)])
    assert error.per_press == pytest.approx([np.sqrt(4.5), np.sqrt(0.5)])
    assert error.correlation == pytest.approx(np.corrcoef(recorded.ravel(), predicted.ravel())[0, 1])
