"""The spectrum: what it does not look at, and whole presses that it names wherever and however they lie."""

from dataclasses import replace

import numpy as np
from synthetic import fitted_anew

from tactsim.core import Pad, Scan

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
    estimator, test = fitted_anew("spectrum", scan), scan.where("test")
    answers = [named(estimator, reading) for reading in test.readings]
    assert [answer.label for answer in answers] == test.labels.tolist()
    assert all(answer.robot_in_object.tolist() == [0, 0, 0] for answer in answers)


def test_the_stated_probability_is_that_of_left_out_presses():
    """Labels that have nothing to do with the presses: no answer is sure, though training readings are separable."""
    rng = np.random.default_rng(3)
    scan = scan_of(rng, 40)
    mixed = replace(scan, labels=rng.permutation(scan.labels), presses=None)
    estimator = fitted_anew("spectrum", mixed)
    sure = [max(named(estimator, reading).probabilities.values()) for reading in mixed.where("test").readings]
    assert estimator.temperature > 5
    assert np.mean(sure) < 0.6
