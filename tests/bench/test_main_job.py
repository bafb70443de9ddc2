"""The main job as a user calls it, against the paper's equations in plain NumPy.

What is shared with the product are files: the readings that `bench scan` wrote, and of `trials.csv` which reading came
when and where the object lay. Maps, measurement model, histogram, estimate, error and the table of accuracy and error
are worked out here, from the paper and docs/method.md.
"""

import csv
import json

import numpy as np
import pytest
from command_line import Bench

from tactsim.models import letter

LETTERS, TRIALS, READINGS = "AIO", 3, 5
SYMMETRY = {"A": 1, "I": 2, "O": 0}  # the paper: I is two-fold, O turns freely
# docs/reference/options.md
SIGMA, PEAK, PRIOR, THRESHOLD, RATIO, CELL, GAMMA = 1.0, 0.9, 0.2, 2.0, 0.3, 0.4, 0.1
REACH, SIDE, TURNS = 10.0, 25, 16  # Table I: 25 x 25 x 16 bins a letter

# The paper interpolates log-odds and then takes the logarithm of eq. 7; the product interpolates the logarithms, which
# it keeps once per map cell in 16 bits (docs/estimators.md). Against the same interpolation only the rounding is left:
# it moves probabilities by less than 0.007 there, and what is nearer to each other than that may change places.
ROUNDING = 0.007
# Against the paper's interpolation the error between nodes 0.4 mm apart is left, which sums over 36 taxels. It moves
# single probabilities much and the table little: some estimates go to a neighbouring bin, 0.8 mm away.
# Share of all labels; a third of the 0.94 mm that the bins' size costs
TABLE_RIGHT, TABLE_ERROR_MM = 0.07, 0.3


def classify(readings):
    """Eq. 3 with `<=` in No Contact: 1 In Contact, -1 No Contact, 0 Unknown; readings (n, taxels) kPa."""
    share = RATIO * readings.max(axis=1, keepdims=True)
    contact = (readings > THRESHOLD) & (readings > share)
    return contact.astype(int) - ((readings <= THRESHOLD) & (readings <= share))


def compose(a, b):
    """Multiply poses [x, y, theta], (..., 3)."""
    cosine, sine = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + cosine * b[..., 0] - sine * b[..., 1]
    y = a[..., 1] + sine * b[..., 0] + cosine * b[..., 1]
    return np.stack([x, y, a[..., 2] + b[..., 2]], axis=-1)


def inverse(a):
    """Invert poses [x, y, theta], (..., 3)."""
    cosine, sine = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [-cosine * a[..., 0] - sine * a[..., 1], sine * a[..., 0] - cosine * a[..., 1], -a[..., 2]], axis=-1
    )


def taxels_at(poses, taxel_xy):
    """Place taxels (t, 2) by sensor poses (n, 3): (n, t, 2) mm."""
    placed = np.concatenate([taxel_xy, np.zeros((len(taxel_xy), 1))], axis=1)
    return compose(poses[:, None], placed[None])[..., :2]


def logit(p):
    """Eq. 1."""
    return np.log(p) - np.log1p(-p)


def learn_map(places, classes):
    """Sum eq. 2 to 6 at nodes CELL apart: the first node (2,) in cells, and log-odds (rows, columns).

    places: (n, 2) mm, of decided taxels. classes: (n,) 1 or -1.
    """
    low = np.floor(places.min(axis=0) / CELL) - 20  # 8 mm, or 8 sigma, beyond: no taxel says anything there
    columns, rows = (np.ceil(places.max(axis=0) / CELL) + 20 - low + 1).astype(int)
    x, y = ((low[axis] + np.arange(count)) * CELL for axis, count in enumerate((columns, rows)))
    log_odds = np.full((rows, columns), logit(PRIOR))
    for (tx, ty), kind in zip(places, classes, strict=True):
        spread = PEAK * np.outer(np.exp(-2 * (y - ty) ** 2 / SIGMA**2), np.exp(-2 * (x - tx) ** 2 / SIGMA**2))
        told = PRIOR + ((1 - PRIOR) * spread if kind > 0 else -PRIOR * spread)
        log_odds += logit(told) - logit(PRIOR)
    return low, log_odds


def interpolate(nodes, beyond, low, places):
    """Interpolate nodes (rows, columns) bilinearly at places (..., 2) mm; `beyond` them."""
    at = places / CELL - low
    rows, columns = nodes.shape
    inside = ((at >= 0) & (at <= [columns - 1, rows - 1])).all(axis=-1)
    at = np.where(inside[..., None], at, 0)
    whole = np.minimum(at.astype(int), [columns - 2, rows - 2])
    (x, y), (i, j) = np.moveaxis(at - whole, -1, 0), np.moveaxis(whole, -1, 0)
    below = (1 - x) * nodes[j, i] + x * nodes[j, i + 1]
    above = (1 - x) * nodes[j + 1, i] + x * nodes[j + 1, i + 1]
    return np.where(inside, (1 - y) * below + y * above, beyond)


def log_p(log_odds, kind):
    """Give log p(e | x), eq. 7, of a decided taxel whose interpolated log-odds are given."""
    occupied = 1 / (1 + np.exp(-log_odds))
    return np.log(GAMMA * PRIOR + (1 - GAMMA) * (occupied if kind > 0 else 1 - occupied))


def log_likelihood(chart, classes, places, interpolation):
    """Sum eq. 7 over a reading: classes (t,), places (bins, t, 2)."""
    low, log_odds = chart
    total = 0.0
    for kind in (1, -1):
        of = places[:, classes == kind]
        if interpolation == "log-odds":
            total += log_p(interpolate(log_odds, logit(PRIOR), low, of), kind).sum(axis=1)
        else:
            total += interpolate(log_p(log_odds, kind), log_p(logit(PRIOR), kind), low, of).sum(axis=1)
    return total


def bins():
    """List the bins' middles: robot_in_object, (bins, 3)."""
    middle = -REACH + 2 * REACH * (np.arange(SIDE) + 0.5) / SIDE
    turn = 2 * np.pi * (np.arange(TURNS) + 0.5) / TURNS
    return np.stack(np.meshgrid(middle, middle, turn), axis=-1).reshape(-1, 3)


def inertia_over_mass(name):
    """Polar second moment over area of a letter about its centre of area, which lies at 0; mm^2, by Green's theorem."""
    area = moment = 0.0
    for ring in letter(name).footprint.to_polygons():
        a, b = np.asarray(ring, dtype=float), np.roll(ring, -1, axis=0).astype(float)
        cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        area += cross.sum() / 2
        moment += (cross * (a**2 + a * b + b**2).sum(axis=1)).sum() / 12
    return moment / area


def error(estimated, true, name):
    """Give the error of the object's placement in the robot frame, mm (the paper's [24])."""
    moved = inverse(estimated)[:2] - inverse(true)[:2]
    order = SYMMETRY[name]
    turn = np.angle(np.exp(1j * order * (estimated[2] - true[2]))) / order if order else 0.0
    return np.sqrt(moved @ moved + inertia_over_mass(name) * 2 * (1 - np.cos(turn)))


@pytest.fixture(scope="module")
def job(tmp_path_factory, shared_cache):
    """Do the main job; gives its --json, its trials, and the arrays of the scan that it pressed."""
    folder = tmp_path_factory.mktemp("main-job")
    call = Bench(folder, shared_cache)
    words = ("--letters", LETTERS, "--trials", TRIALS, "--readings", READINGS, "--out", "run", "--json")
    done = call("run", "--estimator", "histogram", "--bins", "10000", *words)
    assert done.returncode == 0, done.stderr
    assert call("scan", "--letters", LETTERS, "--out", "scan.npz").returncode == 0
    with (folder / "run" / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with np.load(folder / "scan.npz", allow_pickle=False) as arrays:
        scan = {name: arrays[name] for name in ("readings", "poses", "labels", "split", "taxel_xy")}
    return json.loads(done.stdout), rows, scan


def recognise(rows, scan, interpolation):
    """Do the trials of `rows` again; gives of each row {letter: mass}, the estimate within each letter."""
    classes, states, maps = classify(scan["readings"]), bins(), {}
    for name in LETTERS:
        of = (scan["labels"] == name) & (scan["split"] == "train")
        places, kinds = taxels_at(scan["poses"][of], scan["taxel_xy"]), classes[of]
        maps[name] = learn_map(places[kinds != 0], kinds[kinds != 0])
    for row in rows:
        if row["reading_number"] == "1":
            belief = dict.fromkeys(LETTERS, 0.0)
        true = np.array([float(row[f"true_{axis}"]) for axis in ("x", "y", "theta")])
        tests = np.flatnonzero((scan["labels"] == row["truth"]) & (scan["split"] == "test"))
        index = tests[int(row["touch_index"])]
        sensor_in_robot = compose(inverse(true), scan["poses"][index])
        places = taxels_at(compose(states, sensor_in_robot), scan["taxel_xy"])
        for name, chart in maps.items():  # eq. 13
            belief[name] = belief[name] + log_likelihood(chart, classes[index], places, interpolation)
        top = max(log.max() for log in belief.values())
        masses = {name: np.exp(log - top).sum() for name, log in belief.items()}
        total = sum(masses.values())
        modes = {name: states[np.argmax(log)] for name, log in belief.items()}  # eq. 15 and 16
        yield {name: mass / total for name, mass in masses.items()}, modes, true


def curves(labels, poses, trues, truths):
    """Give whether each reading's label is right, and its error (NaN where it is not): (trials, readings) both."""
    right = np.array([label == truth for label, truth in zip(labels, truths, strict=True)])
    errors = [error(*of) for of in zip(poses, trues, truths, strict=True)]
    return (part.reshape(-1, READINGS) for part in (right, np.where(right, errors, np.nan)))


@pytest.mark.long
@pytest.mark.parametrize("interpolation", ["logarithms", "log-odds"])
def test_its_table_is_that_of_the_papers_equations(job, interpolation):
    printed, rows, scan = job
    assert len(rows) == len(LETTERS) * TRIALS * READINGS
    masses, estimates, trues = zip(*recognise(rows, scan, interpolation), strict=True)
    truths, said = ([row[name] for row in rows] for name in ("truth", "label"))
    best = [max(of, key=of.get) for of in masses]  # eq. 14
    if interpolation == "logarithms":
        for row, of, letter_of_most in zip(rows, masses, best, strict=True):
            assert of[row["label"]] >= of[letter_of_most] - 2 * ROUNDING
            assert float(row["p_label"]) == pytest.approx(of[row["label"]], abs=ROUNDING)
            assert float(row["p_truth"]) == pytest.approx(of[row["truth"]], abs=ROUNDING)
    poses = [np.array([float(row[axis]) for axis in ("x", "y", "theta")]) for row in rows]
    right, errors = curves(said, poses, trues, truths)
    # What it prints is what its trials say ...
    np.testing.assert_allclose(printed["accuracy"], right.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(printed["error_mm"], np.nanmean(errors, axis=0), rtol=1e-9)
    # ... and that is what the equations say.
    poses = [of[name] for of, name in zip(estimates, best, strict=True)]
    right_here, errors_here = curves(best, poses, trues, truths)
    if interpolation == "logarithms":
        assert (right != right_here).mean() <= 0.03
        np.testing.assert_allclose(np.nanmean(errors, axis=0), np.nanmean(errors_here, axis=0), rtol=0.005)
    else:
        assert abs(right.mean() - right_here.mean()) <= TABLE_RIGHT
        last, last_here = (np.nanmean(of[:, -1]) for of in (errors, errors_here))
        assert abs(last - last_here) <= TABLE_ERROR_MM
