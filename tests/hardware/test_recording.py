import gzip
import struct
import zlib
from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_pads import csv_device, line_device, ramp, serving, singletact, small_device

from tactsim.core import InputError
from tactsim.hardware.device import Device, Part
from tactsim.hardware.emulator import Faults, emulate
from tactsim.hardware.live import LiveSource
from tactsim.hardware.recorded import CsvReplay, Replay
from tactsim.hardware.recording import LARGEST_PAYLOAD, Recorder, RecordReader, check_whole
from tactsim.hardware.sources import open_source

HEADER = struct.Struct("<BBHId")


def segment(device):
    return {"device": device.as_json()}


def small_recording(path, device, frames=20):
    messages = emulate(device, ramp(device), rate=100.0).say(frames / 100)
    with Recorder(path) as recorder:
        recorder.segment(segment(device), 0.0)
        for k, message in enumerate(messages):
            recorder.received(0, message[:7], k * 0.01)
            recorder.received(0, message[7:], k * 0.01 + 0.004)
        recorder.mark({"note": "touched"}, 1.0)
        recorder.end({"frames": len(messages)}, 2.0)
    return path


def same(one, other):
    return np.array_equal(one.pressures, other.pressures) and (one.host_time, one.device_time, one.index) == (
        other.host_time,
        other.device_time,
        other.index,
    )


def test_the_file_is_what_the_documentation_says(tmp_path):
    with Recorder(tmp_path / "a") as recorder:
        recorder.received(2, b"abc", 1.5)
    content = (tmp_path / "a").read_bytes()
    body = HEADER.pack(2, 2, 0, 3, 1.5) + b"abc"
    assert content == b"\x89TACTREC\r\n\x1a\n" + b"\x01\x00" + body + struct.pack("<I", zlib.crc32(body))


@pytest.mark.parametrize(
    ("on", "faults"), [("tcp", Faults()), ("pty", Faults(drop=0.002, flip=0.002, torn=0.02, garbage=0.05))]
)
def test_replay_gives_bit_equal_readings(tmp_path, paper_pad, emulated_pad, on, faults):
    with serving(emulated_pad, on=on, faults=faults) as url, Recorder(tmp_path / "a") as recorder:
        recorder.segment(segment(paper_pad), 0.0)
        with LiveSource([url], paper_pad, recorder) as source:
            live = [source.read() for _ in range(100)]
            counters = source.counters.as_dict()
        recorder.end(counters, 0.0)
    replay = Replay(tmp_path / "a")
    again = list(replay)
    assert len(again) >= 100  # the last chunk may hold more than were taken
    assert all(map(same, live, again))
    assert replay.whole.finished


def test_replay_of_questions_and_answers_is_bit_equal(tmp_path):
    device = singletact(taxels=15)
    with serving(emulate(device, ramp(device), rate=50.0)) as url, Recorder(tmp_path / "a") as recorder:
        recorder.segment(segment(device), 0.0)
        with LiveSource([url], device, recorder) as source:
            live = [source.read() for _ in range(30)]
            counters = source.counters.as_dict()
    replay = Replay(tmp_path / "a")
    assert all(map(same, live, replay))
    assert replay.counters.as_dict() == counters
    assert not replay.whole.finished


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Give the bytes of a small recording, its records, and a path to write what became of it."""
    path = small_recording(tmp_path_factory.mktemp("recorded") / "a", small_device())
    return path.read_bytes(), list(RecordReader(path)), path


@given(cut=st.integers(0, 5000))
def test_a_recording_cut_anywhere_is_read_up_to_there(cut, recorded):
    content, whole, path = recorded
    path.write_bytes(content[: cut % len(content)])
    if cut % len(content) < 14:
        with pytest.raises(InputError, match="is no recording"):
            list(RecordReader(path))
        return
    reader = RecordReader(path)
    records = list(reader)
    assert records == whole[: len(records)]
    assert not reader.whole.finished
    assert reader.whole.whole_bytes <= cut % len(content)


@given(at=st.integers(14, 5000), change=st.integers(1, 255))
def test_a_changed_byte_ends_the_readable_part(at, change, recorded):
    content, whole, path = bytearray(recorded[0]), *recorded[1:]
    content[14 + at % (len(content) - 14)] ^= change
    path.write_bytes(content)
    reader = RecordReader(path)
    records = list(reader)
    assert records == whole[: len(records)]
    assert len(records) < len(whole)
    assert not reader.whole.finished
    assert reader.whole.fault


def test_a_claimed_size_is_not_believed(recorded):
    good, whole, path = recorded
    for length, fault in [(LARGEST_PAYLOAD + 1, "claims 4,194,305 bytes"), (LARGEST_PAYLOAD, "is cut short")]:
        path.write_bytes(good + HEADER.pack(2, 0, 0, length, 1.0) + b"x" * 100)
        reader = RecordReader(path)
        assert list(reader) == whole
        assert fault in reader.whole.fault


@pytest.mark.parametrize(
    "content", [b"\x89TACTREC\r\n\x1a\n", b"\x89TACTREC\r\n\x1a\n\x02\x00", b"\x00" * 50]
)
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match=r"is no recording|format version 2"):
        check_whole(tmp_path / "a")


def test_a_recording_keeps_the_axes_that_are_not_read(tmp_path):
    """Three bytes a taxel: x, y and z. The normal one is read; the others can be, from the same bytes."""

    def device(normal, signed, rows=1):
        layout = [
            {"is": "header", "bytes": "AA 55"},
            {"is": "taxels", "count": 2, "bits": 8, "axes": 3, "normal": normal, "signed": signed},
            {"is": "checksum", "kind": "lrc8"},
        ]
        pad = {"rows": rows, "columns": 2 // rows, "no_seam": True}
        codec = {"kind": "fields", "kpa_per_count": 0.5, "layout": layout}
        return Device.model_validate({"name": f"axis {normal}", "codec": codec, "pad": pad})

    body = bytes.fromhex("AA 55 FE 01 64 02 FF C8")  # -2, 1, 100 and 2, -1, 200
    with Recorder(tmp_path / "a") as recorder:
        recorder.segment({"device": device(2, False).as_json()}, 0.0)
        recorder.received(0, body + bytes([-sum(body) & 255]), 0.1)

    def pressures(read_as=None):
        (reading,) = Replay(tmp_path / "a", read_as=read_as)
        return reading.pressures.tolist()

    assert pressures() == [50.0, 100.0]
    assert pressures(device(0, True)) == [-1.0, 1.0]
    assert pressures(device(1, True)) == [0.5, -0.5]
    with pytest.raises(InputError, match="recorded with another pad than that of 'axis 0'"):
        pressures(device(0, True, rows=2))


def test_an_existing_file_is_not_overwritten(tmp_path):
    small_recording(tmp_path / "a", small_device())
    with pytest.raises(InputError, match="exists"):
        Recorder(tmp_path / "a")


def test_going_on_with_a_recording_drops_its_torn_end_only(tmp_path):
    device = small_device()
    path = small_recording(tmp_path / "a", device)
    before = list(Replay(path))
    path.write_bytes(path.read_bytes()[:-5])
    with Recorder(path, append=True) as recorder:
        recorder.segment(segment(device), 10.0)
        for message in emulate(device, ramp(device), rate=100.0).say(0.05):
            recorder.received(0, message, 11.0)
        recorder.end({}, 12.0)
    replay = Replay(path)
    after = list(replay)
    assert all(map(same, before, after))
    assert len(after) == len(before) + 6
    assert replay.segments == 2
    assert replay.whole.finished


def test_a_csv_of_another_pad_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("Time [ms], Elem0\n0, 1\n")
    with pytest.raises(InputError, match="has 1 taxels, 'csv' has 6"):
        CsvReplay(tmp_path / "a.csv", csv_device())
    (tmp_path / "b.csv").write_text("x,y\n0, 1\n")
    with pytest.raises(InputError, match="first line is 'Time"):
        CsvReplay(tmp_path / "b.csv", csv_device())
    with pytest.raises(InputError, match="codec kind 'pps-csv'"):
        CsvReplay(tmp_path / "b.csv", small_device())


def test_lines_of_a_csv_that_are_damaged_are_left_out(tmp_path):
    text = "Time [ms], Elem0, Elem1\n0, 1, 2\n10, 1\n20, x, 2\n30, nan, 2\n40, 5, 6\n50, 1e999, 0\n55, 1e300, 0\n60, 7"
    (tmp_path / "a.csv").write_text(text)
    source = CsvReplay(tmp_path / "a.csv", csv_device(2))
    assert [reading.pressures.tolist() for reading in source] == [[1, 2], [5, 6]]
    assert source.counters.resyncs == 6


ROWS = np.array([[0.5, -1.0, 2.0, 0.0, 3.25, 1.0], [1.5, 1.0, 2.0, 0.0, 3.25, 7.0]])


def spreadsheet(separator, point, mark="", quote=""):
    """Write the vendor's recording as a spreadsheet saves it."""
    names = separator.join(f"{quote}{name}{quote}" for name in ("Time [ms]", *(f"Elem{k}" for k in range(6))))
    lines = [
        separator.join(str(x).replace(".", point) for x in (10.5 * k, *row)) for k, row in enumerate(ROWS)
    ]
    return (mark + "\r\n".join([names, *lines]) + "\r\n").encode()


@pytest.mark.parametrize(
    "content", [spreadsheet(",", "."), spreadsheet(";", ","), spreadsheet(";", ".", mark="\ufeff", quote='"')]
)
def test_the_vendors_csv_is_a_recording_too_as_it_is_and_as_a_spreadsheet_saved_it(tmp_path, content):
    (tmp_path / "a.csv").write_bytes(content)
    source = CsvReplay(tmp_path / "a.csv", csv_device())
    readings = list(source)
    assert np.array_equal([reading.pressures for reading in readings], ROWS)
    assert [reading.device_time for reading in readings] == [0.0, 0.0105]
    assert source.counters.garbage_bytes == 0


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_blanks_between_thousands_make_no_text_of_another_kind(tmp_path, encoding):
    lines = "".join(f"{at};{5 + at}\u00a0250\u00a0500;7\n" for at in range(40))
    (tmp_path / "a.csv").write_text("Time [s];a;b\n" + lines, encoding=encoding)
    source = open_source([f"recording:{tmp_path}/a.csv"], csv_device(2))
    assert [reading.pressures[0] for reading in source] == [1e6 * (5 + at) + 250_500 for at in range(40)]


def vendor_table(title, times, separator=",", above="", end="\n", behind=""):
    """Write 250 frames of four numbers, 20 ms apart; the third second is pressed."""
    rows = [separator.join([time, *(str(taxel + 20 * (100 <= k < 150)) for taxel in range(4))])
            for k, time in enumerate(times)]  # fmt: skip
    return above + "\n".join(line + behind for line in (title, *rows)) + end


def of_day(seconds, noon=False):
    """Write a time of day, s from a minute before midnight, or before 1 PM as an American clock shows it."""
    over = seconds >= 60
    hour = ("12", " 1")[over].strip() if noon else ("23", "0")[over]
    return f"{hour}:{(59, 0)[over]:02d}:{seconds - 60 * over:05.2f}{' PM' * noon}"


TITLE = "Time [ms], Elem0, Elem1, Elem2, Elem3"
MS = [str(20 * k) for k in range(250)]
S = [f"{0.02 * k:g}" for k in range(250)]
US = [str(20_000 * k) for k in range(250)]


@pytest.mark.parametrize(
    "text",
    [
        vendor_table(TITLE, MS),
        vendor_table(TITLE, MS, end=""),
        vendor_table('"Time [ms]","Elem0","Elem1","Elem2","Elem3"', [f'"{time}"' for time in MS]),
        vendor_table("Time [s], Elem0, Elem1, Elem2, Elem3", S),
        vendor_table("timestamp_us,a,b,c,d", US),
        vendor_table("Time,Elem0,Elem1,Elem2,Elem3", S),
        vendor_table("Time [ms],a,b,c,d", [str(1_700_000_000_000 + 20 * k) for k in range(250)]),
        vendor_table("Time,a,b,c,d", [str(1_700_000_000_000_000_000 + 20_000_000 * k) for k in range(250)]),
        vendor_table("Time\ta\tb\tc\td", [time.replace(".", ",") for time in S], "\t"),
        vendor_table("Time (msec),a,b,c,d", MS),
        vendor_table("Time_stamp/ms,a,b,c,d", MS),
        vendor_table("Time in s,a,b,c,d", S).replace("\n0,0,1", "\n0,0\n0,0,1"),
        vendor_table(TITLE, MS).replace("\n", "\r"),
        vendor_table("Time(s);COM5 - Sensor (N);b;c;(Full Scale Range: 1N)", [time.replace(".", ",") for time in S],
                     ";", above="Start Time;06/05/2026 09:57:19\n\n", behind=";"),
        vendor_table("Pressure (\N{MICRO SIGN}V)\nTime [\N{MICRO SIGN}s],a,b,c,d", US).encode("latin-1"),
        vendor_table("Time [s]\ta\tb\tc\td", S, "\t").encode("utf-16"),
        vendor_table("Time [s]\ta\tb\tc\td", S, "\t").encode("utf-16-le"),  # without its mark
        vendor_table("# time a b c d", S, " ", above="# at any time\n"),
        vendor_table(",TimeMs,a,b,c,d", [f"{k},{time}" for k, time in enumerate(MS)]),
        vendor_table("%time,field.data0,b,c,d", [f"{1_700_000_000_000_000_000 + 20_000_000 * k}" for k in range(250)]),
        vendor_table("Date,Time,a,b,c,d", [f"27/11/2026,4:00:0{time}" for time in S]),
        vendor_table("timestamp,a,b,c,d", [f"2026-11-27 04:00:0{time}" for time in S]),
        vendor_table("datetime,a,b,c,d", [f"2026-11-27T04:00:0{time}Z" for time in S]),
        vendor_table("Elapsed,a,b,c,d", [f"100:59:0{time}" for time in S]),
        vendor_table("Time,a,b,c,d", [of_day(59.0 + 0.02 * k) for k in range(250)]),
        vendor_table("Time,a,b,c,d", [of_day(59.0 + 0.02 * k, noon=True) for k in range(250)]),
        vendor_table("Time,a,b,c,d", [f"{45_258.25 + 0.02 * k / 86_400}" for k in range(250)]),
        "a,b,c,d,time [s]\n" + "".join(f"0,{1 + 20 * (100 <= k < 150)},2,3,{time}\n" for k, time in enumerate(S)),
        vendor_table("X_Value\ta\tb\tc\td\tComment", [time.replace(".", ",") for time in S], "\t",
                     above="Time_Pref\tRelative\nTime\t12:00:00,5\n" + "Channels\t4\n" * 25, behind="\t"),
    ],
)  # fmt: skip
def test_the_time_of_a_csv_is_in_the_unit_of_its_title_or_told_by_its_steps(tmp_path, text):
    (tmp_path / "a.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    source = CsvReplay(tmp_path / "a.csv", csv_device(4))
    readings = list(source)
    times = np.array([reading.device_time for reading in readings])
    assert np.abs(times - 0.02 * np.arange(250)).max() < 1e-6
    assert [reading.pressures[1] for reading in readings] == [1.0 + 20 * (100 <= k < 150) for k in range(250)]
    cut = not isinstance(text, bytes) and "\n0,0\n" in text
    assert source.counters.resyncs == cut
    assert any("1 line left out as no reading, the first '0,0'" in line for line in source.summary()) == cut


def test_a_packed_csv_is_read_and_a_torn_one_says_so(tmp_path):
    packed = gzip.compress(vendor_table(TITLE, MS).encode())
    (tmp_path / "a.csv.gz").write_bytes(packed)
    with open_source([f"recording:{tmp_path / 'a.csv.gz'}"], csv_device(4)) as source:
        assert len(list(source)) == 250
    (tmp_path / "b.csv.gz").write_bytes(packed[:-30])
    with (
        pytest.raises(InputError, match=r"b\.csv\.gz"),
        CsvReplay(tmp_path / "b.csv.gz", csv_device(4)) as source,
    ):
        list(source)


def test_a_csv_whose_title_names_no_unit_of_time_says_what_it_was_read_as(tmp_path):
    for title, said in (("time", "the time is read as ms, by its steps of 2.5"), ("time [s]", None)):
        (tmp_path / "a.csv").write_text(vendor_table(f"{title},a,b,c,d", [f"{2.5 * k}" for k in range(9)]))
        with CsvReplay(tmp_path / "a.csv", csv_device(4)) as source:
            list(source)
            assert [line.partition(":")[0] for line in source.summary()] == ([said] if said else [])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (vendor_table("Time,a,b,c,d", ["04-00-00"] * 9).encode(), "but '04-00-00,"),
        (b"Time [fortnights],a,b,c,d\n0,1,2,3,4\n", "unit of time is 'fortnights'; known are s, ms"),
        (TITLE.encode(), "stands no line of readings"),
        (b"Time [ms],R1C1,R2C1,R1C2,R2C2\n0,1,2,3,4\n", "R1C1, R2C1, R1C2, R2C2 ... are in no order"),
        (b"Time [ms],N,Elem0,Elem1,Elem2\n0,1,2,3,4\n", "column 'N' has no number as others have"),
        (
            "Time,1 [N/cm²],2 [N/cm²],3 [N/cm²],4 [N/cm²]\n0,1,2,3,4\n".encode(),
            r"1 \[N/cm²\] ... are not in kPa",
        ),
        (b"time_ms,row,col,value\n0,0,0,5\n", "it has a taxel a row; make it a table with a column a taxel"),
    ],
)
def test_why_a_csv_is_not_read_is_said(tmp_path, content, expected):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError, match=expected):
        CsvReplay(tmp_path / "a.csv", csv_device(4))


LINES = line_device(4)


@pytest.mark.parametrize(
    "stamp",
    [
        "{:%H:%M:%S.%f} -> ", "{:%H:%M:%S.%f} > ", "[{:%Y-%m-%d %H:%M:%S.%f}] ", "{:%Y-%m-%d %H:%M:%S.%f}\t",
        "[{:%a %b %d %H:%M:%S.%f} 2026] ", "[{:%H:%M:%S:%f}] ", "{:%b %d %H:%M:%S.%f} ", "{:%m/%d/%Y %I:%M:%S.%f %p} ",
        "[0 {:%H:%M:%S.%f}] ", "{:%Y-%m-%dT%H:%M:%S.%f}Z ",
    ],
)  # fmt: skip
@pytest.mark.parametrize("separator", [",", " "])
def test_a_terminal_s_log_is_read_by_the_device_file_of_the_port(tmp_path, stamp, separator):
    """The first line, which may be the rest of one, is none; midnight passes, and noon of a clock of twelve hours."""
    begin = datetime(2026, 1, 2, 12 if "%p" in stamp else 23, 59, 59)
    lines = [
        stamp.format(begin + timedelta(milliseconds=20 * k)) + separator.join(map(str, [-k, 1023, 7, k]))
        for k in range(100)
    ]
    lines.insert(50, "--- a word of the terminal")
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
    with open_source([f"recording:{tmp_path / 'a.log'}"], LINES) as source:
        readings = list(source)
        assert source.summary()[0].startswith("2 lines left out as no reading, the first")
    assert [reading.pressures.tolist() for reading in readings] == [[-k, 1023, 7, k] for k in range(1, 100)]
    times = [reading.host_time for reading in readings]
    assert np.diff(times) == pytest.approx(np.full(98, 0.02), abs=1e-6)


def test_lines_without_a_time_say_so_and_a_title_says_which_device_file_reads_a_table(tmp_path):
    lines = "=~=~= PuTTY log 2026.01.02 12:34:56 =~=~=\r\n" + "1,2,3,4\r\n" * 5
    (tmp_path / "a.log").write_text(lines)
    source = CsvReplay(tmp_path / "a.log", LINES)
    assert len(list(source)) == 5
    assert source.summary()[0].startswith("no time stands before its lines")
    with pytest.raises(InputError, match="the codec kind 'csv', which `bench probe` writes"):
        CsvReplay(tmp_path / "a.log", csv_device(4))


def test_a_line_above_the_first_frame_is_the_one_that_is_left_out(tmp_path):
    (tmp_path / "a.txt").write_text("shape,2,2\n" + "".join(f"{k},9,{k + 2},7\n" for k in range(30)))
    with open_source([f"recording:{tmp_path / 'a.txt'}"], LINES) as source:
        assert len(list(source)) == 30
        assert "1 line left out as no reading, the first 'shape,2,2'" in source.summary()


LAID = [
    ("".join(f"{k}\t9\t{k + 2}\t7\n" for k in range(30)), "no time stands before"),
    ("".join(f"{k} 9\n{k + 2} 7\n" for k in range(30)), "30 frames of several lines"),
    ("-10000\n" + "".join(f"1.5 2.5 3.5\n{k}.0 9.0\n{k + 2}.0 7.0\n" for k in range(30)), "30 frames of several lines"),
    ("node_id," + ",".join(f"frame{k}" for k in range(30)) + "\n" + "".join(
        f"{number}," + ",".join(str(value(k)) for k in range(30)) + "\n"
        for number, value in enumerate((lambda k: k, lambda k: 9, lambda k: k + 2, lambda k: 7))
    ), "30 frames of several lines or of a column"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("between", "first"), [("\n", ""), ("-----\n", ""), ("\n", "\n"), ("Frame:\n", "Frame:\n")]
)
def test_the_first_and_the_last_frame_of_rows_are_read(tmp_path, between, first):
    frames = (f"{k} 9\n{k + 2} 7\n" for k in range(30))
    (tmp_path / "a.txt").write_text(first + between.join(frames))
    with open_source([f"recording:{tmp_path / 'a.txt'}"], LINES) as source:
        assert [reading.pressures.tolist() for reading in source] == [[k, 9, k + 2, 7] for k in range(30)]


@pytest.mark.parametrize(("text", "said"), LAID)
def test_frames_without_times_are_all_read_however_their_numbers_are_laid_in_lines(tmp_path, text, said):
    (tmp_path / "a.txt").write_text(text)
    with open_source([f"recording:{tmp_path / 'a.txt'}"], LINES) as source:
        assert [reading.pressures.tolist() for reading in source] == [[k, 9, k + 2, 7] for k in range(30)]
        assert source.summary() == [line for line in source.summary() if line.startswith(said)]
        assert source.counters.as_dict()["garbage_bytes"] == 0


def test_lines_behind_a_clock_that_the_device_file_does_not_name_are_no_frames(tmp_path):
    (tmp_path / "a.txt").write_text("".join(f"{k}.5 {k} 9 {k + 2} 7\n" for k in range(30)))
    with open_source([f"recording:{tmp_path / 'a.txt'}"], LINES) as source:
        assert list(source) == []
        assert source.summary()[0].startswith("30 lines left out as no reading")


def test_a_movie_of_tekscan_is_refused_by_its_name(tmp_path):
    head = "DATA_TYPE MOVIE\nROWS 2\nCOLS 2\nSECONDS_PER_FRAME 0.01\nASCII_DATA @@\n"
    (tmp_path / "a.asf").write_text(head + "Frame 1\n1,B\n3,4\n\n" * 9 + "@@\n")
    with pytest.raises(
        InputError, match=r"a\.asf is a movie of Tekscan's I-Scan \(ASF\).* write a table of it"
    ):
        open_source([f"recording:{tmp_path / 'a.asf'}"], LINES)


def test_a_taxel_that_is_nan_in_every_line_counts_as_0_and_is_said(tmp_path):
    for word in ("nan", ""):
        rows = [f"{20 * k},1,{word},{k if k != 70 else 'nan'},4" for k in range(80)]
        (tmp_path / "a.csv").write_text("\n".join([TITLE, *rows]) + "\n")
        with CsvReplay(tmp_path / "a.csv", csv_device(4)) as source:
            assert [reading.pressures.tolist() for reading in source] == [
                [1, 0, k, 4] for k in range(80) if k != 70
            ]
            assert [line[:22] for line in source.summary()] == [
                "taxel 1: no number in ",
                "1 line left out as no ",
            ]
    (tmp_path / "a.csv").write_text(TITLE + "\n0,nan,nan,nan,nan\n")
    with pytest.raises(InputError, match="every number is NaN"):
        CsvReplay(tmp_path / "a.csv", csv_device(4))


def test_a_device_file_may_say_the_order_of_columns(tmp_path):
    device = csv_device(4).model_copy(update={"part": (Part(address=3, taxels=(0, 2, 1, 3)),)})
    (tmp_path / "a.csv").write_text("Time [ms],R1C1,R2C1,R1C2,R2C2\n0,1,2,3,4\n")
    assert [reading.pressures.tolist() for reading in CsvReplay(tmp_path / "a.csv", device)] == [[1, 3, 2, 4]]


def test_a_number_whose_point_is_not_clear_is_no_frame(tmp_path):
    """1.234 beside 1,5: thousands, or perhaps a fraction. 1.234,5 tells which."""
    for line, wanted in (("", [[1.5, 2.0], [7.0, 8.0]]), ("10;1.234,5;2\n", [1.5, 1234.5, 1234, 1234, 7])):
        text = f"Time [ms];Elem0;Elem1\n0;1,5;2\n{line}20;1.234;2,5\n25;1.234;3\n30;7;8\n"
        (tmp_path / "a.csv").write_text(text)
        source = CsvReplay(tmp_path / "a.csv", csv_device(2))
        read = [reading.pressures.tolist() for reading in source]
        assert (([first for first, _ in read]) if line else read) == wanted


def test_a_recording_is_known_by_its_content_and_not_by_its_name(tmp_path):
    path = small_recording(tmp_path / "a.csv", small_device())
    with open_source([f"recording:{path}"], small_device()) as source:
        assert len(list(source)) == 21


def test_a_recording_without_a_beginning_is_refused(tmp_path):
    with Recorder(tmp_path / "a") as recorder:
        recorder.received(0, b"", 0.0)
    with pytest.raises(InputError, match="without a beginning"):
        Replay(tmp_path / "a")
