"""What a pad would read in presses that are off by given errors, and how readings change with each error and number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.hardware.gain_fit import Gains, best_gain
from tactsim.hardware.press_errors import PressErrors

NARROWEST, WIDEST = 0.3, 10.0  # mm, of a point spread
BLUNTEST, STEEPEST_RESPONSE = 0.2, 5.0  # exponents of a response curve
SOFTEST, STIFFEST = 1.0, 1e6  # kPa/mm, of a layer
STIFFEST_WRIST = 1e7  # N mm/rad
LOAD, LEAN = 3, slice(4, 6)  # of a press's errors
# How far presses may be off, as a prior: placement beside half a face, lean beside what lifts a side of it.
_GUESS = np.array([0.6, 0.6, 0.2, 0.2, 1.0, 1.0])
_STEP = np.array([0.025, 0.025, 0.05, 0.0, 0.1, 0.1])  # of differences, times the prior
_GIVE_STEP, _SHARED_STEP = 0.03, 0.02
MOST_GIVE = 0.98
_STEEPEST = 0.03  # rad, standard deviation of tilts; a layer that needs more is taken to be stiffer
_DEEPEST = 0.25  # mm, by which a typical pressure presses a layer in; one softer is taken to be stiffer
_GROWN_STEP = 0.1  # mm, of a difference
_LARGE = 2.0  # times the median reading
_FAR_OFF = 1.5  # times what is left of the median press


@dataclass(frozen=True)
class Guess:
    """Parameters of a simulated pad.

    psf_sigma: mm, of the point spread. stiffness: kPa/mm, of the layer. wrist: N mm/rad, infinite if it is rigid.
    grown: mm, by which the outline of each object lies outside that of its drawing; empty if all are as drawn.
    """

    psf_sigma: float
    stiffness: float
    wrist: float
    grown: tuple[float, ...] = ()


# predict(guess, errors) gives what the simulated pad would read without imperfections, (n, taxels) kPa, NaN for a press
# that does not come to rest. errors: (n, 5) [mm, mm, rad, rad, rad], by which each press is off its stated pose, and
# its tilt about the pad's x and y before the wrist gives way.
Predict = Callable[[Guess, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class State:
    """Where a fit stands.

    sigma: mm, of the point spread. response: the exponent g of the response curve, which makes (p / p0)^g of p / p0.
    Each with its standard error.
    give: how much of a tilt the wrist takes back under a typical contact, 0 if it is rigid. errors: (n, 6)
    [mm, mm, rad, -, kPa/mm, kPa/mm]: placement, logarithm of the reading's load, and lean, the slope of the pressure
    along the pad that a tilt about x and y makes under a typical contact. gains: of taxels about their mean; None if
    these have none of their own, as `saved_by_gains` says it. found: what the last
    round said of the errors. give_range: 95 % interval of the give. likelier: by how much the logarithm of the
    likelihood is above that of level presses. grown, grown_error: (outlines,) mm, as in `Guess`, with standard errors.
    """

    sigma: float
    sigma_error: float
    response: float
    response_error: float
    give: float
    errors: FloatArray
    gains: Gains | None = None
    gains_saved: tuple[float, float] = (0.0, np.inf)
    found: PressErrors | None = None
    give_range: tuple[float, float] = (0.0, np.inf)
    likelier: float = 0.0
    grown: FloatArray = field(default_factory=lambda: np.zeros(0))
    grown_error: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def relative(self) -> FloatArray | float:
        """Give the taxels' gains about their mean, (taxels,), or 1 for all."""
        return 1.0 if self.gains is None else self.gains.relative


@dataclass(frozen=True, eq=False)
class PressModel:
    """Recorded readings (n, taxels) kPa, by what predicts them.

    fold: (n,) the group of each press; gains are judged on a group that they were not fitted to. outline: (n,) which
    outline each press is of; -1 for those whose outlines are taken as drawn.
    stated, bending, progress: as in `tactsim.hardware.sensor_fit.fit_sensor`. typical: kPa, p0 of the response curve.
    """

    recorded: FloatArray
    predict: Predict
    stated: Guess
    bending: float
    fold: NDArray[np.intp]
    typical: float
    outline: NDArray[np.intp]
    progress: Callable[[int, int], None]

    @property
    def outlines(self) -> int:
        """Count the outlines that may differ from their drawings."""
        return int(self.outline.max(initial=-1)) + 1

    @property
    def prior(self) -> FloatArray:
        """Guess how far a press's errors (6,) may be, by the size of the faces and their pressure."""
        half = (12 * self.bending) ** 0.25 / 2  # mm, of a square with this second moment
        lean = self.typical / half
        return _GUESS * [half, half, 1.0, 1.0, lean, lean]

    def guess(self, sigma: float, give: float, errors: FloatArray, grown: FloatArray) -> Guess:
        """Choose stiffness and wrist: what readings leave open is as stated."""
        stiffness = self.stated.stiffness
        if give and np.isfinite(self.stated.wrist):
            stiffness = 1e3 * give / (1 - give) * self.stated.wrist / self.bending
        lean = float(np.sqrt((errors[:, LEAN] ** 2).mean()))
        softest = max(lean / (1 - give) / _STEEPEST, self.typical / _DEEPEST, SOFTEST)
        stiffness = min(max(stiffness, softest), STIFFEST)
        wrist = 1e-3 * stiffness * self.bending * (1 - give) / give if give else np.inf
        return Guess(sigma, stiffness, min(wrist, STIFFEST_WRIST) if give else np.inf, tuple(grown.tolist()))

    def read(
        self, state: State, *, give: float | None = None, errors: FloatArray | None = None
    ) -> FloatArray:
        """Predict readings (n, taxels) at a state, or at another give or other errors."""
        give = state.give if give is None else give
        errors = state.errors if errors is None else errors
        guess = self.guess(state.sigma, give, state.errors, state.grown)
        tilts = errors[:, LEAN] / (guess.stiffness * (1 - give))
        image = self.predict(guess, np.column_stack([errors[:, :3], tilts]))
        return self.answered(image, state.response, errors[:, LOAD])

    def answered(self, image: FloatArray, response: float, load: FloatArray) -> FloatArray:
        """Give what a pad with this response curve answers to pressures (n, taxels) under loads exp(`load`)."""
        if response != 1:
            image = self.typical * (np.maximum(image, 0) / self.typical) ** response
        return image * np.exp(load)[:, None]

    def residual(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Give readings, what they leave of the recorded ones, the taxels' gains and the mean square left."""
        predicted = self.read(state)
        gain = (
            best_gain(self.recorded, state.relative * predicted)
            * state.relative
            * np.ones(predicted.shape[1])
        )
        left = np.nan_to_num(self.recorded - gain * predicted)
        variance = float(((self.weights(left)[:, None] * left) ** 2).mean())
        return predicted, left, gain, max(variance, 1e-12)

    def weights(self, left: FloatArray) -> FloatArray:
        """Weigh presses (n,) by their readings and by what is left of these (n, taxels).

        Errors of the model grow with a reading, so a press that reads much more than most does not count for more than
        they do; nor does one that is far off.
        """
        size = np.sqrt((self.recorded**2).mean(axis=1))
        even = np.minimum(1.0, _LARGE * np.median(size) / np.maximum(size, 1e-12))
        off = even * np.sqrt((left**2).mean(axis=1))
        return np.asarray(even * np.minimum(1.0, _FAR_OFF * np.median(off) / np.maximum(off, 1e-12)))

    def slopes(self, state: State, here: FloatArray, *, leans: bool) -> FloatArray:
        """Differentiate readings by each press's errors: (n, taxels, 6); 0 where a press does not rest."""
        slopes = np.zeros((*self.recorded.shape, 6))
        slopes[..., LOAD] = here
        steps = _STEP * self.prior
        for axis in (0, 1, 2, 4, 5) if leans else (0, 1, 2):
            shift = np.zeros(6)
            shift[axis] = steps[axis]
            ahead = self.read(state, errors=state.errors + shift)
            if leans:
                slopes[..., axis] = (ahead - here) / steps[axis]
            else:
                behind = self.read(state, errors=state.errors - shift)
                slopes[..., axis] = (ahead - behind) / (2 * steps[axis])
        return np.nan_to_num(slopes)

    def softer(self, state: State, here: FloatArray) -> FloatArray:
        """Differentiate readings by the give: (n, taxels)."""
        step = _GIVE_STEP if state.give + _GIVE_STEP <= MOST_GIVE else -_GIVE_STEP
        return np.nan_to_num((self.read(state, give=state.give + step) - here) / step)

    def common(self, state: State, here: FloatArray) -> FloatArray:
        """Differentiate readings by gain, point spread and response, (n, taxels, 3)."""
        wider = self.read(replace(state, sigma=state.sigma + _SHARED_STEP))
        bent = self.read(replace(state, response=state.response + _SHARED_STEP))
        slopes = np.stack([here, (wider - here) / _SHARED_STEP, (bent - here) / _SHARED_STEP], axis=2)
        return np.nan_to_num(slopes)

    def wider(self, state: State, here: FloatArray) -> FloatArray:
        """Differentiate readings by how far each outline lies outside its drawing: (n, taxels, outlines)."""
        slopes = np.zeros((*here.shape, len(state.grown)))
        if len(state.grown):
            ahead = self.read(replace(state, grown=state.grown + _GROWN_STEP))
            own = self.outline >= 0
            slopes[own, :, self.outline[own]] = np.nan_to_num((ahead - here)[own] / _GROWN_STEP)
        return slopes

    def yielding(self, give: float) -> float:
        """Turn a give into stiffness over wrist, kPa/mm per N mm/rad."""
        if give <= 0:
            return 0.0
        return np.inf if give >= MOST_GIVE else 1e3 * give / (1 - give) / self.bending
