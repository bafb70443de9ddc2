"""Find the parameters of the simulated pad that bring its readings nearest to recorded ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.hardware.press_fit import (
    BELIEVED,
    BLUNTEST,
    CONFIDENT,
    LEAN,
    LOAD,
    NARROWEST,
    ROUNDS,
    SOFTEST,
    STEEPEST_RESPONSE,
    STIFFEST,
    STIFFEST_WRIST,
    WIDEST,
    Guess,
    Predict,
    PressFit,
    State,
    known,
    shape,
)
from tactsim.hardware.taxel_fit import (
    PressErrors,
    best_gain,
    shrunk_gains,
    stray_contacts,
    unevenness,
    untouched,
)

_DECADES = 0.5  # between the layers of the profile likelihood
_TOO_STEEP = 0.3  # rad, of a tilt that tips over
_FOLDS = 6
_LIFTED = 0.6  # of the mean pressure; on the safe side


@dataclass(frozen=True, eq=False)
class SensorFit:
    """The parameters of the sensor model that explain recorded readings best.

    psf_sigma: mm, the point spread. response: the exponent g of the response curve p0 (p / p0)^g, whose p0 is
    `typical`, kPa of the simulation. gain: recorded over simulated
    pressure, which an error of the force and the unit of the recording change too. Each has its 95 % interval, with an
    end at 0 or infinity where the value is on its bound or the readings do not tell.
    gain_per_taxel: (taxels,) relative to `gain`, drawn to 1 by as much as readings leave open; all 1 if they do not
    help on presses that they were not fitted to. gains_saved: by which share of the squares left they help there, and
    its standard error. gain_spread: standard deviation of the taxels' true gains, before the response; texture: of what
    each press's contact adds to them; stray: share of the taxels in contact where no face is. noise:
    in the recording's unit, standard deviation of a reading where nothing touches.
    placement: (n, 3) [mm, mm, rad] in the sensor frame, by how much each press seems to be off;
    offset: (3,) its median; placement_mm, placement_rad: its standard deviation. loads: (n,) shares of the mean load;
    load_spread: their standard deviation. Each standard deviation has its 95 % interval. misfit: root mean
    square of what is left unexplained. held_out, held_out_placed: (n, taxels) readings predicted for each group of
    presses by a fit to the others, each press where it is stated (but for what all are off) or where it seems to be.

    tilts: (n, 2) rad about the pad's x and y; tilt_offset: (2,) their mean; placement_tilt: their standard deviation;
    all for `stiffness` (kPa/mm) and `wrist` (N mm/rad, infinite if rigid). lean: kPa/mm, stiffness times
    placement_tilt, which readings do tell. tilt_gain: by how much the logarithm of the likelihood rises with tilts and
    a wrist that gives way; they are not believed, and 0, if that is little. yielding, yielding_low, yielding_high:
    kPa/mm per N mm/rad, stiffness over wrist and its 95 % interval; an end of the interval is 0 or infinite if the
    readings do not bound it. There is none where tilts lift many faces from the pad with a side: a linearised fit is
    biased then. stiffness_low, stiffness_high: kPa/mm, a 95 % interval of the profile likelihood, in which tilts and
    wrist follow; 0 or infinite likewise. held: "layer" or "wrist", whose stiffness was taken as it is, so that the
    other's follows from their ratio. lifted: whether tilts lift a side of many faces from the pad: then tilt, layer and
    wrist are rough figures. blanks: presses that do not come to rest in the fitted simulation, which says nothing of
    them. grown, grown_range: mm, by which each outline seems to lie outside its drawing, and 95 % intervals.
    """

    psf_sigma: float
    psf_sigma_range: tuple[float, float]
    response: float
    response_range: tuple[float, float]
    typical: float
    gain: float
    gain_range: tuple[float, float]
    gain_per_taxel: FloatArray
    gains_saved: tuple[float, float]
    gain_spread: float
    texture: float
    stray: float
    noise: float
    placement: FloatArray
    offset: FloatArray
    placement_mm: float
    placement_mm_range: tuple[float, float]
    placement_rad: float
    placement_rad_range: tuple[float, float]
    loads: FloatArray
    load_spread: float
    load_spread_range: tuple[float, float]
    tilts: FloatArray
    tilt_offset: FloatArray
    placement_tilt: float
    placement_tilt_range: tuple[float, float]
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
    held_out: FloatArray
    held_out_placed: FloatArray
    grown: tuple[float, ...]
    grown_range: tuple[tuple[float, float], ...]

    @property
    def guess(self) -> Guess:
        """Give the parameters that a prediction takes."""
        return Guess(self.psf_sigma, self.stiffness, self.wrist, self.grown)

    @property
    def errors(self) -> FloatArray:
        """Give placement and tilt of each press, (n, 5), as a prediction takes them."""
        return np.column_stack([self.placement, self.tilts])

    def answered(self, pressures: FloatArray) -> FloatArray:
        """Give what the fitted pad answers to simulated pressures (n, taxels) kPa of the fitted presses."""
        bent = self.typical * (np.maximum(pressures, 0) / self.typical) ** self.response
        return self.gain * self.gain_per_taxel * self.loads[:, None] ** self.response * bent


def fit_sensor(
    recorded: FloatArray,
    predict: Predict,
    stated: Guess,
    bending: float,
    fold: NDArray[np.intp] | None = None,
    outline: NDArray[np.intp] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> SensorFit:
    """Fit point spread, response, gain, noise, placement, load, tilt and stiffness to readings (n, taxels) of any unit.

    stated: the simulation's own parameters. bending: mm^4, a typical second moment of the area that touches.
    fold: (n,) groups of presses that are held out in turn to judge the fit; every sixth press if there are none.
    outline: (n,) which outline each press is of, where outlines may differ from their drawings; none may otherwise.
    progress: is told after each round how many are done, and how many there are at most.

    The unit is found first, as the gain of all readings, and everything after is as if it were 1.
    Level presses on a rigid wrist are fitted first. Then presses may tilt and the wrist give way; this is kept
    if the readings are much more likely with it. Each round finds the point spread with the best gain, and then
    each press's errors by a linearised step (`taxel_fit`). Errors have a normal prior whose spread is itself
    fitted, so that what a letter's symmetry leaves open stays where it was. Without them, wrong placement would
    pass for a wider point spread, and a tilt for both.

    Under a flat face on an elastic (Winkler) foundation the pressure is max(0, p0 + g . r), and moments balance
    where g = stiffness * tilt - (stiffness / wrist) * moment(g). So readings tell stiffness * tilt and
    stiffness / wrist, and no more. What is left open is taken as stated: the wrist, if it gives way and the
    ratio is known, else the layer's stiffness.

    Raises InputError if nothing in the readings follows the prediction.
    """
    ideal = predict(stated, np.zeros((len(recorded), 5)))
    unit = best_gain(recorded, ideal)
    if not unit > 0:
        raise InputError(
            "the recorded readings do not follow the simulated ones at all: are the poses right?"
        )
    touched = ~untouched(np.nan_to_num(ideal))
    typical = float(ideal[touched].mean())
    groups = np.arange(len(recorded)) % _FOLDS if fold is None else fold
    drawn = np.full(len(recorded), -1) if outline is None else outline
    fit = PressFit(recorded / unit, predict, stated, bending, groups, typical, drawn, progress)
    found = _summary(fit, fit.tilted(fit.level()), unit)
    progress(ROUNDS, ROUNDS)
    return found


def _summary(fit: PressFit, state: State, unit: float) -> SensorFit:
    """Put a fit into physical units, and say how well its parameters are known."""
    predicted, left, _, variance = fit.residual(state)
    guess, found = fit.guess(state.sigma, state.give, state.errors, state.grown), known(state)
    rested = np.isfinite(predicted).all(axis=1)
    per_lean = 1 / (guess.stiffness * (1 - state.give))
    tilts = state.errors[:, LEAN] * per_lean
    tilted = len(found.sd) > LEAN.start
    steep = float(found.sd[LEAN.start]) * per_lean if tilted else 0.0
    steep_range = _sd_range(found, LEAN.start, per_lean) if tilted else (0.0, 0.0)
    low, high = (fit.yielding(give) for give in state.give_range)
    lifted = _lifts(found, predicted[rested], fit.bending)
    if lifted:
        low, high = 0.0, np.inf
    softest, stiffest = _stiffness_range(fit, state, variance)
    gain = best_gain(fit.recorded, state.relative * predicted)
    apart, placed = _held_out(fit, state)
    noise = noise_of(left[rested], predicted[rested])
    unseen = _left_out(fit, state)
    own, texture = unevenness(fit.recorded, unseen, fit.fold, noise)
    gain_spread = 0.0 if state.gains is None else shrunk_gains(fit.recorded, predicted, fit.fold).spread
    return SensorFit(
        psf_sigma=state.sigma,
        psf_sigma_range=_interval(state.sigma, state.sigma_error, NARROWEST, WIDEST),
        response=state.response,
        response_range=_interval(state.response, state.response_error, BLUNTEST, STEEPEST_RESPONSE),
        typical=fit.typical,
        gain=gain * unit,
        gain_range=_interval(gain * unit, gain * unit * float(found.shared_error[-3]), 0.0, np.inf),
        gain_per_taxel=state.relative * np.ones(fit.recorded.shape[1]),
        gains_saved=state.gains_saved,
        gain_spread=float(np.hypot(gain_spread, own)) / state.response,
        texture=texture / state.response,
        stray=stray_contacts(fit.recorded, unseen, noise),
        noise=noise * unit,
        placement=state.errors[:, :3],
        offset=np.median(state.errors[:, :3], axis=0),
        placement_mm=float(found.sd[0]),
        placement_mm_range=_sd_range(found, 0, 1.0),
        placement_rad=float(found.sd[2]),
        placement_rad_range=_sd_range(found, 2, 1.0),
        loads=np.exp(state.errors[:, LOAD] / state.response),
        load_spread=float(found.sd[LOAD]) / state.response,
        load_spread_range=_sd_range(found, LOAD, 1 / state.response),
        tilts=tilts,
        tilt_offset=tilts.mean(axis=0),
        placement_tilt=steep,
        placement_tilt_range=steep_range,
        lean=steep * guess.stiffness,
        tilt_gain=state.likelier,
        stiffness=guess.stiffness,
        stiffness_low=softest,
        stiffness_high=stiffest,
        wrist=guess.wrist,
        yielding=fit.yielding(state.give),
        yielding_low=low,
        yielding_high=high,
        held="wrist" if state.give and np.isfinite(fit.stated.wrist) else "layer",
        lifted=lifted,
        misfit=float(np.sqrt((left**2).mean())) * unit,
        blanks=int((~rested).sum()),
        held_out=apart * unit,
        held_out_placed=placed * unit,
        grown=guess.grown,
        grown_range=tuple(
            (float(by - CONFIDENT * error), float(by + CONFIDENT * error))
            for by, error in zip(state.grown, state.grown_error, strict=True)
        ),
    )


def _held_out(fit: PressFit, state: State) -> tuple[FloatArray, FloatArray]:
    """Predict readings (n, taxels), each of the fit's groups of presses by the numbers that fit the others best.

    Gains of taxels, and all numbers that presses share, are fitted to the other groups, linearised about the whole fit.
    First each press is where it is stated, but for the mean by which the others are off; then it is where its own
    reading puts it.
    """
    leans, yields = shape(state)
    predicted, _, gain, variance = fit.residual(state)
    predicted = np.nan_to_num(predicted)
    round_ = fit.linearised(state, variance, leans=leans or yields)
    found = round_.found(leans, yields)
    count = len(found.sd)
    slopes = round_.slopes[..., :count]
    common = round_.common if yields else round_.common[..., 1:]
    start = np.zeros(common.shape[2])
    start[0] = state.give if yields else 0.0
    information = np.einsum("nti,ntj->nij", slopes, slopes) / variance + np.diag(1 / found.sd**2)
    apart, placed = np.empty_like(fit.recorded), np.empty_like(fit.recorded)
    own, seen = found.told
    for group in np.unique(fit.fold):
        out = fit.fold == group
        others = ~out if not out.all() else out
        shared = np.linalg.lstsq(own[others].sum(axis=0), seen[others].sum(axis=0), rcond=None)[0]
        mean = found.errors[others].mean(axis=0)
        relative = np.ones(fit.recorded.shape[1])
        if state.gains is not None:
            relative = shrunk_gains(fit.recorded[others], predicted[others], fit.fold[others]).relative
        gain = best_gain(fit.recorded[others], relative * predicted[others]) * relative
        moved = common[out] @ (shared - start)
        off = round_.about[out] - common[out] @ shared
        told = np.einsum("nti,nt->ni", slopes[out], off) / variance + mean / found.sd**2
        errors = np.linalg.solve(information[out], told[..., None])[..., 0]
        step = np.einsum("nti,ni->nt", slopes[out], errors - state.errors[out, :count])
        placed[out] = gain * predicted[out] + moved + step
        stated = np.zeros_like(state.errors)
        stated[:, :count] = mean
        apart[out] = gain * np.nan_to_num(fit.read(state, errors=stated)[out]) + moved
    return apart, placed


def _left_out(fit: PressFit, state: State) -> FloatArray:
    """Predict readings (n, taxels) of groups of presses that were held out, as a scan of the fitted world would.

    Outlines are as drawn; each press lies where its reading puts it.
    """
    as_drawn = replace(fit, outline=np.full(len(fit.recorded), -1))
    return _held_out(as_drawn, replace(state, grown=np.zeros(0), grown_error=np.zeros(0)))[1]


def _interval(value: float, error: float, least: float, most: float) -> tuple[float, float]:
    """Give a 95 % interval; open towards a bound that the value lies on, or that the interval reaches."""
    low, high = value - CONFIDENT * error, value + CONFIDENT * error
    near = 1e-3 * value
    return (low if low > least + near else 0.0), (high if high < most - near else np.inf)


def _sd_range(found: PressErrors, error: int, scale: float) -> tuple[float, float]:
    """Give the 95 % interval of the spread of one of the presses' errors."""
    return float(found.sd_low[error]) * scale, float(found.sd_high[error]) * scale


def _stiffness_range(fit: PressFit, state: State, variance: float) -> tuple[float, float]:
    """Find the layers that explain the readings as well, kPa/mm: a profile likelihood.

    Tilts and wrist follow the stiffness, so that lean and give stay. An end that the readings do not bound
    is 0 or infinite.
    """
    errors = state.errors[:, :5].copy()
    chosen = fit.guess(state.sigma, state.give, state.errors, state.grown)
    steps = np.arange(np.log10(SOFTEST), np.log10(STIFFEST) + 1e-9, _DECADES)
    squares = []
    for stiffness in 10**steps:
        wrist = chosen.wrist * stiffness / chosen.stiffness
        errors[:, 3:] = state.errors[:, LEAN] / (stiffness * (1 - state.give))
        steep = np.abs(errors[:, 3:]).max() > _TOO_STEEP
        if steep or not (np.isinf(wrist) or 1 <= wrist <= STIFFEST_WRIST):
            squares.append(np.inf)
            continue
        image = fit.predict(replace(chosen, stiffness=float(stiffness), wrist=wrist), errors)
        predicted = fit.answered(image, state.response, state.errors[:, LOAD])
        gain = best_gain(fit.recorded, state.relative * predicted) * state.relative
        left = np.where(np.isfinite(predicted), fit.recorded - gain * predicted, fit.recorded)
        squares.append(float((left**2).sum()))
    as_good = np.flatnonzero(np.array(squares) - min(squares) < 2 * BELIEVED * variance)
    first, last = int(as_good[0]), int(as_good[-1])
    return (
        0.0 if first == 0 else float(10 ** steps[first - 1]),
        np.inf if last == len(steps) - 1 else float(10 ** steps[last + 1]),
    )


def _lifts(found: PressErrors, predicted: FloatArray, bending: float) -> bool:
    """Tell whether tilts are so large that many faces leave the pad with a side.

    A linearised fit then puts `give` too high: by 20 % to 100 % in stiffness over wrist where tilts are known.
    """
    if len(found.sd) <= LEAN.start:
        return False
    half = (12 * bending) ** 0.25 / 2  # of a square with this second moment
    return float(found.sd[LEAN.start]) * half > _LIFTED * float(predicted[~untouched(predicted)].mean())


def noise_of(left: FloatArray, predicted: FloatArray) -> float:
    """Take the spread of what is `left` at taxels that nothing touches; at all, if all are touched."""
    free = untouched(predicted)
    values = left[free] if free.sum() >= 10 else left.ravel()
    return float(1.4826 * np.median(np.abs(values - np.median(values))))  # sd of a normal distribution
