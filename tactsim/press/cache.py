"""Keep ideal readings on disk, by everything that they depend on.

A file holds the readings of one letter at one list of poses. Its name is a hash of the letter's shape, the
poses, tilts, loads, pad, press and point spread, the versions of NumPy and MuJoCo and the source that presses; the file
repeats the hash and adds one of its content. A file that does not say both is made again.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from tactsim.core.cache_folder import cache_folder
from tactsim.core.errors import InputError
from tactsim.core.files import read_bytes, write_bytes
from tactsim.core.poses import FloatArray
from tactsim.core.source_digest import source_digest
from tactsim.press.scan_options import ScanOptions
from tactsim.press.touches import Touches

MOST_FILES = 2000  # of some 55 kB; the ones longest unused are removed beyond
_MAGIC = b"tactsim readings 2\n"
_LARGEST = 1 << 28  # bytes of a file


def key(touches: Touches, options: ScanOptions) -> str:
    """Hash all that the ideal readings of `touches` depend on, 64 hex digits."""
    poses, tilts, load = (
        hashlib.sha256(np.ascontiguousarray(() if array is None else array, "<f8").tobytes()).hexdigest()
        for array in (touches.poses, touches.tilts, touches.load)
    )
    content = json.dumps(
        {
            "letter": touches.letter.digest,
            "poses": poses,
            "tilts": tilts,
            "load": load,
            "pad": options.pad.model_dump(mode="json"),
            "press": options.press.model_dump(mode="json"),
            "psf_sigma": options.sensor.psf_sigma,
            "hysteresis": options.sensor.hysteresis if options.press.dynamics == "full" else 0.0,
            "source": source_digest(),
            "versions": versions(),
        },
        sort_keys=True,
    )
    return hashlib.sha256(content.encode()).hexdigest()


def load(key: str, shape: tuple[int, int]) -> FloatArray | None:
    """Read the readings stored under `key`, or None if there are none, or not whole, or not those."""
    path = _path(key)
    try:
        content = read_bytes(path, _LARGEST)
    except InputError:
        return None
    with suppress(OSError):  # in a folder that is read-only nothing is pruned either
        os.utime(path)
    head = _MAGIC + bytes.fromhex(key)
    body = content[len(head) + 32 :]
    if content[: len(head)] != head or content[len(head) : len(head) + 32] != hashlib.sha256(body).digest():
        return None
    return np.frombuffer(body, "<f8").reshape(shape).copy() if len(body) == 8 * math.prod(shape) else None


def store(key: str, readings: FloatArray) -> None:
    """Keep readings under `key`. A folder that cannot be written is no fault: nothing is kept then."""
    content = np.ascontiguousarray(readings, "<f8").tobytes()
    with suppress(InputError):
        write_bytes(_path(key), _MAGIC + bytes.fromhex(key) + hashlib.sha256(content).digest() + content)


def prune() -> None:
    """Remove the files that were not used for longest, beyond MOST_FILES."""
    with suppress(OSError):
        files = sorted((path.stat().st_mtime, path) for path in cache_folder().glob("*.readings"))
        for _, path in files[:-MOST_FILES]:
            with suppress(FileNotFoundError):
                path.unlink()


def _path(key: str) -> Path:
    return cache_folder() / f"{key[:40]}.readings"


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Name the versions of what the readings are worked out with."""
    return {"mujoco": version("mujoco"), "numpy": np.__version__}
