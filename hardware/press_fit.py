"""Bring simulated presses to recorded readings, in rounds.

What is found: point spread, response curve, gains, outlines, placement, load, tilt, layer and wrist.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.hardware.gain_fit import Gains, saved_by_gains, shrunk_gains, with_gains
from tactsim.hardware.guessed_press import (
    BLUNTEST,
    LOAD,
    MOST_GIVE,
    NARROWEST,
    STEEPEST_RESPONSE,
    WIDEST,
    PressModel,
    State,
)
from tactsim.hardware.press_errors import PressErrors, press_errors

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


@dataclass(frozen=True, eq=False)
class Round:
    """One linearised round of a fit, see `press_errors`.

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


class PressFit(PressModel):
    """A model of presses, and the rounds that fit it to what was recorded."""

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
            new,
            sigma=old.sigma,
            response=old.response,
            give=old.give,
            errors=old.errors,
            gains=old.gains,
            grown=old.grown,
        )

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
        values = []
        bounds = ((NARROWEST, WIDEST), (BLUNTEST, STEEPEST_RESPONSE))
        for value, by, (least, most) in zip(
            (old.sigma, old.response), found.shared[-2:], bounds, strict=True
        ):
            by = share * float(np.clip(by, -_LONGEST * value, _LONGEST * value))
            values.append(min(max(value + by, least), most))
        sigma, response = values
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
