"""Lines of numbers as sketches print them: read, or told by `bench probe` with the device file that reads them."""

import functools
import json
import operator
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core.counters import Counters
from tactsim.hardware.codecs.codec import Frame, Framer
from tactsim.hardware.codecs.lines import LinesFormat, guess_lines, is_text
from tactsim.hardware.device import Device

VALUES = [[100 + k % 7, 200, 300 + k % 3, 400] for k in range(30)]
# How a sketch prints four numbers and a time in ms.
FORMS = {
    "plain": lambda v, t: ",".join(map(str, v)) + "\r\n",
    "line feeds": lambda v, t: ",".join(map(str, v)) + "\n",
    "carriage returns": lambda v, t: ",".join(map(str, v)) + "\r",
    "comma behind": lambda v, t: "".join(f"{x}," for x in v) + "\r\n",
    "tab behind": lambda v, t: "".join(f"{x}\t" for x in v) + "\r\n",
    "blank behind": lambda v, t: "".join(f"{x} " for x in v) + "\r\n",
    "semicolon behind": lambda v, t: ",".join(map(str, v)) + ";\r\n",
    "comma before": lambda v, t: "," + ",".join(map(str, v)) + "\r\n",
    "semicolons": lambda v, t: "; ".join(map(str, v)) + "\r\n",
    "names": lambda v, t: ",".join(f"S{k}:{x}" for k, x in enumerate(v)) + "\r\n",
    "names and blanks": lambda v, t: "\t".join(f"taxel_{k} = {x}" for k, x in enumerate(v)) + "\r\n",
    "names of two words": lambda v, t: "\t".join(f"Sensor {k}: {x}" for k, x in enumerate(v)) + "\r\n",
    "brackets": lambda v, t: "[" + ", ".join(map(str, v)) + "]\r\n",
    "dollar": lambda v, t: "$" + ",".join(map(str, v)) + "\r\n",
    "hash": lambda v, t: "# " + ",".join(map(str, v)) + "\r\n",
    "bars": lambda v, t: " | ".join(map(str, v)) + "\r\n",
    "padded": lambda v, t: "  ".join(f"{x:6d}" for x in v) + "\r\n",
    "signs": lambda v, t: ",".join(f"{x:+d}" for x in v) + "\r\n",
    "fractions": lambda v, t: ",".join(f"{x:.2f}" for x in v) + "\r\n",
    "hexadecimal": lambda v, t: ",".join(hex(x) for x in v) + "\r\n",
    "zero bytes": lambda v, t: ",".join(map(str, v)) + "\0\r\n",
    "rows": lambda v, t: f"{v[0]},{v[1]}\r\n{v[2]},{v[3]}\r\n\r\n",
    "rows with blanks": lambda v, t: f"{v[0]} {v[1]} \n{v[2]} {v[3]} \n\n",
    "empty lines": lambda v, t: ",".join(map(str, v)) + "\r\n\r\n",
    "words first": lambda v, t: ("Ready\r\n" if t == 0 else "") + ",".join(map(str, v)) + "\r\n",
    "time": lambda v, t: f"{t}," + ",".join(map(str, v)) + "\r\n",
    "titles again and again": lambda v, t: (
        ("t,a,b,c,d\n" if t % 200 == 0 else "") + f"{t},{v[0]},{v[1]},{v[2]},{v[3]}\n"
    ),
    "count and time in s": lambda v, t: f"{t // 20},{t / 1000}," + ",".join(map(str, v)) + "\r\n",
    "json": lambda v, t: json.dumps({"t": t, "v": v}) + "\r\n",
    "decimal commas": lambda v, t: ";".join(f"{x},0" for x in v) + "\r\n",
    "date and time": lambda v, t: f"2026-11-27T04:00:{t / 1000:06.3f}," + ",".join(map(str, v)) + "\r\n",
    "a day and a time": lambda v, t: f"2026-11-27 04:00:{t / 1000:06.3f} " + " ".join(map(str, v)) + "\r\n",
    "a time and a blank": lambda v, t: f"{t} " + ",".join(map(str, v)) + "\r\n",
    "a named time": lambda v, t: f"Time: {t} P: " + ",".join(map(str, v)) + "\r\n",
    "a word first": lambda v, t: "$PAD," + ",".join(map(str, v)) + "\r\n",
    "rows parted by a rule": lambda v, t: f"{v[0]} {v[1]}\r\n{v[2]} {v[3]}\r\n-----\r\n",
    "rows under a heading": lambda v, t: f"Frame {t}\r\n{v[0]},{v[1]}\r\n{v[2]},{v[3]}\r\n",
    "rows under a named count": lambda v, t: f"Frame: {t}\r\n{v[0]},{v[1]}\r\n{v[2]},{v[3]}\r\n",
    "rows above a note": lambda v, t: f"{v[0]} {v[1]}\r\n{v[2]} {v[3]}\r\nT = {t % 7}.5 C\r\n",
    "a note now and then": lambda v, t: (
        ",".join(map(str, v)) + f"\r\nloop {t % 70} us" * (t % 100 == 80) + "\r\n"
    ),
    "numbered rows": lambda v, t: f"0: {v[0]} {v[1]}\r\n1: {v[2]} {v[3]}\r\n\r\n",
    "a monitor's time": lambda v, t: f"12:00:{t / 1000:06.3f} -> " + ",".join(map(str, v)) + "\r\n",
    "a time in brackets": lambda v, t: f"[12:00:{t / 1000:06.3f}] " + ",".join(map(str, v)) + "\r\n",
    "a log's words": lambda v, t: f"I ({t}) pad: " + ",".join(map(str, v)) + "\r\n",
    "on a clear screen": lambda v, t: "\x1b[2J\x1b[H" + " ".join(map(str, v)) + "\r\n",
}
GIVEN = {
    "time": {"before": ["clock"]}, "titles again and again": {"before": ["clock"]},
    "count and time in s": {"before": ["index", "clock"]}, "json": {"before": ["clock"]},
    "date and time": {"before": ["skip"]}, "a day and a time": {"before": ["skip", "skip"]},
    "a time and a blank": {"before": ["clock"]}, "a named time": {"before": ["clock"]},
    "a word first": {"before": ["skip"]}, "decimal commas": {"delimiter": ";", "decimal": ","},
}  # fmt: skip


def printed(name):
    return "".join(FORMS[name](values, 20 * k) for k, values in enumerate(VALUES)).encode()


def read(codec, chunks):
    framer = Framer(codec, Counters())
    return [arrived.packet.values.tolist() for chunk in chunks for arrived in framer.feed(chunk, 0.0)]


@pytest.mark.parametrize("name", FORMS)
def test_what_sketches_print_is_read_byte_by_byte_too(name):
    codec = LinesFormat(kind="csv", taxels=4, kpa_per_count=1.0, **GIVEN.get(name, {})).build()
    data = b"\n\n" + printed(name)
    # The last line of some forms waits for what comes next.
    assert read(codec, [data, b"\n\n"]) == VALUES
    assert read(codec, [data[at : at + 1] for at in range(len(data))] + [b"\n\n"]) == VALUES


@pytest.mark.parametrize("name", FORMS)
def test_a_probe_names_the_device_file_that_reads_them(name):
    data = printed(name)
    assert is_text(data)
    guess = guess_lines(data)
    device = Device.model_validate(tomllib.loads(guess.device_file()))
    assert device.pad.taxels == 4
    if name in ("time", "count and time in s"):
        assert device.codec.tick_s == (0.001 if name == "time" else 1.0)
    seen = read(device.build_codec(), [data])
    assert len(seen) >= len(VALUES) - 2
    assert all(values in VALUES for values in seen)


def test_values_far_from_0_have_their_middle_as_zero_and_broken_ones_apart():
    """Counts of a resistive sheet rest at 820 and fall; a taxel that is stuck at 1023 says nothing of the others."""
    rng = np.random.default_rng(0)
    rest = rng.normal(820, 25, 100).round()
    rest[7] = 1023
    lines = [",".join(f"{value:.0f}" for value in rest + rng.integers(-1, 2, 100) * (rest < 1000))] * 9
    device = Device.model_validate(tomllib.loads(guess_lines("\n".join(lines).encode()).device_file()))
    assert abs(device.codec.zero - 820) < 8
    off = abs(device.build_codec().to_kpa(rest))
    assert (np.sort(off)[:-1] <= device.largest_offset_kpa).all()
    assert off[7] > device.largest_offset_kpa
    near = [",".join("0123")] * 9
    assert "zero" not in guess_lines("\n".join(near).encode()).device_file()


@pytest.mark.parametrize(("word", "count"), [("nan", 24), ("ovf", 24), ("", 24)])
def test_a_line_without_a_number_is_left_out_and_the_probe_says_why(word, count):
    lines = [",".join([word if k % 5 == 0 else "9", "1", "2", "3"]) for k in range(30)]
    data = ("\n" + "\n".join(lines) + "\n").encode()
    codec = LinesFormat(kind="csv", taxels=4, kpa_per_count=1.0).build()
    assert read(codec, [data]) == [[9, 1, 2, 3]] * count
    if word:
        assert f"{word!r} is no number" in guess_lines(data).describe()


@pytest.mark.parametrize(
    ("form", "odd"),
    [
        (lambda v, k: "$TACT," + ",".join(map(str, v)) + "*5B", "400*5B"),
        (lambda v, k: ",".join(["ovf", *map(str, v[1:])]), "ovf"),
        (lambda v, k: ",".join(["20260102123456", *map(str, v)]), ""),
    ],
)
def test_no_device_file_is_named_for_lines_that_none_reads(form, odd):
    guess = guess_lines("".join(form(values, k) + "\r\n" for k, values in enumerate(VALUES)).encode())
    assert guess is not None
    assert not guess.read
    assert guess.odd == odd or guess.before == ("skip",)


@pytest.mark.parametrize(
    "form",
    [lambda v: "".join(f">S{k}:{x}\n" for k, x in enumerate(v)),
     lambda v: f"R0: {v[0]} {v[1]}\nR1: {v[2]} {v[3]}\n", lambda v: f"[[{v[0]} {v[1]}]\n [{v[2]} {v[3]}]]\n",
     lambda v: f"R0 {v[0]} {v[1]}\nR1 {v[2]} {v[3]}\n", lambda v: f"0,{v[0]},{v[1]}\n1,{v[2]},{v[3]}\n",
     lambda v: "".join(f"{k // 2},{k % 2},{x}\n" for k, x in enumerate(v)),
     lambda v: "".join(f"Sensor {k}: {x}\n" for k, x in enumerate(v)),
     lambda v: f"    C0  C1\nR0  {v[0]} {v[1]}\nR1  {v[2]} {v[3]}\n\n",
     lambda v: f"0 | {v[0]}\n1 | {v[1]}\n2 | {v[2]}\n3 | {v[3]}\n\n"],
)  # fmt: skip
def test_parts_of_frames_with_names_of_their_own_are_refused(form):
    guess = guess_lines("".join(map(form, VALUES)).encode())
    assert not guess.read
    assert "which no device file joins" in guess.refusal()


def test_the_checksum_of_nmea_leaves_out_the_dollar():
    codec = LinesFormat(kind="csv", taxels=4, before=("skip",), checksum="xor8", kpa_per_count=1.0).build()
    sentence = b"\n$TACT,100,200,300,400*%02X\r\n"
    right = functools.reduce(operator.xor, b"TACT,100,200,300,400")
    assert read(codec, [sentence % right]) == [VALUES[0]]
    assert read(codec, [sentence % (right ^ ord("$"))]) == []
    assert tomllib.loads(guess_lines(9 * (sentence % right)).device_file())["codec"]["checksum"] == "xor8"


def test_lines_of_one_number_may_be_the_taxels_of_a_frame():
    guess = guess_lines("".join(f"{x}\n" for v in VALUES for x in v).encode())
    assert "if they are parts of one" in guess.describe()


@pytest.mark.parametrize("unit", ["kPa", " g", " \u00b0C"])
def test_numbers_with_a_unit_are_no_bare_numbers(unit):
    data = "".join(",".join(f"{x}{unit}" for x in v) + "\n" for v in VALUES).encode()
    assert guess_lines(data) is None
    assert is_text(data)


def test_a_comma_between_two_numbers_is_no_decimal_one():
    lines = "".join(f"{v[0]},{v[1]}\r\n" for v in VALUES)
    guess = guess_lines(lines.encode())
    assert (guess.columns, guess.decimal) == (2, ".")


def test_rows_of_which_a_number_was_lost_are_no_frame():
    codec = LinesFormat(kind="csv", taxels=4, kpa_per_count=1.0).build()
    assert read(codec, [b"\n\n1,2\n3\n\n1,2\n3,4\n\n1\n3,4,5\n\n5,6\n7,8\n\n\n"]) == [
        [1, 2, 3, 4],
        [5, 6, 7, 8],
    ]


@pytest.mark.parametrize("jump", [-8000, 3000])
def test_a_clock_may_begin_anew_or_jump_once(jump):
    """Lines that waited in a buffer come before those of now; a device that restarts counts from 0."""
    rng = np.random.default_rng(0)
    rows = [[9000 + 20 * k + jump * (k > 9), *rng.integers(870, 880, 9)] for k in range(60)]
    assert guess_lines("\n".join(",".join(map(str, row)) for row in rows).encode()).before == ("clock",)


@pytest.mark.parametrize(
    ("step", "unit"), [(4.2, 1.0), (0.035, 1.0), (1, 1.0), (4200, 1e-3), (42, 1e-3), (42_000, 1e-6)]
)
@pytest.mark.parametrize("twice", [False, True])
def test_a_stamp_since_1970_is_the_clock_in_the_unit_of_its_size(step, unit, twice):
    stamps = [1.75e9 / unit + step * (k // 2 if twice else k) for k in range(len(VALUES))]
    lines = "".join(
        f"{stamp:.3f}," + ",".join(map(str, values)) + "\n"
        for stamp, values in zip(stamps, VALUES, strict=True)
    )
    guess = guess_lines(lines.encode())
    assert (guess.before, guess.tick_s, guess.read) == (("clock",), unit, True)


def test_stamps_in_ns_and_tables_with_a_column_a_frame_are_refused_for_what_they_are():
    lines = "".join(f"{1750000000000000000 + k * 42_000_000},{v[0]},{v[1]}\n" for k, v in enumerate(VALUES))
    assert "counts ns since 1970" in guess_lines(lines.encode()).refusal()
    lines = "node_id,frame0,frame1,frame2\n" + "".join(f"{k},{v[0]},{v[1]},7\n" for k, v in enumerate(VALUES))
    guess = guess_lines(lines.encode())
    assert not guess.read
    assert "its lines a taxel each" in guess.refusal()


def test_rows_between_lines_of_other_numbers_have_no_decimal_commas():
    lines = "".join(f"1.5 2.5 3.5\n{v[0]}.0 {v[1]}.0\n{v[2]}.0 {v[3]}.0\n" for v in VALUES)
    assert guess_lines(lines.encode()).decimal == "."


@given(st.binary(max_size=400))
def test_bytes_of_another_kind_are_not_taken_for_text(data):
    guess = guess_lines(data)  # raises nothing, whatever comes
    if guess is not None:
        assert guess.columns >= 1


def test_noise_is_no_text():
    rng = np.random.default_rng(0)
    assert not is_text(rng.integers(0, 256, 500).astype(np.uint8).tobytes())
    assert guess_lines(b"Hello\nworld\nagain\n") is None
    assert guess_lines(b"".join(b"[INFO] sensor ok, loop %d\n" % k for k in range(30))) is None


@pytest.mark.parametrize("form", ["{:04x}", "{:X}", "0x{:02X}"])
@pytest.mark.parametrize("separator", [" ", ",", "\t"])
def test_hexadecimal_lines_are_named_and_read(form, separator):
    values = [[x + 160 for x in frame] for frame in VALUES]
    data = "".join(separator.join(map(form.format, frame)) + "\r\n" for frame in values).encode()
    guess = guess_lines(b"\n" + data)
    device = Device.model_validate(tomllib.loads(guess.device_file()))
    assert read(device.build_codec(), [b"\n", data, b"\n"]) == values
    if "0x" not in form:
        assert "lines of 4 hexadecimal numbers" in guess.describe()
    codec = LinesFormat(kind="csv", taxels=4, base=16, kpa_per_count=1.0).build()
    sent = codec.encode(Frame(np.array(values[0], dtype=float)))
    assert read(codec, [b"\n", sent]) == values[:1]


def test_decimal_lines_with_a_word_of_letters_are_not_hexadecimal():
    for lines in ("face,1,2,3\n", "1,2,3\n", "dead,beef,1.5\n", "a 10 20 30\n"):
        guess = guess_lines(9 * lines.encode())
        assert guess is None or guess.base == 10
