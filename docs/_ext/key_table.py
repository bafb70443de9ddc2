"""Describe every key of a device file in tables made from the models that read it.

    python docs/_ext/key_table.py

prints them; docs/reference/device-files.md is filled with them when the site is built.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from tactsim.core.pad import Pad
from tactsim.hardware.codecs.codec import CHECKSUMS
from tactsim.hardware.codecs.fields import (
    Checksum,
    Clock,
    FieldsFormat,
    Fixed,
    Length,
    Number,
    PacketNumber,
    Skip,
    Taxels,
)
from tactsim.hardware.codecs.lines import LinesFormat
from tactsim.hardware.codecs.pps_csv import CsvFormat
from tactsim.hardware.codecs.singletact import SingleTactFormat
from tactsim.hardware.device import Device, Matrix, Part

_TABLES: tuple[tuple[str, tuple[type[BaseModel], ...]], ...] = (
    ("Outside of any table", (Device,)),
    ('`[codec]` with `kind = "fields"`', (FieldsFormat,)),
    ("an item of its `layout`", (Fixed, Length, Number, Clock, PacketNumber, Skip, Taxels, Checksum)),
    ('`[codec]` with `kind = "singletact"`', (SingleTactFormat,)),
    ('`[codec]` with `kind = "csv"`', (LinesFormat,)),
    ('`[codec]` with `kind = "pps-csv"`', (CsvFormat,)),
    ("`[[part]]`, one for each device that the pad is made of", (Part,)),
    ("`[pad]`", (Pad,)),
    ("`[matrix]`, of a resistive matrix without guards", (Matrix,)),
)
_KINDS = {
    int: "whole number",
    float: "number",
    bool: "`true` or `false`",
    str: "text",
    bytes: 'bytes, as `"AA 55"`',
}


def key_tables() -> str:
    """Write the tables in Markdown, one for each table of a device file."""
    parts = []
    for heading, models in _TABLES:
        several = len(models) > 1
        rows = [row for model in models for row in _rows(model, several)]
        title = "| item " * several + "| key | default | values | what |"
        parts.append("\n".join([f"{heading}:", "", title, "|---" * (title.count("|") - 1) + "|", *rows]))
    return "\n\n".join(parts)


def _rows(model: type[BaseModel], several: bool) -> Iterator[str]:
    name = (
        ", ".join(f"`{word}`" for word in get_args(model.model_fields["is_"].annotation)) if several else ""
    )
    for key, field in model.model_fields.items():
        if key in ("is_", "codec", "pad", "matrix", "part") or (key == "kind" and model is not Checksum):
            continue  # headings say what they are
        if field.description is None:
            raise ValueError(f"{model.__name__}.{key} has no description")
        cells = [f"`{key}`", _default(field), _values(key, field), field.description]
        yield "| " + " | ".join([name, *cells] if several else cells) + " |"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "must be given"
    default = field.default
    if default is None or default is PydanticUndefined or default in (b"", ()):
        return "none"
    return f"`{str(default).lower()}`" if isinstance(default, bool) else f"`{default}`"


def _values(key: str, field: FieldInfo) -> str:
    if key in ("kind", "checksum"):
        return ", ".join(f"`{name}`" for name in CHECKSUMS)
    kinds = [kind for kind in (get_args(field.annotation) or (field.annotation,)) if kind is not type(None)]
    if get_origin(field.annotation) is tuple and get_origin(kinds[0]) is Literal:
        return "list of " + ", ".join(f"`{word}`" for word in get_args(kinds[0]))
    words: list[str] = []
    for kind in [field.annotation] if get_origin(field.annotation) is Literal else kinds:
        if get_origin(kind) is Literal:
            words += [f"`{word}`" for word in get_args(kind)]
        elif kind in _KINDS:
            words.append(_KINDS[kind] + _bounds(field))
        else:
            words.append("list")
    return ", ".join(dict.fromkeys(words))


def _bounds(field: FieldInfo) -> str:
    """Say between which numbers a value must lie."""
    limits: dict[str, Any] = {}
    for mark in field.metadata:
        limits |= {name: getattr(mark, name) for name in ("ge", "gt", "le") if hasattr(mark, name)}
    low = (
        f" from {limits['ge']:,}" if "ge" in limits else f" above {limits['gt']:,}" if "gt" in limits else ""
    )
    return low + (f" to {limits['le']:,}" if "le" in limits else "")


if __name__ == "__main__":
    print(key_tables())
