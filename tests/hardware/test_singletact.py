import struct

import numpy as np
import pytest
from made_pads import singletact

from tactsim.core.counters import Counters
from tactsim.hardware.codecs.codec import CodecError
from tactsim.hardware.codecs.singletact import (
    Polling,
    Question,
    Reply,
    SingleTactFormat,
    parse_request,
    write_reply,
    write_request,
)
from tactsim.hardware.stream import Stream


def codec(taxels=1):
    return SingleTactFormat(kind="singletact", taxels=taxels, full_scale_kpa=100.0).build()


def asked(stream, at, taxels):
    """Return what the stream asks at `at`; questions for the settings are answered on the way."""
    while True:
        request = stream.request(0, at)
        stream.sent(0, request, at)
        if parse_request(request).register != 5:
            return request
        assert stream.received(0, reply_to(request, 0, [], elements=taxels), at) == []


def reply_to(request, index, outputs, ticks=0, number=None, elements=0, accumulator=0):
    """Answer a read as a bridge does whose sensor is at frame `index`."""
    question = parse_request(request)
    settings = bytes(5) + bytes([accumulator]) + bytes(6) + bytes([elements])
    registers = (
        settings.ljust(128, b"\0") + struct.pack(">HH", index, 0) + np.asarray(outputs, dtype=">u2").tobytes()
    )
    data = registers.ljust(192, b"\0")[question.register : question.register + question.count]
    return write_reply(Reply(question.address, False, question.id if number is None else number, ticks, data))


def test_a_request_is_what_the_makers_driver_sends():
    # NETInterface, SerialCommand.GenerateReadCommand(4, 7, 128, 6)
    assert write_request(Question(4, 7, 128, 6)) == bytes.fromhex("FFFFFFFF 04 64 07 01 80 06 FF FEFEFEFE")


@pytest.mark.parametrize("header", ["FFFFFFFF", "AAAAAAAA"])
def test_an_answer_is_read_field_by_field(header):
    message = bytes.fromhex(header + "04 00 07 00010203 06 0005 0001 02FF FEFEFEFE")
    assert len(message) == 16 + 6
    assert codec().decode(message) == (
        len(message),
        Reply(4, False, 7, 0x00010203, bytes.fromhex("000500010 2FF".replace(" ", ""))),
    )


def test_the_outputs_255_and_767_are_zero_and_full_scale():
    form = codec(4)
    assert form.to_kpa(np.array([255.0, 767.0, 511.0, 0.0])).tolist() == [0.0, 100.0, 50.0, -255 * 100 / 512]
    assert form.from_kpa(np.array([0.0, 100.0, -1e6, 1e6])).tolist() == [255, 767, 0, 1023]


def ask(stream, index, outputs, at=0.0, ticks=0, taxels=None):
    taxels = len(outputs) if taxels is None else taxels
    request = asked(stream, at, taxels)
    return parse_request(request), stream.received(0, reply_to(request, index, outputs, ticks), at + 0.01)


def test_an_array_of_25_is_read_twice_and_its_index_once_more():
    stream = Stream(singletact(taxels=25))
    outputs = np.arange(25) * 20 + 255
    questions, readings = zip(*(ask(stream, 8, outputs, at=k * 0.02) for k in range(3)), strict=True)
    assert [(each.register, each.count) for each in questions] == [(128, 32), (160, 22), (128, 4)]
    assert [len(each) for each in readings] == [0, 0, 1]
    assert np.allclose(readings[2][0].pressures, np.arange(25) * 20 * 100 / 512)


@pytest.mark.parametrize("moved_at", [1, 2])
def test_a_frame_whose_index_moves_between_the_reads_is_torn(moved_at):
    stream = Stream(singletact(taxels=25))
    for k in range(3):
        _, readings = ask(stream, 8 + (k >= moved_at), np.full(25, 300), at=k * 0.02)
        assert readings == []
    assert stream.counters.torn == 1
    for k in range(3, 6):
        _, readings = ask(stream, 9, np.full(25, 300), at=k * 0.02)
    assert len(readings) == 1


def test_the_same_frame_again_is_no_new_reading():
    stream = Stream(singletact(taxels=1))
    assert [len(ask(stream, index, [300], at=k)[1]) for k, index in enumerate([5, 5, 6, 6, 5])] == [
        1, 0, 1, 0, 1,
    ]  # fmt: skip
    assert stream.counters.repeats == 2


@pytest.mark.parametrize(("what", "change"), [("id", {"number": 99}), ("length", {})])
def test_an_answer_to_another_question_is_dropped(what, change):
    stream = Stream(singletact(taxels=1))
    request = asked(stream, 0.0, taxels=1)
    wrong = reply_to(request, 5, [300], **change)
    if what == "length":
        wrong = write_reply(Reply(4, False, parse_request(request).id, 0, bytes(8)))
    assert stream.received(0, wrong, 0.01) == []
    assert stream.counters.strays == 1
    assert len(stream.received(0, reply_to(request, 5, [300]), 0.02)) == 1


def test_a_slow_answer_is_stale_although_the_flag_says_nothing():
    """The maker's bridge never sets its flag: after 100 ms it sends what its buffer held before."""
    stream = Stream(singletact(taxels=1))
    request = asked(stream, 0.0, taxels=1)
    assert stream.received(0, reply_to(request, 5, [300]), 0.11) == []
    assert stream.counters.stale == 1


def test_a_question_without_answer_is_asked_again_with_another_id():
    counters = Counters()
    polling = Polling(codec(1).format, (4,), counters)
    first = polling.request(0.0)
    polling.sent(first, 0.0)
    assert polling.request(0.2) == b""
    second = polling.request(0.3)
    polling.sent(second, 0.3)
    assert parse_request(second).id == parse_request(first).id + 1
    assert counters.timeouts == 1


@pytest.mark.parametrize("lost", range(0, 12, 3))
def test_after_a_lost_answer_no_frame_mixes_two_sensors(lost):
    """Both sensors are at one frame index, so that the index does not tell them apart."""
    counters, now, asked, frames = Counters(), 0.0, 0, []
    polling = Polling(codec(25).format, (4, 5), counters)
    while len(frames) < 8:
        request = polling.request(now)
        now += 0.01
        if not request:
            continue
        polling.sent(request, now)
        address = parse_request(request).address
        asked += 1
        if asked == lost + 1:
            now += 0.3
            continue
        answer = reply_to(request, 7, [300 if address == 4 else 900] * 25, elements=25)
        _, reply = codec(25).decode(answer)
        if (frame := polling.take(reply, now)) is not None:
            frames.append(frame)
    assert counters.timeouts == 1
    for frame in frames:
        assert set(frame.values.tolist()) == {300.0 if frame.address == 4 else 900.0}
    assert {frame.address for frame in frames} == {4, 5}


def settings_of(stream, elements, at, accumulator=0):
    """Let the sensor answer the question for its settings."""
    request = stream.request(0, at)
    assert parse_request(request) == Question(4, parse_request(request).id, 5, 8)
    stream.sent(0, request, at)
    return stream.received(0, reply_to(request, 0, [], elements=elements, accumulator=accumulator), at)


def test_a_sensor_with_another_number_of_elements_than_the_file_is_refused():
    """Its registers go on behind the elements that it has, and would be read as pressures."""
    stream = Stream(singletact(taxels=25))
    assert settings_of(stream, 16, 0.0) == []  # a flipped bit? there is no checksum, so it is asked again
    with pytest.raises(CodecError, match=r"address 4 has 16 elements \(register 12\).* taxels = 25"):
        settings_of(stream, 16, 0.1)


def test_one_flipped_bit_in_the_settings_refuses_nothing():
    stream = Stream(singletact(taxels=25))
    for elements in (27, 25):
        assert settings_of(stream, elements, 0.0) == []
    assert parse_request(stream.request(0, 0.1)).register == 128


def test_the_accumulator_is_set_only_where_it_differs_and_checked():
    stream = Stream(singletact(taxels=1, accumulator=3))
    assert settings_of(stream, 1, 0.0, accumulator=0) == []
    request = stream.request(0, 0.1)
    # WinAppArduinoInterface: a write
    assert request == bytes.fromhex("FFFFFFFF 04 64 01 02 05 01 03 FF FEFEFEFE")
    stream.sent(0, request, 0.1)
    assert stream.received(0, write_reply(Reply(4, False, 1, 0, b"")), 0.11) == []
    assert settings_of(stream, 1, 0.2, accumulator=3) == []
    assert parse_request(stream.request(0, 0.3)).register == 128

    same = Stream(singletact(taxels=1, accumulator=3))
    assert settings_of(same, 1, 0.0, accumulator=3) == []
    assert parse_request(same.request(0, 0.1)).register == 128


def test_a_sensor_that_does_not_take_the_accumulator_is_refused():
    stream = Stream(singletact(taxels=1, accumulator=3))
    settings_of(stream, 1, 0.0)
    request = stream.request(0, 0.1)
    stream.sent(0, request, 0.1)
    stream.received(0, write_reply(Reply(4, False, 1, 0, b"")), 0.11)
    with pytest.raises(CodecError, match=r"keeps its accumulator \(register 5\) at 0.*locked"):
        settings_of(stream, 1, 0.2)


@pytest.mark.parametrize("counts", [1024, 0x0300 ^ 0x8000])
def test_counts_that_a_sensor_cannot_say_are_no_reading(counts):
    stream = Stream(singletact(taxels=1))
    assert ask(stream, 5, [counts])[1] == []
    assert stream.counters.impossible == 1
    assert len(ask(stream, 6, [1023], at=0.1)[1]) == 1


def test_an_answer_whose_bytes_come_slowly_is_not_stale():
    """The bridge begins to answer at once, over a slow line; only old bytes begin after 100 ms."""
    stream = Stream(singletact(taxels=1))
    request = asked(stream, 0.0, taxels=1)
    answer = reply_to(request, 5, [300])
    assert stream.received(0, answer[:3], 0.02) == []
    assert stream.received(0, answer[3:-1], 0.12) == []
    assert len(stream.received(0, answer[-1:], 0.2)) == 1
    assert stream.counters.stale == 0
