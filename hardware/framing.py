"""Cut a stream of bytes into packets, whatever chunks it comes in."""

from __future__ import annotations

from typing import Generic

from tactsim.core.counters import Counters
from tactsim.hardware.codecs.codec import Codec, CodecError, Packet


class Framer(Generic[Packet]):
    """Give a codec what has come so far; the buffer never holds more than one chunk and an unfinished packet."""

    def __init__(self, codec: Codec[Packet], counters: Counters) -> None:
        self._codec, self._counters = codec, counters
        self._buffer = bytearray()
        self._in_garbage = False

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes in and return the packets that they complete.

        Raises CodecError if the codec asks for more bytes though it has `longest` of them: that is its bug,
        and the buffer would grow without end.
        """
        buffer, packets, at = self._buffer, [], 0
        buffer += data
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
            at += used
            if packet is not None:
                packets.append(packet)
                self._in_garbage = False
            else:
                self._counters.garbage_bytes += used
                self._counters.resyncs += not self._in_garbage
                self._in_garbage = True
        del buffer[:at]
        return packets

    def reset(self) -> None:
        """Forget the beginning of a packet: its rest will not come."""
        self._counters.garbage_bytes += len(self._buffer)
        self._buffer.clear()
        self._in_garbage = False

    def __len__(self) -> int:
        """Count the bytes that wait for more."""
        return len(self._buffer)
