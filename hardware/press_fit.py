"""Bring simulated presses to recorded readings, in rounds.

What is found: point spread, response curve, gains, outlines, placement, load, tilt, layer and wrist.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.hardware.taxel_fit import (
    Gains,
    PressErrors,
    best_gain,
    press_errors,
    saved_by_gains,
    shrunk_gains,
    with_gains,
)

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
_REACH = np.array([3.0, 3.0, 3.0, 10.0, np.inf, np.inf])  # of errors, times the prior
_FIRST_GIVE = 0.5
_LONGEST = 0.3  # of a step of the give, and, as a share, of point spread and response
_LEVEL_ROUNDS, _TILTED_ROUNDS = 6, 12
ROUNDS = _LEVEL_ROUNDS + 2 * _TILTED_ROUNDS  # at most
_SETTLED = 0.003  # of the mean square: a round that takes less is the last
# Shares of a round's step that are tried: of what presses share, and of their errors. Errors may follow a wrist that
# gives way so steeply that they must not go ahead of it.
_SHARES = ((1.0, 1.0), (0.5, 1.0), (0.25, 1.0), (0.5, 0.5), (0.25, 0.25), (0.1, 0.1))
_STARTS = (0.4, 6.0, 6)  # mm, point spreads to start from, and how many
_RESPONSES = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)  # exponents to start from
_MOST_GROWN = 1.0  # mm
_DRAWN = 0.5  # mm, standard deviation by which outlines are off their drawings, as a prior
_GAINS_JUDGED = 3  # level rounds before it is judged whether gains help
_DECISIONS = (1, 3)  # rounds in which it is decided what can be believed; the first may only end the fit
_HALVINGS = 2
# By how much the logarithm of the likelihood must rise for tilts to be believed. Chance alone gives some 3; the rest
# is for what the model leaves out.
BELIEVED = 15.0
CONFIDENT = 1.96  # standard errors of a 95 % interval


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
class Round:
    """One linearised round of a fit, see `taxel_fit`.

    common: shared slopes of give, outlines, gain, point spread, response. The first is counted from 0, the others from
    where the fit stands. grown: (outlines,) mm, there. weight: (n,) of the presses: less than 1 for
    those that are far off, such as one that holds on to a letter's last corner (P. J. Huber, Robust Statistics, 1981).
    """

    about: FloatArray
    slopes: FloatArray
    common: FloatArray
    weight: FloatArray
    of_gains: FloatArray
    gains: Gains | None
    guess: FloatArray
    variance: float
    bounds: tuple[float, float]
    grown: FloatArray

    def found(self, leans: bool, yields: bool) -> PressErrors:
        """Estimate errors with or without lean and give."""
        count = 6 if leans else 4
        guess = self.guess[:count]
        groups = [(0, 1), (2,), (3,), (4, 5)][: 4 if leans else 3]
        slopes, common = self.slopes[..., :count], self.common if yields else self.common[..., 1:]
        bounds = self.bounds if yields else (-np.inf, np.inf)
        each = self.weight[:, None]
        about, slopes, common = each * self.about, each[..., None] * slopes, each[..., None] * common
        drawn, precision = np.zeros(common.shape[2]), np.zeros(common.shape[2])
        outlines = slice(int(yields), int(yields) + len(self.grown))
        drawn[outlines], precision[outlines] = -self.grown, 1 / _DRAWN**2
        found = press_errors(about, slopes, self.variance, guess, groups, common, bounds, (drawn, precision))
        if self.gains is None:
            return found
        found = with_gains(found, about, slopes, common, self.variance, each * self.of_gains, self.gains)
        if yields:
            found.shared[0] = min(max(found.shared[0], bounds[0]), bounds[1])
        return found


@dataclass(frozen=True, eq=False)
class PressFit:
    """Recorded readings (n, taxels) kPa, what predicts them, and the rounds that bring the two together.

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
        relative = state.relative * np.ones(predicted.shape[1])
        gain = best_gain(self.recorded, relative * predicted) * relative
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

    def level(self) -> State:
        """Fit level presses on a rigid wrist, and judge whether taxels have gains of their own."""
        state = self.started()
        for number in range(_LEVEL_ROUNDS):
            self.progress(number, ROUNDS)
            variance = self.residual(state)[3]
            found = self.linearised(state, variance, leans=False).found(False, False)
            state = self.advanced(state, found, variance, yields=False)
            if number == _GAINS_JUDGED:
                state = self.judged(state)
        return state

    def judged(self, state: State) -> State:
        """Let taxels have gains of their own if these help on presses that they were not fitted to."""
        image = self.read(state)
        saved = saved_by_gains(self.recorded, image, self.fold)
        gains = shrunk_gains(self.recorded, image, self.fold) if saved[0] > saved[1] else None
        return replace(state, gains=gains, gains_saved=saved)

    def started(self) -> State:
        """Find where to start: the point spread and the response with which each press looks most like its reading.

        Each press is where it is stated, and has a load of its own: what is compared is the cosine between the two.
        """
        errors = np.zeros((len(self.recorded), 6))
        size = np.linalg.norm(self.recorded, axis=1)
        best, most = (self.stated.psf_sigma, 1.0), -np.inf
        for sigma in np.geomspace(_STARTS[0], _STARTS[1], _STARTS[2]).tolist():
            image = np.nan_to_num(
                self.predict(self.guess(sigma, 0.0, errors, np.zeros(self.outlines)), errors[:, :5])
            )
            for response in _RESPONSES:
                bent = self.answered(image, response, errors[:, LOAD])
                alike = (self.recorded * bent).sum(axis=1)
                alike /= np.maximum(size * np.linalg.norm(bent, axis=1), 1e-12)
                if alike.sum() > most:
                    best, most = (sigma, response), float(alike.sum())
        nothing = np.zeros(self.outlines)
        return State(
            best[0], np.inf, best[1], np.inf, 0.0, errors, grown=nothing, grown_error=nothing + np.inf
        )

    def tilted(self, level: State) -> State:
        """Let presses tilt, and the wrist give way, where the readings are much more likely so.

        Of level, tilted and giving way, the simplest that is about as likely as the likeliest is taken, each
        linearised where it fits best (Laplace's approximation).
        """
        soft = self.rounds(level, yields=True)
        if not soft.give and len(known(soft).sd) == 4:
            return replace(level, give_range=soft.give_range)
        rigid = self.rounds(level, yields=False)
        variance = min(self.residual(state)[3] for state in (level, rigid, soft))
        likely = [self.linearised(state, variance).found(*shape(state)) for state in (level, rigid, soft)]
        logs = [found.log_likelihood for found in likely]
        chosen = next(number for number in range(3) if logs[number] > max(logs) - BELIEVED)
        state = replace((level, rigid, soft)[chosen], likelier=logs[chosen] - logs[0])
        if not state.give:
            both = self.linearised(state, variance).found(True, True)
            reach = CONFIDENT * float(both.shared_error[0])
            state = replace(state, give_range=(0.0, float(both.shared[0]) + reach))
        return state

    def rounds(self, level: State, *, yields: bool) -> State:
        """Fit tilted presses on a rigid wrist, or on one that yields; level ones if tilts cannot be believed."""
        ratio = 1e-3 * self.stated.stiffness * self.bending / self.stated.wrist
        state = replace(level, give=min(ratio / (1 + ratio), _FIRST_GIVE) if yields else 0.0)
        leans = True
        before = _LEVEL_ROUNDS + (0 if yields else _TILTED_ROUNDS)
        for number in range(_TILTED_ROUNDS):
            self.progress(before + number, ROUNDS)
            variance = self.residual(state)[3]
            round_ = self.linearised(state, variance)
            now = round_.found(leans, yields)
            if number in _DECISIONS:
                believed = now.log_likelihood - round_.found(False, yields).log_likelihood > BELIEVED
                gives = yields and now.log_likelihood - round_.found(leans, False).log_likelihood > BELIEVED
                if not believed and not gives:
                    reach = now.shared[0] + CONFIDENT * now.shared_error[0] if yields else 0.0
                    return replace(level, give_range=(0.0, float(reach)))
                if not believed and number == _DECISIONS[-1]:
                    leans = False
                    now = round_.found(leans, yields)
            reach = CONFIDENT * float(now.shared_error[0])
            state = self.advanced(state, now, variance, yields=yields)
            state = replace(state, give_range=(state.give - reach, state.give + reach))
            if number == _DECISIONS[-1]:
                state = self.judged(state)
            elif number > _DECISIONS[-1] and self.residual(state)[3] > (1 - _SETTLED) * variance:
                break
        return state

    def advanced(self, old: State, found: PressErrors, variance: float, *, yields: bool) -> State:
        """Go to what a round found; a part of the way, or none, if that brings readings no nearer."""
        for share, of_errors in _SHARES:
            give = old.give + share * (float(found.shared[0]) - old.give) if yields else 0.0
            new = self.stepped(self.shared(replace(old, give=give), found, share), found, variance, of_errors)
            if self.residual(new)[3] <= variance:
                return new
        return replace(
            old, found=found, sigma_error=new.sigma_error, response_error=new.response_error,
            grown_error=new.grown_error,
        )  # fmt: skip

    def linearised(self, state: State, variance: float, *, leans: bool = True) -> Round:
        """Linearise the readings about a state; without `leans` for a fit of level presses on a rigid wrist."""
        predicted, residual, gain, _ = self.residual(state)
        slopes = gain[:, None] * self.slopes(state, predicted, leans=leans)
        about = residual + np.einsum("nti,ni->nt", slopes, state.errors)
        give = gain * self.softer(state, predicted) if leans else np.zeros_like(predicted)
        about += state.give * give
        shared = gain[:, None] * np.concatenate(
            [self.wider(state, predicted), self.common(state, predicted)], axis=2
        )
        common = np.concatenate([give[..., None], shared], axis=2)
        bounds = max(0.0, state.give - _LONGEST), min(MOST_GIVE, state.give + _LONGEST)
        of_gains = np.nan_to_num(gain / state.relative * predicted)
        return Round(
            about, slopes, common, self.weights(residual), of_gains, state.gains, self.prior, variance, bounds,
            state.grown,
        )  # fmt: skip

    def shared(self, old: State, found: PressErrors, share: float) -> State:
        """Go a share of the way to point spread, response, outlines and gains that were found; less if it is far."""
        values = np.array([old.sigma, old.response])
        by = share * np.clip(found.shared[-2:], -_LONGEST * values, _LONGEST * values)
        least, most = (NARROWEST, BLUNTEST), (WIDEST, STEEPEST_RESPONSE)
        sigma, response = np.clip(values + by, least, most).tolist()
        of_outlines = slice(len(found.shared) - 3 - len(old.grown), len(found.shared) - 3)
        grown = np.clip(old.grown + share * found.shared[of_outlines], -_MOST_GROWN, _MOST_GROWN)
        gains = old.gains
        if gains is not None and found.gains is not None:
            relative = np.maximum(gains.relative + share * found.gains, 0)
            gains = replace(gains, relative=relative / relative.mean())
        return replace(
            old, sigma=sigma, sigma_error=float(found.shared_error[-2]), response=response,
            response_error=float(found.shared_error[-1]), gains=gains, grown=grown,
            grown_error=found.shared_error[of_outlines],
        )  # fmt: skip

    def stepped(self, old: State, found: PressErrors, variance: float, share: float = 1.0) -> State:
        """Go a share of the way to the errors that were found; for a press that this brings no nearer, less of it."""
        count = len(found.sd)
        new = replace(old, found=found, errors=old.errors.copy())
        new.errors[:, count:] = 0
        start, target = new.errors.copy(), new.errors
        reach = (_REACH * self.prior)[:count]
        aim = np.clip(found.errors, -reach, reach)
        target[:, :count] += share * (aim - target[:, :count])

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
        target[:, LOAD] -= target[:, LOAD].mean()  # the gain takes what all loads have in common
        return new


def known(state: State) -> PressErrors:
    """Give what the last round said of the errors."""
    assert state.found is not None
    return state.found


def shape(state: State) -> tuple[bool, bool]:
    """Tell whether presses tilt and whether the wrist gives way."""
    return len(known(state).sd) > 4, state.give > 0
