"""What the harness and a plug-in's process say to each other: JSON with arrays behind it, nothing that is unpickled.

A message is a length, a JSON object, and the numbers of its arrays, float64, whose shapes the object names. What comes
from a plug-in is believed in nothing: sizes are limited, and every fault is a ValueError.
"""

from __future__ import annotations

import json
import math
import socket
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np

from tactsim.core.poses import FloatArray

_LARGEST = 1 << 26  # bytes of a message: a million weighted poses fit
_LENGTH = struct.Struct("<II")


@dataclass(frozen=True, eq=False)
class Message:
    """What is said: words that JSON can hold, and arrays of numbers by name."""

    words: Mapping[str, Any]
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)


def send(pipe: socket.socket, message: Message) -> None:
    """Send a message. Raises OSError if nobody is there."""
    arrays = {name: np.ascontiguousarray(array, dtype="<f8") for name, array in message.arrays.items()}
    head = json.dumps([message.words, {name: array.shape for name, array in arrays.items()}]).encode()
    body = b"".join([head, *(array.tobytes() for array in arrays.values())])
    pipe.sendall(_LENGTH.pack(len(head), len(body)) + body)


def receive(pipe: socket.socket, until: float = math.inf) -> Message:
    """Wait for a message, at most until `until` on the monotonic clock.

    Raises TimeoutError, EOFError if the other side is gone, and ValueError for what is no message.
    """
    of_head, size = _LENGTH.unpack(_exactly(pipe, _LENGTH.size, until))
    if of_head > size or size > _LARGEST:
        raise ValueError(f"a message of {size:,} bytes; the most is {_LARGEST:,}")
    body = _exactly(pipe, size, until)
    try:
        words, shapes = json.loads(body[:of_head])
        arrays, place = dict[str, FloatArray](), of_head
        for name, shape in shapes.items():
            count = math.prod(shape)
            if not (
                all(isinstance(length, int) and length >= 0 for length in shape) and place + 8 * count <= size
            ):
                raise ValueError("arrays that are larger than the message")
            arrays[name] = np.frombuffer(body, "<f8", count, place).reshape(shape).astype(float)
            place += 8 * count
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f"what is no message: {error}") from error
    if place != size or not isinstance(words, dict):
        raise ValueError("what is no message")
    return Message(words, arrays)


def _exactly(pipe: socket.socket, size: int, until: float) -> bytes:
    pieces, left = [], size
    while left:
        if until < math.inf:
            remaining = until - monotonic()
            if remaining <= 0:
                raise TimeoutError
            pipe.settimeout(remaining)
        try:
            piece = pipe.recv(min(left, 1 << 20))
        except ConnectionError as error:
            raise EOFError from error
        if not piece:
            raise EOFError
        pieces.append(piece)
        left -= len(piece)
    return b"".join(pieces)
