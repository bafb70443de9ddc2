"""What is fitted to a pad from the training readings alone: idle level, unit, lengths, response, options of maps.

Defaults were found for the paper's pad: lengths in mm for its pitch of 1.9 mm, the threshold of eq. 3 for presses in
which a covered taxel reads 36 kPa. Readings of another pad are brought to that: lengths are divided by the ratio of
the pitches, readings by their scale, above the level at which taxels idle. So no default depends on a unit, a zero, a
sign or a pitch, whatever filter it is a default of.
Then the options of the maps that were not given are chosen, one after another, by what the maps say of training
readings that they were not made from, in nats: the mutual information between what is predicted at a taxel from presses
elsewhere, and what that taxel felt. It depends neither on the unit of the readings, nor on that of the prediction.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core import InputError, Scan
from tactsim.core.idle import Idle, find_idle
from tactsim.core.pad import pitch
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PlaneBelief
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood, quantile_edges
from tactsim.estimators.likelihoods.classifier import lehmer_mean, threshold_of
from tactsim.estimators.likelihoods.folds import can_leave_out, some_labels
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.likelihood import kind_of
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps_by
from tactsim.estimators.options import FilterOptions, LikelihoodOptions, OpenSetOptions

_PITCH = 1.9  # mm, of the paper's pad by `lengths.pitch`
_SCALE = 36.0  # kPa, the median scale of simulated presses with 2 N on the paper's pad
# A reading touches if its scale is above this share of that which a tenth of the readings exceed.
_TOUCHES = 0.2
# Options that are lengths, mm; `reach` and `motion` may be words, too.
_LENGTHS = ("sigma", "cell", "noise_mm")
# What is tried, in mm and kPa of the paper's pad; cells are as fine beside sigma as the defaults are. A ratio below the
# paper's is not tried: of single touches it may say more, and yet sequences are recognised less often.
_TRIED = {
    "threshold": (0.7, 1.0, 1.4, 2.0, 2.8, 3.6, 5.0, 7.0),
    "ratio": (0.3, 0.4),
    "sigma": (0.7, 1.0, 1.4, 2.0),
}
_CELL = 0.4
_START = {"threshold": 2.0}
# Exponents of the curve that straightens readings: 1 / 2 undoes a response that squares.
_EXPONENTS = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
# Another value than the default must say so much more: chance differs by less. A bent response by less than an option:
# readings stay the same, and are counted in the same bins.
_MORE, _MORE_BENT = 1.01, 1.002
# What maps say of left-out readings, nats.
_Measure = Callable[[Scan, LikelihoodOptions], float]
# A calibrated model counts classes in one bin for so many training taxels, in 4 to 16 bins.
_OF_A_BIN, _FEWEST, _MOST = 500, 4, 16


@dataclass(frozen=True)
class PadUnits:
    """How lengths and readings of a pad are brought to those of the paper's pad.

    length: mm that count as 1 mm. pressure: what is read, in the scan's unit, that counts as 36 kPa. exponent: of the
    response curve 36 kPa (z / pressure)^exponent of readings z, the same for all taxels; 1 is a straight line. idle:
    the level of each taxel above which z is taken, and its sign; None if readings are taken as they are.
    """

    length: float = 1.0
    pressure: float = _SCALE
    exponent: float = 1.0
    idle: Idle | None = None

    def readings(self, readings: FloatArray) -> FloatArray:
        """Bring readings (..., taxels) to kPa of the paper's pad; what is below the idle level is below 0.

        They are rounded to single precision, so that readings in another unit give the same to the last bit.
        """
        return self.pressures(readings if self.idle is None else self.idle.rise(readings))

    def pressures(self, rise: FloatArray) -> FloatArray:
        """Bring what readings are above the idle level, of any shape, to kPa of the paper's pad, as `readings` does."""
        return _single(_SCALE * np.sign(rise) * np.abs(rise / self.pressure) ** self.exponent)

    def reading_of(self, pressure: float) -> float:
        """Give the rise of a taxel, in the scan's unit, under a pressure in kPa of the paper's pad."""
        share = abs(pressure) / _SCALE
        return float(np.copysign(self.pressure * share ** (1 / self.exponent), pressure))

    def poses(self, poses: FloatArray) -> FloatArray:
        """Bring poses (..., 3) to mm of the paper's pad; angles stay."""
        return np.concatenate([self.positions(poses[..., :2]), poses[..., 2:]], axis=-1)

    def positions(self, xy: FloatArray) -> FloatArray:
        """Bring positions (..., 2) mm to mm of the paper's pad, rounded as readings are.

        On a lattice many positions are equally near; which is taken must not depend on the unit.
        """
        return _single(xy / self.length)

    def poses_back(self, poses: FloatArray) -> FloatArray:
        """Bring poses (..., 3) in mm of the paper's pad back to mm."""
        return poses * [self.length, self.length, 1.0]

    def scan(self, scan: Scan) -> Scan:
        """Bring a scan to mm and kPa of the paper's pad, without what was felt on the way to rest."""
        return replace(
            scan,
            readings=self.readings(scan.readings),
            poses=self.poses(scan.poses),
            taxel_xy=self.positions(scan.taxel_xy),
            sequence=None,
            sequence_times=None,
            sequence_force=None,
        )

    def plane_back(self, belief: PlaneBelief) -> PlaneBelief:
        """Bring the cells of a belief over the plane in mm of the paper's pad back to mm."""
        return replace(belief, x=belief.x * self.length, y=belief.y * self.length)

    def maps_back(self, maps: Mapping[str, OccupancyMap]) -> dict[str, OccupancyMap]:
        """Bring maps in mm of the paper's pad back to mm."""
        return {
            label: replace(chart, origin=chart.origin * self.length, cell=chart.cell * self.length)
            for label, chart in maps.items()
        }


@dataclass(frozen=True)
class PadFit:
    """What was fitted to a scan's pad. units: see there. chosen: by name, in mm and kPa of the paper's pad.

    before, after: nats, what a map says of a left-out taxel with the defaults and with what was chosen; None where
    nothing was to be chosen.
    """

    units: PadUnits
    chosen: Mapping[str, float] = field(default_factory=dict)
    before: float | None = None
    after: float | None = None

    def inner(self, options: FilterOptions) -> FilterOptions:
        """Give the options of a filter that works in mm and kPa of the paper's pad."""
        changed: dict[str, Any] = dict(self.chosen)
        given = options.model_fields_set
        for name in (*_LENGTHS, "reach"):
            value = getattr(options, name, None)
            if name in given and isinstance(value, float):
                changed[name] = value / self.units.length
        if "threshold" in given and options.threshold != "auto":
            changed["threshold"] = float(self.units.pressures(np.array(options.threshold)))
        if "motion" in given and "," in options.motion:
            mm, rad = options.motion.split(",", 1)
            changed["motion"] = f"{float(mm) / self.units.length},{rad}"
        return options.model_copy(update=changed)

    def outer(self, options: FilterOptions) -> FilterOptions:
        """Give the options as they were used: those that nobody gave in mm and in the unit of the scan."""
        lengths = {
            name: getattr(options, name) * self.units.length
            for name in _LENGTHS
            if name not in options.model_fields_set and hasattr(options, name)
        }
        return options.model_copy(update={**lengths, **self.facts()["chosen"]})

    def describe(self) -> str:
        """Say in a few words what the lengths and readings of the paper's pad are here."""
        idle = "" if self.units.idle is None else f"; {self.units.idle.describe()}"
        return (
            f"fitted to the pad: its 1 mm is {self.units.length:.3g} mm here, its 36 kPa a reading of "
            f"{self.units.pressure:.4g}{idle}"
        )

    def facts(self) -> dict[str, Any]:
        """Say what was found, as a JSON object: lengths in mm, readings in the unit of the scan, nats."""
        chosen: dict[str, float] = {}
        for name, value in self.chosen.items():
            if name == "threshold":
                chosen[name] = self.units.reading_of(value)
            else:
                chosen[name] = value * self.units.length if name in _LENGTHS else value
        return {
            "length_ratio": self.units.length,
            "typical_reading": self.units.pressure,
            **({} if self.units.idle is None else self.units.idle.facts()),
            "response_exponent": self.units.exponent,
            "chosen": chosen,
            "information_default": self.before,
            "information_chosen": self.after,
        }


def fit_to_pad(scan: Scan, options: FilterOptions) -> PadFit:
    """Fit units and options to the training readings of a scan and to the places of its taxels.

    Only options that were not given are chosen, and none if no object was pressed twice, by coordinate search: one
    after another is given the value with which most is said of left-out readings. Where maps are of classes these are
    the threshold, the ratio and the width of the point spread; where they are of pressures, the exponent of the
    response curve and the width. A model of both has the threshold and the ratio of classes beside. The same readings
    give the same in whatever unit.

    Raises InputError if the poses are too far apart for a map.
    """
    train = scan.where("train")
    idle = find_idle(train.readings, train.presses)
    fitted = _fit_above(replace(scan, readings=idle.rise(scan.readings)), options)
    return replace(fitted, units=replace(fitted.units, idle=idle))


def _fit_above(scan: Scan, options: FilterOptions) -> PadFit:
    """Fit units and options to readings that are 0 at rest and rise under load."""
    train = scan.where("train")
    if not train.readings.any() or not can_leave_out(train):
        return PadFit(units_of(scan))
    some, given = some_letters(train), options.model_fields_set
    model = kind_of(options.likelihood)
    forces = model.of_pressures
    # A curve changes no class but for the threshold and the ratio, which are chosen anyway.
    open_set = isinstance(options, OpenSetOptions) and options.unknown > 0
    exponent, straight, _ = response(scan, options) if forces or open_set else (1.0, None, None)
    fitted = PadFit(
        units_of(scan, exponent), {name: value for name, value in _START.items() if name not in given}
    )
    brought, first = fitted.units.scan(some), pressure_information if forces else class_information
    if "quantiles" in type(options).model_fields and "quantiles" not in given:
        bins = int(np.clip(train.readings.size // _OF_A_BIN, _FEWEST, _MOST))
        fitted = replace(fitted, chosen={**fitted.chosen, "quantiles": bins})

    def information_with(measure: _Measure, name: str, value: float) -> float:
        return measure(brought, _with(fitted, name, value, given).inner(options))

    before = first(brought, fitted.inner(options))
    said: dict[_Measure, float] = {first: before}
    for name, values in _TRIED.items():
        if name in given or (name != "sigma" and not model.of_classes):
            continue
        # The threshold and the ratio matter to classes alone; a width that both have is chosen for pressures.
        measure = first if name == "sigma" else class_information
        if measure not in said:
            said[measure] = measure(brought, fitted.inner(options))
        start = getattr(fitted.inner(options), name)
        value, said[measure] = climb(
            partial(information_with, measure, name), values, start, said[measure], _MORE
        )
        fitted = _with(fitted, name, value, given)
    return replace(fitted, before=straight if forces else before, after=said[first])


def _with(fitted: PadFit, name: str, value: float, given: Collection[str]) -> PadFit:
    """Choose a value of an option; cells stay as fine beside sigma as the defaults are, unless they were given."""
    chosen = {**fitted.chosen, name: value}
    if name == "sigma" and "cell" not in given:
        chosen["cell"] = _CELL * value
    return replace(fitted, chosen=chosen)


def climb(
    information: Callable[[float], float], values: Sequence[float], start: float, known: float, least: float
) -> tuple[float, float]:
    """Go through values away from the start, upwards and downwards, each way as long as more is said.

    known: nats, what is said at the start. The first step must say `least` times as much. Returns the best value,
    and what is said there.
    """
    best, most = start, known
    up, down = (
        [value for value in values if value > start],
        [value for value in values[::-1] if value < start],
    )
    for way in (up, down):
        reached_value, reached = start, known
        for value in way:
            more = information(value)
            asked = least if reached_value == start else 1.0
            if more <= reached * (asked if reached > 0 else 1 / asked):
                break
            reached_value, reached = value, more
        if reached > most:
            best, most = reached_value, reached
    return best, most


def units_of(scan: Scan, exponent: float = 1.0) -> PadUnits:
    """Find the pad's pitch beside the paper's, and the median scale of the training presses that touch."""
    length = pitch(scan.taxel_xy) / _PITCH
    readings = scan.where("train").readings
    if readings.any() and not (readings > 0).any():
        raise InputError(
            "no training reading is above 0, as under load it would be: say what taxels read at rest (`bench import "
            "--zero`)"
        )
    plain = _typical(readings)
    bent = _typical(np.sign(readings) * np.abs(readings / plain) ** exponent) ** (1 / exponent)
    return PadUnits(1.0 if abs(length - 1) < 1e-9 or not length else length, plain * bent, exponent)


def response(scan: Scan, options: FilterOptions) -> tuple[float, float, float]:
    """Find the exponent of the response curve with which mosaics say most of the pressures that were left out.

    A mosaic adds pressures up: it predicts best if readings are straight in them. So the response need not be
    known, nor what was pressed. Returns the exponent, and the nats that mosaics say without it and with it.
    """
    some = some_letters(scan)

    def information_with(exponent: float) -> float:
        units = units_of(scan, exponent)
        return pressure_information(units.scan(some), PadFit(units, {"threshold": 2.0}).inner(options))

    straight = information_with(1.0)
    exponent, bent = climb(information_with, _EXPONENTS, 1.0, straight, _MORE_BENT)
    return exponent, straight, bent


def _typical(readings: FloatArray) -> float:
    """Take the median scale of readings (n, taxels) that touch; 1 if there is none."""
    scale = lehmer_mean(readings)
    if not scale.any():
        return 1.0
    return float(np.median(scale[scale >= _TOUCHES * np.quantile(scale, 0.9)]))


def _single(values: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):  # an infinity is refused by who gets it
        return np.asarray(values, dtype=np.float32).astype(float)


# Bins of equally many taxels in which predictions and pressures are counted.
_PREDICTED, _FELT = 16, 8


def some_letters(scan: Scan) -> Scan:
    """Keep the training readings of at most six letters, the same ones in whatever order they come."""
    train = scan.where("train")
    return train.of_letters(some_labels(train))


def class_information(scan: Scan, options: LikelihoodOptions) -> float:
    """Measure what the log-odds of maps say of the class (eq. 3) of a taxel whose position was left out: nats.

    scan: of which the training readings count, one at least.
    """
    maps = learn_maps_by(options, scan)
    model = CalibratedLikelihood(options)
    model.maps = maps
    model.threshold = threshold_of(options.threshold, scan.where("train").readings)
    odds, classes, counted = model.left_out(scan.where("train"))
    return mutual_information(_binned(odds[counted], _PREDICTED), classes[counted].astype(np.intp))


def pressure_information(scan: Scan, options: LikelihoodOptions) -> float:
    """Measure what mosaics say of the relative pressure of a taxel whose position was left out: nats.

    scan: of which the training readings count, one at least.
    """
    train = scan.where("train")
    maps = learn_maps_by(options, scan)
    model = ForceLikelihood(options)
    predicted, relative, _, _, known = model.fit_mosaics(train, maps)
    counted = known if known.any() else ~known
    return mutual_information(_binned(predicted[counted], _PREDICTED), _binned(relative[counted], _FELT))


def mutual_information(first: NDArray[np.intp], second: NDArray[np.intp]) -> float:
    """Compute the mutual information of two variables from n pairs of bins (n,) each, in nats.

    What chance alone makes of independent variables, (a - 1) (b - 1) / 2n for a and b bins that hold something, is
    taken off (Miller 1955).
    """
    if not len(first):
        return 0.0
    rows, columns = int(first.max()) + 1, int(second.max()) + 1
    count = np.bincount(first * columns + second, minlength=rows * columns).reshape(rows, columns)
    joint = count / len(first)
    alone = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    held = joint > 0
    used = [int((joint.sum(axis=axis) > 0).sum()) for axis in (0, 1)]
    chance = (used[0] - 1) * (used[1] - 1) / (2 * len(first))
    return float((joint[held] * np.log(joint[held] / alone[held])).sum()) - chance


def _binned(values: FloatArray, bins: int) -> NDArray[np.intp]:
    """Say in which of so many bins that hold equally many each value lies; equal values share a bin."""
    return np.searchsorted(np.unique(quantile_edges(values, bins)), values, side="right")
