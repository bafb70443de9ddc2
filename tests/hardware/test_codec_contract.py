"""The contract of every codec, the built-in ones and those of installed packages, at the example keys of its format."""

from functools import cache

import numpy as np
import pytest

from tactsim.hardware.codecs import codec_registry as registry
from tactsim.hardware.codecs.codec import CodecError
from tactsim.hardware.device import Device
from tactsim.hardware.emulator import emulate
from tactsim.hardware.stream import Stream

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
