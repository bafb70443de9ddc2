"""What happened on the way from bytes to readings, counted."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass
class Counters:
    """Counts since a source was opened; they end up in its recording and in every report."""

    bytes: int = 0  # received
    frames: int = 0  # decoded whole
    readings: int = 0  # given out: one frame of every part
    garbage_bytes: int = 0  # in no frame
    resyncs: int = 0  # runs of garbage between frames
    missed: int = 0  # frames that the device's counter shows to be lost
    torn: int = 0  # frames that changed while they were read
    repeats: int = 0  # the same frame again: read faster than the device measures, or it hangs
    stale: int = 0  # answers that the bridge made up from old bytes
    strays: int = 0  # answers to a question that was not asked, frames of an unknown part
    timeouts: int = 0  # questions without an answer
    unpaired: int = 0  # frames replaced by a newer one before the other parts' had come
    clock_restarts: int = 0  # the device's clock ran backwards: it was reset
    reconnects: int = 0  # links lost and opened again

    def as_dict(self) -> dict[str, int]:
        """List the counts by name."""
        return asdict(self)
