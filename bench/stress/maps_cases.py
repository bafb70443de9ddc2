"""Occupancy maps (eq. 1 to 6) and the measurement model (eq. 7): at their edges, and against exact sums."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import numpy as np

from tactsim.bench.stress.case import (
    Worst,
    after,
    case,
    draws,
    every_estimator,
    few,
    fitted,
    flaw,
    hidden,
    pressed,
    probabilities,
    refused,
)
from tactsim.core import Pad, Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators import create
from tactsim.estimators.filters.histogram import HistogramFilter
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, UNKNOWN, classify
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps, maps_of
from tactsim.estimators.likelihoods.paper import PaperLikelihood, PaperOptions


def exact_log_odds(
    scan: Scan, label: str, at: FloatArray, sigma: float, peak: float, prior: float
) -> FloatArray:
    """Sum eq. 5 and 6 at points (n, 2) mm, one term at a time, with exactly rounded sums."""
    train = scan.where("train", label)
    centres = transform(train.poses, train.taxel_xy).reshape(-1, 2)
    classes = classify(train.readings).ravel()
    start = math.log(prior) - math.log1p(-prior)
    found = []
    for point in at:
        g = peak * np.exp(-2 * (((centres - point) / sigma) ** 2).sum(axis=1))
        touched, empty = g[classes == CONTACT], g[classes == NO_CONTACT]
        # log (p + (1-p) G') / (p (1-G')), and the same for No Contact, each as two well-conditioned logs.
        terms = np.concatenate([
            np.log1p((1 - prior) / prior * touched), -np.log1p(-touched),
            -np.log1p(prior / (1 - prior) * empty), np.log1p(-empty),
        ])  # fmt: skip
        found.append(math.fsum([start, *terms.tolist()]))
    return np.array(found)


def deviation(scan: Scan, label: str, **options: float) -> FloatArray:
    """Compare 200 cells of a learned map with the exact sum, relative to 1 + |log-odds|."""
    chart = learn_maps(scan, **options)[label]
    without_cell = {name: value for name, value in options.items() if name != "cell"}
    rng = np.random.default_rng(0)
    row, column = (rng.integers(size, size=200) for size in chart.log_odds.shape)
    at = chart.origin + chart.cell * np.column_stack([column, row])
    exact = exact_log_odds(scan, label, at, **{"sigma": 1.0, "peak": 0.9, "prior": 0.2} | without_cell)
    return np.abs(chart.log_odds[row, column] - exact) / (1 + np.abs(exact))


@case(
    "maps.point-spread-and-cell",
    varied="point spread 0.1 to 10 mm, map cells 0.05 to 5 mm",
    deviation="log-odds from the exact sum, relative; cells below sigma / 25 taken",
    limit=1e-9,
    because="a taxel is left out where it adds less than 1e-12, and a thousand of them may be",
    quick=False,
)
def _point_spread_and_cell(worst: Worst) -> None:
    scan = few(pressed("E"), 64)
    for sigma in (0.1, 0.3, 1.0, 3.0, 10.0):
        for cell in (0.05, 0.2, 1.0, 5.0):
            where = f"sigma {sigma}, cell {cell} mm"
            if sigma <= 25 * cell:
                worst.see(deviation(scan, "E", sigma=sigma, cell=cell), where)
            else:
                worst.holds(refused(create, "histogram", sigma=sigma, cell=cell), where)


@case(
    "maps.peak-near-one",
    varied="G' at a taxel's centre from 1e-9 to 1 - 1e-9; 1 and more",
    deviation="log-odds from the exact sum, relative; a peak of 1 taken",
    limit=1e-6,
    because="1 - G' loses nine digits; G' >= 1 is no probability and is refused",
)
def _peak_near_one(worst: Worst) -> None:
    scan = few(pressed("E"))
    for peak in (1e-9, 1e-3, 0.5, 0.999, 1 - 1e-6, 1 - 1e-9):
        worst.see(deviation(scan, "E", peak=peak), f"peak {peak!r}")
    for peak in (1.0, 1.13, 0.0, math.nan, math.inf):
        worst.holds(refused(create, "histogram", peak=peak), f"peak {peak} is taken")


@case(
    "maps.prior-near-0-and-1",
    varied="p(m) from 1e-6 to 1 - 1e-6; 0, 1 and beyond",
    deviation="log-odds from the exact sum, relative; a prior of 0 or 1 taken",
    limit=1e-6,
    because="a taxel is left out where it adds less than 1e-12, and a hundred of them may be",
)
def _prior_near_zero_and_one(worst: Worst) -> None:
    scan = few(pressed("E"))
    for prior in (1e-6, 1e-3, 0.2, 0.5, 0.999, 1 - 1e-6):
        worst.see(deviation(scan, "E", prior=prior), f"prior {prior!r}")
    for prior in (0.0, 1.0, -1.0, 1e-300, math.nan):
        worst.holds(refused(create, "histogram", prior=prior), f"prior {prior} is taken")


@case(
    "maps.one-reading-10,000-times",
    varied="one training reading repeated up to 10,000 times",
    deviation="log-odds from so many times those of one reading, relative",
    limit=1e-9,
    because="10,000 roundings of 1e-16, relative; the log-odds themselves reach 10,000",
    quick=False,
)
def _one_reading_many_times(worst: Worst) -> None:
    scan = few(pressed("E").where("train"), 24)
    start = math.log(0.2 / 0.8)

    def evidence(times: int) -> FloatArray:
        repeated = scan.chosen(np.repeat(np.arange(len(scan)), times))
        return learn_maps(repeated)["E"].log_odds - start

    once = evidence(1)
    for times in (10, 1250):
        many = evidence(times)
        worst.see(np.abs(many - times * once).max() / np.abs(many).max(), f"{8 * times:,} readings")


@case(
    "maps.order-of-readings",
    varied="the training readings shuffled, five times",
    deviation="log-odds, from the order of the file",
    limit=1e-9,
    because="a cell sums a few thousand terms below 3 in another order",
)
def _order_of_readings(worst: Worst) -> None:
    scan = pressed("E").where("train")
    first = learn_maps(scan)["E"].log_odds
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(scan))
        worst.see(np.abs(learn_maps(scan.chosen(order))["E"].log_odds - first), f"order {seed}")


@case(
    "maps.without-information",
    varied="training readings all Unknown, zero, alike, saturated or negative, for every estimator that learns",
    deviation="probabilities from equal ones (but of particles), or from a sum of 1",
    limit=1e-6,
    because="the letters' maps are the same, so no reading may tell them apart",
)
def _without_information(worst: Worst) -> None:
    scan = few(pressed("AEI"), 8)
    readings, poses, _ = hidden(pressed("AEI"), "E", 6)
    # 1.9 is Unknown: below T, above 0.3 of the largest.
    for value in (1.9, 0.0, 50.0, 1e9, -1e9):
        poses_of_one = np.tile(scan.where(label="A").poses, (3, 1))
        blank = replace(scan, readings=np.full(scan.readings.shape, value), poses=poses_of_one)
        for name, budget in every_estimator(learning=True):
            estimator = fitted(name, blank, **budget)
            estimate = after(estimator, readings, poses)
            worst.see(flaw(estimate), f"{name}, all {value:g} kPa")
            if not draws(name):  # whose populations wander by chance
                worst.see(np.abs(probabilities(estimate) - 1 / 3), f"{name}, all {value:g} kPa")


@case(
    "maps.far-apart",
    varied="training poses and taxels from 1e3 to 1e300 mm apart",
    deviation="neither learned from nor refused in one line",
    limit=0,
    because="a map of a kilometre has 1e13 cells; it is refused before memory is asked for",
)
def _far_apart(worst: Worst) -> None:
    scan = few(pressed("I"))
    for decade in (3, 6, 9, 100, 300):
        poses = scan.poses.copy()
        poses[0, :2] = (10.0**decade, -(10.0**decade))
        far = refused(lambda of=poses: learn_maps(replace(scan, poses=of)))
        worst.holds(far or decade < 4, f"1e{decade} mm")


def exact_log_p(kind: int, log_odds: float, gamma: float, prior: float) -> float:
    """Evaluate eq. 7 as printed for one taxel, in logs throughout and without tables."""
    if kind == UNKNOWN:
        return 0.0
    x = -log_odds if kind == CONTACT else log_odds
    log_occupied = -(max(x, 0.0) + math.log1p(math.exp(-abs(x))))
    failed, worked = math.log(gamma) + math.log(prior), math.log1p(-gamma) + log_occupied
    return max(failed, worked) + math.log1p(math.exp(-abs(failed - worked)))


@case(
    "likelihood.gamma",
    varied="gamma from 1e-300 to 1 - 1e-16, log-odds to +-1000; 0, 1 and beyond",
    deviation="log p from eq. 7 in exact steps, relative; a gamma of 0 or 1 taken",
    limit=1e-9,
    because="a sum of two positive terms loses nothing; gamma = 0 makes log(1 - p) of p = 1 infinite",
)
def _gamma(worst: Worst) -> None:
    odds = np.array([-1000, -745.2, -128, -37, -1, -1e-9, 0, 1e-9, 1, 37, 128, 745.2, 1000.0])
    for value in (1e-300, 1e-30, 1e-6, 0.1, 0.5, 1 - 1e-9, 1 - 1e-16):
        for prior in (1e-6, 0.2, 1 - 1e-6):
            model = PaperLikelihood(PaperOptions(gamma=value, prior=prior))
            chart = OccupancyMap(np.zeros(2), 1.0, odds[None], prior)
            model.fit(pressed("I"), {"I": chart})
            at = np.column_stack([np.arange(len(odds)), np.zeros(len(odds))])
            got = model.log_tables("I", at)
            for kind in (NO_CONTACT, CONTACT):
                exact = np.array([exact_log_p(kind, x, value, prior) for x in odds])
                worst.see(np.abs(got[kind] - exact) / (1e-3 + np.abs(exact)), f"gamma {value}, prior {prior}")
    for value in (0.0, 1.0, 1e-320, -0.1, 1.1, math.nan, math.inf):
        worst.holds(refused(create, "histogram", gamma=value), f"gamma {value} is taken")


def on_the_lattice() -> tuple[Scan, FloatArray]:
    """Press three letters where every taxel lies on a node of maps and tables, 0.4 mm apart.

    Then interpolation is exact, and what is left between an estimator and eq. 7 is rounding.
    Returns the scan and 24 poses on the lattice.
    """
    pad = Pad(pitch_x=1.6, pitch_y=1.6, taxel_width=1.5, taxel_height=1.5, seam=None)
    rng = np.random.default_rng(5)
    return pressed("AEI", pad=pad), np.column_stack([0.4 * rng.integers(-25, 26, (24, 2)), np.zeros(24)])


def straight_readings(scan: Scan, label: str | None = None) -> tuple[FloatArray, FloatArray]:
    """Take the test readings at angle 0, and their poses moved to the nearest node."""
    test = scan.where("test", label)
    chosen = test.poses[:, 2] == 0
    return test.readings[chosen], np.round(test.poses[chosen] / 0.4) * 0.4


def one_state(scan: Scan, **options: float) -> HistogramFilter:
    """Fit a histogram of one bin, whose one state is [0, 0, 0] and lies on a node of the tables."""
    alone = {"split": "1x1x1", "reach": 10.0, "skip": False}
    made = cast("HistogramFilter", create("histogram", **{**alone, **options}))
    made.fit(scan)
    made.reset(np.random.default_rng(0))
    return made


def exact_log_p_of_letters(one: HistogramFilter, reading: FloatArray, pose: FloatArray) -> FloatArray:
    """Sum eq. 7 for one reading at the state [0, 0, 0] of every letter, exactly rounded."""
    kinds, at = classify(reading), transform(pose, one.taxel_xy)
    return np.array([
        math.fsum(
            exact_log_p(kind, odds, one.likelihood.options.gamma, one.options.prior)
            for kind, odds in zip(kinds, one.maps[label].log_odds_at(at), strict=True)
        )
        for label in one.labels
    ])  # fmt: skip


@case(
    "likelihood.tables",
    varied="1 to 192 readings of every letter, summed by a filter with tables of 16 bits",
    deviation="log p(letter) from float64 terms summed by math.fsum, nats",
    limit=1e-2,
    because="16 readings of 36 terms, rounded by up to 2^-13 nats: four standard deviations of two letters' difference",
)
def _tables(worst: Worst) -> None:
    scan, _ = on_the_lattice()
    one = one_state(scan, gamma=0.6)
    for label in scan.letters:
        readings, poses = straight_readings(scan, label)
        said = [exact_log_p_of_letters(one, *of) for of in zip(readings, poses, strict=True)]
        for count in (1, 4, 16, 48, 192):
            one.reset(np.random.default_rng(0))
            for k in range(count):
                one.update(readings[k % len(readings)], poses[k % len(readings)])
            got = one.estimate().probabilities
            seen = np.array([got[name] for name in one.labels])
            exact = np.array([math.fsum(said[k % len(said)][i] for k in range(count)) for i in range(3)])
            exact -= exact.max()
            exact -= math.log(math.fsum(np.exp(exact)))
            shown = exact > -600  # a probability below exp(-745) is 0, rightly
            worst.see(np.abs(np.log(seen[shown]) - exact[shown]), f"letter {label}, {count} readings")
            worst.see(seen[~shown], f"letter {label}, {count} readings, no letter")


@case(
    "likelihood.one-reading-below-float32",
    varied="gamma from 1e-2 to 1e-30, so that a reading's 36 factors fall to exp(-2,500)",
    deviation="probabilities from those of exactly rounded sums",
    limit=1e-3,
    because="36 terms rounded by up to 2^-12 nats, of which p sees a quarter: three standard deviations",
)
def _one_reading_below_float32(worst: Worst) -> None:
    scan, poses = on_the_lattice()
    rng = np.random.default_rng(6)
    for value in (1e-2, 1e-6, 1e-12, 1e-30):
        one = one_state(scan, gamma=value)
        for pose in poses:
            reading = rng.choice([0.0, 60.0], size=36)  # one that no letter gives
            one.reset(rng)
            one.update(reading, pose)
            exact = exact_log_p_of_letters(one, reading, pose)
            exact = np.exp(exact - exact.max())
            got = [one.estimate().probabilities[label] for label in one.labels]
            worst.see(np.abs(got - exact / math.fsum(exact)), f"gamma {value}")


@case(
    "likelihood.products-would-be-zero",
    varied="readings until the product of their likelihoods is 0 in float32 and in float64",
    deviation="trials in which the letter is wrong, or its probabilities are not finite, after that",
    limit=0,
    because="logs have no such floor; argmax of a product says the first letter, without a word",
    quick=False,
)
def _products_would_be_zero(worst: Worst) -> None:
    scan = pressed()
    estimator = fitted("histogram", scan, bins=1000)
    for label in scan.letters:
        readings, poses, truth = hidden(scan, label, 192, seed=7)
        chart = maps_of(estimator)[label]
        product32, product64, total = np.float32(1), 1.0, 0.0
        estimator.reset(np.random.default_rng(0))
        for reading, pose in zip(readings, poses, strict=True):
            estimator.update(reading, pose)
            odds = chart.log_odds_at(transform(truth, transform(pose, scan.taxel_xy)))
            taxels = zip(classify(reading), odds, strict=True)
            log_p = math.fsum(exact_log_p(k, x, 0.1, 0.2) for k, x in taxels)
            total += log_p
            with np.errstate(under="ignore"):
                product32 *= np.float32(np.exp(log_p))
                product64 *= math.exp(log_p)
        worst.holds(product32 == 0 and (product64 == 0) == (total < -745.2), f"{label}: no floor was reached")
        p = probabilities(estimator.estimate())
        worst.holds(estimator.estimate().label == label and np.isfinite(p).all(), f"letter {label}")


@case(
    "likelihood.classifier-edges",
    varied="readings of zeros, below zero, equal to T, equal to 0.3 e_max, subnormal, 1e9 kPa",
    deviation="taxels classified otherwise than eq. 3 says",
    limit=0,
    because="a comparison has no rounding",
)
def _classifier_edges(worst: Worst) -> None:
    readings = {
        "zeros": [0.0, -0.0, 0.0],
        "all negative": [-3.0, -1e-9, -50.0],
        "equal to T": [2.0, 2.0, 2.0],
        "beside T": [np.nextafter(2, 0), 2.0, np.nextafter(2, 3)],
        "equal to 0.3 e_max": [10.0, 3.0, 0.3 * 10.0],
        "T between": [6.0, 1.8, 1.9],
        "subnormal": [5e-324, 0.0, -5e-324],
        "largest": [1e9, -1e9, 3e8],
    }
    for name, reading in readings.items():
        wanted = []
        for taxel in reading:
            above = (taxel > 2.0, taxel > 0.3 * max(reading))
            wanted.append(CONTACT if all(above) else UNKNOWN if any(above) else NO_CONTACT)
        worst.see(float((classify(reading) != wanted).sum()), name)
    together = classify(np.array(list(readings.values())))
    apart = [classify(reading) for reading in readings.values()]
    worst.see(float((together != apart).sum()), "all at once")


@case(
    "maps.not-finite",
    varied="NaN and infinity in a map's cells, in a scan's readings, poses and taxels",
    deviation="how many are taken",
    limit=0,
    because="a NaN in a map is silent: accuracy reads exactly 1 / letters",
)
def _not_finite(worst: Worst) -> None:
    scan = pressed("I")
    for bad in (math.nan, math.inf, -math.inf):
        grid = np.zeros((4, 5))
        grid[2, 3] = bad
        try:
            OccupancyMap(np.zeros(2), 0.4, grid, 0.2)
        except ValueError:
            worst.holds(True, "map")
        else:
            worst.holds(False, f"a map with {bad}")
        for name in ("readings", "poses", "taxel_xy"):
            values = getattr(scan, name).copy()
            values[-1, -1] = bad
            worst.holds(refused(replace, scan, **{name: values}), f"{name} with {bad}")
