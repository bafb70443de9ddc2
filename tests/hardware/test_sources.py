"""One contract for every source: a port (pty and TCP), recordings, the simulated pad and a plug-in."""

from contextlib import ExitStack

import numpy as np
import pytest
from made_pads import csv_device, ramp, serving, small_device

from tactsim.core import InputError, plug_ins
from tactsim.core.reading import Reading
from tactsim.hardware import sources
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.counters import Counters
from tactsim.hardware.emulator import emulate
from tactsim.hardware.errors import SourceEnded, SourceError
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Recorder, RecordReader
from tactsim.hardware.sources import Source, open_source


class Foreign(Source):
    """A driver of somebody else's."""

    def __init__(self, device):
        self.pad, self.taxel_xy, self.counters = device.pad, device.pad.taxel_xy, Counters()

    def read(self, timeout=None):
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

    def __init__(self, name="foreign", load=lambda: open_foreign):
        self.name, self.load = name, load


@pytest.fixture
def plug_in(monkeypatch):
    """Pretend that a package with a source is installed, beside those that are."""
    real = plug_ins.entry_points
    points = [Point()]
    monkeypatch.setattr(plug_ins, "entry_points", lambda group: [*real(group=group), *points])
    return points


@pytest.fixture(params=["pty", "tcp", "recording", "recorded-readings", "csv", "simulated", "foreign"])
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
            yield f"recording:{tmp_path / 'a.csv'}", csv_device()
        elif request.param == "simulated":
            yield "simulated:A@3.4,-3.4,0.5", device
        else:
            yield "foreign:anything", device


def test_every_source_gives_readings_of_its_pad(opened):
    place, device = opened
    with open_source([place], device) as source:
        readings = [source.read(5.0) for _ in range(20)]
        assert source.taxel_xy.shape == (6, 2)
        assert source.pad == device.pad
        assert source.counters.readings >= 20
    assert all(reading.pressures.shape == (6,) for reading in readings)
    assert not any(reading.pressures.flags.writeable for reading in readings)
    times = [reading.host_time for reading in readings]
    assert times == sorted(times)


def test_every_source_is_corrected_alike(opened):
    place, device = opened
    calibration = Calibration.model_validate(
        {
            "device": "small", "port": "p", "taken": "2026-01-01T00:00:00Z", "frames": 50, "tare": (1000.0,) * 6,
            "noise": (0.1,) * 6, "gain": (1.0,) * 6, "dead": (1,),
        }
    )  # fmt: skip
    with open_source([place], device, calibration) as source:
        reading = source.read(5.0)
        assert source.taxel_xy.shape == (5, 2)
    assert reading.pressures.shape == (5,)
    assert (reading.pressures < -500).all()


def test_every_source_can_be_recorded_and_replayed_bit_for_bit(opened, tmp_path):
    place, device = opened
    with Recorder(tmp_path / "copy") as recorder:
        recorder.segment({"device": device.as_json()}, 0.0)
        with open_source([place], device, log=recorder) as source:
            live = [source.read(5.0) for _ in range(20)]
    again = list(Replay(tmp_path / "copy"))
    assert len(again) >= 20
    for one, other in zip(live, again, strict=False):
        assert np.array_equal(one.pressures, other.pressures)
        assert (one.host_time, one.device_time, one.index) == (
            other.host_time, other.device_time, other.index
        )  # fmt: skip
    assert sum(1 for _ in RecordReader(tmp_path / "copy")) > 1


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
    content = {
        "device": "small", "port": "p", "taken": "2026-01-01T00:00:00Z", "frames": 50, "tare": (1.0,) * 6,
        "noise": (0.1,) * 6, "gain": (2.0,) * 6, "stuck": (0,),
    }  # fmt: skip
    calibration = Calibration.model_validate(content)
    with Recorder(tmp_path / "a") as recorder:
        recorder.segment(
            {"device": device.as_json(), "calibration": calibration.model_dump(mode="json")}, 0.0
        )
        recorder.reading(Reading(np.full(6, 3.0), 0.0))
    place = f"recording:{tmp_path / 'a'}"
    with open_source([place], device) as source:
        assert source.read().pressures.tolist() == [4.0] * 5
        assert source.taxel_xy.shape == (5, 2)
    with pytest.raises(SourceError, match="calibration of its own"):
        open_source([place], device, calibration)


def test_sources_are_listed_with_their_status(plug_in):
    def broken():
        raise ImportError("no module named 'vendor'")

    plug_in += [Point("broken", broken), Point("port"), Point("nothing", lambda: 3)]
    rows = {row.name + row.status[:6]: row for row in sources.listing()}
    assert rows["portbuilt "].summary.startswith("a sensor on a serial port")
    assert rows["foreignfrom s"].summary == "A driver of somebody else's."
    assert "no module named 'vendor'" in rows["brokenplug-i"].status
    assert rows["porthidden"].status == "hidden by the built-in of that name"
    assert "opens a source" in rows["nothingplug-i"].status
    assert "simulated" in sources.names()


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("recordin:x", "unknown source 'recordin': did you mean 'recording'"),
        ("recording:/nothing/here", "cannot read recording /nothing/here: No such file"),
        ("simulated:?@0,0,0", "unknown letter"),
        ("simulated:A@0,0", "a pose is written x,y,theta"),
        ("simulated:A@0,0,nan", "a pose is written x,y,theta"),
    ],
)
def test_a_place_that_is_none_is_one_line(place, message):
    with pytest.raises(InputError, match=message):
        open_source([place], small_device())
