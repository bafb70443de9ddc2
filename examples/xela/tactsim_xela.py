"""XELA's uSkin sensors as a source of readings: xela:HOST:PORT/NUMBER.

XELA's server sends JSON over a WebSocket, a message for each moment (as in github.com/mcsix/xela_server_ros2, MIT):

    {"message": 5548, "1": {"model": "uSPa44", "time": 1695.9, "taxels": 16, "calibrated": [x, y, z, x, ...]}}

Forces are in N, taxel by taxel from the top left, line by line. The first message of all is {"message": "Welcome"}.
"""

from __future__ import annotations

import asyncio
import json
import math
import queue
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from tornado.httpclient import HTTPError
from tornado.websocket import websocket_connect

from tactsim.core.counters import Counters
from tactsim.core.reading import Reading
from tactsim.core.source import HasPad, Log, NoReading, Source, SourceError

_PATIENCE = 5.0  # s for the first connection, and for a reading if the caller says nothing
_RETRY = 0.5  # s between attempts to connect again
_WAITING = 1000  # readings that wait for a slow reader; then the oldest are dropped


class XelaSource(Source):
    """The normal pressures of one sensor that XELA's server reads.

    A thread listens, so that each reading has the time at which it came, and the server never waits for the reader.
    """

    def __init__(self, url: str, sensor: str, device: HasPad) -> None:
        """Connect. Raises SourceError if no server answers."""
        self.pad, self.taxel_xy, self.counters = device.pad, device.pad.taxel_xy, Counters()
        self._url, self._sensor = url, sensor
        self._kpa_per_n = 1e3 / (self.pad.taxel_width * self.pad.taxel_height)  # 1 N/mm^2 is 1000 kPa
        rows = np.arange(self.pad.taxels).reshape(self.pad.rows, self.pad.columns)
        self._from_bottom = rows[::-1].ravel()  # the server begins at the top, the pad at the bottom
        self._arrived: queue.Queue[Reading | SourceError] = queue.Queue()
        self._connected, self._closed = threading.Event(), False
        self._trouble = "it does not answer"
        self._last_index: int | None = None
        self._after_loss = False
        self._loop = asyncio.new_event_loop()
        self._task = self._loop.create_task(self._listen())
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        if not self._connected.wait(_PATIENCE):
            self.close()
            raise SourceError(f"no XELA server at {url}: {self._trouble}. Is xela_server running?")

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading; see `Source.read`."""
        if self._closed:
            raise SourceError(f"{self._url} was closed")
        patience = _PATIENCE if timeout is None else timeout
        try:
            arrived = self._arrived.get(timeout=patience)
        except queue.Empty:
            why = f"sensor {self._sensor} says nothing" if self._connected.is_set() else self._trouble
            raise NoReading(f"no reading from {self._url} in {patience:g} s: {why}") from None
        if isinstance(arrived, SourceError):
            raise arrived
        self.counters.readings += 1
        return arrived

    def close(self) -> None:
        """Disconnect."""
        if not self._closed:
            self._closed = True
            self._loop.call_soon_threadsafe(self._task.cancel)
            self._thread.join()
            self._loop.close()

    def _run(self) -> None:
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._task)

    async def _listen(self) -> None:
        """Take in messages for ever; connect again when the connection is lost."""
        while True:
            try:
                connection = await websocket_connect(self._url, connect_timeout=_PATIENCE)
            except (OSError, HTTPError) as error:
                self._trouble = str(error)
                await asyncio.sleep(_RETRY)
                continue
            self._connected.set()
            try:
                while (message := await connection.read_message()) is not None:
                    self.counters.bytes += len(message)
                    self._take(message, time.monotonic())
            finally:
                connection.close()
            self._connected.clear()
            self._trouble = "the server closed the connection"
            self.counters.reconnects += 1
            self._after_loss, self._last_index = True, None

    def _take(self, message: str | bytes, now: float) -> None:
        """Make a reading of a message, if it holds one of the sensor."""
        try:
            content = json.loads(message)
            index, entry = content["message"], content.get(self._sensor)
        except (ValueError, TypeError, KeyError, AttributeError):
            self.counters.garbage_bytes += len(message)
            return
        if not isinstance(index, int) or not isinstance(entry, dict):  # a greeting, or other sensors only
            self.counters.strays += 1
            return
        self.counters.frames += 1
        if index == self._last_index:
            self.counters.repeats += 1
            return
        if self._last_index is not None and index > self._last_index:
            self.counters.missed += index - self._last_index - 1
        self._last_index = index
        reading = self._reading(entry, index, now)
        if reading is not None:
            self._after_loss = self._after_loss and isinstance(reading, SourceError)
            self._arrived.put(reading)
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        """Make room if too many wait, and let the oldest that is left say that readings before it are lost."""
        with self._arrived.mutex:
            waiting = self._arrived.queue
            if len(waiting) > _WAITING:
                waiting.popleft()
                self.counters.missed += 1
                if isinstance(oldest := waiting[0], Reading):
                    waiting[0] = replace(oldest, after_loss=True)

    def _reading(self, entry: dict[str, Any], index: int, now: float) -> Reading | SourceError | None:
        forces, taxels = entry.get("calibrated"), self.pad.taxels
        if not isinstance(forces, list) or not forces:
            return SourceError(
                f"{self._url} sends no forces for sensor {self._sensor}: have xServ.ini calibrate it"
            )
        if len(forces) != 3 * taxels:
            return SourceError(
                f"sensor {self._sensor} of {self._url} ({entry.get('model')}) has {len(forces) // 3} taxels, the "
                f"device file {taxels}"
            )
        if not all(isinstance(force, int | float) and math.isfinite(force) for force in forces):
            self.counters.impossible += 1
            return None
        normal = np.array(forces[2::3], dtype=float)[self._from_bottom]
        seconds = entry.get("time")
        return Reading(
            normal * self._kpa_per_n,
            now,
            float(seconds) if isinstance(seconds, int | float) else None,
            index,
            self._after_loss,
        )


def open_source(places: Sequence[str], device: HasPad, log: Log | None) -> Source:
    """Read a sensor of XELA's server: xela:HOST:PORT/NUMBER."""
    if len(places) != 1:
        raise SourceError(f"one XELA sensor is one place; {len(places)} were given")
    address, _, sensor = places[0].partition("/")
    host, _, port = address.partition(":")
    if not host or not port.isdigit() or not (sensor or "1").isdigit():
        raise SourceError(f"write xela:HOST:PORT/NUMBER, such as xela:127.0.0.1:5000/1, not xela:{places[0]}")
    return XelaSource(f"ws://{host}:{port}", sensor or "1", device)
