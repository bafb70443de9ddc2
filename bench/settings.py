"""Nested settings as they are typed: dotted names, tables in tables, and how some words are read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tactsim.core import InputError


def key_values(pairs: Iterable[str], option: str) -> dict[str, Any]:
    """Parse `key=value` words; dots nest: `press.force=3` gives {"press": {"force": "3"}}.

    Values stay text, for the configuration's own types to read; `none` stands for None.
    Raises InputError if a word has no `=`, or one name has two values or is both a value and a group.
    """
    result: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not (equals and key.strip()):
            raise InputError(f"{option} {pair!r}: write it as key=value")
        *groups, last = key.strip().split(".")
        inner = result
        for group in groups:
            inner = inner.setdefault(group, {})
            if not isinstance(inner, dict):
                raise InputError(f"{option} {pair!r}: {group!r} has a value already")
        if isinstance(inner.get(last), dict):
            raise InputError(f"{option} {pair!r}: {last!r} is a group of options")
        if last in inner:
            raise InputError(f"{option} {pair!r}: {key.strip()} is given twice")
        inner[last] = None if value.strip().lower() == "none" else value.strip()
    return result


def nested(words: Any) -> Any:
    """Let dots in names nest, as on the command line: {"press.force": 5} is {"press": {"force": 5}}.

    Raises InputError if one option has two values.
    """
    if not isinstance(words, Mapping):
        return words
    result: dict[str, Any] = {}
    for name, value in words.items():
        for part in reversed(str(name).split(".")):
            value = {part: value}
        twice = _in_both(result, value)
        if twice:
            raise InputError(f"{twice} is given twice")
        result = merged(result, value)
    return result


def _in_both(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Name an option that has a value in both of two nested tables, with dots; empty if there is none."""
    for name in one.keys() & other.keys():
        if not (isinstance(one[name], Mapping) and isinstance(other[name], Mapping)):
            return name
        if inner := _in_both(one[name], other[name]):
            return f"{name}.{inner}"
    return ""


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested values with nested changes applied; neither argument is modified."""
    result = dict(base)
    for key, value in changes.items():
        inner = result.get(key)
        result[key] = (
            merged(inner, value) if isinstance(inner, Mapping) and isinstance(value, Mapping) else value
        )
    return result


def as_paths(words: Any) -> Any:
    """Take one path for a list of one."""
    return (words,) if isinstance(words, str | Path) else words


def whole_number(text: str) -> int | None:
    """Read a count of at most nine digits; None if `text` is not one."""
    return int(text) if re.fullmatch(r"[0-9]{1,9}", text) else None
