"""The device files that come along, read from devices behind real ptys that were written from public documents."""

import numpy as np
import pytest
from public_devices import AnySkin, Arduino, DFRobot, FlexiTac, PaxiniBoard, PaxiniModule, on_a_pty

from tactsim.core.source import NoReading
from tactsim.hardware.device import built_in_devices, load_device
from tactsim.hardware.live import LiveSource

OWN = {"emulated", "singletact-5x5"}  # tested beside their codecs


def at_once(name):
    """A device file without the time that an Arduino takes to start."""
    return load_device(name).model_copy(update={"settle": 0.0})


def rows_up(picture):
    """The pad's rows run up; a picture's run down."""
    return np.array(picture, dtype=float)[::-1].ravel()


def picture(rows, columns, most, seed=0):
    return np.random.default_rng(seed).integers(0, most, (rows, columns)).tolist()


def three_axes(count, seed=0):
    rng = np.random.default_rng(seed)
    return [
        (int(rng.integers(-128, 128)), int(rng.integers(-128, 128)), int(rng.integers(0, 256)))
        for _ in range(count)
    ]


SIX, EIGHT = picture(6, 6, 4096), picture(4, 8, 4096)
FORCES = three_axes(9)
SKIN = [(20.0 + k, 1.5 * k, -2.5 * k, 100.25 * (k + 1)) for k in range(5)]  # t, x, y, z of each chip
FULL, SHORT = picture(16, 32, 1024, 3), picture(12, 32, 1024, 4)
PRINTED = picture(4, 4, 1024)
DEVICES = {
    "dfrobot-6x6": (DFRobot(SIX), rows_up(SIX)),
    "dfrobot-4x8": (DFRobot(EIGHT), rows_up(EIGHT)),
    "flexitac-16x32": (FlexiTac(FULL), rows_up(FULL) // 4),
    "flexitac-12x32": (FlexiTac(SHORT), rows_up(SHORT) // 4),
    "anyskin": (AnySkin(SKIN), [SKIN[chip][3] for chip in (1, 0, 2)]),
    "paxini-m2020": (PaxiniModule(1, FORCES), [z for _, _, z in FORCES]),
    "paxini-m2020-board": (PaxiniBoard(FORCES, (-30, 40, 200)), [z for _, _, z in FORCES]),
    "arduino-csv": (Arduino(PRINTED), rows_up(PRINTED)),
}


def test_every_device_file_that_comes_along_is_read_from_its_device():
    assert set(built_in_devices()) == set(DEVICES) | OWN


@pytest.mark.parametrize("name", DEVICES)
def test_each_taxel_is_read_where_its_document_puts_it(name):
    speaker, counts = DEVICES[name]
    device = at_once(name)
    with on_a_pty(speaker) as url, LiveSource([url], device) as source:
        readings = [source.read(5.0) for _ in range(5)]
        counters = source.counters
        assert (counters.bad_checksums, counters.timeouts, counters.torn) == (0, 0, 0)
        # What was on its way when the port was opened, and answers to the command that starts a device.
        assert counters.garbage_bytes <= device.codec.build().longest + 100
    for reading in readings:
        assert np.array_equal(reading.pressures, device.codec.kpa_per_count * np.asarray(counts))
    assert (np.diff(source.taxel_xy.reshape(device.pad.rows, -1, 2)[:, 0, 1]) > 0).all()


def test_the_arduinos_clock_is_read():
    with on_a_pty(Arduino(PRINTED)) as url, LiveSource([url], at_once("arduino-csv")) as source:
        times = [source.read(5.0).device_time for _ in range(5)]
    assert np.allclose(np.diff(times), 0.01)


def test_a_device_is_asked_no_more_often_than_it_measures():
    slave = DFRobot(SIX)
    with on_a_pty(slave) as url, LiveSource([url], at_once("dfrobot-6x6")) as source:
        for _ in range(6):
            source.read(5.0)
    # The slave looks every 2 ms and may see one question late and the next in time.
    assert len(slave.asked) <= 2 + (slave.asked[-1] - slave.asked[0]) / 0.05


@pytest.mark.parametrize(
    ("name", "speaker", "said"),
    [
        (
            "dfrobot-6x6",
            DFRobot(SIX, lambda answer: answer[:20] + bytes([answer[20] ^ 4]) + answer[21:]),
            "right but for their checksum",
        ),
        (
            "paxini-m2020-board",
            PaxiniBoard(FORCES, (0, 0, 0), error=7),
            "no whole frame .* comes, and not what is stated to follow it",
        ),
        ("paxini-m2020", PaxiniModule(2, FORCES), "not one byte came"),
        ("anyskin", AnySkin([(20.0, 0.0, 0.0, float("nan"))] * 5), "no whole frame"),
    ],
)
def test_what_is_not_the_device_or_says_an_error_is_no_reading(name, speaker, said):
    with (
        on_a_pty(speaker) as url,
        LiveSource([url], at_once(name)) as source,
        pytest.raises(NoReading, match=said),
    ):
        source.read(1.0)
