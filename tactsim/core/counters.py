"""Count what happens between a device's bytes and its readings."""

from __future__ import annotations

from dataclasses import asdict, dataclass

# What people are shown where a counter's name says too little.
_WORDS = {
    "torn": "frames that changed while they were read",
    "impossible": "frames with impossible values",
    "stale": "answers made of old bytes",
    "strays": "answers that nobody asked for",
    "unpaired": "frames without those of the other parts",
}


def counter_words(name: str) -> str:
    """Say what a counter counts."""
    return _WORDS.get(name, name.replace("_", " "))


@dataclass
class Counters:
    """Counts since a source was opened. Its recording and the commands of the real pad show them."""

    bytes: int = 0  # received
    frames: int = 0  # decoded whole
    readings: int = 0  # returned, each made of one frame of every part
    garbage_bytes: int = 0  # that belong to no frame
    resyncs: int = 0  # runs of garbage between frames
    bad_checksums: int = 0  # frames that agree with the device file in all but their checksum
    missed: int = 0  # frames that the device's counter shows to be lost
    torn: int = 0  # frames that changed while they were read
    impossible: int = 0  # frames with a value that the device cannot say
    # The same frame again: the host reads faster than the device measures, or the device hangs.
    repeats: int = 0
    stale: int = 0  # answers that the bridge made up from old bytes
    strays: int = 0  # answers to a request that was not made, and frames of an unknown part
    timeouts: int = 0  # requests without an answer
    unpaired: int = 0  # frames to which those of the other parts, of the same moment, did not come
    clock_restarts: int = 0  # the device's clock ran backwards, so the device was reset
    reconnects: int = 0  # links lost and opened again

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)
