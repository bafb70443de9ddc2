"""No framing invents a frame: whatever is lost, torn or added, each frame read is one that was sent, bit for bit."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from made_pads import described, line_device, small_device

from tactsim.core.counters import Counters
from tactsim.hardware.codecs.codec import Frame, Framer
from tactsim.hardware.codecs.fields import packing_of
from tactsim.hardware.stream import Stream

HEADER = {"is": "header", "bytes": "AA 55"}
FOOTER = {"is": "footer", "bytes": "0D 0A"}
TAXELS = {"is": "taxels", "count": 6, "bits": 16}
MARK_BYTES = b"\xaa\x55\x0d\x0a\x00\xff"


def numbers(values, index):
    return Frame(np.frombuffer(values, ">u2").astype(float), index=index, ticks=index)


def read(form, stream):
    return [tuple(one.packet.values) for one in Framer(form, Counters()).feed(stream, 0.0)]


# Six values of two bytes, many of which look like marks.
values_of_a_frame = st.lists(st.sampled_from(MARK_BYTES), min_size=12, max_size=12).map(bytes)
sent_frames = st.lists(values_of_a_frame, min_size=3, max_size=10)
faults = st.lists(
    st.tuples(
        st.sampled_from(["lose", "change", "add", "repeat"]),
        st.floats(0, 1),
        st.one_of(st.binary(max_size=40), st.lists(st.sampled_from(MARK_BYTES), max_size=40).map(bytes)),
    ),
    max_size=6,
)


def spoiled(stream, faults):
    """Lose, change, add or repeat bytes anywhere."""
    stream = bytearray(stream)
    for kind, where, content in faults:
        at, size = int(where * len(stream)), len(content)
        if kind == "lose":
            del stream[at : at + size]
        elif kind == "change":
            stream[at : at + size] = bytes(byte ^ 1 for byte in stream[at : at + size])
        elif kind == "add":
            stream[at:at] = content
        else:
            stream[at:at] = stream[max(at - size, 0) : at]
    return bytes(stream)


SUM = {"is": "checksum", "kind": "crc32"}
CHECKED = {
    "header": described([HEADER, {"is": "index"}, TAXELS, SUM]),
    "footer": described([{"is": "index"}, TAXELS, SUM, FOOTER]),
    "neither": described([{"is": "index"}, TAXELS, SUM]),
    "lines": line_device(before=["clock"], checksum="crc32"),
    "lines of three axes": line_device(
        before=["skip"], after=1, axes=3, normal=1, delimiter="tab", checksum="crc32"
    ),
}


@pytest.mark.parametrize("kind", CHECKED)
@settings(max_examples=25)
@given(sent_frames, faults)
def test_with_a_crc_nothing_that_happens_to_the_bytes_makes_a_frame(kind, sent, faults):
    form = CHECKED[kind].codec.build()
    stream = b"".join(form.encode(numbers(values, k)) for k, values in enumerate(sent))
    known = [tuple(numbers(values, 0).values) for values in sent]
    assert len(read(form, stream)) >= len(sent) - 1  # the first one may lack its neighbour
    assert set(read(form, spoiled(stream, faults))) <= set(known)


TOLD_BY_MARKS_ALONE = ("header", "footer")  # so that bytes that are added are found out, too
UNCHECKED = {
    "header": (described([HEADER, TAXELS]), b"\xaa\x55"),
    "footer": (described([TAXELS, FOOTER]), b"\x0d\x0a"),
    "header and footer": (described([HEADER, TAXELS, {"is": "footer", "bytes": "00"}]), b"\xaa\x55"),
    "header and question": (described([HEADER, TAXELS], request="3F"), b"\xaa\x55"),
    "header and one byte": (described([HEADER, TAXELS, {"is": "checksum", "kind": "lrc8"}]), b"\xaa\x55"),
}
losses = st.lists(st.tuples(st.booleans(), st.sets(st.integers(0, 11)), st.binary(max_size=30)), max_size=10)


@pytest.mark.parametrize("kind", UNCHECKED)
@settings(max_examples=25)
@given(sent_frames, losses)
@example(
    [b"\r\n" + b"\xaa" * 10] + [b"\xaa" * 12] * 6,
    [(False, set(), b""), (True, set(range(12)), b""), (True, {0, 9}, b"")],
)
def test_without_one_nothing_that_is_lost_or_added_between_two_marks_does(kind, sent, losses):
    """Bytes are lost or added between two marks, not both: as many lost as added cannot be told without a checksum.

    For the same reason none are added where the data hold a mark: from there on the frame may become as long as one.
    Frames in a row that hold the footer at one place may as well be such that begin behind it.
    """
    device, mark = UNCHECKED[kind]
    form = device.codec.build()
    frames = [form.encode(numbers(values, 0)) for values in sent]
    arrived = [bytearray(frame) for frame in frames]
    first = len(mark) if kind.startswith("header") else 0  # where the values begin; they may look like a mark
    for frame, (loses, lost, added) in zip(arrived, losses, strict=False):
        if loses:
            for at in sorted(lost, reverse=True):
                del frame[first + at]
        elif kind in TOLD_BY_MARKS_ALONE and frame.count(mark) == 1:
            frame[first + 5 : first + 5] = bytes(byte for byte in added if byte not in mark)
    if kind == "footer":
        assume(
            not any(
                one[at : at + 2] == other[at : at + 2] == mark
                for one, other in pairwise(arrived)
                for at in range(len(frames[0]) - len(mark))
            )
        )
    known = {tuple(numbers(values, 0).values) for values in sent}
    assert set(read(form, b"".join(arrived))) <= known


def test_a_frame_in_whose_values_the_mark_stands_once_is_dropped_and_the_next_one_read():
    """It may as well be the remains of two frames."""
    form = described([HEADER, TAXELS]).codec.build()
    odd, plain = (form.encode(Frame(np.array(values, dtype=float))) for values in ([0xAA55] * 6, range(6)))
    assert read(form, odd + plain * 5) == [tuple(range(6))] * 4


def test_a_mark_that_always_stands_in_the_values_hides_no_frame_and_one_lost_byte_costs_few():
    """FlexiTac's counts AA 55 under the edge of an object, at one place in every image."""
    form = described([HEADER, TAXELS]).codec.build()
    frames = [form.encode(Frame(np.array([k, 0xAA55, 3, 4, 5, 6], dtype=float))) for k in range(20)]
    sent = [(k, 0xAA55, 3, 4, 5, 6) for k in range(20)]
    assert read(form, b"".join(frames)) == sent[:17]  # three headers must follow each
    torn = [*frames[:8], frames[8][:7] + frames[8][8:], *frames[9:]]
    seen = read(form, b"".join(torn))
    assert set(seen) <= set(sent)
    assert len(seen) >= 17 - 4


def test_an_answer_that_ends_with_the_next_ones_first_byte_is_none():
    """A byte of the answer was lost, so the question was asked again; all but one byte of the header came till then."""
    form = described([HEADER, TAXELS], request="3F").codec.build()
    framer = Framer(form, Counters())
    first, second = (form.encode(Frame(np.full(6, value))) for value in (1.0, 2.0))
    found = framer.feed(first[:5] + first[6:] + second[:1], 0.25) + framer.feed(second[1:], 0.26)
    assert [one.packet.values.tolist() for one in found] == [[2.0] * 6]


def test_the_remains_of_two_frames_whose_checksum_is_right_by_chance_are_no_frame():
    """One in 256 is: here a frame breaks off behind four bytes, and the next one's bytes go on to the right sum."""
    form = described([HEADER, TAXELS, {"is": "checksum", "kind": "lrc8"}]).codec.build()
    torn = form.encode(Frame(np.arange(6.0)))[:4]
    for last in range(256):
        second = form.encode(Frame(np.array([1, 2, 3, last * 256, 5, 6], dtype=float)))
        mixed = torn + second
        by_chance = -sum(mixed[: form.size - 1]) & 255 == mixed[form.size - 1]
        assert read(form, mixed) == [(1, 2, 3, last * 256, 5, 6)]
        if by_chance:
            break
    assert by_chance


def test_a_crc_that_is_right_by_chance_is_no_frame_but_with_the_frame_before_it_is():
    form = described([TAXELS, {"is": "checksum", "kind": "crc16-modbus"}]).codec.build()
    first, second = (form.encode(Frame(np.full(6, value))) for value in (1.0, 2.0))
    assert read(form, bytes(20) + first + bytes(20)) == []
    assert read(form, bytes(20) + first + second + bytes(20)) == [(2.0,) * 6]


PACKETS = [
    HEADER,
    {"is": "index", "size": 2},
    {"is": "packet", "of": 3, "first": 1},
    {"is": "taxels", "count": 2},
    SUM,
]


@settings(max_examples=25)
@given(
    sent_frames, st.integers(65530, 65535), st.lists(st.sampled_from([0.0, 0.001, 0.3]), max_size=40), faults
)
def test_packets_of_two_frames_are_never_joined(sent, first, pauses, faults):
    device = described(PACKETS)
    form, stream = device.codec.build(), Stream(device)
    packets = []
    for k, values in enumerate(sent):
        message = form.encode(numbers(values, (first + k) % 65536))
        packets += [message[at : at + form.size] for at in range(0, len(message), form.size)]
    readings, now = [], 0.0
    for k, packet in enumerate(packets):
        now += pauses[k] if k < len(pauses) else 0.001
        broken = [fault for fault in faults if int(fault[1] * len(packets)) == k]
        readings += stream.received(0, spoiled(packet, broken), now)
    known = {tuple(numbers(values, 0).values) for values in sent}
    assert {tuple(reading.pressures) for reading in readings} <= known
    if not faults and 0.3 not in pauses:
        assert [tuple(reading.pressures) for reading in readings] == [
            tuple(numbers(values, 0).values) for values in sent
        ]
        assert stream.counters.torn == 0


def test_a_lost_packet_costs_its_frame_and_no_other():
    device = described(PACKETS)
    form, stream = device.codec.build(), Stream(device)
    messages = [form.encode(Frame(np.full(6, float(k)), index=k)) for k in range(4)]
    packets = [
        message[at : at + form.size] for message in messages for at in range(0, len(message), form.size)
    ]
    assert len(packets) == 12
    readings = stream.received(0, b"".join(packets[:4] + packets[5:]), 0.0)  # frame 1 lacks its second packet
    assert [reading.pressures[0] for reading in readings] == [0, 2, 3]
    assert stream.counters.torn == 1
    # The end of one frame and the beginning of the next are lost, or a link between them.
    assert stream.received(0, packets[0] + packets[4] + packets[5], 0.1) == []
    stream.received(0, b"".join(packets[:2]), 0.2)
    stream.lost(0, 0.2)
    assert stream.received(0, packets[2], 0.2) == []


@pytest.mark.parametrize(
    ("ahead", "behind"), [([HEADER], [SUM]), ([HEADER], []), ([], [FOOTER]), ([], [SUM, FOOTER]), ([], [SUM])]
)
def test_packets_with_the_same_counter_are_of_two_frames_if_time_lies_between_them(ahead, behind):
    """A counter of one byte is the same again after 256 frames."""
    packet = [{"is": "index"}, {"is": "packet", "of": 2}, {"is": "taxels", "count": 3}]
    device = described([*ahead, *packet, *behind])
    form, stream = device.codec.build(), Stream(device)
    before = b"".join(form.encode(Frame(np.full(6, 9.0), index=index)) for index in (5, 6))
    early, late = (form.encode(Frame(np.full(6, value), index=7)) for value in (1.0, 2.0))
    stream.received(0, b"\r\n" + before, 0.0)
    assert {reading.pressures[0] for reading in stream.received(0, early[: form.size], 0.01)} <= {9.0}
    assert stream.received(0, late[form.size :], 2.57) == []
    assert [reading.pressures[0] for reading in stream.received(0, late + b"\xaa\x55", 2.6)] == [2.0]
    assert stream.counters.torn == 1


@settings(max_examples=25)
@given(st.lists(st.integers(0, 1023), min_size=18, max_size=60), st.integers(0, 40), st.data())
def test_plain_lines_that_are_lost_whole_or_begun_before_the_port_was_opened_make_none(numbers, cut, data):
    form = line_device().codec.build()
    sent = [numbers[at : at + 6] for at in range(0, len(numbers) - 5, 6)]
    kept = [values for values in sent if data.draw(st.booleans())]
    # Rows of four numbers make no frame of six; two of three between empty lines would be one.
    noise = data.draw(
        st.lists(st.sampled_from([b"ready\r\n", b"\r\n", b"1,2,3,4\n", b"nan,1,2,3,4,5\n", b"\xff\x00\n"]))
    )
    arrived = [form.encode(Frame(np.array(values, dtype=float))) for values in kept] + noise
    stream = b"".join(data.draw(st.permutations(arrived)))[cut:]
    assert set(read(form, stream)) <= {tuple(map(float, values)) for values in sent}


@pytest.mark.parametrize(
    ("line", "values"),
    [(b"1,2,3,4,5,6", [1, 2, 3, 4, 5, 6]), (b" 1.5 ,\t-2,+3,4e2,.5,6.\r", [1.5, -2, 3, 400, 0.5, 6]),
     (b"1,2,3,4,5", None), (b"1,2,3,4,5,6,7", None), (b"1,2,3,4,5,", None), (b"1,2,3,4,5,nan", None),
     (b"1,2,3,4,5,inf", None), (b"1,2,3,4,5,ovf", None), (b"1,2,3,4,5,1e999", None), (b"1,2,3,4,5,1_0", None),
     (b"1,2,3,4,5,0x10", None), ("1,2,3,4,5,\u0661".encode(), None), (b"\xef\xbb\xbf1,2,3,4,5,6", None),
     (b"", None)],
)  # fmt: skip
def test_a_line_is_six_plain_numbers_and_nothing_else(line, values):
    found = read(line_device().codec.build(), b"\n" + line + b"\n")
    assert found == ([] if values is None else [tuple(values)])


def test_a_line_that_its_checksum_contradicts_is_none_and_is_counted():
    form, counters = line_device(checksum="xor8", before=["clock", "index"]).codec.build(), Counters()
    check = 0
    for letter in b"250,7,1,2,3,4,5,6":  # NMEA 0183: all between the line's beginning and the star
        check ^= letter
    good = b"250,7,1,2,3,4,5,6*%02X\r\n" % check
    (frame,) = (
        one.packet for one in Framer(form, counters).feed(b"\r\n" + good + good.replace(b"7,1", b"7,2"), 0.0)
    )
    assert (frame.ticks, frame.index, frame.values.tolist()) == (250.0, 7, [1, 2, 3, 4, 5, 6])
    assert counters.bad_checksums == 1
    assert form.encode(frame) == good


def test_decimal_commas_semicolons_and_blanks_are_read():
    values = [1.5, -2.0, 3.25, 4.0, 5.0, 6.0]
    for line, options in (
        (b"1,5;-2;3,25;4;5;6", {"delimiter": ";", "decimal": ","}),
        (b"1.5  -2 3.25\t4 5 6 ", {"delimiter": "blank"}),
        (b"1.5\t-2\t3.25\t4\t5\t6", {"delimiter": "tab"}),
    ):
        form = line_device(**options).codec.build()
        assert read(form, b"\n" + line + b"\n") == [tuple(values)], line
        assert read(form, b"\n" + form.encode(Frame(np.array(values)))) == [tuple(values)], line
    assert read(line_device(delimiter=";", decimal=",").codec.build(), b"\n1.5;2;3;4;5;6\n") == []


@pytest.mark.parametrize(
    ("options", "said"),
    [({"decimal": ","}, "both a comma"), ({"axes": 2, "normal": 2}, "normal axis 2 is none of 2"),
     ({"before": ["clock", "clock"]}, "one column is the clock"),
     ({"checksum": "md5"}, "unknown checksum 'md5'"), ({"kpa_per_count": 0}, "must not be 0")],
)  # fmt: skip
def test_lines_that_make_no_sense_are_refused_with_the_reason(options, said):
    with pytest.raises(ValueError, match=said):
        line_device(**options)


def test_parts_whose_frames_come_in_packets_are_joined_by_their_counter():
    layout = [*PACKETS[:1], {"is": "address"}, *PACKETS[1:]]
    parts = [{"address": at, "taxels": [6 * at + k for k in range(6)]} for at in range(2)]
    with pytest.raises(ValueError, match="joined by their counter: leave out pair_within_s"):
        small_device(
            codec={"layout": layout},
            pad={"rows": 2, "columns": 6, "no_seam": True},
            part=parts,
            pair_within_s=0.1,
        )


def slip(packet):
    return packet.replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc") + b"\xc0"


def cobs(packet):
    return b"".join(bytes([len(part) + 1]) + part for part in packet.split(b"\0")) + b"\0"


@given(st.integers(0, 2**32), st.integers(4, 60))
def test_slip_and_cobs_are_named_with_the_length_of_their_packets(seed, length):
    rng = np.random.default_rng(seed)
    packets = [rng.choice([0, 1, 7, 192, 219, 220], length).astype(np.uint8).tobytes() for _ in range(20)]
    assert packing_of(b"".join(map(slip, packets))) == f"SLIP (C0 behind each), {length} bytes long"
    assert packing_of(b"".join(map(cobs, packets))) == f"COBS (00 behind each), {length} bytes long"


@given(st.integers(0, 2**32), st.integers(4, 60))
def test_frames_with_a_header_are_neither(seed, length):
    rng = np.random.default_rng(seed)
    frames = [b"\xc0\x00" + rng.integers(0, 256, length, dtype=np.uint8).tobytes() for _ in range(20)]
    assert packing_of(b"".join(frames)) is None
