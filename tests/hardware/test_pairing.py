"""Each reading's values come from one moment of the device, or there is no reading, whatever of each part is lost."""

import os
import tty
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_pads import LAYOUT, PAD, singletact, small_device

from tactsim.core.source import NoReading
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.device import Device
from tactsim.hardware.emulator import emulate
from tactsim.hardware.live import LiveSource
from tactsim.hardware.stream import Stream

HEADER, INDEX = {"is": "header", "bytes": "AA 55"}, {"is": "index", "size": 2}
TAXELS, FOOTER = {"is": "taxels", "count": 6, "bits": 16}, {"is": "footer", "bytes": "0D 0A"}
PARTS = [[0, 1, -1, -1, -1, -1], [-1, -1, 2, 3, -1, -1], [-1, -1, -1, -1, 4, 5]]
PERIOD = 0.01  # s from one frame to the next


def pad_of_parts(ports, items, **device):
    """A pad of as many parts as `ports` names a port for, each of which has six taxels."""
    wires = [list(taxels) for taxels in PARTS[: len(ports)]]
    wires[-1] = [k if all(k not in wire for wire in wires[:-1]) else -1 for k in range(6)]
    parts = [
        {"port": port, "address": at, "taxels": wire}
        for at, (port, wire) in enumerate(zip(ports, wires, strict=True))
    ]
    layout = [HEADER, {"is": "address"}, *items, TAXELS, FOOTER]
    codec = {"kind": "fields", "kpa_per_count": 1.0, "layout": layout}
    return Device.model_validate({"name": "parts", "codec": codec, "pad": PAD, "part": parts} | device)


def says(device, part, moment, first=0):
    """Write what a part says of a moment: its values are the moment's number."""
    values = np.full(6, float(moment))
    return device.codec.build().encode(Frame(values, part, (first + moment) % 65536, 0))


wirings = st.sampled_from([[0, 0], [0, 1], [1, 0, 0], [0, 1, 2], [0, 0, 0]])


@settings(max_examples=15)
@given(wirings, st.integers(0, 65535), st.integers(0, 60), st.randoms(use_true_random=False))
def test_by_the_counter_no_loss_joins_two_moments(ports, first, losses, random):
    """Frames of every part are lost, links lag behind each other, come in lumps and are lost themselves."""
    device = pad_of_parts(ports, [INDEX])
    stream, queues = Stream(device), {port: [] for port in ports}
    share = losses / 100
    for moment in range(60):
        for part, port in enumerate(ports):
            if random.random() >= share:
                queues[port].append((moment, says(device, part, moment, first)))
    readings, now = [], 0.0
    while any(queues.values()):
        port = random.choice([port for port, queue in queues.items() if queue])
        count = random.randint(1, 12)
        lump, queues[port] = queues[port][:count], queues[port][count:]
        now += 1e-3
        readings += stream.received(port, b"".join(message for _, message in lump), now)
        if random.random() < share / 10:
            stream.lost(port, now)
    moments = [set(reading.pressures.tolist()) for reading in readings]
    assert all(len(moment) == 1 for moment in moments)
    numbers = [moment.pop() for moment in moments]
    assert numbers == sorted(set(numbers))
    assert [reading.index for reading in readings] == [(first + number) % 65536 for number in numbers]
    if not losses:
        assert len(readings) == 60
    waiting = sum(len(framer._buffer) for framer in stream._framers)
    moments = [frames for _, frames in stream._pairing._moments.values()]
    waiting += sum(frame.values.nbytes for moment in moments for frame in moment.values())
    assert waiting < 100 * len(ports) * 100
    assert every_frame_is_accounted_for(stream, readings)


def every_frame_is_accounted_for(stream, readings):
    """Tell whether each frame that was heard is in a reading or counted as unpaired, those that still wait too."""
    stream.lost(0, 1e6)
    return sum(stream.heard.values()) == len(stream.heard) * len(readings) + stream.counters.unpaired


@settings(max_examples=15)
@given(wirings, st.integers(0, 60), st.randoms(use_true_random=False))
def test_by_a_stated_time_no_loss_joins_two_moments(ports, losses, random):
    """There is no counter. Each frame comes some time after its moment, and a stalled reader finds several at once."""
    device = pad_of_parts(ports, [], pair_within_s=0.4 * PERIOD)
    stream, readings = Stream(device), []
    arrivals = []
    for moment in range(60):
        for part, port in enumerate(ports):
            if 100 * random.random() >= losses:
                late = 0.2 * PERIOD * random.random()
                arrivals.append((moment * PERIOD + late, port, says(device, part, moment)))
    arrivals.sort(key=lambda arrival: arrival[0])
    stalls = [random.uniform(0, 60 * PERIOD) for _ in range(losses // 10)]
    came = [(read_at(when, stalls), port, when, message) for when, port, message in arrivals]
    came.sort(key=lambda arrival: arrival[:3])
    for (now, port), messages in groupby(came, key=lambda arrival: arrival[:2]):
        *_, when, lump = zip(*messages, strict=True)
        if set(when) == {now}:  # the reader was waiting
            readings += stream.received(port, b"", now)
        readings += stream.received(port, b"".join(lump), now)
    assert all(len(set(reading.pressures)) == 1 for reading in readings)
    if not losses:
        assert len(readings) == 60
    assert every_frame_is_accounted_for(stream, readings)


def read_at(when, stalls):
    """Give the time at which a byte is read that came at `when`: a reader stalls for three frames."""
    for stall in sorted(stalls):
        if stall <= when < stall + 3 * PERIOD:
            when = stall + 3 * PERIOD
    return when


@settings(max_examples=10)
@given(st.integers(0, 40), st.integers(0, 1000))
def test_sensors_that_are_asked_are_joined_by_the_bridges_clock(losses, seed):
    """The pressure rises all the time, so each value tells when it was measured."""
    parts = [{"address": 5, "taxels": [0, 1]}, {"address": 6, "taxels": [2, 3]}]
    device = singletact(2, parts)
    device = device.model_copy(update={"pair_within_s": 0.05})
    emulated = emulate(device, lambda now: np.full(4, 20 * now), rate=100.0)
    stream, rng, readings = Stream(device), np.random.default_rng(seed), []
    for step in range(400):
        now = step * 0.005
        if request := stream.request(0, now):
            stream.sent(0, request, now)
            emulated.hear(request, now)
        for message in emulated.say(now):
            if 100 * rng.random() >= losses:
                readings += stream.received(0, message, now + 0.002)
    moments = np.array([reading.pressures for reading in readings]).reshape(-1, 4) / 20
    if not losses:
        assert len(readings) > 70
    # A frame's period, and half a count of each
    assert np.ptp(moments, axis=1).max(initial=0.0) <= 0.05 + 1 / 100 + 0.2 / 20


CRC = {"is": "checksum", "kind": "crc16-modbus"}
FRAMINGS = {
    "header and checksum": [HEADER, TAXELS, CRC], "header": [HEADER, TAXELS], "footer": [TAXELS, FOOTER],
    "neither": [TAXELS, CRC], "lines": None,
}  # fmt: skip


@pytest.mark.parametrize("layout", FRAMINGS.values(), ids=FRAMINGS)
def test_a_frame_has_its_own_time_though_its_neighbour_says_where_it_begins_or_ends(layout):
    """The two parts measure 1 ms apart, every 10 ms."""
    codec = {"kind": "csv", "taxels": 6} if layout is None else {"kind": "fields", "layout": layout}
    parts = [
        {"port": at, "taxels": wire} for at, wire in enumerate(([0, 1, 2, -1, -1, -1], [-1] * 3 + [3, 4, 5]))
    ]
    device = Device.model_validate(
        {"name": "two", "codec": codec | {"kpa_per_count": 1.0}, "pad": PAD, "part": parts,
         "pair_within_s": 0.004}
    )  # fmt: skip
    stream, readings = Stream(device), []
    for moment in range(1, 101):
        for port in range(2):
            now = moment * PERIOD + port * 0.001
            stream.received(port, b"", now)
            readings += stream.received(port, says(device, 0, moment), now + 0.0005)
    assert len(readings) >= 99  # of the first or the last one the neighbour is missing
    assert all(len(set(reading.pressures)) == 1 for reading in readings)


def test_a_late_answer_may_be_as_old_as_the_first_question():
    """Asked again, the part answers what it was asked before; the other part's frame is 0.2 s younger."""
    device = pad_of_parts([0, 1], [], pair_within_s=0.1)
    device = device.model_copy(update={"codec": device.codec.model_copy(update={"request": b"?"})})
    stream = Stream(device)
    stream.sent(0, b"?", 1.0)
    stream.sent(0, b"?", 1.26)
    stream.sent(1, b"?", 1.26)
    assert stream.received(0, says(device, 0, 1), 1.27) == []
    assert stream.received(1, says(device, 1, 2), 1.28) == []


def test_a_counter_that_comes_round_again_pairs_with_nothing_old():
    """One part says 7 and both are silent until the other's counter has come round to 7 again."""
    device = pad_of_parts([0, 0], [INDEX])
    stream = Stream(device)
    assert stream.received(0, says(device, 0, 7), 0.0) == []
    assert stream.received(0, says(device, 1, 7), 131.0) == []
    for moment in (30_000, 60_000, 7):  # within the deadline, so that a frame takes the place of an older one
        stream.received(0, says(device, 1, moment), 131.0)
    assert stream.counters.unpaired == 2
    assert every_frame_is_accounted_for(stream, [])


def test_a_device_that_begins_anew_is_joined_with_nothing_of_before():
    device = pad_of_parts([0, 0], [INDEX])
    stream = Stream(device)
    for index in (900, 901):
        stream.received(0, says(device, 1, index), 0.0)
    stream.received(0, says(device, 0, 901), 0.0)
    assert stream.received(0, says(device, 0, 950), 0.1) == []  # and then it is reset
    assert stream.received(0, says(device, 0, 3), 0.2) == []
    (reading,) = stream.received(0, says(device, 1, 3), 0.2) + stream.received(
        0, says(device, 0, 4) + says(device, 1, 4), 0.3
    )
    assert set(reading.pressures) == {4.0}
    assert reading.after_loss
    assert stream.received(0, says(device, 1, 950), 0.4) == []


@contextmanager
def two_ports(folder):
    """Two ports that can be unplugged; gives their names and a function that plugs both in, anew if need be."""
    masters, names = [], [str(folder / "left"), str(folder / "right")]

    def plug():
        for master in masters:
            os.close(master)
        masters.clear()
        for name in names:
            master, slave = os.openpty()
            tty.setraw(slave)
            Path(name).unlink(missing_ok=True)
            Path(name).symlink_to(os.ttyname(slave))
            os.close(slave)
            masters.append(master)
        return masters

    plug()
    try:
        yield names, plug, masters
    finally:
        for master in masters:
            os.close(master)


def test_halves_from_before_and_after_an_unplugged_cable_are_not_joined(tmp_path):
    device = pad_of_parts([0, 1], [INDEX])
    with two_ports(tmp_path) as (names, plug, masters), LiveSource(names, device) as source:
        os.write(masters[0], says(device, 0, 5))
        with pytest.raises(NoReading, match="nothing from the part at address 1"):
            source.read(0.3)
        plug()
        with pytest.raises(NoReading):
            source.read(1.0)
        os.write(masters[1], says(device, 1, 5))
        with pytest.raises(NoReading):
            source.read(0.3)
        assert source.counters.reconnects == 2
        for port in range(2):
            os.write(masters[port], says(device, port, 6))
        reading = source.read(5.0)
    assert set(reading.pressures) == {6.0}
    assert reading.after_loss


@pytest.mark.parametrize("index", [[], [{"is": "index", "size": 1}]])
def test_parts_without_a_counter_that_lasts_need_a_stated_time(index):
    with pytest.raises(ValueError, match="state pair_within_s"):
        pad_of_parts([0, 1], index)
    assert pad_of_parts([0, 1], index, pair_within_s=0.02).ports == 2
    assert small_device(codec={"layout": [LAYOUT[0], TAXELS]}).ports == 1
