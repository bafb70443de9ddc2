from contextlib import nullcontext

import numpy as np
import pytest
from made_pads import csv_device, small_device

from tactsim.core import InputError
from tactsim.core.reading import Reading
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.recorded import CsvReplay, Replay
from tactsim.hardware.recording import Recorder
from tactsim.hardware.scans import read_intervals, scan_of_intervals

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
        (
            "label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,dev,0,0,0,0,1\n",
            "line 2: split: give 'train' or 'test', got 'dev'",
        ),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,0,0\n", "line 2: missing is last_s"),
        ("label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,0,0,1,2\n", "line 2: .*more columns"),
        (
            "label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,90,0,1\n",
            "line 2: theta_rad: .*theta_deg",
        ),
    ],
)
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
    [
        ("1.00", None),
        ("1.01", r"the recording ends at 0.95 s, but a mark \(B\) goes on until 1.01 s"),
        ("0.1", "before"),
    ],
)
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
