"""Cut a stream of bytes into packets, whatever chunks it comes in, and say when each packet began."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic

from tactsim.core.counters import Counters
from tactsim.hardware.codecs.codec import Codec, CodecError, Packet

LARGEST_CHUNK = 1 << 16  # bytes; behind a smaller one nothing was left to read when it came


@dataclass(frozen=True)
class Arrived(Generic[Packet]):
    """A packet and when it came, s: its first byte at `began`, its last at `ended`, and none before or at `after`."""

    packet: Packet
    began: float
    after: float
    ended: float


class Framer(Generic[Packet]):
    """Give a codec what has come so far; the buffer never holds more than one chunk and an unfinished packet."""

    def __init__(self, codec: Codec[Packet], counters: Counters) -> None:
        self._codec, self._counters = codec, counters
        self._buffer = bytearray()
        self._in_garbage = False
        self._last = float("-inf")  # when all that had come was last read
        self._chunks: deque[tuple[int, float, float]] = deque()  # (end in the buffer, came, not before or at)

    def feed(self, data: bytes, now: float) -> list[Arrived[Packet]]:
        """Take in bytes that came at `now` (s) and return the packets that they complete.

        No bytes say that nothing came until `now`. Raises CodecError if the codec asks for more bytes though
        it has `longest` of them: that is its bug, and the buffer would grow without end.
        """
        buffer, packets, at = self._buffer, [], 0
        buffer += data
        if data:
            self._chunks.append((len(buffer), now, self._last))
        if len(data) < LARGEST_CHUNK:
            self._last = max(self._last, now)
        self._counters.bytes += len(data)
        while at < len(buffer):
            used, packet = self._codec.decode(buffer, at)
            if used == 0:
                if len(buffer) - at >= self._codec.longest:
                    raise CodecError(
                        f"codec {type(self._codec).__name__} waits for more than the {self._codec.longest} "
                        "bytes that it calls its longest packet"
                    )
                break
            if packet is not None:
                first = at + self._codec.before
                while self._chunks[0][0] <= first:
                    self._chunks.popleft()
                ended = next((came for end, came, _ in self._chunks if end >= first + used), now)
                packets.append(Arrived(packet, *self._chunks[0][1:], ended))
                self._in_garbage = False
            else:
                self._counters.garbage_bytes += used
                self._counters.resyncs += not self._in_garbage
                self._counters.bad_checksums += self._codec.fails_checksum(buffer, at)
                self._in_garbage = True
            at += used
        del buffer[:at]
        self._chunks = deque((end - at, came, before) for end, came, before in self._chunks if end > at)
        return packets

    def reset(self) -> None:
        """Forget the beginning of a packet: its rest will not come."""
        self._counters.garbage_bytes += len(self._buffer)
        self._buffer.clear()
        self._chunks.clear()
        self._last = float("-inf")
        self._in_garbage = False
