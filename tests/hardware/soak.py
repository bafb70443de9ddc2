"""Read two devices at once for a long time, while all goes wrong that can: is any reading made up, does memory grow?"""

import gc
import json
import multiprocessing
import resource
import socket
import sys
import threading
import time
from dataclasses import dataclass, field

import numpy as np
import soak_devices
from made_pads import singletact

from tactsim.core.source import NoReading
from tactsim.hardware.device import load_device
from tactsim.hardware.live import LiveSource

_START = 120.0  # s within which a device must have said something
_WARM = 1 / 3  # share of the time after which memory is looked at for the first time
_LOOK, _LOOKS = 1 / 50, 20  # share of the time that a look at memory takes, and how often it counts blocks


class Losses:
    """A source's log that knows how often the link had been lost when the bytes of a reading came."""

    def __init__(self):
        self.count, self.when = 0, {}

    def received(self, link, data, time):
        self.when[time] = self.count
        if len(self.when) > 1000:
            del self.when[next(iter(self.when))]

    def sent(self, link, data, time):
        pass

    def lost(self, link, time):
        self.count += 1


@dataclass
class Found:
    """What was read of one device. invented: what is wrong with readings, the first few."""

    readings: int = 0
    silences: int = 0
    last: int = -1
    device_time: float = -1.0
    losses: int = 0
    invented: list = field(default_factory=list)
    counters: dict = field(default_factory=dict)
    faults: dict = field(default_factory=dict)
    error: str = ""


@dataclass
class Result:
    """How a soak ended.

    memory_kb: the most that was ever in use, blocks: how many Python had in use, after the first third and at the end.
    What waits to be read comes and goes, so the blocks are the fewest of a while. What leaks is among the fewest, too.
    reading: whether both devices were still being read then.
    """

    seconds: float
    devices: dict
    memory_kb: tuple
    blocks: tuple
    reading: bool
    cpu_share: float

    def __str__(self):
        growth = 60 * (self.memory_kb[1] - self.memory_kb[0]) / ((1 - _WARM) * self.seconds / 60)
        lines = [
            f"{self.seconds:.0f} s, {100 * self.cpu_share:.1f} % of a core; memory {self.memory_kb[0]:,} kB after a "
            f"third, {self.memory_kb[1]:,} kB at the end ({growth:+,.0f} kB an hour); blocks {self.blocks[0]:,} and "
            f"{self.blocks[1]:,}"
        ]
        for name, found in self.devices.items():
            counters = ", ".join(f"{word} {count:,}" for word, count in found.counters.items() if count)
            faults = ", ".join(f"{word} {count:,}" for word, count in found.faults.items())
            lines.append(
                f"{name}: {found.readings:,} readings ({found.readings / self.seconds:.0f} a second), "
                f"{len(found.invented)} invented, {found.silences} silences\n  faults: {faults}\n  counted: {counters}"
            )
        return "\n".join(lines)


def soak(seconds, folder, often=1.0, seed=0):
    """Read both devices for so many seconds once both have spoken; `often`: how many times as often all goes wrong."""
    context = multiprocessing.get_context("spawn")
    link, port = str(folder / "pad"), _free_port()
    array, url = singletact(soak_devices.SINGLETACT_TAXELS), f"socket://127.0.0.1:{port}"
    placed = {
        "arrays": (load_device("emulated"), link, link, 500, _moment_of_arrays),
        "bridge": (array, url, port, 20, _moment_of_bridge),
    }
    processes, threads, found = [], [], {}
    enough, stop = threading.Event(), context.Event()
    for name, (device, url, place, rate, moment) in placed.items():
        found[name] = Found()
        arguments = (name, place, rate, stop, seed, often, str(folder / f"{name}.json"))
        processes.append(context.Process(target=soak_devices.run, args=arguments, daemon=True))
        processes[-1].start()
        threads.append(threading.Thread(target=_read, args=(device, url, enough, moment, found[name])))
    for thread in threads:
        thread.start()
    started = time.monotonic() + _START
    while not all(one.readings or one.error for one in found.values()) and time.monotonic() < started:
        time.sleep(0.05)
    begun, used = time.monotonic(), time.process_time()
    time.sleep((_WARM - _LOOK) * seconds)
    warm = _memory(_LOOK * seconds)
    time.sleep((1 - _WARM - _LOOK) * seconds)
    # While both still read, since a source that is closed holds nothing any more.
    end, reading = _memory(_LOOK * seconds), all(thread.is_alive() for thread in threads)
    enough.set()
    for thread in threads:
        thread.join()
    elapsed = time.monotonic() - begun
    share = (time.process_time() - used) / elapsed
    stop.set()
    for name, process in zip(found, processes, strict=True):
        process.join(60)
        found[name].faults = json.loads((folder / f"{name}.json").read_text())
    return Result(elapsed, found, (warm[0], end[0]), (warm[1], end[1]), reading, share)


def _read(device, url, enough, moment_of, found):
    """Read a device until it is enough, and look whether each reading is of one moment."""
    losses, until = Losses(), time.monotonic() + _START
    try:
        while time.monotonic() < until:
            try:
                source = LiveSource([url], device, losses)
                break
            except Exception:  # the device is not there yet, or unplugged just now
                time.sleep(0.1)
        with source:
            while not enough.is_set() and (found.readings or time.monotonic() < until):
                try:
                    reading = source.read(0.5)
                except NoReading:
                    found.silences += 1
                    continue
                found.readings += 1
                _check(reading, moment_of(reading), losses.when[reading.host_time], found)
            found.counters = source.counters.as_dict()
    except Exception as error:
        found.error = f"{type(error).__name__}: {error}"


def _check(reading, moment, losses, found):
    wrong = ""
    if moment is None:
        wrong = "its values are of no one moment"
    elif moment <= found.last:
        wrong = f"moment {moment} after {found.last}"
    elif reading.device_time < found.device_time:
        wrong = f"its time {reading.device_time} is before {found.device_time}"
    elif losses > found.losses and not reading.after_loss:
        wrong = "the link was lost before it, and it does not say so"
    if wrong and len(found.invented) < 20:
        found.invented.append(f"reading {found.readings}: {wrong}")
    found.last = found.last if moment is None else moment
    found.device_time, found.losses = reading.device_time, losses


def _moment_of_arrays(reading):
    values = np.rint(reading.pressures / 0.7 + 512).astype(int).tolist()
    moment = values[0] << 24 | values[1] << 12 | values[2]
    return moment if values == soak_devices.arrays_at(moment) else None


def _moment_of_bridge(reading):
    values = np.rint(reading.pressures * 512 / 100 + 255).astype(int).tolist()
    moment = values[0] << 20 | values[1] << 10 | values[2]
    return moment if values == soak_devices.singletact_at(moment) else None


def _memory(seconds):
    """Look for so many seconds: the most memory that was ever in use, kB, and the fewest blocks."""
    blocks = []
    for _ in range(_LOOKS):
        time.sleep(seconds / _LOOKS)
        gc.collect()
        blocks.append(sys.getallocatedblocks())
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, min(blocks)


def _free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]
