"""MCAP: a scan as a log that Foxglove plays back: images of the taxels, poses, and the exact readings as JSON.

Topics: `/tactile` (foxglove.RawImage, what the taxels say over the largest reading of the scan, the row of largest y on
top), `/pose` (foxglove.PoseInFrame, m), `/reading` (tactsim.Reading, the exact numbers in the scan's units) and, where
the scan has sequences, `/frame` (tactsim.Frame, the exact images of each press). A press takes a second, or as many as
its sequence needs.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from numpy.typing import NDArray

from tactsim.bench.formats.scan_document import document_of, loads_of, parts_of, presses_of
from tactsim.core import InputError, Scan
from tactsim.core.documents import parse_json
from tactsim.core.errors import short
from tactsim.core.files import read_bytes
from tactsim.core.npz import LARGEST
from tactsim.core.poses import FloatArray

_DOCUMENT = "tactsim"  # the name of the metadata that hold the rest of the scan
_LATEST_S = 2**63 / 1e9
_LARGEST_CHUNK = 64 << 20  # bytes; those that are written are of some 1 MiB

_NUMBER, _WHOLE, _TEXT = {"type": "number"}, {"type": "integer"}, {"type": "string"}
_TIME = {"type": "object", "title": "time", "properties": {"sec": _WHOLE, "nsec": _WHOLE}}
_XYZ = {"type": "object", "properties": dict.fromkeys("xyz", _NUMBER)}
_NUMBERS = {"type": "array", "items": _NUMBER}
_POSE = {"type": "object", "properties": {"position": _XYZ, "orientation": {
    "type": "object", "properties": dict.fromkeys("xyzw", _NUMBER)}}}  # fmt: skip
# What Foxglove goes by are the names of its own schemas and of their fields.
_SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.RawImage": {
        "timestamp": _TIME, "frame_id": _TEXT, "width": _WHOLE, "height": _WHOLE, "encoding": _TEXT, "step": _WHOLE,
        "data": _TEXT | {"contentEncoding": "base64"},
    },
    "foxglove.PoseInFrame": {"timestamp": _TIME, "frame_id": _TEXT, "pose": _POSE},
    "tactsim.Reading": {
        "row": _WHOLE, "label": _TEXT, "split": _TEXT, "pose": _NUMBERS | {"description": "x mm, y mm, theta rad"},
        "taxels": _NUMBERS,
    },
    "tactsim.Frame": {"row": _WHOLE, "frame": _WHOLE, "force": _NUMBER | {"description": "N"}, "taxels": _NUMBERS},
}  # fmt: skip
_TOPICS = {
    "/tactile": "foxglove.RawImage",
    "/pose": "foxglove.PoseInFrame",
    "/reading": "tactsim.Reading",
    "/frame": "tactsim.Frame",
}


def write_scan(scan: Scan, stream: IO[bytes]) -> None:
    """Write a scan as one log, from 0 s on, a press after the other."""
    if len(scan) * _period(scan) > _LATEST_S:
        raise InputError(
            f"mcap counts ns in 64 bits, and {len(scan):,} presses take {_period(scan):,.0f} s each"
        )
    writer = Writer(stream, enable_data_crcs=True)
    writer.start(profile="", library="tactsim")
    writer.add_metadata(_DOCUMENT, {"scan": json.dumps(document_of(scan), sort_keys=True)})
    channels = {}
    for topic, name in _TOPICS.items():
        if topic == "/frame" and scan.sequence is None:
            continue
        schema = {"title": name, "type": "object", "properties": _SCHEMAS[name]}
        number = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        channels[topic] = writer.register_channel(topic, "json", number)

    def say(topic: str, seconds: float, message: dict[str, Any]) -> None:
        time = round(1e9 * seconds)
        if _TOPICS[topic].startswith("foxglove."):
            message["timestamp"] = {"sec": time // 10**9, "nsec": time % 10**9}
        content = json.dumps(message, ensure_ascii=False).encode()
        writer.add_message(channels[topic], log_time=time, publish_time=time, data=content)

    draw = _drawing(scan)
    for row in range(len(scan)):
        _write_press(scan, row, draw, say)
    writer.finish()


def read_scan(path: Path) -> Scan:
    """Read a scan written by `write_scan`, from `/reading` and `/frame` alone. Raises InputError if it is not whole."""
    document: dict[str, Any] | None = None
    readings: list[dict[str, Any]] = []
    frames: list[dict[str, Any]] = []
    topics: dict[int, str] = {}
    for record in _records(read_bytes(path, LARGEST)):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Metadata) and record.name == _DOCUMENT:
            document = parse_json(record.metadata.get("scan", ""), f"its metadata {_DOCUMENT!r}")
        elif isinstance(record, Message) and topics.get(record.channel_id) in ("/reading", "/frame"):
            topic = topics[record.channel_id]
            into = readings if topic == "/reading" else frames
            into.append(_parsed(record.data, topic, len(into)))
    if document is None:
        raise InputError(f"it has no metadata {_DOCUMENT!r}: tactsim did not write it")
    taxel_xy, times, meta = parts_of(document)
    scan: dict[str, Any] = {
        "readings": _stacked(readings, "taxels", len(taxel_xy)),
        "poses": _stacked(readings, "pose", 3),
        **{to: _words(readings, name) for to, name in (("labels", "label"), ("split", "split"))},
    }
    if times is not None:
        count, taxels = len(readings), len(taxel_xy)
        if len(frames) != count * len(times):
            raise InputError(f"it has {len(frames):,} images of {count:,} presses at {len(times):,} times")
        for number, message in enumerate(frames):
            if (message["row"], message.get("frame")) != divmod(number, len(times)):
                raise InputError(
                    f"/frame: message {number:,} is not of the press and the time that come next"
                )
        images = _stacked(frames, "taxels", taxels).reshape(count, len(times), taxels)
        forces = np.array([message.get("force") for message in frames], dtype=object)
        scan |= {
            "sequence": images.astype(np.float32),
            "sequence_times": times,
            "sequence_force": _floats(forces, "force").reshape(count, len(times)).astype(np.float32),
        }
    return Scan(taxel_xy=taxel_xy, meta=meta, loads=loads_of(document), presses=presses_of(document), **scan)


def _write_press(
    scan: Scan,
    row: int,
    draw: Callable[[NDArray[Any]], dict[str, Any]],
    say: Callable[[str, float, dict[str, Any]], None],
) -> None:
    times = scan.sequence_times
    begin = row * _period(scan)
    pose, end = scan.poses[row], begin
    say("/pose", begin, {"frame_id": "object", "pose": _pose_in_m(pose)})
    if times is not None and scan.sequence is not None and scan.sequence_force is not None:
        end = begin + max(0.0, float(times[-1]))
        for frame, seconds in enumerate(times.tolist()):
            taxels, force = scan.sequence[row, frame], float(scan.sequence_force[row, frame])
            at = begin + max(0.0, seconds)
            say("/tactile", at, draw(taxels))
            say("/frame", at, {"row": row, "frame": frame, "force": force, "taxels": taxels.tolist()})
    else:
        say("/tactile", begin, draw(scan.readings[row]))
    label, split = str(scan.labels[row]), str(scan.split[row])
    taxels = scan.readings[row].tolist()
    say(
        "/reading", end, {"row": row, "label": label, "split": split, "pose": pose.tolist(), "taxels": taxels}
    )


def _period(scan: Scan) -> float:
    """Give the whole seconds that a press takes in the log."""
    return 1.0 if scan.sequence_times is None else max(1.0, math.floor(scan.sequence_times[-1]) + 1.0)


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
        picture = np.zeros((height, width))
        picture[places] = taxels
        data = np.clip(picture / largest, 0, 1).astype("<f4").tobytes()
        return {
            "frame_id": "sensor", "width": width, "height": height, "encoding": "32FC1", "step": 4 * width,
            "data": base64.b64encode(data).decode(),
        }  # fmt: skip

    return draw


def _pose_in_m(pose: FloatArray) -> dict[str, Any]:
    """Write a pose [x mm, y mm, theta rad] as Foxglove has them: metres, and the quaternion of a turn about z."""
    x, y, theta = pose.tolist()
    return {
        "position": {"x": x / 1000, "y": y / 1000, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(theta / 2), "w": math.cos(theta / 2)},
    }


def _records(content: bytes) -> Iterator[McapRecord]:
    """Read all records; a chunk says how large it is before it is unpacked. Raises InputError for a fault."""
    left = LARGEST
    try:
        for record in StreamReader(BytesIO(content), emit_chunks=True, validate_crcs=True).records:
            if not isinstance(record, Chunk):
                yield record
                continue
            size = record.uncompressed_size
            stated = (
                zstandard.frame_content_size(record.data)
                if record.compression == "zstd"
                else len(record.data)
            )
            if record.compression not in ("zstd", "") or stated != size or size > min(left, _LARGEST_CHUNK):
                raise InputError(
                    f"a chunk of {short(record.compression)} claims {size:,} bytes and holds {stated:,}; write it with "
                    f"zstd and chunks of at most {min(left, _LARGEST_CHUNK):,}"
                )
            left -= size
            yield from breakup_chunk(record, validate_crc=True)
    except (McapError, ValueError, OverflowError, struct.error, zstandard.ZstdError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"it is no whole MCAP file: {type(error).__name__} {error}".rstrip()) from error


def _parsed(content: bytes, topic: str, number: int) -> dict[str, Any]:
    message = parse_json(content, f"{topic}, message {number}")
    row = message.get("row")
    if not isinstance(row, int) or (topic == "/reading" and row != number):
        raise InputError(
            f"{topic}: message {number:,} says row {short(row)}; messages come in the order of the rows"
        )
    return message


def _stacked(messages: list[dict[str, Any]], name: str, length: int) -> FloatArray:
    for number, message in enumerate(messages):
        if not isinstance(message.get(name), list) or len(message[name]) != length:
            raise InputError(
                f"message {number:,}: {name} is {short(message.get(name))}, not {length} numbers"
            )
    return _floats(np.array([message[name] for message in messages], dtype=object), name).reshape(-1, length)


def _floats(values: NDArray[np.object_], name: str) -> FloatArray:
    if not all(type(value) in (int, float) for value in values.flat):
        raise InputError(f"a message's {name} is no number")
    return values.astype(np.float64)


def _words(messages: list[dict[str, Any]], name: str) -> NDArray[np.str_]:
    words = [message.get(name) for message in messages]
    for number, word in enumerate(words):
        if not isinstance(word, str) or not 0 < len(word) <= 100:
            raise InputError(f"message {number:,}: {name} is {short(word)}, no text of 1 to 100 characters")
    return np.array(words, dtype=np.str_)
