"""Whole images: named wherever and however they lie, told from their mirror images, and sure only where it is right."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import fitted_anew

from tactsim.core import Pad, Scan
from tactsim.estimators.baselines import whole_image

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
    part, wanted = whole_image._parts(train, letter), np.eye(3)[letter]
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
