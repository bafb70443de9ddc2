"""Read untrusted text, TOML and JSON; every fault is an InputError.

A document is limited in size and in depth of nesting. Its numbers are finite and have at most 64 bits, as TOML
prescribes. So later computations neither overflow nor exhaust the stack, and every value can be written out again.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactsim.core.errors import InputError, short
from tactsim.core.files import read_bytes

SMALL = 1 << 20  # bytes: limit for files that a person writes
LARGE = 64 << 20  # bytes: limit for files that a program writes
DEEPEST = 40  # tables or lists within each other
_MOST_INTEGER = 2**63
# Matches a dotted key of more names than tables may nest. Python's parser keeps every prefix of a key, so a
# key of 100,000 names would take all memory.
_LONG_KEY = re.compile(
    r"""(?<![\w."'-])(?>(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){%d}""" % DEEPEST  # noqa: UP031
)


def read_text(path: str | Path, what: str, most: int = SMALL) -> str:
    """Read a file of at most `most` bytes in UTF-8, or UTF-16 with its mark; InputErrors name `what` and `path`."""
    try:
        content = read_bytes(path, most)
    except InputError as error:
        raise InputError(f"cannot read {what} {path}: {error}") from error
    return _text(content, f"{what} {path}")


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """Read a TOML file. Raises InputError that names `what` and `path`."""
    return parse_toml(read_text(path, what), f"{what} {path}")


def read_json(path: str | Path, what: str) -> dict[str, Any]:
    """Read a file that holds a JSON object. Raises InputError that names `what` and `path`."""
    return parse_json(read_text(path, what, LARGE), f"{what} {path}")


def parse_toml(content: str | bytes, where: str) -> dict[str, Any]:
    """Parse TOML. Raises InputError that begins with `where`."""
    text = content if isinstance(content, str) else _text(content, where)
    if _LONG_KEY.search(text):
        raise InputError(f"{where} nests more than {DEEPEST} tables or lists in each other")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # an integer of 5,000 digits is a ValueError too
        raise InputError(f"{where} is not TOML: {error}") from error
    _check_bounds(table, where)
    return table


def parse_json(content: str | bytes, where: str) -> dict[str, Any]:
    """Parse a JSON object. Raises InputError that begins with `where`."""
    try:
        value = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is not whole JSON: {error}") from error
    if not isinstance(value, dict):
        raise InputError(f"{where} holds no JSON object")
    _check_bounds(value, where)
    return value


def encoding_of(start: bytes) -> str:
    """Name the encoding of a text by its first two bytes or more; no text begins with a byte of 0 otherwise."""
    if start.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return "utf-16"
    return {b"\0": "utf-16-be", b"": "utf-8-sig"}.get(
        start[:1], "utf-16-le" if start[1:2] == b"\0" else "utf-8-sig"
    )


def _text(content: bytes, where: str) -> str:
    try:
        text = content.decode(encoding_of(content))
        if "\0" in text:  # as in UTF-32, or where a writer was cut off
            raise InputError(f"{where} is not text in UTF-8: it holds bytes of 0; save it so")
        return text
    except UnicodeDecodeError as error:
        raise InputError(f"{where} is not text in UTF-8, from byte {error.start} on; save it so") from error


def _check_bounds(document: Mapping[str, Any], where: str) -> None:
    """Raise InputError for a number beyond 64 bits or not finite, and for deep nesting."""
    left: list[tuple[tuple[str, ...], Any]] = [((), document)]
    while left:
        place, value = left.pop()
        fault = None
        if isinstance(value, dict | list):
            if len(place) == DEEPEST:
                raise InputError(f"{where} nests more than {DEEPEST} tables or lists in each other")
            inner = value.items() if isinstance(value, dict) else enumerate(value)
            left += [((*place, str(key)), content) for key, content in inner]
        elif isinstance(value, int) and not -_MOST_INTEGER <= value < _MOST_INTEGER:
            fault = "which takes more than 64 bits"
        elif isinstance(value, float) and not math.isfinite(value):
            fault = "which is no finite number"
        if fault:
            raise InputError(f"{where}: {short('.'.join(place))} is {short(value)}, {fault}")
