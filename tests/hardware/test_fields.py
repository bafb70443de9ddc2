import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_pads import small_device

from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.hardware.codecs.codec import CHECKSUMS, Frame
from tactsim.hardware.codecs.fields import FieldsFormat


def codec(layout, **options):
    return FieldsFormat.model_validate(
        {"kind": "fields", "kpa_per_count": 1.0, "layout": layout} | options
    ).build()


HEADER = {"is": "header", "bytes": "AA55"}


def test_a_frame_written_by_hand_is_read():
    device = small_device()
    # index 0x0102, clock 0x0304, six values of 12 bits 0x111 .. 0x666; the checksum by pymodbus' table
    body = bytes.fromhex("AA 55 11 01 02 03 04 11 12 22 33 34 44 55 56 66")
    crc = 0xFFFF
    for byte in body:  # bitwise, as the MODBUS specification states it
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xA001 if crc & 1 else 0)
    message = body + crc.to_bytes(2, "big") + b"\r\n"
    used, frame = device.codec.build().decode(message)
    assert used == len(message) == 20
    assert frame.values.tolist() == [0x111, 0x222, 0x333, 0x444, 0x555, 0x666]
    assert (frame.index, frame.ticks) == (0x0102, 0x0304)


@pytest.mark.parametrize(
    ("bits", "endian", "data", "values"),
    [
        (16, "big", "01 02 03 04", [0x0102, 0x0304]),
        (16, "little", "01 02 03 04", [0x0201, 0x0403]),
        (12, "little", "23 C1 AB", [0x123, 0xABC]),
        # 10 bits, high bit first: 1000000001 0000000011 (and four bits to fill the byte)
        (10, "big", "80 40 30", [0b1000000001, 0b0000000011]),
        # low bit first: byte 0 holds the low 8 bits of the first value
        (10, "little", "01 0E 00", [0b1000000001, 0b0000000011]),
    ],
)
def test_packed_values_are_read_as_the_documentation_says(bits, endian, data, values):
    form = codec(
        [HEADER, {"is": "taxels", "count": 2, "bits": bits}, {"is": "footer", "bytes": "0A"}], endian=endian
    )
    _, frame = form.decode(bytes.fromhex(f"AA 55 {data} 0A"))
    assert frame.values.tolist() == values


@pytest.mark.parametrize(
    ("item", "endian", "data", "values"),
    [
        # IEEE 754: 1 is 3F800000, -2.5 is C0200000
        ({"bits": 32, "float": True}, "big", "3F 80 00 00 C0 20 00 00", [1.0, -2.5]),
        ({"bits": 32, "float": True}, "little", "00 00 80 3F 00 00 20 C0", [1.0, -2.5]),
        ({"bits": 32, "signed": True}, "little", "FE FF FF FF 01 00 00 00", [-2, 1]),
        ({"bits": 8, "axes": 3, "normal": 0, "signed": True}, "big", "FF 80 01 02 03 C8", [-1, 2]),
        # 12 bits, two axes: 123 and 456, then 789 and ABC
        ({"bits": 12, "axes": 2, "normal": 1}, "big", "12 34 56 78 9A BC", [0x456, 0xABC]),
    ],
)
def test_floats_and_the_normal_of_several_axes_are_read(item, endian, data, values):
    layout = [HEADER, {"is": "taxels", "count": 2} | item, {"is": "footer", "bytes": "0A"}]
    form = codec(layout, endian=endian, kpa_per_count=0.1)
    message = bytes.fromhex(f"AA 55 {data} 0A")
    used, frame = form.decode(message)
    assert (used, frame.values.tolist()) == (len(message), values)
    _, again = form.decode(form.encode(frame))
    assert again.values.tolist() == values


@pytest.mark.parametrize("odd", ["7F C0 00 00", "7F 80 00 00", "FF 7F FF FF"])  # NaN, infinite, -3.4e38
def test_a_float_that_is_no_pressure_is_in_no_frame(odd):
    layout = [
        HEADER,
        {"is": "taxels", "count": 1, "bits": 32, "float": True},
        {"is": "checksum", "kind": "lrc8"},
    ]
    form = codec(layout)
    body = bytes.fromhex(f"AA 55 {odd}")
    assert form.decode(body + bytes([-sum(body) & 255])) == (1, None)


def test_the_checksum_of_modbus_ascii_makes_all_bytes_sum_to_nothing():
    message = bytes.fromhex("55 AA 00 10 17 00 01 00 01 D8")  # PaXini's command to send by itself
    assert CHECKSUMS["lrc8"][1](message[:-1]) == message[-1]


@given(
    st.sampled_from([8, 10, 12, 16, 32]), st.sampled_from(["big", "little"]), st.booleans(),
    st.sampled_from([None, *CHECKSUMS]), st.data(),
)  # fmt: skip
def test_what_is_encoded_is_decoded(bits, endian, signed, checksum, data):
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    values = data.draw(st.lists(st.integers(low, high), min_size=1, max_size=30))
    layout = [
        HEADER,
        {"is": "length", "of": "frame", "size": 2},
        {"is": "address"},
        {"is": "index", "size": 4},
        {"is": "skip", "size": 3},
        {"is": "clock", "size": 4, "tick_s": 1e-3},
        {"is": "taxels", "count": len(values), "bits": bits, "signed": signed},
        *([] if checksum is None else [{"is": "checksum", "kind": checksum, "skip": 2}]),
        {"is": "footer", "bytes": "0D0A"},
    ]
    form = codec(layout, endian=endian, kpa_per_count=0.1)
    frame = Frame(np.array(values, dtype=float), address=7, index=70_000, ticks=123_456)
    message = form.encode(frame)
    used, again = form.decode(message)
    assert used == len(message)
    assert again.values.tolist() == values
    assert (again.address, again.index, again.ticks) == (7, 70_000, 123_456)


def test_counts_become_pressures_and_back():
    form = small_device().codec.build()
    assert form.to_kpa(np.array([100.0, 102.0])).tolist() == [0.0, 1.0]
    assert form.from_kpa(np.array([0.0, 1.1, -1e9, 1e9])).tolist() == [100, 102, 0, 4095]


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ([{"is": "taxels", "count": 1}], "must begin with a header, end with a footer, or have a checksum"),
        ([{"is": "taxels", "count": 1}, HEADER], "header must be the first"),
        ([HEADER, {"is": "taxels", "count": 1}, {"is": "taxels", "count": 1}], "2 items 'taxels'"),
        ([HEADER, {"is": "taxels", "count": 10_000, "bits": 16}, {"is": "length", "of": "data"}], "not fit"),
        ([HEADER, {"is": "taxels", "count": 6}, {"is": "checksum", "kind": "sum8", "skip": 3}],
         "the checksum does not cover the taxels"),
        ([HEADER, {"is": "taxels", "count": 1}, {"is": "packet", "of": 2}], "needs an 'index'"),
        ([HEADER, {"is": "index"}, {"is": "packet", "of": 256, "first": 1}, {"is": "taxels", "count": 1}],
         "256 packets from 1 on do not fit a number of 1 bytes"),
    ],
)  # fmt: skip
def test_a_layout_that_makes_no_sense_is_refused_with_the_reason(layout, message):
    with pytest.raises(InputError, match=message):
        checked(FieldsFormat, {"kind": "fields", "kpa_per_count": 1.0, "layout": layout}, "x")


def test_a_checksum_may_have_an_order_of_bytes_of_its_own():
    """Modbus RTU: big-endian numbers, the CRC's low byte first. The frame is DFRobot's request for SEN0704."""
    layout = [
        {"is": "header", "bytes": "01 04"},
        {"is": "taxels", "count": 2, "bits": 16},
        {"is": "checksum", "kind": "crc16-modbus", "endian": "little"},
    ]
    form = codec(layout)
    used, frame = form.decode(bytes.fromhex("01 04 00 07 00 24 41 D0"))
    assert used == 8
    assert frame.values.tolist() == [7, 36]
    assert form.encode(frame) == bytes.fromhex("01 04 00 07 00 24 41 D0")


def test_a_frame_whose_checksum_alone_is_wrong_is_known_from_garbage():
    form = small_device().codec.build()
    good = form.encode(Frame(np.arange(6.0), index=5, ticks=9))
    swapped = good[:-4] + good[-3:-2] + good[-4:-3] + good[-2:]
    assert [form.fails_checksum(each, 0) for each in (good, swapped, b"\0" + good, good[:-1])] == [
        False, True, False, False
    ]  # fmt: skip
