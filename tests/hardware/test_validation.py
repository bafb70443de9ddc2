"""What a fit finds of a sensor, and leaves of presses and taxels, on readings made with known errors."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tactsim.core import InputError, Pad, compose, transform
from tactsim.hardware.sensor_fit import Guess, fit_sensor
from tactsim.hardware.taxel_fit import moments, press_errors, stray_contacts, taxel_error, unevenness


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


ANY = (-np.inf, np.inf)
GROUPS = [(0, 1), (2,)]


def sample(rng, presses=300, taxels=20, s=(0.4, 2.0), mean=(0.3, -0.2, 1.0), sd=(0.5, 0.5, 2.0), noise=0.7):
    slopes = rng.standard_normal((presses, taxels, 3))
    shared = rng.standard_normal((presses, taxels, len(s))) + slopes[..., :1]
    errors = rng.standard_normal((presses, 3)) * sd + mean
    readings = np.einsum("nti,ni->nt", slopes, errors) + shared @ np.array(s)
    return readings + noise * rng.standard_normal(readings.shape), slopes, shared, errors


def test_what_a_sample_was_made_of_is_found():
    readings, slopes, shared, errors = sample(np.random.default_rng(1))
    found = press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, shared, ANY)
    assert found.shared[0] == pytest.approx(0.4, abs=3 * found.shared_error[0])
    assert found.shared[1] == pytest.approx(2.0, abs=3 * found.shared_error[1])
    for low, sd, high in zip(found.sd_low, (0.5, 0.5, 2.0), found.sd_high, strict=True):
        assert low < sd < high
    assert found.mean == pytest.approx([0.3, -0.2, 1.0], abs=0.35)
    assert found.sd == pytest.approx([0.5, 0.5, 2.0], rel=0.1)
    assert np.sqrt(((found.errors - errors) ** 2).mean()) < 0.25


@pytest.mark.long
def test_the_stated_error_of_a_shared_number_is_that_of_repeats():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(60):
        readings, slopes, shared, _ = sample(rng, presses=40, taxels=8)
        found.append(press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, shared, ANY))
    scores = [(one.shared[0] - 0.4) / one.shared_error[0] for one in found]
    assert abs(np.mean(scores)) < 0.45
    assert 0.7 < np.std(scores) < 1.4


def test_likelihoods_differ_as_the_densities_do():
    readings, slopes, shared, _ = sample(np.random.default_rng(3), presses=30, taxels=6, s=(0.0,))

    def density(found, count):
        total = 0.0
        for y, j in zip(readings, slopes[..., :count], strict=True):
            covariance = j @ np.diag(found.sd**2) @ j.T + 0.49 * np.eye(6)
            total += multivariate_normal(j @ found.mean, covariance).logpdf(y)
        return total

    whole = press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, np.zeros_like(shared), ANY)
    less = press_errors(readings, slopes[..., :2], 0.49, np.ones(2), [(0, 1)], np.zeros_like(shared), ANY)
    assert whole.log_likelihood - less.log_likelihood == pytest.approx(
        density(whole, 3) - density(less, 2), abs=1e-6
    )


def test_a_bound_holds_and_the_other_shared_number_makes_up_for_it():
    readings, slopes, shared, _ = sample(np.random.default_rng(4))
    shared[..., 1] += shared[..., 0]
    found = press_errors(readings, slopes, 0.49, np.ones(3), GROUPS, shared, (0.9, 1.0))
    assert found.shared[0] == 0.9


def test_without_any_effect_errors_stay_at_nothing():
    rng = np.random.default_rng(5)
    readings = rng.standard_normal((50, 10))
    found = press_errors(readings, np.zeros((50, 10, 3)), 1.0, np.ones(3), GROUPS, np.zeros((50, 10, 1)), ANY)
    assert found.errors == pytest.approx(np.zeros((50, 3)))
    assert found.shared[0] == 0
    assert np.isinf(found.shared_error[0])


PATTERNS, TAXELS = 20, 300


def readings(rng, own, contact, noise, copies=1):
    """Presses of patterns whose contact covers a third of the taxels, and what a fit without unevenness predicts."""
    predicted = rng.uniform(20, 60, (PATTERNS, TAXELS)) * (rng.random((PATTERNS, TAXELS)) < 0.33)
    gain = np.maximum(1 + own * rng.standard_normal(TAXELS), 0)
    factor = np.maximum(gain + contact * rng.standard_normal(predicted.shape), 0)
    image = np.repeat(factor * predicted, copies, axis=0)
    loads = rng.uniform(0.5, 2, (len(image), 1))
    recorded = loads * image + noise * rng.standard_normal(image.shape)
    return recorded, np.repeat(predicted, copies, axis=0), np.repeat(np.arange(PATTERNS), copies)


@pytest.mark.parametrize(("own", "contact"), [(0.3, 0.1), (0.1, 0.5), (0.8, 0.9)])
def test_known_spreads_are_found_again(own, contact):
    found = unevenness(*readings(np.random.default_rng(0), own, contact, 1.0), 1.0)
    assert found == pytest.approx((own, contact), rel=0.3, abs=0.1)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_an_even_pad_has_next_to_none(noise):
    own, contact = unevenness(*readings(np.random.default_rng(1), 0, 0, noise), noise)
    assert own < 0.03
    assert contact < 0.06


def test_copies_of_a_pattern_do_not_make_its_texture_the_taxels_own():
    recorded, predicted, pattern = readings(np.random.default_rng(2), 0.2, 0.6, 0.5, copies=10)
    own, contact = unevenness(recorded, predicted, pattern, 0.5)
    assert (own, contact) == pytest.approx((0.2, 0.6), abs=0.1)
    assert unevenness(recorded, predicted, np.arange(len(pattern)), 0.5)[0] > own + 0.05


def test_one_pattern_says_nothing_of_the_taxels_own():
    recorded, predicted, _ = readings(np.random.default_rng(3), 0.5, 0.0, 0.1)
    own, contact = unevenness(recorded[:1], predicted[:1], np.zeros(1, dtype=int), 0.1)
    assert own < 0.01
    assert contact == pytest.approx(0.5, abs=0.2)


def test_presses_of_which_nothing_is_predicted_do_not_count():
    recorded, predicted, pattern = readings(np.random.default_rng(4), 0.3, 0.4, 0.1)
    known = unevenness(recorded, predicted, pattern, 0.1)
    more = np.full((1, TAXELS), 50.0), np.zeros((1, TAXELS)), [PATTERNS]
    beside = (np.concatenate(both) for both in zip((recorded, predicted, pattern), more, strict=True))
    assert unevenness(*beside, 0.1) == pytest.approx(known)
    assert unevenness(recorded, np.full_like(predicted, np.nan), pattern, 0.1) == (0.0, 0.0)


@pytest.mark.parametrize(("own", "contact"), [(0.0, 0.7), (0.6, 0.0), (1.0, 3.0)])
def test_moments_are_those_of_drawn_factors(own, contact):
    rng = np.random.default_rng(5)
    gain = np.maximum(1 + own * rng.standard_normal(1_000_000), 0)
    one, other = (np.maximum(gain + contact * rng.standard_normal(len(gain)), 0) for _ in range(2))
    mean = (one.mean() + other.mean()) / 2
    drawn = one.var() / mean**2, np.mean(one * other) / mean**2 - 1
    assert moments(own, contact) == pytest.approx(drawn, rel=0.02, abs=0.005)


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_contacts_where_none_should_be_are_counted(share):
    rng = np.random.default_rng(6)
    recorded, predicted, _ = readings(rng, 0.3, 0.3, 1.0)
    stray = (predicted == 0) & (rng.random(predicted.shape) < share)
    recorded[stray] += 30.0
    assert stray_contacts(recorded, predicted, 1.0) == pytest.approx(stray[predicted == 0].mean(), abs=2e-3)
    assert stray_contacts(1000 * recorded, predicted, 1000.0) == stray_contacts(recorded, predicted, 1.0)
    assert stray_contacts(recorded, np.zeros_like(predicted), 1.0) == 0.0
