"""MCAP: a scan as a log that Foxglove plays back: images of the taxels, poses, and the exact readings as JSON.

Topics: `/tactile` (foxglove.RawImage, the taxels over the scan's largest reading, the row of largest y on top), `/pose`
(foxglove.PoseInFrame, m), `/reading` (tactsim.Reading, exact, in the scan's units) and, of sequences, `/frame`
(tactsim.Frame). A press takes a second, or as many as its sequence. The attached `scan.npz` is what is read back.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.writer import Writer
from numpy.typing import NDArray

from tactsim.core import InputError, Scan
from tactsim.core.files import open_regular
from tactsim.core.npz import LARGEST

_SCAN = "scan.npz"


def write_scan(scan: Scan, stream: IO[bytes]) -> None:
    """Write a scan as one log, from 0 s on, a press after the other. Raises InputError if it takes centuries."""
    times = scan.sequence_times
    last = 0.0 if times is None else max(0.0, float(times[-1]))
    period = math.floor(last) + 1.0  # s that a press takes in the log
    if len(scan) * period > 2**63 / 1e9:
        raise InputError(f"mcap counts ns in 64 bits, and {len(scan):,} presses take {period:,.0f} s each")
    writer = Writer(stream, enable_data_crcs=True)
    writer.start(profile="", library="tactsim")
    with TemporaryDirectory() as folder:
        scan.save(Path(folder, _SCAN))
        writer.add_attachment(0, 0, _SCAN, "application/zip", Path(folder, _SCAN).read_bytes())
    channels: dict[str, int] = {}

    def say(topic: str, schema_name: str, seconds: float, message: dict[str, Any]) -> None:
        time = round(1e9 * seconds)
        message = {"timestamp": {"sec": time // 10**9, "nsec": time % 10**9}, **message}
        if topic not in channels:
            schema = json.dumps({"title": schema_name, **_schema(message)}).encode()
            number = writer.register_schema(schema_name, "jsonschema", schema)
            channels[topic] = writer.register_channel(topic, "json", number)
        content = json.dumps(message, ensure_ascii=False).encode()
        writer.add_message(channels[topic], log_time=time, publish_time=time, data=content)

    draw = _drawing(scan)
    for row, (x, y, theta) in enumerate(scan.poses.tolist()):
        begin = end = row * period
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(theta / 2), "w": math.cos(theta / 2)}
        pose = {"position": {"x": x / 1000, "y": y / 1000, "z": 0.0}, "orientation": turn}
        say("/pose", "foxglove.PoseInFrame", begin, {"frame_id": "object", "pose": pose})
        if times is None or scan.sequence is None or scan.sequence_force is None:
            say("/tactile", "foxglove.RawImage", begin, draw(scan.readings[row]))
        else:
            for frame, taxels in enumerate(scan.sequence[row]):
                end = begin + max(0.0, float(times[frame]))
                say("/tactile", "foxglove.RawImage", end, draw(taxels))
                exact = {"force": float(scan.sequence_force[row, frame]), "taxels": taxels.tolist()}
                say("/frame", "tactsim.Frame", end, {"row": row, "frame": frame, **exact})
        reading = {"row": row, "label": str(scan.labels[row]), "split": str(scan.split[row])}
        reading |= {"pose": [x, y, theta], "taxels": scan.readings[row].tolist()}
        say("/reading", "tactsim.Reading", end, reading)
    writer.finish()


def read_scan(path: Path) -> Scan:
    """Read the attached scan. Raises InputError if the file is not whole or none is attached."""
    with TemporaryDirectory() as folder, open_regular(path) as stream:
        try:
            attachments = SeekingReader(stream, True, record_size_limit=LARGEST).iter_attachments()
            attached = next((one for one in attachments if one.name == _SCAN), None)
        except (McapError, ValueError, OverflowError, struct.error) as error:
            raise InputError(f"it is no whole MCAP file: {type(error).__name__} {error}".rstrip()) from error
        if attached is None:
            raise InputError(f"it has no {_SCAN}: tactsim did not write it, or did so before version 0.2")
        Path(folder, _SCAN).write_bytes(attached.data)
        return Scan.load(Path(folder, _SCAN))


def _schema(value: Any) -> dict[str, Any]:
    """Describe a message in JSON's own words; a list is one of numbers."""
    if isinstance(value, dict):
        properties = {name: _schema(part) for name, part in value.items()}
        properties.get("data", {})["contentEncoding"] = "base64"
        return {"type": "object", "properties": properties}
    if isinstance(value, list):
        return {"type": "array", "items": {"type": "number"}}
    return {"type": {int: "integer", float: "number", str: "string"}[type(value)]}


def _drawing(scan: Scan) -> Callable[[NDArray[Any]], dict[str, Any]]:
    """Make the function that draws taxels as they lie on the pad: 32FC1, where the scan's largest reading is 1.

    A taxel that the pad does not have, or that is left out, is 0, and so is what is below 0.
    """
    columns, rows = (np.unique(np.round(scan.taxel_xy[:, axis], 4), return_inverse=True) for axis in (0, 1))
    height, width, places = len(rows[0]), len(columns[0]), (len(rows[0]) - 1 - rows[1], columns[1])
    if height * width > 4 * len(scan.taxel_xy):  # they lie in no rows and columns
        height, width = 1, len(scan.taxel_xy)
        places = (np.zeros(width, dtype=int), np.arange(width))
    largest = max(float(scan.readings.max()), 1e-12)

    def draw(taxels: NDArray[Any]) -> dict[str, Any]:
        picture = np.zeros((height, width), "<f4")
        picture[places] = np.clip(taxels / largest, 0, 1)
        data = base64.b64encode(picture.tobytes()).decode()
        size = {"width": width, "height": height, "encoding": "32FC1", "step": 4 * width}
        return {"frame_id": "sensor", **size, "data": data}

    return draw
