"""Codecs by the kind in a device file: built-in ones and those of an installed package, and the contract of each."""

from functools import cache

import numpy as np
import pytest
from made_pads import ramp, serving
from plugging import install_plug_in

from tactsim.hardware.codecs import codec_registry as registry
from tactsim.hardware.codecs.codec import Codec, CodecError
from tactsim.hardware.device import Device, load_device
from tactsim.hardware.emulator import emulate
from tactsim.hardware.live import LiveSource
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Recorder
from tactsim.hardware.stream import Stream

KNOCKS = '''
"""A codec of somebody else's: each taxel is one character, "A" for 0 kPa and "B" for `step_kpa`, and so on."""
import numpy as np
from pydantic import Field
from tactsim.hardware.codecs.codec import Codec, CodecFormat, Frame

class Knocks(CodecFormat):
    """Letters for pressures."""
    taxels: int = Field(ge=1)
    step_kpa: float = Field(gt=0)
    def build(self):
        return KnocksCodec(self)

class KnocksCodec(Codec):
    def __init__(self, form):
        self.form, self.taxels, self.longest = form, form.taxels, form.taxels + 1
    def decode(self, buffer, start=0):
        end = buffer.find(b"\\n", start, start + self.longest)
        if end < 0:
            return (1, None) if len(buffer) - start >= self.longest else (0, None)
        line = bytes(buffer[start:end])
        whole = len(line) == self.taxels and all(b"A"[0] <= byte <= b"Z"[0] for byte in line)
        return end + 1 - start, Frame(np.frombuffer(line, np.uint8) - 65.0) if whole else None
    def encode(self, frame):
        return bytes((frame.values + 65).astype(np.uint8)) + b"\\n"
    def to_kpa(self, values):
        return values * self.form.step_kpa
    def from_kpa(self, pressures):
        return np.clip(np.round(pressures / self.form.step_kpa), 0, 25)
'''
DEVICE = """
name = "knocking"
[codec]
kind = "knocks"
taxels = 6
step_kpa = 0.5
[pad]
rows = 2
columns = 3
no_seam = true
"""


@pytest.fixture
def knocking(tmp_path, monkeypatch):
    """Install the package, and write a device file that uses it."""
    (tmp_path / "knocks.py").write_text(KNOCKS)
    install_plug_in(tmp_path, monkeypatch, group=registry.GROUP, knocks="knocks:Knocks")
    (tmp_path / "knocking.toml").write_text(DEVICE)
    return tmp_path / "knocking.toml"


def test_an_installed_codec_is_listed_and_reads_a_port(knocking, tmp_path):
    (row,) = (row for row in registry.listing() if row.name == "knocks")
    assert (row.summary, row.status) == ("Letters for pressures.", "from plugged")
    assert "knocks" in registry.names()
    device = load_device(knocking)
    with serving(emulate(device, ramp(device), 100.0)) as url, Recorder(tmp_path / "copy") as recorder:
        recorder.segment({"device": device.as_json()}, 0.0)
        with LiveSource([url], device, recorder) as source:
            live = [source.read(5.0) for _ in range(5)]
    # The recording names the codec and holds all of its keys.
    again = [reading for reading, _ in zip(Replay(tmp_path / "copy"), range(5), strict=False)]
    for one, other in zip(live, again, strict=True):
        assert np.array_equal(one.pressures, other.pressures)
        assert (one.pressures >= 0).all()
        assert (np.diff(one.pressures) >= 0).all()


def test_a_codec_that_only_reads_cannot_be_emulated(knocking, monkeypatch):
    device = load_device(knocking)
    monkeypatch.setattr(type(device.codec.build()), "encode", Codec.encode)
    with pytest.raises(CodecError, match="KnocksCodec writes no frames, so its device cannot be emulated"):
        emulate(device, lambda now: np.zeros(device.pad.taxels), rate=10.0)


every_codec = pytest.mark.parametrize("kind", registry.names())


@cache
def device_of(kind):
    """A pad of one row with the codec at its example keys."""
    fields = registry.load(kind).model_fields
    keys = {
        name: field.examples[0] for name, field in fields.items() if field.is_required() and name != "kind"
    }
    codec = {"kind": kind} | keys
    taxels = registry.load(kind).model_validate(codec).build().taxels
    return Device.model_validate(
        {"name": kind, "codec": codec, "pad": {"rows": 1, "columns": taxels, "no_seam": True}}
    )


def rising(device):
    """Pressures that differ in every taxel and rise with time."""
    return lambda now: 5.0 + np.arange(device.pad.taxels) * 0.5 + 2.0 * now


@cache
def conversation(kind):
    """What a device says in a second: the time and the bytes of each message, and the readings made of them."""
    device = device_of(kind)
    try:
        emulated, stream = emulate(device, rising(device), rate=50.0), Stream(device)
        emulated.hear(stream.greeting(0), 0.0)
        said, readings = [], []
        for now in np.arange(200) * 0.005:
            if request := stream.request(0, now):
                stream.sent(0, request, now)
                emulated.hear(request, now)
            for message in emulated.say(now):
                said.append(message)
                readings += stream.received(0, message, now)
    except CodecError as error:
        pytest.skip(str(error))
    return said, readings


@every_codec
def test_a_device_file_of_it_reads_back_as_it_was_written(kind):
    device = device_of(kind)
    assert Device.model_validate(device.as_json()) == device
    assert device.codec.kind == kind
    assert device.build_codec().longest > 0


@every_codec
def test_the_pressures_on_an_emulated_device_are_read(kind):
    device = device_of(kind)
    _, readings = conversation(kind)
    assert len(readings) >= 10
    codec = device.build_codec()
    times = np.linspace(-0.05, 1.0, 2101)
    possible = np.array([codec.to_kpa(codec.from_kpa(rising(device)(time))) for time in times])
    for reading in readings:
        assert reading.pressures.shape == (device.pad.taxels,)
        # Some moment explains all taxels, up to the step of a number that is written in text.
        assert np.abs(possible - reading.pressures).max(axis=1).min() < 0.02
    assert (np.diff([reading.pressures[0] for reading in readings]) >= 0).all()
