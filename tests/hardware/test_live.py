import os
import threading
import time
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from made_pads import ramp, serving, singletact, small_device

from tactsim.core.source import NoReading, SourceError
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.codecs.singletact import Reply, parse_request, write_reply
from tactsim.hardware.emulator import Faults, emulate
from tactsim.hardware.emulator.emulated import EmulatedSingleTact
from tactsim.hardware.live import LiveSource, Port
from tactsim.hardware.recording import Kind, Recorder, RecordReader


@pytest.fixture
def pty():
    """A pty pair: the device's end, and the name of the host's."""
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for end in (master, slave):
        try:
            os.close(end)
        except OSError:
            continue


def message(device, index, value=100.0):
    return device.codec.build().encode(Frame(np.full(6, value), index=index, ticks=index))


def in_time(source, timeout, expected):
    """Read, and make sure that it fails with these words and within its deadline."""
    start = time.monotonic()
    with pytest.raises(NoReading, match=expected):
        source.read(timeout)
    assert time.monotonic() - start < timeout + 2.0  # a hang, not a slow machine, is what this finds


@pytest.mark.parametrize("on", ["pty", "tcp"])
def test_readings_come_in_order_and_none_is_lost(paper_pad, emulated_pad, on):
    with serving(emulated_pad, on=on) as url, LiveSource([url], paper_pad) as source:
        readings = [source.read() for _ in range(100)]
    indices = [reading.index for reading in readings]
    assert indices == list(range(indices[0], indices[0] + 100))
    assert source.counters.garbage_bytes == 0
    expected = np.array([ramp(paper_pad)(index / 200.0) for index in indices])
    assert np.abs([reading.pressures for reading in readings] - expected).max() <= 0.35 + 1e-9
    hosts = np.array([reading.host_time for reading in readings])
    assert (np.diff(hosts) >= 0).all()


def test_silence_ends_in_an_error(pty):
    with LiveSource([pty[1]], small_device()) as source:
        in_time(source, 0.2, "not one byte came. Is the device on")


def test_a_wrong_baud_rate_or_format_ends_in_an_error(pty):
    with LiveSource([pty[1]], small_device()) as source:
        os.write(pty[0], np.random.default_rng(0).bytes(3000))
        in_time(source, 0.2, "3,000 bytes came and no whole frame of 'small'.* baud rate")


def test_a_flood_of_garbage_is_neither_kept_nor_waited_for(pty):
    device = small_device()
    stop = threading.Event()
    os.set_blocking(pty[0], False)

    def flood():
        noise = np.random.default_rng(0).bytes(4000)
        while not stop.is_set():
            try:
                os.write(pty[0], noise)
            except BlockingIOError:
                time.sleep(0.001)

    thread = threading.Thread(target=flood)
    with LiveSource([pty[1]], device) as source:
        tracemalloc.start()
        thread.start()
        try:
            in_time(source, 0.5, "no whole frame")
            kept = tracemalloc.get_traced_memory()[0]
        finally:
            tracemalloc.stop()
            stop.set()
            thread.join()
        assert source.counters.bytes > 200_000
        assert kept < 100_000


def test_a_port_opened_twice_is_refused(pty):
    with (
        LiveSource([pty[1]], small_device()),
        pytest.raises(SourceError, match="another program has it open"),
    ):
        Port(pty[1], 115200)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("/dev/nothing-here", "there is no such port; `bench devices` lists them"),
        ("A", "cannot open A: there is no such port.*did you mean simulated:A?"),
        ("socket://127.0.0.1:1", "cannot open socket://127.0.0.1:1.*refused"),
    ],
)
def test_a_port_that_is_not_there_is_one_line(url, message):
    with pytest.raises(SourceError, match=message) as error:
        LiveSource([url], small_device())
    assert "\n" not in str(error.value)


def test_an_unplugged_pty_ends_in_an_error_and_not_in_a_spin(pty):
    device = small_device()
    with LiveSource([pty[1]], device) as source:
        os.write(pty[0], message(device, 1))
        assert source.read(1.0).index == 1
        os.close(pty[0])
        used = time.process_time()
        in_time(source, 0.5, "cannot open|is gone")
        assert source.counters.reconnects == 1
        assert time.process_time() - used < 0.25  # a spin takes all of the half second


@pytest.mark.parametrize("on", ["pty", "tcp"])
def test_a_link_that_is_cut_comes_back(paper_pad, emulated_pad, on, tmp_path):
    options = {"link": tmp_path / "pad"} if on == "pty" else {}
    with (
        serving(emulated_pad, on=on, faults=Faults(disconnect=0.3), **options) as url,
        LiveSource([url], paper_pad) as source,
    ):
        readings = [source.read(5.0) for _ in range(150)]
        assert source.counters.reconnects >= 1
    device_time = np.array([reading.device_time for reading in readings])
    assert (np.diff(device_time) > 0).all()
    assert source.counters.clock_restarts == 0


def test_a_sensor_that_does_not_answer_is_named_and_its_old_bytes_are_not_taken():
    device = singletact(taxels=3)
    emulated = EmulatedSingleTact(device, ramp(device), rate=50.0)
    with serving(emulated) as url, LiveSource([url], device) as source:
        assert source.read(2.0).pressures.shape == (3,)
        emulated.silent = frozenset({4})
        with pytest.raises(NoReading, match="its sensor does not"):
            for _ in range(10_000):  # what was measured before may still come
                source.read(0.6)
        assert source.counters.stale >= 1


def test_a_sensor_that_hangs_is_named():
    device = singletact(taxels=3)
    with serving(emulate(device, ramp(device), rate=1e-6)) as url, LiveSource([url], device) as source:
        assert source.read(2.0).index == 0
        in_time(source, 0.3, "the same frame again and again")


def test_the_time_a_device_takes_to_start_is_not_held_against_it(pty):
    device = small_device(settle=0.5)
    thread = threading.Timer(0.7, lambda: os.write(pty[0], message(device, 2)))
    with LiveSource([pty[1]], device) as source:
        os.write(pty[0], message(device, 1))  # a board that restarts says things that mean nothing
        thread.start()
        assert source.read(0.4).index == 2


def test_a_device_that_must_be_told_to_speak_is_told_after_every_reconnection(tmp_path):
    device = small_device(codec={"start": "53 54"})
    emulated = emulate(device, ramp(device), rate=100.0)
    with (
        serving(emulated, faults=Faults(disconnect=0.3), link=tmp_path / "pad") as url,
        Recorder(tmp_path / "a") as recorder,
        LiveSource([url], device, recorder) as source,
    ):
        assert len([source.read(5.0) for _ in range(60)]) == 60
        reconnects = source.counters.reconnects
    records = list(RecordReader(tmp_path / "a"))
    sent = [record.payload for record in records if record.kind is Kind.SENT]
    assert sum(record.kind is Kind.LOST for record in records) == reconnects >= 1
    # Told at the start and after every loss, but for a connection that is lost again before it can be told.
    assert 2 <= len(sent) <= reconnects + 1
    assert set(sent) == {b"ST"}


def test_silence_is_not_blamed_on_what_was_said_before_it(pty):
    device = small_device()
    with LiveSource([pty[1]], device) as source:
        os.write(pty[0], message(device, 1))
        source.read(1.0)
        os.write(pty[0], message(device, 1) * 3)
        in_time(source, 1.5, "the device fell silent 1.* s ago")


def test_answers_that_come_too_late_are_called_that(pty):
    stop = threading.Event()

    def answer_late():
        os.set_blocking(pty[0], False)
        while not stop.wait(0.002):
            with suppress(BlockingIOError):
                question = parse_request(os.read(pty[0], 256)[:15])
                time.sleep(0.3)
                # The last of the settings: the sensor has 1 element
                data = bytes(question.count - 1) + b"\x01"
                os.write(pty[0], write_reply(Reply(question.address, False, question.id, 0, data)))

    thread = threading.Thread(target=answer_late)
    with LiveSource([pty[1]], singletact(taxels=1)) as source:
        thread.start()
        try:
            in_time(source, 1.5, "answers come more than 0.25 s after their questions")
        finally:
            stop.set()
            thread.join()


def test_the_accumulator_of_the_device_file_makes_torn_frames_whole():
    """With one sample a frame a sensor measures 32 times as fast as it is shipped, more than can be read whole."""
    device = singletact(taxels=25, accumulator=0)
    with (
        serving(emulate(device, ramp(device), rate=500.0)) as url,
        LiveSource([url], device) as source,
        pytest.raises(NoReading, match=r"changed while they were read.*accumulator in the device file"),
    ):
        for _ in range(100):
            source.read(0.3)
    slower = singletact(taxels=25, accumulator=5)
    with serving(emulate(slower, ramp(slower), rate=140.0)) as url, LiveSource([url], slower) as source:
        assert len([source.read(5.0) for _ in range(5)]) == 5


def test_the_number_of_ports_must_fit(paper_pad):
    with pytest.raises(SourceError, match="has 1 port; 2 were given"):
        LiveSource(["a", "b"], paper_pad)
