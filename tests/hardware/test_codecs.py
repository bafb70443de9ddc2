"""What holds for every codec, whatever bytes come in whatever chunks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_pads import csv_device, described, line_device, singletact, small_device

from tactsim.core.counters import Counters
from tactsim.hardware.codecs import codec_registry as registry
from tactsim.hardware.codecs.codec import Codec, CodecError, Frame, Framer
from tactsim.hardware.codecs.singletact import Reply, write_reply


def small_messages(count, rng):
    form = small_device().codec.build()
    return form, [
        form.encode(Frame(rng.integers(0, 4096, 6).astype(float), index=k, ticks=k)) for k in range(count)
    ]


def headed_messages(count, rng):
    """Frames without checksum or footer, whose payload may look like headers."""
    layout = [{"is": "header", "bytes": "FF FE"}, {"is": "index"}, {"is": "taxels", "count": 5, "bits": 8}]
    form = described(layout, 5).codec.build()
    values = rng.choice([0x00, 0x11, 0xFD], size=(count, 5)).astype(float)
    return form, [form.encode(Frame(row, index=k)) for k, row in enumerate(values)]


def singletact_messages(count, rng):
    form = singletact().codec.build()
    data = rng.choice([0x00, 0x01, 0xFF, 0xFE, 0xAA], size=(count, 32)).astype(np.uint8)
    return form, [write_reply(Reply(4, False, k % 256, k, row.tobytes())) for k, row in enumerate(data)]


def csv_messages(count, rng):
    form = csv_device().codec.build()
    rows = [form.encode(Frame(rng.normal(size=6).round(3), ticks=10.0 * k)) for k in range(count)]
    return form, [b"\n" + rows[0], *rows[1:]]


def footed_messages(count, rng):
    """Floats of three axes without a header. The first message begins with the end of the one before."""
    taxels = {"is": "taxels", "count": 3, "bits": 32, "float": True, "axes": 3, "normal": 2}
    form = described([taxels, {"is": "footer", "bytes": "0D 0A"}], 3, endian="little").codec.build()
    values = rng.normal(size=(count, 3)).astype(np.float32).astype(float)
    messages = [form.encode(Frame(row)) for row in values]
    return form, [b"\r\n" + messages[0], *messages[1:]]


def crc_messages(count, rng):
    """Nothing but values and a CRC. The first message begins with the one before."""
    layout = [{"is": "index"}, {"is": "taxels", "count": 4}, {"is": "checksum", "kind": "crc32"}]
    form = described(layout, 4).codec.build()
    values = rng.integers(0, 65536, size=(count + 1, 4)).astype(float)
    messages = [form.encode(Frame(row, index=k)) for k, row in enumerate(values)]
    return form, [messages[0] + messages[1], *messages[2:]]


def line_messages(count, rng):
    """An Arduino's lines. The first one begins with the end of the one before."""
    form = line_device(4, before=["index", "clock"], checksum="crc16-ccitt").codec.build()
    values = rng.integers(0, 1024, size=(count, 4)).astype(float)
    messages = [form.encode(Frame(row, index=k, ticks=10 * k)) for k, row in enumerate(values)]
    return form, [b"\n" + messages[0], *messages[1:]]


MAKERS = {
    "fields": small_messages, "fields-header-only": headed_messages, "fields-footer-only": footed_messages,
    "fields-crc-only": crc_messages, "singletact": singletact_messages, "csv": line_messages,
    "pps-csv": csv_messages,
}  # fmt: skip
# In these a frame is told by its neighbours.
BY_NEIGHBOURS = (headed_messages, footed_messages, crc_messages, line_messages, csv_messages)
every_codec = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)


def test_a_line_with_a_right_checksum_is_no_wrong_one():
    form, (first, second) = line_messages(2, np.random.default_rng(0))
    assert form.fails_checksum(first[:1] + second, 0) is False
    flipped = bytearray(first[:1] + second)
    flipped[3] = ord("7") if flipped[3] != ord("7") else ord("8")
    assert form.fails_checksum(bytes(flipped), 0) is True
    # Its index is no whole number: wrong, but not for its checksum.
    numbers = b"1.5,2,3,4,5,6"
    line = b"\n" + numbers + form._sum(numbers) + b"\r\n"
    assert form.fails_checksum(line, 0) is False


def test_every_codec_that_comes_along_is_tried_here():
    assert {name.removesuffix("-only").removesuffix("-header").removesuffix("-footer").removesuffix("-crc")
            for name in MAKERS} == set(registry.BUILT_IN)  # fmt: skip


def key(packet):
    """Make packets comparable."""
    return (
        packet if isinstance(packet, Reply) else (packet.address, packet.index, packet.ticks, *packet.values)
    )


def read(form, chunks):
    counters = Counters()
    framer = Framer(form, counters)
    arrived = [one for chunk in chunks for one in framer.feed(chunk, 0.0)]
    return [key(one.packet) for one in arrived], counters, framer


def chunks_of(data, lengths):
    at = 0
    for length in lengths:
        yield data[at : at + length]
        at += length
    yield data[at:]


@every_codec
@settings(max_examples=50)
@given(
    garbage=st.one_of(
        st.just(b""),
        st.binary(max_size=300),
        st.lists(st.sampled_from(b"\xff\xfe\xaa\x55\r\n\x04T,1"), max_size=80),
    ),
    where=st.integers(0, 12),
    lengths=st.lists(st.integers(0, 60), max_size=60),
    seed=st.integers(0, 5),
)
def test_any_chunking_of_a_stream_whole_or_spoiled_gives_the_same_frames(make, garbage, where, lengths, seed):
    form, messages = make(12, np.random.default_rng(seed))
    stream = b"".join([*messages[:where], bytes(garbage), *messages[where:]])
    whole, _, _ = read(form, [stream])
    chunked, counters, _ = read(form, chunks_of(stream, lengths))
    assert chunked == whole
    assert counters.bytes == len(stream)
    if not garbage:
        assert len(whole) >= 11  # the last one may wait for the next header
        assert counters.garbage_bytes == 0


@pytest.mark.parametrize("make", [small_messages, singletact_messages], ids=["fields", "singletact"])
@given(garbage=st.binary(max_size=300), where=st.integers(0, 12))
def test_garbage_between_frames_costs_none(make, garbage, where):
    form, messages = make(12, np.random.default_rng(0))
    expected, _, _ = read(form, messages)
    found, counters, _ = read(form, [*messages[:where], garbage, *messages[where:], messages[-1]])
    assert found[:12] == expected
    assert counters.garbage_bytes == len(garbage)


@every_codec
@settings(max_examples=50)
@given(garbage=st.binary(min_size=1, max_size=200), at=st.integers(0, 400), lost=st.integers(0, 200))
def test_a_burst_costs_at_most_the_frames_it_touches(make, garbage, at, lost):
    """Bytes are overwritten, lost or added somewhere; every frame that they do not touch is read.

    Where a frame is told by its neighbours, a burst touches these, too.
    """
    form, messages = make(12, np.random.default_rng(1))
    stream = b"".join(messages)
    at = min(at, len(stream))
    spoiled = stream[:at] + garbage + stream[at + lost :]
    ends = np.cumsum([len(message) for message in messages])
    starts = ends - [len(message) for message in messages]
    reach = 1 if make in BY_NEIGHBOURS else 0
    untouched = [
        k for k in range(reach, 12 - reach) if ends[k + reach] <= at or starts[k - reach] >= at + max(lost, 1)
    ]
    expected = read(form, [stream, messages[-1]])[0]
    found = read(form, [spoiled, messages[-1]])[0]
    assert [k for k in untouched if expected[k] not in found] == []


@every_codec
@settings(max_examples=100)
@given(data=st.lists(st.binary(max_size=200), max_size=20))
def test_a_fuzzed_codec_raises_nothing_and_keeps_little(make, data):
    form, _ = make(1, np.random.default_rng(0))
    _, counters, framer = read(form, data)
    assert len(framer._buffer) < form.longest
    assert counters.bytes == sum(map(len, data))


def test_a_codec_that_waits_for_ever_is_named():
    class Stuck(Codec):
        longest = 4

        def decode(self, buffer, start=0):
            return 0, None

        to_kpa = from_kpa = None

    with pytest.raises(CodecError, match="Stuck waits for more than the 4 bytes"):
        Framer(Stuck(), Counters()).feed(b"1234", 0.0)
