"""`Faults`: spoil what an emulated device sends, on request."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactsim.hardware.emulator.emulated import Pressures

_LONGEST_BURST = 200  # bytes


@dataclass(frozen=True)
class Faults:
    """How often each fault happens.

    drop, flip: probability that a byte is lost, or changed. torn: probability that a frame breaks off in its
    middle. garbage: probability of a burst of random bytes before a frame. drift: kPa a second that all
    taxels gain. disconnect: s after which the line is cut, again and again; 0 for never.
    """

    drop: float = 0.0
    flip: float = 0.0
    torn: float = 0.0
    garbage: float = 0.0
    drift: float = 0.0
    disconnect: float = 0.0

    def drifted(self, pressures: Pressures) -> Pressures:
        """Add the drift to what the pad would say."""
        return lambda now: pressures(now) + self.drift * now

    def spoil(self, message: bytes, rng: np.random.Generator) -> bytes:
        """Apply the faults to one frame and return the bytes that arrive."""
        if self.torn and rng.random() < self.torn:
            message = message[: rng.integers(len(message))]
        if self.flip:
            data = np.frombuffer(message, np.uint8).copy()
            hit = rng.random(len(data)) < self.flip
            data[hit] ^= rng.integers(1, 256, size=int(hit.sum()), dtype=np.uint8)
            message = data.tobytes()
        if self.drop:
            data = np.frombuffer(message, np.uint8)
            message = data[rng.random(len(data)) >= self.drop].tobytes()
        if self.garbage and rng.random() < self.garbage:
            message = rng.bytes(int(rng.integers(1, _LONGEST_BURST))) + message
        return message
