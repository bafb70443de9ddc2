import numpy as np
import pytest
from made_pads import small_device

from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.stream import DeviceClock, Stream

HALF = {"taxels": [0, 1, 2, -1, -1, -1]}


def test_frames_of_parts_that_are_not_listed_are_strays(paper_pad):
    stream = Stream(paper_pad)
    form = paper_pad.codec.build()
    assert stream.received(0, form.encode(Frame(np.zeros(24), 3, 0, 0)), 0.0) == []
    assert stream.counters.strays == 1


@pytest.mark.parametrize(
    ("indices", "missed", "repeats"),
    [([1, 2, 3], 0, 0), ([1, 5], 3, 0), ([65534, 65535, 0, 2], 1, 0), ([7, 7, 8], 0, 1), ([900, 3, 4], 0, 0)],
)
def test_the_frame_counter_tells_what_was_missed(indices, missed, repeats):
    device = small_device()
    form, stream = device.codec.build(), Stream(device)
    for index in indices:
        stream.received(0, form.encode(Frame(np.zeros(6), index=index)), 0.0)
    assert (stream.counters.missed, stream.counters.repeats) == (missed, repeats)


def test_a_lost_link_forgets_the_half_frame():
    device = small_device()
    form, stream = device.codec.build(), Stream(device)
    message = form.encode(Frame(np.zeros(6), index=1))
    stream.received(0, message[:10], 0.0)
    stream.lost(0, 0.1)
    assert stream.received(0, message[10:], 0.2) == []
    assert len(stream.received(0, message, 0.3)) == 1
    assert stream.counters.reconnects == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"part": [{"taxels": [0, 1, 2, 3, 4]}]}, "part 0 lists 5 taxels, but the codec's frames have 6"),
        ({"part": [{"taxels": [0, 1, 2, 3, 4, 4]}]}, "in parts 0 and 0"),
        ({"part": [{"taxels": [0, 1, 2, 3, 4, -1]}]}, "taxel 5 of the pad is in no part"),
        ({"part": [{"port": 1}]}, "numbered 0, 1, 2"),
        ({"part": [HALF, {"taxels": [-1, -1, -1, 3, 4, 5]}]}, "same port and address"),
        ({"part": [{"taxels": [0, 1, 2, 3, 4, 5], "first_column": "left"}]}, "leave out first_row and first"),
    ],
)
def test_wiring_that_makes_no_sense_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        small_device(**change)


@pytest.mark.parametrize(
    ("part", "taxels"),
    [({}, [0, 1, 2, 3, 4, 5]), ({"first_row": "top"}, [3, 4, 5, 0, 1, 2]),
     ({"first_column": "left"}, [2, 1, 0, 5, 4, 3]),
     ({"first_row": "top", "first_column": "left"}, [5, 4, 3, 2, 1, 0])],
)  # fmt: skip
def test_a_device_may_begin_at_each_corner(part, taxels):
    """Taxel 0 has the lowest x and y. Seen from above, +x is to the left, so it lies at the bottom right."""
    device = small_device(part=[part])
    assert device.wiring(device.part[0]).tolist() == taxels


def test_a_reading_after_a_silence_says_so_though_the_port_stayed_open():
    device = small_device()
    form, stream = device.codec.build(), Stream(device)
    late = device.deadline
    said = [
        stream.received(0, form.encode(Frame(np.zeros(6), index=index)), now)[0].after_loss
        for index, now in enumerate([9.0, 9.0 + late, 9.5 + 2 * late, 9.6 + 2 * late])
    ]
    assert said == [False, False, True, False]


@pytest.mark.parametrize("wrap", [1 << 16, 1 << 32])
def test_a_clock_that_wraps_goes_on(wrap):
    clock = DeviceClock(1e-3, wrap)
    times = wrap * 1e-3 - 0.05 + np.arange(100) * 0.01
    got = [clock.seconds(round(time / 1e-3) % wrap, time + 7) for time in times]
    assert np.allclose(np.diff(got), 0.01)
    assert clock.restarts == 0


def test_a_pause_of_several_wraps_is_told_by_the_hosts_clock():
    clock = DeviceClock(1e-3, 1 << 16)  # wraps every 65.5 s
    first = clock.seconds(1000, 0.0)
    later = clock.seconds((1000 + 300_000) % 65536, 300.2)
    assert later - first == pytest.approx(300.0)


def test_a_clock_that_restarts_follows_the_host():
    clock = DeviceClock(1e-4, 1 << 32)
    first = clock.seconds(5_000_000, 10.0)
    again = clock.seconds(20, 12.5)
    assert again - first == pytest.approx(2.5)
    assert clock.restarts == 1
    assert clock.seconds(1020, 12.6) - again == pytest.approx(0.1)
