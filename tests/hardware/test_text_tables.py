"""Numbers and times as people write them: units, orders of lines, marks between thousands."""

import re
from itertools import chain

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import InputError
from tactsim.hardware.codecs.codec import CodecError, Frame
from tactsim.hardware.codecs.pps_csv import read_table
from tactsim.hardware.text_tables import check_taxel_names, thousands_mark, unit_since_1970


def table(title, times, separator=","):
    """A recording whose first taxel counts the lines in the order of their times."""
    rows = (
        f"{time}{separator}{rank}{separator}7"
        for time, rank in zip(times, np.argsort(np.argsort(times)), strict=True)
    )
    return [separator.join([title, "a", "b"]), *rows]


def frames_of(texts):
    return [frame for frame in read_table(iter(texts))[1] if isinstance(frame, Frame)]


@pytest.mark.parametrize(
    ("title", "seconds"),
    [
        *[
            (title, 1e-3)
            for title in ("Time [mS]", "time_ms", "timeMs", "Time (MilliSeconds)", "Milli Sec.", "t (m Sec.)")
        ],
        *[(title, 1e-6) for title in ("Time [uS]", "Time (µs)", "micros", "time/Micro Seconds", "time_usec")],
        *[(title, 1.0) for title in ("Time [S]", "elapsed_time_s", "Time (Sec.)", "seconds")],
        *[(title, 60.0) for title in ("Time [min]", "time (Minutes)")],
        *[("Zeit in Sekunden", 1.0), ("Temps (ms)", 1e-3), ("Tiempo [s]", 1.0), ("Zeitstempel_us", 1e-6)],
    ],
)
def test_a_unit_of_time_is_read_however_it_is_written(title, seconds):
    first, last = frames_of(table(title, range(0, 900, 30)))[:: len(range(0, 900, 30)) - 1]
    assert last.ticks - first.ticks == pytest.approx(870 * seconds)


@pytest.mark.parametrize("order", ["newest first", "one late", "two late", "shuffled"])
def test_lines_come_in_the_order_of_their_times(order):
    times = np.arange(200) * 40
    late = np.delete(times, 100)
    shuffled = np.random.default_rng(0).permutation(times)
    given = {
        "newest first": times[::-1],
        "one late": np.insert(late, 130, times[100]),
        "two late": np.concatenate([np.delete(times, [90, 91]), times[90:92]]),
        "shuffled": shuffled,
    }[order]
    _, frames, remark = read_table(iter(table("Time [ms]", given)))
    read = [frame for frame in frames if isinstance(frame, Frame)]
    assert [frame.values[0] for frame in read] == list(range(200))
    assert "not in the order of their times" in remark


def test_a_clock_that_begins_anew_is_no_disorder():
    twice = [*range(0, 4000, 40), *range(0, 2000, 40)]
    _, frames, remark = read_table(iter(table("Time [ms]", twice)))
    assert [frame.ticks for frame in frames] == pytest.approx(np.array(twice) / 1000)
    assert remark is None


@pytest.mark.parametrize(
    ("most", "step", "times"),
    [
        (2**16, 40, 1),
        (2**32, 20_000, 1),
        (2**32 / 1000, 20.5, 1),
        (2**8, 40, 31),
        (2**12, 40, 2),
        (1000, 40, 7),
        (2**16, 40_000, 121),  # more lines go round than not
        (3600, 0.04, 1),  # a clock on the wall that is put back
    ],
)
def test_a_clock_that_goes_round_at_the_end_of_its_bits_goes_on(most, step, times):
    """As millis() in 16 bits and micros() in 32 do: its later half would else come first."""
    went = (most - 50 * step) % most + step * np.arange(200)
    _, frames, remark = read_table(iter(table("Time [ms]", (went % most).round(3))))
    assert np.diff([frame.ticks for frame in frames]) == pytest.approx(step / 1000, abs=1e-6)
    assert f"the clock goes round {times} times" in remark


def test_times_that_are_all_equal_say_nothing():
    with pytest.raises(CodecError, match="all 30 lines have one time, 5"):
        read_table(iter(table("Time [ms]", [5] * 30)))


MARKS = st.sampled_from([",", ".", " ", "\u00a0", "\u202f", "\u2009", "'", "\u2019"])


@given(
    MARKS,
    st.lists(st.integers(1_000, 9_999_999), min_size=25, max_size=60),
    st.lists(st.integers(0, 999), min_size=1),
)
def test_marks_between_thousands_are_found(mark, large, small):
    written = [f"{number:,}".replace(",", mark) for number in large]
    assert thousands_mark([*written, *map(str, small)]) == mark


@pytest.mark.parametrize(
    ("mark", "decimal", "separator"), [(".", ",", ";"), (",", ".", "\t"), ("\u00a0", ",", ";")]
)
def test_marks_between_thousands_stand_beside_decimals(mark, decimal, separator):
    """Lines under load, whose numbers alone have the mark, would be left out."""
    values = np.array([[0.5, 1234567.25], [5181.5, 0.75]] * 10)
    written = [[f"{n:,}".translate({44: mark, 46: decimal}) for n in row] for row in values]
    lines = [separator.join([f"{40 * at}", *row]) for at, row in enumerate(written)]
    frames = frames_of([separator.join(["Time [ms]", "a", "b"]), *lines])
    assert np.array_equal([frame.values for frame in frames], values)


@given(st.sampled_from(",."), st.lists(st.floats(0.001, 999), min_size=30, max_size=60))
def test_decimals_are_no_thousands(mark, numbers):
    """As %g writes them, and with three decimals each, where a whole number has some, too."""
    for form in ("{:.6g}", "{:.2f}"):
        cells = [form.format(number).replace(".", mark) for number in chain(numbers, [0.5, 12.25])]
        assert thousands_mark(cells) is None
    assert thousands_mark([f"{number:.3f}".replace(".", mark) for number in chain(numbers, [0.0])]) is None


def test_a_number_that_reads_both_ways_is_refused():
    with pytest.raises(InputError, match=r"^5,166 may be 5166 or 5\.166"):
        thousands_mark(["5,166", "12", "0"])
    every = [f"{3.1 + at / 999:.3f}" for at in range(60)]  # V, or counts of a pad that rests at 3,100
    assert thousands_mark(every, unit="V") is None
    assert thousands_mark([f"{number}" for number in (512.333, *map(float, every))], unit="count") is None
    with pytest.raises(InputError, match=r"^3\.100 may be 3100 or"):
        read_table(iter(["Time [ms];a", *(f"{40 * at};{cell}" for at, cell in enumerate(every))]), "count")


@pytest.mark.parametrize("mark", [65535, 9999, -9999])
def test_lines_with_a_failed_cell_are_left_out_and_counted(mark):
    lines = [f"{40 * at}, {at % 7}, {500 + at}" for at in range(60)]
    lines[20], lines[41] = f"800, {mark}, 520", f"1640, 6, {mark}"
    _, frames, remark = read_table(iter(["Time [ms], Elem0, Elem1", *lines]))
    frames = list(frames)
    assert [frame.split(", ")[0] for frame in frames if isinstance(frame, str)] == ["800", "1640"]
    assert max(frame.values.max() for frame in frames if not isinstance(frame, str)) == 559
    assert "2 of 60 lines have a failed cell" in remark


def test_a_taxel_that_fails_in_many_lines_counts_as_never_pressed():
    rows = [[500 + at, 490 + at, 510, 505, 495 + at % 9] for at in range(60)]
    lines = [", ".join(map(str, [40 * at, 65535 if at % 4 else 500, *row])) for at, row in enumerate(rows)]
    _, frames, remark = read_table(iter(["Time [ms], a, b, c, d, e, f", *lines]))
    assert [frame.values.tolist() for frame in frames] == [[0, *row] for row in rows]
    assert remark == "taxel 0: no number in every line, or failed in many, counts as 0: never pressed"


@pytest.mark.parametrize("seconds", [1.0, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("step", [0.035, 4.2, 300.0])
def test_times_since_1970_tell_their_unit_whatever_their_steps(seconds, step):
    """A step of 4.2 s among stamps in s is none of 4.2 ms."""
    times = (1.75e9 + step * np.arange(30)) / seconds
    assert unit_since_1970(times) == seconds
    found = frames_of(table("timestamp", [f"{time:.3f}" for time in times]))
    assert found[-1].ticks == pytest.approx(29 * step, rel=1e-4)


def test_counters_of_ms_and_us_are_no_times_since_1970():
    assert unit_since_1970(1e6 + 20 * np.arange(30)) is None
    assert unit_since_1970(1.2e9 + 10_000 * np.arange(30)) is None  # us, 20 minutes after it was switched on
    assert unit_since_1970([1.75e9]) is None


def test_counts_below_0_without_a_sign_are_mended_in_a_recording():
    counts = [at % 9 - 4 for at in range(60)]
    lines = [f"{40 * at}, {count % 65536}, {500 + at}" for at, count in enumerate(counts)]
    lines = [f"{line}, 500, 510, 520, 490" for line in lines]
    _, frames, remark = read_table(iter(["Time [ms], a, b, c, d, e, f", *lines]))
    assert [frame.values[0] for frame in frames] == counts
    assert f"{sum(count < 0 for count in counts)} counts below 0" in remark


def test_counts_above_15_bits_that_were_stored_with_a_sign_are_mended_in_a_recording():
    counts = [30_000 + 97 * at for at in range(60)]
    stored = [(count + 2**15) % 2**16 - 2**15 for count in counts]
    lines = [f"{40 * at}, {count}, {stored[-1 - at]}" for at, count in enumerate(stored)]
    _, frames, remark = read_table(iter(["Time [ms], Elem0, Elem1", *lines]))
    assert [list(frame.values) for frame in frames] == [
        [a, b] for a, b in zip(counts, counts[::-1], strict=True)
    ]
    assert (
        f"{2 * sum(count > 32767 for count in counts)} counts above 32767 were stored with a sign" in remark
    )


def test_counts_of_no_more_than_1_below_0_are_mended_where_most_taxels_read_them():
    idle = np.random.default_rng(0).integers(-1, 2, (60, 4))
    lines = [", ".join(map(str, [40 * at, *row])) for at, row in enumerate(idle % 2**16)]
    _, frames, _ = read_table(iter(["Time [ms], a, b, c, d", *lines]))
    assert np.array_equal([frame.values for frame in frames], idle)


STEPS = 0.04 * np.arange(60)  # s


@pytest.mark.parametrize("mark", [",", ".", " ", "'", "\u00a0"])
def test_times_have_marks_between_thousands_too(mark):
    times = [f"{round(1000 * time):,}".replace(",", mark) for time in STEPS]
    lines = [f"{time};{at};7" for at, time in enumerate(times)]
    assert [frame.ticks for frame in frames_of(["Time [ms];a;b", *lines])] == pytest.approx(STEPS)


@pytest.mark.parametrize(("unit", "seconds"), [("s", 1), ("[ms]", 1e-3), ("(min)", 60), ("us", 1e-6)])
def test_a_line_of_units_below_the_title_says_them(unit, seconds):
    lines = [f"{time / seconds:.6f},{at},7" for at, time in enumerate(STEPS)]
    names, frames, _ = read_table(iter(["Time,a,b", f"{unit},N,N", *lines]))
    assert [frame.ticks for frame in frames if isinstance(frame, Frame)] == pytest.approx(STEPS, abs=1e-4)
    assert names == ["a [N]", "b [N]"]


@pytest.mark.parametrize(
    ("form", "mark"),
    [
        *[("28.11.2026 12:00:{}", "."), ("11/28/2026 12:00:{} PM", "."), ("12:00:{}", ":")],
        *[("2026/11/28 12:00:{}", "."), ("Sat, 28 Nov 2026 12:00:{}", "."), ("11/28/26 12:00:{}", ".")],
        *[("28-Nov-2026 12:00:{}", "."), ("0 days 12:00:{}", ".")],  # as MATLAB and pandas write them
        ("2026-11-28T12:00:{}+01:00", "."),
    ],
)
def test_a_time_of_day_behind_any_date_is_read(form, mark):
    texts = [form.format(f"{time:06.3f}".replace(".", mark)) for time in STEPS]
    texts[-1] = texts[-1].replace("T12", "T13").replace("+01", "+02")  # from here on in summer time
    lines = [f"{text};{at};7" for at, text in enumerate(texts)]
    assert [frame.ticks for frame in frames_of(["time;a;b", *lines])] == pytest.approx(STEPS)


def test_decimal_commas_in_quotes_stand_between_commas():
    lines = [f'"{time:.2f}","{at / 2:.1f}","0.5"'.replace(".", ",") for at, time in enumerate(STEPS)]
    frames = frames_of(["Time [s],a,b", *lines])
    assert [(frame.ticks, *frame.values) for frame in frames] == [
        (pytest.approx(time), at / 2, 0.5) for at, time in enumerate(STEPS)
    ]


def test_a_printed_minus_is_one_and_a_line_that_ends_before_the_time_is_none():
    lines = [f"{at},{time:.2f},\u2212{at},7" for at, time in enumerate(STEPS)]
    frames = frames_of(["sample,Time [s],a,b", *lines[:30], "end", *lines[30:]])
    assert [frame.values[0] for frame in frames] == [-at for at in range(60)]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (["time_s,a,b", *(f"{1.75e12 + 40 * at:.0f},1,2" for at in range(9))], "since 1970 in other units"),
        *[
            (["time,a,b", *(f"{begin}00.{40 * at:03d},1,2" for at in range(9))], "have no marks within")
            for begin in ("0959", "202611280959")
        ],
        (["time [s*1000],a,b", *(f"{40 * at},1,2" for at in range(9))], "unit of time is 's*1000'"),
        (
            ["time,a,b", *(f"{134 * 10**15 + 400_000 * at},1,2" for at in range(9))],
            "count 100 ns, as Windows",
        ),
        (
            ["time,a,b", *(f"12:00:00.{40 * at},1,2" for at in range(9))],
            "times end in 0 and 120: write 40 ms as .040",
        ),
        (
            ["time (10 us),a,b", *(f"{4000 * at},1,2" for at in range(9))],
            "unit of time is '10 us'; write the times in",
        ),
        (
            ["board,time_s,a,b", *(f"{at % 2},{at // 2},1,2" for at in range(18))],
            "column 'board' says 0, 1 at the same times: lines of several boards",
        ),
    ],
)
def test_times_that_would_be_read_wrong_are_refused(lines, says):
    with pytest.raises(CodecError, match=re.escape(says)):
        read_table(iter(lines))


def test_a_time_of_day_below_the_table_is_none_of_its_times():
    lines = [f"{1000 * time:.0f},{at},7" for at, time in enumerate(STEPS)]
    frames = frames_of(["Time [ms],a,b", *lines, "End time,12:00:01"])
    assert [frame.ticks for frame in frames] == pytest.approx(STEPS)


def test_a_unit_that_makes_no_sense_is_asked_for():
    _, _, remark = read_table(iter(["Time [ms],a,b", *(f"{at / 25},1,2" for at in range(100))]))
    assert remark == "a line every 4e-05 s, as 'Time [ms]' says: is it another unit?"


def test_a_clock_coarser_than_the_lines_is_said():
    _, _, remark = read_table(iter(["time_s,a,b", *(f"{at // 25},1,2" for at in range(100))]))
    assert remark == "96 of 100 lines have the time of the line before: the clock is coarser than the lines"


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["A1", "A2", "B1", "B2"], "letters may be rows or columns"),
        (["C", "A", "B"], "in no order of taxels"),
        (["p1", "p2", "total"], "column 'total' has no number as others have"),
        (["force", "force.1", "force.2"], None),  # as pandas counts equal names
        (["A", "B", "C", "D"], None),
        (["a1", "a2", "a3", "b1", "b2", "b3"], None),
    ],
)
def test_names_of_taxels_say_their_order_or_do_not(names, says):
    if says is None:
        check_taxel_names(names, "count")
        return
    with pytest.raises(InputError, match=says):
        check_taxel_names(names, "count")
