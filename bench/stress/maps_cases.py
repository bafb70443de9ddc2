"""Occupancy maps (eq. 1 to 6): extreme sensors, priors, cells and readings."""

from __future__ import annotations

import math
from dataclasses import replace

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
from tactsim.core import Scan, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators import create
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps


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
    rng = np.random.default_rng(0)
    row, column = (rng.integers(size, size=200) for size in chart.log_odds.shape)
    at = chart.origin + chart.cell * np.column_stack([column, row])
    sensor = {
        name: options.get(name, usual) for name, usual in (("sigma", 1.0), ("peak", 0.9), ("prior", 0.2))
    }
    exact = exact_log_odds(scan, label, at, **sensor)
    return np.abs(chart.log_odds[row, column] - exact) / (1 + np.abs(exact))


@case(
    "maps.point-spread-and-cell",
    varied="point spread 0.1 to 10 mm, map cells 0.05 to 5 mm",
    deviation="log-odds from the exact sum, relative; cells below sigma / 25 taken",
    limit=1e-9,
    because="a taxel is left out where it adds less than 1e-12, and a thousand of them may be",
    quick=False,
)
def point_spread_and_cell(worst: Worst) -> None:
    """Learn maps of one letter with sensors from a pin to a palm."""
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
def peak_near_one(worst: Worst) -> None:
    """Learn maps with a sensor model that is nearly certain, or nearly without information."""
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
def prior_near_zero_and_one(worst: Worst) -> None:
    """Learn maps where nearly all, or nearly nothing, is taken to be occupied."""
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
def one_reading_many_times(worst: Worst) -> None:
    """Learn from one reading again and again: evidence adds up and nothing overflows."""
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
def order_of_readings(worst: Worst) -> None:
    """Learn the same map from the same readings in another order."""
    scan = pressed("E").where("train")
    first = learn_maps(scan)["E"].log_odds
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(scan))
        worst.see(np.abs(learn_maps(scan.chosen(order))["E"].log_odds - first), f"order {seed}")


@case(
    "maps.without-information",
    varied="training readings that are all Unknown, all zero or all alike, for every estimator that learns",
    deviation="probabilities from equal ones (but of particles), or from a sum of 1",
    limit=1e-6,
    because="the letters' maps are the same, so no reading may tell them apart",
)
def without_information(worst: Worst) -> None:
    """Train where nothing can be learned, then recognise: every letter stays as probable as any other."""
    scan = few(pressed("AEI"), 8)
    readings, poses, _ = hidden(pressed("AEI"), "E", 6)
    unknown = np.full(scan.readings.shape, 1.9)  # below T, above 0.3 of the largest
    for what, trained in (("Unknown", unknown), ("zero", 0 * unknown), ("in contact", 0 * unknown + 50.0)):
        poses_of_one = np.tile(scan.where(label="A").poses, (3, 1))
        blank = replace(scan, readings=trained, poses=poses_of_one)
        for name, budget in every_estimator(learning=True):
            estimator = fitted(name, blank, **budget)
            estimate = after(estimator, readings, poses)
            worst.see(flaw(estimate), f"{name}, all {what}")
            if not draws(name):  # whose populations wander by chance
                worst.see(np.abs(probabilities(estimate) - 1 / 3), f"{name}, all {what}")


@case(
    "maps.not-finite",
    varied="NaN and infinity in a map's cells, in a scan's readings, poses and taxels",
    deviation="how many are taken",
    limit=0,
    because="a NaN in a map is silent: accuracy reads exactly 1 / letters",
)
def not_finite(worst: Worst) -> None:
    """Build maps and scans with NaN or infinity, which must be refused."""
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


@case(
    "maps.far-apart",
    varied="training poses and taxels from 1e3 to 1e300 mm apart",
    deviation="neither learned from nor refused in one line",
    limit=0,
    because="a map of a kilometre has 1e13 cells; it is refused before memory is asked for",
)
def far_apart(worst: Worst) -> None:
    """Learn maps from poses that are far apart."""
    scan = few(pressed("I"))
    for decade in (3, 6, 9, 100, 300):
        poses = scan.poses.copy()
        poses[0, :2] = (10.0**decade, -(10.0**decade))
        worst.holds(
            refused(lambda far=poses: learn_maps(replace(scan, poses=far))) or decade < 4, f"1e{decade} mm"
        )
