"""Bring simulated presses to recorded readings, in rounds: point spread, gains, placement, tilt, layer and wrist."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.hardware.press_errors import PressErrors, press_errors

NARROWEST, WIDEST = 0.3, 4.0  # mm, of a point spread
SOFTEST, STIFFEST = 1.0, 1e6  # kPa/mm, of a layer
STIFFEST_WRIST = 1e7  # N mm/rad
_PLACEMENT = np.array([2.0, 2.0, 0.2])  # mm, mm, rad: how far presses may be off, as a prior
_LEAN = 5.0  # kPa/mm, by which the pressure may differ along the pad, as a prior
_STEP = np.array([0.05, 0.05, 0.01, 0.5, 0.5])  # of the differences by which the effect of an error is found
_GIVE_STEP = 0.03
_MOST_GIVE = 0.98
_LONGEST = 0.3  # of a step of the give
_STEEPEST = 0.03  # rad, standard deviation of tilts; a layer that needs more is taken to be stiffer
_ROUNDS, _TILTED_ROUNDS = 4, 8
_DECISIONS = (1, 5)  # rounds in which it is decided what can be believed; the first may only end the fit
_HALVINGS = 2
# By how much the logarithm of the likelihood must rise for tilts to be believed. Chance alone gives some 3; the rest
# is for what the model leaves out.
BELIEVED = 15.0
CONFIDENT = 1.96  # standard errors of a 95 % interval


@dataclass(frozen=True)
class Guess:
    """Parameters of a simulated pad.

    psf_sigma: mm, of the point spread. stiffness: kPa/mm, of the layer. wrist: N mm/rad, infinite if it is rigid.
    """

    psf_sigma: float
    stiffness: float
    wrist: float


# predict(guess, errors) gives what the simulated pad would read without imperfections, (n, taxels) kPa, NaN for a press
# that does not come to rest. errors: (n, 5) [mm, mm, rad, rad, rad], by which each press is off its stated pose, and
# its tilt about the pad's x and y before the wrist gives way.
Predict = Callable[[Guess, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class State:
    """Where a fit stands.

    give: how much of a tilt the wrist takes back under a typical contact, 0 if it is rigid. errors: (n, 5)
    [mm, mm, rad, kPa/mm, kPa/mm]: placement and lean, the slope of the pressure along the pad that a tilt about
    x and y makes under a typical contact. relative: (taxels,) gains about their mean. found: what the last
    round said of the errors. give_range: 95 % interval of the give. likelier: by how much the logarithm of the
    likelihood is above that of level presses.
    """

    sigma: float
    sigma_error: float
    give: float
    errors: FloatArray
    relative: FloatArray
    found: PressErrors | None = None
    give_range: tuple[float, float] = (0.0, np.inf)
    likelier: float = 0.0


@dataclass(frozen=True, eq=False)
class Round:
    """One linearised round of a fit, see `press_errors`. common: its shared slopes, those of the give first."""

    about: FloatArray
    slopes: FloatArray
    common: FloatArray
    variance: float
    bounds: tuple[float, float]

    def found(self, leans: bool, yields: bool) -> PressErrors:
        """Estimate errors with or without lean and give."""
        count = 5 if leans else 3
        guess = np.array([*_PLACEMENT, _LEAN, _LEAN])[:count]
        groups = [(0, 1), (2,), (3, 4)][: 3 if leans else 2]
        slopes, common = self.slopes[..., :count], self.common[..., 0 if yields else 1 :]
        bounds = self.bounds if yields else (-np.inf, np.inf)
        return press_errors(self.about, slopes, self.variance, guess, groups, common, bounds)


@dataclass(frozen=True, eq=False)
class PressFit:
    """What is fitted: recorded readings (n, taxels) kPa, by what predicts them.

    stated, bending: as in `tactsim.hardware.sensor_fit.fit_sensor`.
    """

    recorded: FloatArray
    predict: Predict
    stated: Guess
    bending: float

    def level(self) -> State:
        """Fit level presses on a rigid wrist."""
        state = State(1.0, np.inf, 0.0, np.zeros((len(self.recorded), 5)), np.ones(self.recorded.shape[1]))
        for _ in range(_ROUNDS):
            state = self.with_sigma(state)
            predicted, residual, gain, variance = self.residual(state)
            slopes = gain[:, None] * self.slopes(state, range(3), central=True)
            about = residual + np.einsum("nti,ni->nt", slopes, state.errors[:, :3])
            common = self.common(state, predicted)
            found = press_errors(
                about, slopes, variance, _PLACEMENT, [(0, 1), (2,)], common, (-np.inf, np.inf)
            )
            errors = np.zeros_like(state.errors)
            errors[:, :3] = np.clip(found.errors, -3 * _PLACEMENT, 3 * _PLACEMENT)
            state = replace(state, errors=errors, found=found)
            state = self.with_gains(state)
        return state

    def tilted(self, level: State) -> State:
        """Let presses tilt, and the wrist give way, where the readings are much more likely so.

        Of level, tilted and giving way, the simplest that is about as likely as the likeliest is taken, each
        linearised where it fits best (Laplace's approximation).
        """
        soft = self.rounds(level, yields=True)
        if not soft.give and len(known(soft).sd) == 3:
            return replace(level, give_range=soft.give_range)
        rigid = self.rounds(level, yields=False)
        variance = min(self.residual(state)[3] for state in (level, rigid, soft))
        likely = [self.linearised(state, variance).found(*shape(state)) for state in (level, rigid, soft)]
        logs = [found.log_likelihood for found in likely]
        chosen = next(number for number in range(3) if logs[number] > max(logs) - BELIEVED)
        state = replace((level, rigid, soft)[chosen], likelier=logs[chosen] - logs[0])
        if not state.give:
            both = self.linearised(state, variance).found(True, True)
            state = replace(state, give_range=(0.0, both.shared + CONFIDENT * both.shared_error))
        return state

    def rounds(self, level: State, *, yields: bool) -> State:
        """Fit tilted presses on a rigid wrist, or on one that yields; level ones if tilts cannot be believed."""
        ratio = 1e-3 * self.stated.stiffness * self.bending / self.stated.wrist
        state = replace(level, give=ratio / (1 + ratio) if yields else 0.0)
        leans = True
        for number in range(_TILTED_ROUNDS):
            state = self.with_sigma(state)
            variance = self.residual(state)[3]
            round_ = self.linearised(state, variance)
            now = round_.found(leans, yields)
            if number in _DECISIONS:
                believed = now.log_likelihood - round_.found(False, yields).log_likelihood > BELIEVED
                gives = yields and now.log_likelihood - round_.found(leans, False).log_likelihood > BELIEVED
                if not believed and not gives:
                    reach = CONFIDENT * now.shared_error if yields else 0.0
                    return replace(level, give_range=(0.0, now.shared + reach))
                if not believed and number == _DECISIONS[-1]:
                    leans = False
                    now = round_.found(leans, yields)
            state = replace(state, give=now.shared if yields else 0.0)
            reach = CONFIDENT * now.shared_error
            state = self.with_gains(self.stepped(state, now, variance))
            state = replace(state, give_range=(now.shared - reach, now.shared + reach))
        return state

    def linearised(self, state: State, variance: float) -> Round:
        """Linearise the readings about a state."""
        predicted, residual, gain, _ = self.residual(state)
        slopes = gain[:, None] * self.slopes(state, range(5), central=False)
        softer = gain * self.softer(state, predicted)
        about = residual + np.einsum("nti,ni->nt", slopes, state.errors) + state.give * softer
        common = np.concatenate([softer[..., None], self.common(state, predicted)], axis=2)
        bounds = max(0.0, state.give - _LONGEST), min(_MOST_GIVE, state.give + _LONGEST)
        return Round(about, slopes, common, variance, bounds)

    def stepped(self, old: State, found: PressErrors, variance: float) -> State:
        """Go to what was found; for a press that this brings no nearer, a part of the way."""
        count = len(found.sd)
        new = replace(old, found=found, errors=old.errors.copy())
        new.errors[:, count:] = 0
        start, target = new.errors.copy(), new.errors
        reach = np.array([*(3 * _PLACEMENT), np.inf, np.inf])[:count]
        target[:, :count] = np.clip(found.errors, -reach, reach)

        def badness(errors: FloatArray) -> FloatArray:
            left = self.residual(replace(new, errors=errors))[1]
            off = (errors[:, :count] - found.mean) / found.sd
            return (left**2).sum(axis=1) / variance + (off**2).sum(axis=1)

        before = badness(start)
        for _ in range(_HALVINGS):
            worse = badness(target) > before
            if not worse.any():
                break
            target[worse] = (target[worse] + start[worse]) / 2
        return new

    def guess(self, sigma: float, give: float, errors: FloatArray) -> Guess:
        """Choose stiffness and wrist: what readings leave open is as stated."""
        stiffness = self.stated.stiffness
        if give and np.isfinite(self.stated.wrist):
            stiffness = 1e3 * give / (1 - give) * self.stated.wrist / self.bending
        lean = float(np.sqrt((errors[:, 3:] ** 2).mean()))
        stiffness = min(max(stiffness, lean / (1 - give) / _STEEPEST, SOFTEST), STIFFEST)
        wrist = 1e-3 * stiffness * self.bending * (1 - give) / give if give else np.inf
        return Guess(sigma, stiffness, min(wrist, STIFFEST_WRIST) if give else np.inf)

    def read(
        self, state: State, *, give: float | None = None, errors: FloatArray | None = None
    ) -> FloatArray:
        """Predict readings (n, taxels) at a state, or at another give or other errors."""
        give = state.give if give is None else give
        guess = self.guess(state.sigma, give, state.errors)
        physical = (state.errors if errors is None else errors).copy()
        physical[:, 3:] /= guess.stiffness * (1 - give)
        return self.predict(guess, physical)

    def residual(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Give readings, what they leave of the recorded ones, the taxels' gains and the mean square left."""
        predicted = self.read(state)
        gain = best_gain(self.recorded, state.relative * predicted) * state.relative
        left = np.nan_to_num(self.recorded - gain * predicted)
        return predicted, left, gain, max(float((left**2).mean()), 1e-12)

    def slopes(self, state: State, axes: range, *, central: bool) -> FloatArray:
        """Differentiate readings by each press's errors: (n, taxels, axes); 0 where a press does not rest."""
        here = None if central else self.read(state)
        slopes = np.empty((*self.recorded.shape, len(axes)))
        for axis in axes:
            shift = np.zeros(5)
            shift[axis] = _STEP[axis]
            ahead = self.read(state, errors=state.errors + shift)
            behind = self.read(state, errors=state.errors - shift) if here is None else here
            slopes[..., axis] = (ahead - behind) / (_STEP[axis] * (2 if central else 1))
        return np.nan_to_num(slopes)

    def softer(self, state: State, here: FloatArray) -> FloatArray:
        """Differentiate readings by the give: (n, taxels)."""
        step = _GIVE_STEP if state.give + _GIVE_STEP <= _MOST_GIVE else -_GIVE_STEP
        return np.nan_to_num((self.read(state, give=state.give + step) - here) / step)

    def common(self, state: State, here: FloatArray) -> FloatArray:
        """Differentiate readings by the gain and the point spread, (n, taxels, 2): else these would pass for errors."""
        step = 0.02
        wider = self.read(replace(state, sigma=state.sigma + step))
        slopes = np.stack([here * state.relative, (wider - here) * state.relative / step], axis=2)
        return np.nan_to_num(slopes)

    def with_sigma(self, state: State) -> State:
        """Find the point spread with the least squares at its best gain, and its standard error."""
        from scipy.optimize import minimize_scalar

        def squares(sigma: float) -> float:
            return float((self.residual(replace(state, sigma=sigma))[1] ** 2).sum())

        best = minimize_scalar(squares, bounds=(NARROWEST, WIDEST), method="bounded", options={"xatol": 1e-3})
        step = 0.02
        low, high = max(best.x - step, NARROWEST), min(best.x + step, WIDEST)
        curvature = (squares(low) + squares(high) - 2 * best.fun) / step**2
        variance = best.fun / max(self.recorded.size - 2, 1)
        error = float(np.sqrt(2 * variance / curvature)) if curvature > 0 else np.inf
        return replace(state, sigma=float(best.x), sigma_error=error)

    def with_gains(self, state: State) -> State:
        """Fit each taxel's gain about their mean."""
        return replace(state, relative=relative_gains(self.recorded, self.read(state)))

    def yielding(self, give: float) -> float:
        """Turn a give into stiffness over wrist, kPa/mm per N mm/rad."""
        if give <= 0:
            return 0.0
        return np.inf if give >= _MOST_GIVE else 1e3 * give / (1 - give) / self.bending


def known(state: State) -> PressErrors:
    """Give what the last round said of the errors."""
    assert state.found is not None
    return state.found


def shape(state: State) -> tuple[bool, bool]:
    """Tell whether presses tilt and whether the wrist gives way."""
    return len(known(state).sd) > 3, state.give > 0


def relative_gains(recorded: FloatArray, predicted: FloatArray) -> FloatArray:
    """Fit each taxel's gain about their mean, (taxels,). Raises InputError if nothing follows the prediction."""
    rested = np.isfinite(predicted)
    recorded, predicted = recorded * rested, np.nan_to_num(predicted)
    power = (predicted**2).sum(axis=0)
    relative = np.ones(recorded.shape[1])  # of a taxel that is never pressed nothing can be said
    pressed = power > 1e-3 * np.median(power)
    gains = (recorded * predicted).sum(axis=0)[pressed] / power[pressed]
    if not gains.mean() > 0:
        raise InputError(
            "the recorded readings do not follow the simulated ones at all: are the poses right?"
        )
    relative[pressed] = gains / gains.mean()
    return relative


def best_gain(recorded: FloatArray, predicted: FloatArray) -> float:
    """Find the gain with the least squares; predictions that are NaN do not count."""
    return float(np.nansum(recorded * predicted) / max(float(np.nansum(predicted**2)), 1e-12))
