"""The baselines: the nearest reading, a bag of features, the whole image."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from synthetic import fitted_anew, started, two_taxel_scan

from tactsim.core import Pad, Scan, compose, invert
from tactsim.estimators.baselines import whole_image
from tactsim.estimators.likelihoods.folds import parts_of_presses

PAD = Pad(
    rows=21, columns=21, pitch_x=2, pitch_y=2, taxel_width=1, taxel_height=1, no_seam=True, unread_columns=0
)
BARS = {
    "bar": [(0, 0, 12, 3)],
    "cross": [(0, 0, 12, 3), (0, 0, 3, 12)],
    "tee": [(0, 4, 12, 3), (0, -2, 3, 9)],
}


def pressed(name, x, y, angle):
    """Press boxes (middle, width, height in mm) that lie at x, y, turned: (taxels,)."""
    cos, sin = np.cos(angle), np.sin(angle)
    along, across = ((PAD.taxel_xy - [x, y]) @ np.array([[cos, -sin], [sin, cos]])).T
    inside = [
        np.clip(w / 2 - np.abs(along - mx) + 1, 0, 1) * np.clip(h / 2 - np.abs(across - my) + 1, 0, 1)
        for mx, my, w, h in BARS[name]
    ]
    return 100 * np.max(inside, axis=0)


def scan_of(rng, presses=12, unit=1.0):
    rows = [
        (name, pressed(name, *rng.uniform(-8, 8, 2), rng.uniform(0, 2 * np.pi)))
        for name in BARS
        for _ in range(presses)
    ]
    split = np.tile(["train", "test"], len(rows) // 2)
    return Scan(
        unit * np.array([reading for _, reading in rows]), np.zeros((len(rows), 3)),
        np.array([name for name, _ in rows]), split, PAD.taxel_xy,
    )  # fmt: skip


def named(estimator, reading):
    estimator.reset(np.random.default_rng(0))
    estimator.update(reading, [0, 0, 0])
    return estimator.estimate()


def test_objects_are_named_wherever_and_however_they_lie():
    scan = scan_of(np.random.default_rng(0), 24)
    estimator, test = fitted_anew("whole-image", scan), scan.where("test")
    answers = [named(estimator, reading) for reading in test.readings]
    assert [answer.label for answer in answers] == test.labels.tolist()
    assert all(answer.robot_in_object.tolist() == [0, 0, 0] for answer in answers)


def test_mirror_images_are_told_apart_where_the_orientation_is_known():
    """L and its mirror image have the same amplitudes: what tells them apart is how they lie."""
    rng, left = np.random.default_rng(0), np.zeros((21, 21))
    left[5:16, 7:10] = left[13:16, 7:15] = 100
    rows = [
        np.roll(left if k % 2 else left[:, ::-1], rng.integers(-3, 4, 2), (0, 1))
        + rng.normal(0, 2, left.shape)
        for k in range(60)
    ]
    scan = Scan(
        np.reshape(rows, (60, -1)), np.zeros((60, 3)), np.tile(["J", "L"], 30),
        np.repeat(["train", "test"], 30), PAD.taxel_xy,
    )  # fmt: skip
    estimator, test = fitted_anew("whole-image", scan), scan.where("test")
    assert estimator.view == "as it lies"
    assert [named(estimator, reading).label for reading in test.readings] == test.labels.tolist()


def test_what_is_left_out_is_foretold_as_if_it_had_not_been_there(monkeypatch):
    """The scores of left-out presses, from one inverse, against fits without them."""
    train = scan_of(np.random.default_rng(1), 16).where("train")
    estimator = fitted_anew("whole-image", train)
    view = estimator._views(train.readings)
    squares = whole_image._squares(*[(one, one) for one in view])
    letter = np.array([train.letters.index(label) for label in train.labels])
    part, wanted = parts_of_presses(train), np.eye(3)[letter]
    seen = []
    monkeypatch.setattr(whole_image, "_log_p", lambda scores: seen.append(scores) or -np.ones_like(scores))
    for name, value in (("_WIDTHS", (1.0,)), ("_RIDGES", (0.01,)), ("_SHARPNESS", (1.0,))):
        monkeypatch.setattr(whole_image, name, value)
    monkeypatch.setattr(whole_image, "_VIEWS", {"both": (0.5, 0.5)})
    estimator._choose(squares, wanted, part)
    kernel = estimator._kernel(squares, "both", 1.0)
    for number in np.unique(part):
        out, kept = part == number, part != number
        ridged = kernel[np.ix_(kept, kept)] + 0.01 * np.eye(kept.sum())
        expected = kernel[np.ix_(out, kept)] @ np.linalg.solve(ridged, wanted[kept])
        assert seen[0][out] == pytest.approx(expected, abs=1e-7)


def test_one_press_an_object_and_copies_of_presses_can_be_learned():
    scan = scan_of(np.random.default_rng(2), 2)
    assert named(fitted_anew("whole-image", scan), scan.readings[0]).label == "bar"
    copies = replace(scan, readings=np.ones_like(scan.readings), presses=None)
    assert named(fitted_anew("whole-image", copies), copies.readings[0]).probabilities[
        "tee"
    ] == pytest.approx(1 / 3, abs=0.01)


def test_the_stated_probability_is_that_of_left_out_presses():
    """Labels that have nothing to do with the presses: no answer is sure, though training readings are separable."""
    rng = np.random.default_rng(3)
    scan = scan_of(rng, 40)
    mixed = replace(scan, labels=rng.permutation(scan.labels), presses=None)
    estimator = fitted_anew("whole-image", mixed)
    sure = [max(named(estimator, reading).probabilities.values()) for reading in mixed.where("test").readings]
    assert np.mean(sure) < 0.6


def grasps(same, meta):
    """Sixty grasps of four readings each. A reading shows its object, or in 3 of 10 cases any; all of a grasp the same
    or each anew."""
    rng, names = np.random.default_rng(5), list(BARS)
    labels = np.repeat(np.tile(names, 20), 4)
    images = []
    for name in labels[::4]:
        shown = [rng.choice(names) if rng.random() < 0.3 else name for _ in range(4)]
        image = [pressed(one, *rng.uniform(-8, 8, 2), rng.uniform(0, 2 * np.pi)) for one in shown]
        images += image[:1] * 4 if same else image
    return Scan(
        np.array(images), np.zeros((240, 3)), labels, np.full(240, "train"), PAD.taxel_xy,
        presses=np.repeat(np.arange(60), 4), meta=meta,
    )  # fmt: skip


def after(estimator, readings):
    estimator.reset(np.random.default_rng(0))
    for reading in readings:
        estimator.update(reading, [0, 0, 0])
    return estimator.estimate().probabilities


def test_readings_of_a_grasp_count_as_what_they_say_together(monkeypatch):
    """Copies say no more than one of them; independent readings are multiplied."""
    unknown = {"poses": "unknown"}
    copies, anew = (fitted_anew("whole-image", grasps(same, unknown)) for same in (True, False))
    assert copies.shared > 0.8
    assert anew.shared < 0.2
    told = fitted_anew("whole-image", grasps(True, {}))
    assert told.shared == 0  # readings of a sequence are of presses here and there
    monkeypatch.setattr(whole_image, "_FITTED", 60)  # grasps are kept whole where there are too many
    assert fitted_anew("whole-image", grasps(True, unknown)).shared > 0.5
    reading = pressed("tee", 1, 2, 0.5)
    one, four = after(copies, [reading]), after(copies, [reading] * 4)
    assert four == pytest.approx(one, abs=0.05)
    assert max(after(told, [reading] * 4).values()) > max(four.values())


def test_many_presses_are_chosen_in_whatever_order_objects_are_listed(monkeypatch):
    monkeypatch.setattr(whole_image, "_CHOSEN_ON", 20)
    monkeypatch.setattr(whole_image, "_FITTED", 30)
    scan = scan_of(np.random.default_rng(4), 24)
    other = scan.chosen(
        np.argsort(np.char.translate(scan.labels, str.maketrans("bct", "zxy")), kind="stable")
    )
    assert other.letters != scan.letters
    one, two = fitted_anew("whole-image", scan), fitted_anew("whole-image", other)
    reading = scan.where("test").readings[0]
    assert after(one, [reading]) == pytest.approx(after(two, [reading]), abs=1e-6)


def test_a_touch_of_nothing_says_nothing():
    scan = scan_of(np.random.default_rng(0), 24)
    estimator = fitted_anew("whole-image", scan)
    nothing = np.full(scan.readings.shape[1], 0.01)
    assert set(after(estimator, [nothing]).values()) == {1 / 3}
    some = scan.readings[0]
    assert after(estimator, [nothing, some]) == after(estimator, [some])


def test_probabilities_are_those_of_kernels_summed_by_hand():
    rng = np.random.default_rng(1)
    readings = rng.uniform(0, 9, (7, 2))
    labels = np.array(["B", "A", "C", "A", "B", "A", "A"])  # of unequal numbers
    estimator = started("nearest", two_taxel_scan(readings, labels), width=2.5)
    expected = dict.fromkeys("ABC", 1.0)
    for reading in rng.uniform(0, 9, (4, 2)):
        estimator.update(reading, [0, 0, 0])
        for label in expected:
            kernels = [multivariate_normal.pdf(reading, mean, 2.5**2) for mean in readings[labels == label]]
            expected[label] *= np.mean(kernels)
        total = sum(expected.values())
        estimate = estimator.estimate()
        assert estimate.probabilities == pytest.approx({label: p / total for label, p in expected.items()})
        assert estimate.label == max(expected, key=expected.get)


def test_the_width_is_the_rms_distance_to_the_nearest_other_of_the_letter():
    scan = two_taxel_scan([[0, 0], [3, 4], [0, 1], [100, 100], [100, 102]], list("AAABB"))
    # squared distances to the nearest: A 1, 18, 1; B 4, 4; of two taxels
    assert started("nearest", scan).width == pytest.approx(np.sqrt((1 + 18 + 1 + 4 + 4) / 5 / 2))
    assert started("nearest", scan, width=7.0).width == 7.0


def test_a_reading_beside_the_letter_does_not_say_where():
    scan = two_taxel_scan([[50, 20], [0, 0.2]], ["A", "A"], [[1, 2, 0.3], [9, 9, 0]])
    estimator = started("nearest", scan)
    estimator.update([50, 21], [4, 0, 0])
    before = estimator.estimate().robot_in_object
    assert before == pytest.approx(compose([1, 2, 0.3], invert([4, 0, 0])))
    estimator.update([0, 0.1], [0, 5, 0])  # nearer to its training reading, in kPa, than the first to its own
    assert estimator.estimate().robot_in_object == pytest.approx(before)


GROUPS = np.array([[0, 0], [50, 0], [50, 60]])


def clustered():
    """Readings around three centres; A has given 6, 3 and 1 of them, B 1, 1 and 3."""
    rng = np.random.default_rng(3)
    which = np.repeat([0, 1, 2, 0, 1, 2], [6, 3, 1, 1, 1, 3])
    labels = np.repeat(["A", "B"], [10, 5])
    return two_taxel_scan(GROUPS[which] + rng.normal(0, 0.5, (15, 2)), labels), which, labels


def test_the_words_are_the_means_of_what_is_alike():
    scan, which, _ = clustered()
    words = started("bag-of-features", scan, words=3).words
    expected = np.array([scan.readings[which == group].mean(axis=0) for group in range(3)])
    order = np.lexsort(words.T[::-1])
    assert words[order] == pytest.approx(expected)


def test_probabilities_are_products_of_shares_counted_by_hand():
    estimator = started("bag-of-features", clustered()[0], words=3)
    shares = {"A": (np.array([6, 3, 1]) + 0.5) / 11.5, "B": (np.array([1, 1, 3]) + 0.5) / 6.5}
    product = dict.fromkeys("AB", 1.0)
    for group in (2, 0, 2, 1):
        estimator.update(GROUPS[group] + 1.0, [3, 4, 5])
        product = {label: p * shares[label][group] for label, p in product.items()}
        total = sum(product.values())
        said = estimator.estimate()
        assert said.probabilities == pytest.approx({label: p / total for label, p in product.items()})
        assert said.label == max(product, key=product.get)
