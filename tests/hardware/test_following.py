"""Recordings of many images a press: what is found in them without marks of the rise."""

import numpy as np
import pytest
from made_pads import small_device

from tactsim.core import InputError
from tactsim.core.reading import Reading
from tactsim.core.source import Source
from tactsim.hardware.scans import Interval, scan_of_intervals, wrong_taxels

PATTERN = np.array([0.0, 5.0, 20.0, 40.0, 30.0, 10.0])
RATE = 100.0  # images a second
IDLE, RISE, HOLD, FALL = 40, 20, 40, 10


class Played(Source):
    """Images (frames, 6) at RATE."""

    def __init__(self, images):
        self.pad = small_device().pad
        self.taxel_xy = self.pad.taxel_xy
        self._images = iter(enumerate(images))

    def read(self):
        raise NotImplementedError

    def close(self):
        pass

    def __iter__(self):
        return (Reading(image, 5 + k / RATE) for k, image in self._images)


def recording(presses=4, noise=0.2, zero=0.0):
    rng = np.random.default_rng(0)
    ramp = np.arange(1, RISE + 1) / (RISE + 1)
    shape = np.concatenate([np.zeros(IDLE), ramp, np.ones(HOLD), np.linspace(0.9, 0.05, FALL)])
    course = np.tile(shape, presses)
    powers = np.array([1.0, 1.0, 1.5, 1.0, 1.0, 1.5])
    images = PATTERN * course[:, None] ** powers
    return zero + images + noise * rng.standard_normal((len(course), 6)), len(shape)


def marks(count, length, first=IDLE + RISE + 5, last=IDLE + RISE + HOLD - 5):
    return [
        Interval(
            label="A", split="test" if k == count - 1 else "train", x_mm=k, y_mm=0, theta_rad=0,
            first_s=max(0.0, (k * length + first) / RATE - 1e-6), last_s=(k * length + last) / RATE + 1e-6,
        )
        for k in range(count)
    ]  # fmt: skip


# The mark holds the plateau, the press from the first touch on, or everything.
@pytest.mark.parametrize("first", [IDLE + RISE + 5, 5])
@pytest.mark.parametrize("zero", [0.0, 3.0])
def test_moments_are_found_without_marks_of_the_rise(first, zero):
    images, length = recording(zero=zero)
    last = IDLE + RISE + HOLD + (0 if first > IDLE else FALL - 2)
    made = scan_of_intervals(Played(images), marks(4, length, first, last), 4)
    assert made.meta["moments"] == {
        "shares": [0.25, 0.5, 0.75, 1.0],
        "of": "felt",
        "split": "train",
        "presses": 3,
    }
    assert made.split.tolist() == ["train"] * 12 + ["test"]
    felt = (made.readings - zero).sum(axis=1)[:12].reshape(3, 4) / PATTERN.sum()
    assert felt == pytest.approx(np.tile([0.25, 0.5, 0.75, 1], (3, 1)), abs=0.04)
    assert made.readings[-1] == pytest.approx(PATTERN + zero, abs=0.3)
    assert np.array_equal(made.poses[:4], np.zeros((4, 3)))


@pytest.mark.parametrize("moments", [None, 4])
@pytest.mark.parametrize("share", [0.6])
def test_test_presses_are_read_at_a_share_of_their_load(moments, share):
    images, length = recording()
    made = scan_of_intervals(Played(images), marks(4, length), moments, share)
    train, test = made.where("train"), made.where("test")
    assert test.moments.tolist() == [share]
    assert test.readings.sum() == pytest.approx(share * PATTERN.sum(), rel=0.06)
    assert train.moments.tolist() == ([1] * 3 if moments is None else [0.25, 0.5, 0.75, 1] * 3)
    assert made.meta["test_load"] == share


def test_a_share_of_the_load_that_no_test_press_shows_is_refused():
    images, length = recording()
    steep = np.delete(images, [k for k in range(len(images)) if IDLE <= k % length < IDLE + RISE], axis=0)
    short = length - RISE
    sudden = marks(4, short, IDLE + 5, IDLE + HOLD - 5)
    with pytest.raises(InputError, match="no test press shows 50% of its load"):
        scan_of_intervals(Played(steep), sudden, None, 0.5)
    with pytest.raises(InputError, match="share above 0, at most 1"):
        scan_of_intervals(Played(images), marks(4, length), None, 1.5)


def test_moments_are_taken_where_there_is_a_rise_and_else_the_mean_of_the_mark_stays():
    images, length = recording()
    assert scan_of_intervals(Played(images), marks(4, length), "found").moments.tolist() == [
        0.25,
        0.5,
        0.75,
        1,
    ] * 3 + [1]
    steep = np.delete(images, [k for k in range(len(images)) if IDLE <= k % length < IDLE + RISE], axis=0)
    sudden = marks(4, length - RISE, IDLE + 5, IDLE + HOLD - 5)
    plain = scan_of_intervals(Played(steep), sudden)
    assert scan_of_intervals(Played(steep), sudden, "found").digest == plain.digest


@pytest.mark.parametrize("seed", range(5))
def test_a_long_light_touch_is_no_load_that_is_always_there(seed):
    """Whether the idle pad was touched before the presses, or a taxel that the presses leave out was all the time."""
    rng = np.random.default_rng(seed)
    idle, presses = rng.normal(0, 0.2, (120, 9)), rng.normal(0, 0.2, (6, 9))
    presses[:, 4:8] += rng.uniform(30, 60, (6, 4))
    idle[:70, 4] += 18
    assert wrong_taxels(idle, presses) == {}
    idle[:, 1] += 18
    assert wrong_taxels(idle, presses) == {}
    presses[:, 1] += 18
    assert list(wrong_taxels(idle, presses)) == [1]


def test_taxels_that_are_stuck_or_always_loaded_while_idle_are_left_out():
    images, length = recording()
    images[:, 1] = 7.5
    images[:, 4] = 25 + 0.2 * np.random.default_rng(1).standard_normal(len(images))
    made = scan_of_intervals(Played(images), marks(4, length))
    assert list(made.meta["left_out"]) == ["1", "4"]
    assert made.meta["left_out"]["1"] == "stuck at 7.5"
    assert made.meta["left_out"]["4"].startswith("always loaded: it reads 2")
    assert np.array_equal(made.taxel_xy, small_device().pad.taxel_xy[[0, 2, 3, 5]])
    assert made.readings[0] == pytest.approx(PATTERN[[0, 2, 3, 5]], abs=0.3)


def test_a_whole_pad_keeps_all_its_taxels():
    images, length = recording()
    assert "left_out" not in scan_of_intervals(Played(images), marks(4, length)).meta
    # A taxel that the object never covers is quiet, not wrong; without idle images nothing is known of any.
    held = images[IDLE + RISE + 5 : IDLE + RISE + HOLD - 5]
    held[:, 1] = 7.5
    whole = scan_of_intervals(Played(held), marks(1, 0, 0, len(held) - 1))
    assert "left_out" not in whole.meta


def test_a_recording_without_plateau_or_rise_is_refused_in_one_line():
    images, _ = recording()
    tap = np.concatenate([np.zeros(IDLE), np.arange(30), np.arange(30, 0, -1)])[:, None] * PATTERN / 30
    for played, marked in (
        (np.tile(tap, (2, 1)), marks(2, len(tap), 5, len(tap) - 1)),
        (images[IDLE + RISE + 2 : IDLE + RISE + HOLD - 2], marks(1, 0, 0, HOLD - 5)),
    ):
        with pytest.raises(InputError, match="no press of the recording shows a plateau") as fault:
            scan_of_intervals(
                Played(played), [each.model_copy(update={"split": "train"}) for each in marked], 4
            )
        assert "\n" not in str(fault.value)
