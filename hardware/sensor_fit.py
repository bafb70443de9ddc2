"""Find the parameters of the simulated pad that bring its readings nearest to recorded ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.hardware.press_errors import PressErrors, press_errors
from tactsim.hardware.taxel_error import untouched

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
_BELIEVED = 15.0
_DECADES = 0.5  # between the layers of the profile likelihood
_TOO_STEEP = 0.3  # rad, of a tilt that tips over
_LIFTED = 0.6  # of the mean pressure
_CONFIDENT = 1.96  # standard errors of a 95 % interval


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
class SensorFit:
    """The parameters of the sensor model that explain recorded readings best.

    psf_sigma, psf_sigma_error: mm, the point spread and its standard error. gain: recorded over simulated
    pressure, which an error of the force changes too. gain_per_taxel: (taxels,) relative to `gain`;
    gain_spread: their standard deviation. noise: kPa, standard deviation of a reading where nothing
    touches. placement: (n, 3) [mm, mm, rad] in the sensor frame, by how much each press seems to be off;
    offset: (3,) its median; placement_mm, placement_rad: its standard deviation. misfit: kPa, root mean
    square of what is left unexplained.

    tilts: (n, 2) rad about the pad's x and y; tilt_offset: (2,) their mean; placement_tilt: their standard
    deviation; all for `stiffness` (kPa/mm) and `wrist` (N mm/rad, infinite if rigid). lean: kPa/mm, stiffness
    times placement_tilt, which readings do tell. tilt_gain: by how much the logarithm of the likelihood rises
    with tilts and a wrist that gives way; they are not believed, and 0, if that is little.
    yielding, yielding_low, yielding_high: kPa/mm per N mm/rad, stiffness over wrist and its 95 % interval; an
    end of the interval is 0 or infinite if the readings do not bound it. There is none where tilts lift many faces from
    the pad with a side: a linearised fit is biased then. stiffness_low, stiffness_high: kPa/mm,
    a 95 % interval of the profile likelihood, in which tilts and wrist follow; 0 or infinite likewise. held:
    "layer" or "wrist", whose stiffness was taken as it is, so that the other's follows from their ratio.
    lifted: whether tilts lift a side of many faces from the pad, so that the figures of tilt, layer and wrist are rough.
    blanks: presses that do not come to rest in the fitted simulation, which says nothing of them.
    """

    psf_sigma: float
    psf_sigma_error: float
    gain: float
    gain_per_taxel: FloatArray
    gain_spread: float
    noise: float
    placement: FloatArray
    offset: FloatArray
    placement_mm: float
    placement_rad: float
    tilts: FloatArray
    tilt_offset: FloatArray
    placement_tilt: float
    lean: float
    tilt_gain: float
    stiffness: float
    stiffness_low: float
    stiffness_high: float
    wrist: float
    yielding: float
    yielding_low: float
    yielding_high: float
    held: Literal["layer", "wrist"]
    lifted: bool
    misfit: float
    blanks: int

    @property
    def guess(self) -> Guess:
        """Give the parameters that a prediction takes."""
        return Guess(self.psf_sigma, self.stiffness, self.wrist)

    @property
    def errors(self) -> FloatArray:
        """Give placement and tilt of each press, (n, 5), as a prediction takes them."""
        return np.column_stack([self.placement, self.tilts])


@dataclass(frozen=True, eq=False)
class _State:
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


def fit_sensor(recorded: FloatArray, predict: Predict, stated: Guess, bending: float) -> SensorFit:
    """Fit point spread, gain, noise, placement, tilt and stiffness to readings (n, taxels) kPa.

    stated: the simulation's own parameters. bending: mm^4, a typical second moment of the area that touches.

    Level presses on a rigid wrist are fitted first. Then presses may tilt and the wrist give way; this is kept
    if the readings are much more likely with it. Each round finds the point spread with the best gain, and then
    each press's errors by a linearised step (`press_errors`). Errors have a normal prior whose spread is itself
    fitted, so that what a letter's symmetry leaves open stays where it was. Without them, wrong placement would
    pass for a wider point spread, and a tilt for both.

    Under a flat face on an elastic (Winkler) foundation the pressure is max(0, p0 + g . r), and moments balance
    where g = stiffness * tilt - (stiffness / wrist) * moment(g). So readings tell stiffness * tilt and
    stiffness / wrist, and no more. What is left open is taken as stated: the wrist, if it gives way and the
    ratio is known, else the layer's stiffness.

    Raises InputError if nothing in the readings follows the prediction.
    """
    fit = _Fit(recorded, predict, stated, bending)
    return fit.summary(fit.tilted(fit.level()))


@dataclass(frozen=True, eq=False)
class _Round:
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
class _Fit:
    recorded: FloatArray
    predict: Predict
    stated: Guess
    bending: float

    def level(self) -> _State:
        """Fit level presses on a rigid wrist."""
        state = _State(1.0, np.inf, 0.0, np.zeros((len(self.recorded), 5)), np.ones(self.recorded.shape[1]))
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

    def tilted(self, level: _State) -> _State:
        """Let presses tilt, and the wrist give way, where the readings are much more likely so.

        Of level, tilted and giving way, the simplest that is about as likely as the likeliest is taken, each
        linearised where it fits best (Laplace's approximation).
        """
        soft = self.rounds(level, yields=True)
        if not soft.give and len(_known(soft).sd) == 3:
            return replace(level, give_range=soft.give_range)
        rigid = self.rounds(level, yields=False)
        variance = min(self.residual(state)[3] for state in (level, rigid, soft))
        likely = [self.linearised(state, variance).found(*_shape(state)) for state in (level, rigid, soft)]
        logs = [found.log_likelihood for found in likely]
        chosen = next(number for number in range(3) if logs[number] > max(logs) - _BELIEVED)
        state = replace((level, rigid, soft)[chosen], likelier=logs[chosen] - logs[0])
        if not state.give:
            both = self.linearised(state, variance).found(True, True)
            state = replace(state, give_range=(0.0, both.shared + _CONFIDENT * both.shared_error))
        return state

    def rounds(self, level: _State, *, yields: bool) -> _State:
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
                believed = now.log_likelihood - round_.found(False, yields).log_likelihood > _BELIEVED
                gives = yields and now.log_likelihood - round_.found(leans, False).log_likelihood > _BELIEVED
                if not believed and not gives:
                    reach = _CONFIDENT * now.shared_error if yields else 0.0
                    return replace(level, give_range=(0.0, now.shared + reach))
                if not believed and number == _DECISIONS[-1]:
                    leans = False
                    now = round_.found(leans, yields)
            state = replace(state, give=now.shared if yields else 0.0)
            reach = _CONFIDENT * now.shared_error
            state = self.with_gains(self.stepped(state, now, variance))
            state = replace(state, give_range=(now.shared - reach, now.shared + reach))
        return state

    def linearised(self, state: _State, variance: float) -> _Round:
        """Linearise the readings about a state."""
        predicted, residual, gain, _ = self.residual(state)
        slopes = gain[:, None] * self.slopes(state, range(5), central=False)
        softer = gain * self.softer(state, predicted)
        about = residual + np.einsum("nti,ni->nt", slopes, state.errors) + state.give * softer
        common = np.concatenate([softer[..., None], self.common(state, predicted)], axis=2)
        bounds = max(0.0, state.give - _LONGEST), min(_MOST_GIVE, state.give + _LONGEST)
        return _Round(about, slopes, common, variance, bounds)

    def stepped(self, old: _State, found: PressErrors, variance: float) -> _State:
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
        self, state: _State, *, give: float | None = None, errors: FloatArray | None = None
    ) -> FloatArray:
        """Predict readings (n, taxels) at a state, or at another give or other errors."""
        give = state.give if give is None else give
        guess = self.guess(state.sigma, give, state.errors)
        physical = (state.errors if errors is None else errors).copy()
        physical[:, 3:] /= guess.stiffness * (1 - give)
        return self.predict(guess, physical)

    def residual(self, state: _State) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Give readings, what they leave of the recorded ones, the taxels' gains and the mean square left."""
        predicted = self.read(state)
        gain = _gain(self.recorded, state.relative * predicted) * state.relative
        left = np.nan_to_num(self.recorded - gain * predicted)
        return predicted, left, gain, max(float((left**2).mean()), 1e-12)

    def slopes(self, state: _State, axes: range, *, central: bool) -> FloatArray:
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

    def softer(self, state: _State, here: FloatArray) -> FloatArray:
        """Differentiate readings by the give: (n, taxels)."""
        step = _GIVE_STEP if state.give + _GIVE_STEP <= _MOST_GIVE else -_GIVE_STEP
        return np.nan_to_num((self.read(state, give=state.give + step) - here) / step)

    def common(self, state: _State, here: FloatArray) -> FloatArray:
        """Differentiate readings by the gain and the point spread, (n, taxels, 2): else these would pass for errors."""
        step = 0.02
        wider = self.read(replace(state, sigma=state.sigma + step))
        slopes = np.stack([here * state.relative, (wider - here) * state.relative / step], axis=2)
        return np.nan_to_num(slopes)

    def with_sigma(self, state: _State) -> _State:
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

    def with_gains(self, state: _State) -> _State:
        """Fit each taxel's gain about their mean."""
        return replace(state, relative=_relative_gains(self.recorded, self.read(state)))

    def summary(self, state: _State) -> SensorFit:
        """Put a fit into physical units, and say how well its parameters are known."""
        predicted, left, _, variance = self.residual(state)
        guess, found = self.guess(state.sigma, state.give, state.errors), _known(state)
        rested = np.isfinite(predicted).all(axis=1)
        per_lean = 1 / (guess.stiffness * (1 - state.give))
        tilts = state.errors[:, 3:] * per_lean
        steep = float(found.sd[3]) * per_lean if len(found.sd) > 3 else 0.0
        low, high = (self.yielding(give) for give in state.give_range)
        lifted = self.lifts(found, predicted[rested])
        if lifted:
            low, high = 0.0, np.inf
        softest, stiffest = self.stiffness_range(state, variance)
        return SensorFit(
            psf_sigma=state.sigma,
            psf_sigma_error=state.sigma_error,
            gain=_gain(self.recorded, state.relative * predicted),
            gain_per_taxel=state.relative,
            gain_spread=float(state.relative.std(ddof=1)) if len(state.relative) > 1 else 0.0,
            noise=_noise(left[rested], predicted[rested]),
            placement=state.errors[:, :3],
            offset=np.median(state.errors[:, :3], axis=0),
            placement_mm=float(found.sd[0]),
            placement_rad=float(found.sd[2]),
            tilts=tilts,
            tilt_offset=tilts.mean(axis=0),
            placement_tilt=steep,
            lean=steep * guess.stiffness,
            tilt_gain=state.likelier,
            stiffness=guess.stiffness,
            stiffness_low=softest,
            stiffness_high=stiffest,
            wrist=guess.wrist,
            yielding=self.yielding(state.give),
            yielding_low=low,
            yielding_high=high,
            held="wrist" if state.give and np.isfinite(self.stated.wrist) else "layer",
            lifted=lifted,
            misfit=float(np.sqrt((left**2).mean())),
            blanks=int((~rested).sum()),
        )

    def stiffness_range(self, state: _State, variance: float) -> tuple[float, float]:
        """Find the layers that explain the readings as well, kPa/mm: a profile likelihood.

        Tilts and wrist follow the stiffness, so that lean and give stay. An end that the readings do not bound
        is 0 or infinite.
        """
        errors = state.errors.copy()
        chosen = self.guess(state.sigma, state.give, errors)
        steps = np.arange(np.log10(SOFTEST), np.log10(STIFFEST) + 1e-9, _DECADES)
        squares = []
        for stiffness in 10**steps:
            wrist = chosen.wrist * stiffness / chosen.stiffness
            errors[:, 3:] = state.errors[:, 3:] / (stiffness * (1 - state.give))
            steep = np.abs(errors[:, 3:]).max() > _TOO_STEEP
            if steep or not (np.isinf(wrist) or 1 <= wrist <= STIFFEST_WRIST):
                squares.append(np.inf)
                continue
            predicted = self.predict(Guess(state.sigma, float(stiffness), wrist), errors)
            gain = _gain(self.recorded, state.relative * predicted) * state.relative
            left = np.where(np.isfinite(predicted), self.recorded - gain * predicted, self.recorded)
            squares.append(float((left**2).sum()))
        as_good = np.flatnonzero(np.array(squares) - min(squares) < 2 * _BELIEVED * variance)
        first, last = int(as_good[0]), int(as_good[-1])
        return (
            0.0 if first == 0 else float(10 ** steps[first - 1]),
            np.inf if last == len(steps) - 1 else float(10 ** steps[last + 1]),
        )

    def lifts(self, found: PressErrors, predicted: FloatArray) -> bool:
        """Tell whether tilts are so large that many faces leave the pad with a side.

        A linearised fit then puts `give` too high: by 20 % to 100 % in stiffness over wrist where tilts are known.
        """
        if len(found.sd) < 4:
            return False
        half = (12 * self.bending) ** 0.25 / 2  # of a square with this second moment
        return float(found.sd[3]) * half > _LIFTED * float(predicted[~untouched(predicted)].mean())

    def yielding(self, give: float) -> float:
        """Turn a give into stiffness over wrist, kPa/mm per N mm/rad."""
        if give <= 0:
            return 0.0
        return np.inf if give >= _MOST_GIVE else 1e3 * give / (1 - give) / self.bending


def _known(state: _State) -> PressErrors:
    assert state.found is not None
    return state.found


def _shape(state: _State) -> tuple[bool, bool]:
    """Tell whether presses tilt and whether the wrist gives way."""
    return len(_known(state).sd) > 3, state.give > 0


def _relative_gains(recorded: FloatArray, predicted: FloatArray) -> FloatArray:
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


def _gain(recorded: FloatArray, predicted: FloatArray) -> float:
    return float(np.nansum(recorded * predicted) / max(float(np.nansum(predicted**2)), 1e-12))


def _noise(left: FloatArray, predicted: FloatArray) -> float:
    """Take the spread of what is `left` at taxels that nothing touches; at all, if all are touched."""
    free = untouched(predicted)
    values = left[free] if free.sum() >= 10 else left.ravel()
    return float(1.4826 * np.median(np.abs(values - np.median(values))))  # sd of a normal distribution
