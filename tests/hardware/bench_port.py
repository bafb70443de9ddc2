"""Read an emulated pad from a pty for some seconds: frames a second, and the share of a core that it takes.

    python tests/hardware/bench_port.py [FRAMES_A_SECOND] [SECONDS]

The device runs in a process of its own, so only the reader's processor time counts.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from typing import Any

import numpy as np

from tactsim.hardware.device import load_device
from tactsim.hardware.emulator import Faults, emulate, serve_pty
from tactsim.hardware.live import LiveSource


def serve(rate: float, names: Any) -> None:
    """Speak at `rate` frames a second of each array until killed."""
    device = load_device("emulated")
    pressures = np.linspace(0, 50, device.pad.taxels)
    serve_pty(
        emulate(device, lambda now: pressures, rate), Faults(), np.random.default_rng(0), ready=names.put
    )


def main(rate: float = 500.0, seconds: float = 5.0) -> None:
    """Print the rate that was read and what it took."""
    context = multiprocessing.get_context("spawn")
    names = context.Queue()
    process = context.Process(target=serve, args=(rate, names), daemon=True)
    process.start()
    try:
        with LiveSource([names.get(timeout=30)], load_device("emulated")) as source:
            source.read(10.0)
            before, start, used = source.counters.frames, time.monotonic(), time.process_time()
            while time.monotonic() - start < seconds:
                source.read(10.0)
            elapsed, used = time.monotonic() - start, time.process_time() - used
            frames = source.counters.frames - before
    finally:
        process.kill()
    print(
        f"{frames / elapsed:.0f} frames a second, {100 * used / elapsed:.1f} % of a core, {source.counters}"
    )


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
