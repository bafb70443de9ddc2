"""Recordings become scans by their marks; images of a rise; windows that are cut from large arrays."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_pads import csv_device, small_device

from tactsim.core import InputError, Pad, Scan, transform
from tactsim.core.reading import Reading
from tactsim.core.source import Source
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.cutting import cut
from tactsim.hardware.recorded import CsvReplay, Replay
from tactsim.hardware.recording import Recorder
from tactsim.hardware.scans import Interval, read_intervals, scan_of_intervals, wrong_taxels

MARKS = """label,split,x_mm,y_mm,theta_rad,first_s,last_s
A,train,1.0,2.0,0.5,0.09,0.31
B,test,0,0,0,0.34,0.36
"""


def test_other_peoples_recordings_become_scans_by_their_marks(tmp_path):
    lines = ["Time [ms]," + ",".join(f"Elem{k}" for k in range(6))]
    lines += [",".join(map(str, [50 * k, *(k + np.arange(6))])) for k in range(20)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "marks.csv").write_text(MARKS)
    scan = scan_of_intervals(
        CsvReplay(tmp_path / "a.csv", csv_device()), read_intervals(tmp_path / "marks.csv")
    )
    assert np.array_equal(scan.readings, [4 + np.arange(6), 7 + np.arange(6)])
    assert scan.poses.tolist() == [[1.0, 2.0, 0.5], [0.0, 0.0, 0.0]]
    assert scan.labels.tolist() == ["A", "B"]
    assert scan.split.tolist() == ["train", "test"]


def test_marks_count_on_the_hosts_clock_where_the_device_has_none(tmp_path):
    with Recorder(tmp_path / "a") as recorder:
        recorder.segment({"device": small_device().as_json()}, 0.0)
        for k in range(20):
            recorder.reading(Reading(np.full(6, float(k)), 64 + k / 20))
    (tmp_path / "marks.csv").write_text(MARKS)
    scan = scan_of_intervals(Replay(tmp_path / "a"), read_intervals(tmp_path / "marks.csv"))
    assert scan.readings[:, 0].tolist() == [4.0, 7.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no line names its columns, which are label, split, x_mm"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\n,,,,,,\n", "holds no marks: there is no row below"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,0,-0.1,1\n", "line 2: first_s"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,dev,0,0,0,0,1\n",
         "line 2: split: give 'train' or 'test', got 'dev'"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,0,0\n", "line 2: missing is last_s"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,0,0,1,2\n", "line 2: .*more columns"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,90,0,1\n",
         "line 2: theta_rad: .*theta_deg"),
    ],
)  # fmt: skip
def test_marks_that_make_no_sense_are_refused_with_their_line(tmp_path, content, message):
    (tmp_path / "marks.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        read_intervals(tmp_path / "marks.csv")


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_marks_that_a_spreadsheet_saved_again_are_the_same(tmp_path, mark):
    (tmp_path / "marks.csv").write_text(MARKS)
    saved = mark + MARKS.replace(",", ";").replace(".", ",")
    (tmp_path / "saved.csv").write_text(saved.replace("A;", '"A;1,5";'), encoding="utf-8")
    first, second = read_intervals(tmp_path / "saved.csv")
    wanted = read_intervals(tmp_path / "marks.csv")
    assert [first.model_copy(update={"label": "A"}), second] == wanted
    assert first.label == "A;1,5"


def test_marks_may_say_angles_in_degrees(tmp_path):
    (tmp_path / "marks.csv").write_text("label,x_mm,y_mm,theta_deg,first_s,last_s\nA,1,2,180,0,1\n")
    (mark,) = read_intervals(tmp_path / "marks.csv")
    assert mark.pose == (1.0, 2.0, np.pi)


def test_marks_without_poses_are_of_presses_whose_poses_nobody_noted(tmp_path):
    text = "label,split,first_s,last_s\nA,train,0.09,0.31\nB,test,0.34,0.36\n"
    (tmp_path / "marks.csv").write_text(text)
    scan = scan_of_intervals(recorded(tmp_path / "a"), read_intervals(tmp_path / "marks.csv"))
    assert (scan.meta["poses"], scan.poses.any(), scan.presses.tolist()) == ("unknown", False, [0, 1])
    (tmp_path / "marks.csv").write_text(MARKS)
    placed = scan_of_intervals(recorded(tmp_path / "b"), read_intervals(tmp_path / "marks.csv"))
    assert ("poses" in placed.meta, placed.presses) == (False, None)
    assert np.array_equal(placed.readings, scan.readings)


@pytest.mark.parametrize(
    ("some", "message"),
    [("x_mm", "line 2: missing are y_mm, theta_rad"), ("x_mm,y_mm", "missing is theta_rad"),
     ("theta_deg", "line 2: missing are x_mm, y_mm"), ("x,y,angle", "unknown option 'x': known are .* x_mm, y_mm")],
)  # fmt: skip
def test_marks_with_a_part_of_the_pose_are_refused(tmp_path, some, message):
    zeros = ",".join("0" for _ in some.split(","))
    (tmp_path / "marks.csv").write_text(f"label,{some},first_s,last_s\nA,{zeros},0,1\n")
    with pytest.raises(InputError, match=message):
        read_intervals(tmp_path / "marks.csv")


def test_windows_of_presses_without_poses_lie_to_each_other_as_the_taxels_do(tmp_path):
    (tmp_path / "marks.csv").write_text("label,split,first_s,last_s\nA,train,0.09,0.31\nB,test,0.34,0.36\n")
    whole = scan_of_intervals(recorded(tmp_path / "a"), read_intervals(tmp_path / "marks.csv"))
    touches = cut(whole, 1, 1)
    assert touches.meta["poses"] == "unknown"
    assert set(touches.presses.tolist()) == {0, 1}
    assert sorted(touches.poses[:, :2].tolist()) == sorted(whole.taxel_xy.tolist())


def test_an_interval_without_readings_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text(
        "Time [ms],Elem0,Elem1,Elem2,Elem3,Elem4,Elem5\n0,1,2,3,4,5,6\n400,1,2,3,4,5,6\n"
    )
    (tmp_path / "marks.csv").write_text(MARKS)
    source = CsvReplay(tmp_path / "a.csv", csv_device())
    with pytest.raises(InputError, match=r"no reading lies between 0.09 and 0.31 s \(A\)"):
        scan_of_intervals(source, read_intervals(tmp_path / "marks.csv"))


def recorded(path, lost_at=None):
    """Record 20 readings, 50 ms apart."""
    with Recorder(path) as recorder:
        recorder.segment({"device": small_device().as_json()}, 0.0)
        form = small_device().codec.build()
        for k in range(20):
            if k == lost_at:
                recorder.lost(0, 64 + k / 20)
            message = form.encode(Frame(np.full(6, 100.0 + k), index=k, ticks=50 * k))
            recorder.received(0, message, 64 + k / 20)
    return Replay(path)


@pytest.mark.parametrize(
    ("last", "message"),
    [("1.00", None), ("1.01", r"the recording ends at 0.95 s, but a mark \(B\) goes on until 1.01 s"),
     ("0.1", "before")],
)  # fmt: skip
def test_marks_past_the_end_or_backwards_are_refused(tmp_path, last, message):
    (tmp_path / "marks.csv").write_text(MARKS.replace("0.34,0.36", f"0.34,{last}"))
    with pytest.raises(InputError, match=message) if message else nullcontext():
        scan_of_intervals(recorded(tmp_path / "a"), read_intervals(tmp_path / "marks.csv"))


@pytest.mark.parametrize(("lost_at", "refused"), [(4, True), (2, False), (7, False)])
def test_a_press_across_an_unplugged_cable_is_refused(tmp_path, lost_at, refused):
    """The mark of A holds readings 2 to 6."""
    (tmp_path / "marks.csv").write_text(MARKS)
    with (
        pytest.raises(InputError, match=r"the pad was lost between 0.09 and 0.31 s \(A\)")
        if refused
        else nullcontext()
    ):
        scan_of_intervals(recorded(tmp_path / "a", lost_at), read_intervals(tmp_path / "marks.csv"))


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
        "shares": [0.25, 0.5, 0.75, 1.0], "of": "felt", "split": "train", "presses": 3,
    }  # fmt: skip
    assert made.split.tolist() == ["train"] * 12 + ["test"]
    felt = (made.readings - zero).sum(axis=1)[:12].reshape(3, 4) / PATTERN.sum()
    assert felt == pytest.approx(np.tile([0.25, 0.5, 0.75, 1], (3, 1)), abs=0.04)
    assert made.readings[-1] == pytest.approx(PATTERN + zero, abs=0.3)
    assert np.array_equal(made.poses[:4], np.zeros((4, 3)))


@pytest.mark.parametrize("moments", [None, 4])
def test_test_presses_are_read_at_a_share_of_their_load(moments):
    (images, length), share = recording(), 0.6
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
        0.25, 0.5, 0.75, 1,
    ] * 3 + [1]  # fmt: skip
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


def array_scan(rows=16, columns=16, missing=(), **pad):
    """A large even array that feels a smooth field of the object's frame, twice at two poses; taxels may be missing."""
    pad = Pad(rows=rows, columns=columns, seam=None, unread_columns=0, **pad)
    poses = np.array([[0.0, 0.0, 0.0], [3.0, -2.0, 0.7]] * 2)
    xy = np.delete(pad.taxel_xy, list(missing), axis=0)
    points = transform(poses, xy)
    split = np.array(["train", "train", "test", "test"])
    return Scan(field(points), poses, np.array(["A", "B"] * 2), split, xy, loads=[1.0, np.nan, 3.0, 4.0])


def field(points):
    return 50 + 3 * points[..., 0] + 20 * np.sin(points[..., 1] / 5)


@pytest.mark.parametrize(
    ("window", "stride", "train", "test"),
    [((5, 5), 1, 72, 72), ((5, 5), 4, 9, 9), ((3, 16), 2, 7, 7), ((1, 2), 8, 4, 4)],
)
def test_each_cut_feels_the_same_place_of_the_object(window, stride, train, test):
    touches = cut(array_scan(), *window, stride)
    assert touches.readings.shape == (2 * (train + test), window[0] * window[1])
    assert np.allclose(touches.taxel_xy.mean(axis=0), 0)
    assert np.allclose(touches.readings, field(transform(touches.poses, touches.taxel_xy)))
    assert (touches.labels == "A").sum() == train + test
    assert [np.count_nonzero(touches.presses == press) for press in range(4)] == [train] * 2 + [test] * 2
    for press in range(4):  # its windows are of its angle
        angles = touches.poses[touches.presses == press, 2]
        assert angles == pytest.approx(array_scan().poses[press, 2])
    assert touches.meta["cut"]["windows"] == {"train": train, "test": test}
    assert np.array_equal(np.isnan(touches.loads), (touches.labels == "B") & (touches.split == "train"))


@given(
    rows=st.integers(1, 7), columns=st.integers(1, 7), stride=st.integers(1, 5),
    window=st.tuples(st.integers(1, 7), st.integers(1, 7)),
)  # fmt: skip
def test_no_test_touch_is_taken_where_a_training_touch_was(rows, columns, stride, window):
    if window[0] > rows or window[1] > columns:
        return
    touches = cut(array_scan(rows, columns), *window, stride)
    train, test = (
        {tuple(np.round(pose, 6)) for pose in touches.where(split).poses} for split in ("train", "test")
    )
    if touches.meta["cut"]["apart"]:
        assert not train & test
    else:  # there is room for one lattice only
        assert train == test
        assert all(
            room == 1 or (stride > 1 and room <= stride // 2)
            for room in (rows - window[0] + 1, columns - window[1] + 1)
        )


def test_what_is_cut_is_described_by_its_own_pad():
    whole = Pad(rows=16, columns=16, seam=None)
    scan = replace(array_scan(), meta={"pad": whole.model_dump(mode="json")})
    assert Pad.model_validate(cut(scan, 5, 4).about["pad"]) == Pad(
        rows=5, columns=4, seam=None, unread_columns=0
    )
    assert cut(array_scan(), 5, 4).about["pad"] is None


@pytest.mark.parametrize("window", [(17, 5), (0, 5), (5, -1)])
def test_a_window_that_does_not_fit_is_refused(window):
    with pytest.raises(InputError, match="cannot be cut from 16x16"):
        cut(array_scan(), *window)


@pytest.mark.parametrize("pitch", [1.9, 3.8])
def test_windows_with_a_missing_taxel_are_left_out(pitch):
    masked = (7, 100, *range(15, 256, 16))  # two taxels, and the last column whole
    size = {"pitch_x": pitch, "pitch_y": pitch}
    touches = cut(array_scan(missing=masked, **size), 5, 5, 1)
    whole = cut(array_scan(**size), 5, 5, 1)
    assert touches.meta["cut"]["missing"] == 2
    assert np.allclose(touches.taxel_xy, whole.taxel_xy)
    assert np.allclose(touches.readings, field(transform(touches.poses, touches.taxel_xy)))
    assert len(touches) < len(whole)


def test_an_array_without_a_whole_window_is_refused():
    with pytest.raises(InputError, match=r"no window of 5x5 taxels is whole.*8 of 64 taxels are missing"):
        cut(array_scan(8, 8, missing=range(3, 64, 8)), 5, 5)


def test_a_pad_with_a_seam_is_not_cut():
    one = np.array(["A"]), np.array(["train"])
    with pytest.raises(InputError, match="not evenly spaced"):
        cut(Scan(np.zeros((1, 36)), np.zeros((1, 3)), *one, Pad().taxel_xy), 3, 3)
