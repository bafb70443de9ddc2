"""One contract for every source: a port (pty and TCP), recordings, the simulated pad and a plug-in."""

from contextlib import ExitStack

import numpy as np
import pytest
from made_pads import calibration, csv_device, ramp, serving, small_device

from tactsim.core import InputError, plug_ins
from tactsim.core.counters import Counters
from tactsim.core.reading import Reading
from tactsim.core.source import Source, SourceEnded, SourceError
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.emulator import emulate
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Recorder
from tactsim.hardware.sources import Checked, Corrected, Paced, Recorded, open_source


class Foreign(Source):
    """A driver of somebody else's."""

    def __init__(self, device):
        self.pad, self.taxel_xy, self.counters = device.pad, device.pad.taxel_xy, Counters()
        self.closed = False

    def read(self, timeout=None):
        if self.closed:
            raise SourceError("it was closed")
        self.counters.readings += 1
        return Reading(np.arange(float(len(self.taxel_xy))), self.counters.readings * 0.01)

    def close(self):
        self.closed = True


def open_foreign(places, device, log):
    """A driver of somebody else's."""
    return Foreign(device)


class Point:
    """An installed package's entry point."""

    name, value, dist = "foreign", "somewhere:open_foreign", None

    def load(self):
        return open_foreign


@pytest.fixture
def plug_in(monkeypatch):
    """Pretend that a package with a source is installed, beside those that are."""
    real = plug_ins.entry_points
    monkeypatch.setattr(plug_ins, "entry_points", lambda group: [*real(group=group), Point()])


@pytest.fixture(params=["pty", "tcp", "recording", "recorded-readings", "csv", "log", "simulated", "foreign"])
def opened(request, tmp_path, plug_in):
    """A place to open, and its device."""
    device = small_device()
    with ExitStack() as stack:
        if request.param in ("pty", "tcp"):
            yield stack.enter_context(serving(emulate(device, ramp(device), 100.0), on=request.param)), device
        elif request.param == "recording":
            with Recorder(tmp_path / "a") as recorder:
                recorder.segment({"device": device.as_json()}, 0.0)
                for message in emulate(device, ramp(device), 100.0).say(0.5):
                    recorder.received(0, message, 1.0)
            yield f"recording:{tmp_path / 'a'}", device
        elif request.param == "recorded-readings":
            with Recorder(tmp_path / "a") as recorder:
                recorder.segment({"device": device.as_json()}, 0.0)
                for k in range(50):
                    recorder.reading(Reading(np.arange(6.0), 0.01 * k))
            yield f"recording:{tmp_path / 'a'}", device
        elif request.param == "csv":
            lines = ["Time [ms]," + ",".join(f"Elem{k}" for k in range(6))]
            lines += [",".join(map(str, [10 * k, *range(6)])) for k in range(50)]
            (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
            yield f"recording:{tmp_path / 'a.csv'}", csv_device(unit="count")
        elif request.param == "log":
            lines = [f"12:00:{k / 100:06.3f} -> 0,1,2,3,4,{k}" for k in range(50)]
            (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
            yield f"recording:{tmp_path / 'a.log'}", csv_device(kind="csv", kpa_per_count=1.0)
        elif request.param == "simulated":
            yield "simulated:A@3.4,-3.4,0.5", device
        else:
            yield "foreign:anything", device


def test_every_source_gives_readings_of_its_pad_and_is_recorded_and_replayed_bit_for_bit(opened, tmp_path):
    place, device = opened
    with Recorder(tmp_path / "copy") as recorder:
        recorder.segment({"device": device.as_json()}, 0.0)
        with open_source([place], device, log=recorder) as source:
            live = [source.read(5.0) for _ in range(20)]
            assert source.taxel_xy.shape == (6, 2)
            assert source.pad == device.pad
            assert source.counters.readings >= 20
    assert all(reading.pressures.shape == (6,) for reading in live)
    assert not any(reading.pressures.flags.writeable for reading in live)
    times = [reading.host_time for reading in live]
    assert times == sorted(times)
    again = list(Replay(tmp_path / "copy"))
    assert len(again) >= 20
    for one, other in zip(live, again, strict=False):
        assert np.array_equal(one.pressures, other.pressures)
        assert (one.host_time, one.device_time, one.index) == (
            other.host_time, other.device_time, other.index
        )  # fmt: skip


def test_every_source_is_corrected_alike(opened):
    place, device = opened
    heavy = CALIBRATION.model_copy(update={"tare": (1000.0,) * 6})
    with open_source([place], device) as source:
        unit = source.unit
    with open_source([place], device, heavy) as source:
        reading = source.read(5.0)
        assert source.unit == unit
        assert source.taxel_xy.shape == (5, 2)
    assert reading.pressures.shape == (5,)
    assert (reading.pressures < -500).all()


CALIBRATION = calibration(gain=(2.0,) * 6, stuck=(0,))
WRAPPERS = {
    "corrected": lambda source, folder: Corrected(source, CALIBRATION, "it"),
    "recorded": lambda source, folder: Recorded(source, Recorder(folder / "wrapped")),
    "checked": lambda source, folder: Checked(source, "it"),
}


def two_segments(path, *calibrations, counts=(20, 7)):
    """Record readings in two segments, each with its calibration or None; returns the place to open."""
    device = small_device()
    with Recorder(path) as recorder:
        for count, known in zip(counts, calibrations, strict=True):
            content = known and known.model_dump(mode="json")
            recorder.segment({"device": device.as_json(), "calibration": content}, 0.0)
            for k in range(count):
                recorder.reading(Reading(np.full(6, 3.0), 0.01 * k))
    return f"recording:{path}"


@pytest.mark.parametrize("kind", [None, *WRAPPERS])
def test_all_segments_are_counted_through_every_wrapper(tmp_path, kind):
    with open_source([two_segments(tmp_path / "a", None, None)], small_device()) as source:
        source = WRAPPERS[kind](source, tmp_path) if kind else source
        assert len(list(source)) == 27
        assert source.counters.readings == 27
        assert "2 segments" in source.summary()


def test_bytes_and_clock_restarts_of_all_segments_are_counted(tmp_path):
    """Each segment begins with a clock and a frame counter of its own; the counts go on."""
    device = small_device()
    frames = [device.codec.build().encode(Frame(np.zeros(6), index=k, ticks=k)) for k in (900, 3)]
    with Recorder(tmp_path / "a") as recorder:
        for _ in range(2):
            recorder.segment({"device": device.as_json()}, 0.0)
            for at, frame in enumerate(frames):
                recorder.received(0, frame, 0.01 * at)
    with open_source([f"recording:{tmp_path / 'a'}"], device) as source:
        assert len(list(source)) == 4
        assert source.counters.bytes == 2 * sum(map(len, frames))
        assert source.counters.missed == 0


def test_a_calibration_that_begins_within_a_recording_is_not_applied_twice(tmp_path):
    whole = CALIBRATION.model_copy(update={"stuck": ()})
    place = two_segments(tmp_path / "a", None, whole)
    with open_source([place], small_device(), CALIBRATION) as source:
        for _ in range(20):
            assert source.read().pressures.tolist() == [4.0] * 5
        with pytest.raises(SourceError, match="calibration of its own"):
            source.read()


def test_segments_that_leave_out_other_taxels_are_not_mixed(tmp_path):
    """As many taxels are left, but not the same ones."""
    place = two_segments(tmp_path / "a", CALIBRATION, CALIBRATION.model_copy(update={"stuck": (1,)}))
    with (
        open_source([place], small_device()) as source,
        pytest.raises(SourceError, match="leave out different taxels"),
    ):
        list(source)


def test_a_source_with_an_end_says_so(tmp_path):
    device = small_device()
    with Recorder(tmp_path / "a") as recorder:
        recorder.segment({"device": device.as_json()}, 0.0)
        recorder.reading(Reading(np.zeros(6), 0.0))
    with open_source([f"recording:{tmp_path / 'a'}"], device) as source:
        source.read()
        with pytest.raises(SourceEnded, match="no more readings"):
            source.read()


def test_a_recording_with_a_calibration_takes_no_other(tmp_path):
    device = small_device()
    place = two_segments(tmp_path / "a", CALIBRATION, CALIBRATION)
    for given in (None, CALIBRATION):  # it changes nothing to name the same again
        with open_source([place], device, given) as source:
            assert source.read().pressures.tolist() == [4.0] * 5
            assert source.taxel_xy.shape == (5, 2)
    with pytest.raises(SourceError, match="calibration of its own"):
        open_source([place], device, calibration(gain=(3.0,) * 6))


@pytest.mark.parametrize(
    ("place", "message"),
    [("recordin:x", "unknown source 'recordin': did you mean 'recording'"),
     ("port", "cannot open port: there is no such port"),
     ("simulated:?@0,0,0", "unknown letter"), ("simulated:A@0,0,nan", "a pose is written x,y,theta")],
)  # fmt: skip
def test_a_place_that_is_none_is_one_line(place, message):
    with pytest.raises(InputError, match=message):
        open_source([place], small_device())


class Listed(Source):
    def __init__(self, times):
        self._times = list(times)
        self.counters = Counters()

    def read(self, timeout=None):
        if not self._times:
            raise SourceEnded("over")
        return Reading(np.zeros(1), self._times.pop(0))

    def close(self):
        pass


class Clock:
    def __init__(self):
        self.now = 100.0

    def sleep(self, seconds):
        self.now += seconds


def played(times, busy=0.0):
    clock = Clock()
    given = []
    for reading in Paced(Listed(times), lambda: clock.now, clock.sleep):
        given.append((reading.host_time - 100.0, clock.now - 100.0))
        clock.now += busy
    return np.array(given)


def test_readings_come_when_they_did():
    times = [5.0, 5.1, 5.15, 5.9]
    np.testing.assert_allclose(played(times, busy=0.01), np.array([times, times]).T - 5.0)


def test_long_pauses_and_clocks_that_go_back_are_cut_short():
    np.testing.assert_allclose(played([5.0, 500.0, 3.0])[:, 1], [0.0, 1.0, 1.0])


def test_a_reader_that_was_away_does_not_make_it_hurry():
    given = played(np.arange(0, 6, 0.1), busy=1.6)
    assert (np.diff(given[:, 1]) >= 1.6 - 1e-9).all()
    assert (given[:, 1] - given[:, 0] <= 1.0 + 1.6).all()
