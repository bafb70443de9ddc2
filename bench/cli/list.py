"""`bench list`: what there is to choose from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer


def command(
    what: Annotated[
        str | None,
        typer.Argument(
            help="Only this: estimators, letters, worlds, scan-options, metrics, suites.", show_default=False
        ),
    ] = None,
) -> None:
    """List estimators with their options, letters, worlds, the scan's options, metrics and suites."""
    from rich.console import Console
    from rich.markup import escape

    from models.errors import unknown

    sections = {
        "estimators": _estimators,
        "letters": _letters,
        "worlds": _worlds,
        "scan-options": _scan_options,
        "metrics": _metrics,
        "suites": _suites,
    }
    if what is not None and what not in sections:
        raise unknown("list", what, sections)
    console = Console(highlight=False)
    for name, lines in sections.items():
        if what in (None, name):
            console.print(f"[bold]{name}[/]")
            for depth, line in lines():
                console.print("  " * depth + escape(line))


Lines = list[tuple[int, str]]


def _estimators() -> Lines:
    from estimators.registry import listing, load
    from models.errors import InputError

    lines: Lines = []
    for entry in listing():
        lines.append((1, f"{entry.name:16} {entry.summary}  [{entry.status}]"))
        try:
            lines += _fields(load(entry.name).options_type, depth=3)
        except InputError:
            continue  # its status, on the line above, says why
    return lines


def _letters() -> Lines:
    from models import names

    return [(1, " ".join(names()))]


def _worlds() -> Lines:
    from tactsim import WORLDS

    return [
        (1, f"{name:16} {', '.join(_settings(world)) or 'the defaults'}") for name, world in WORLDS.items()
    ]


def _scan_options() -> Lines:
    from tactsim import ScanOptions

    return [(1, "set with --scan-set NAME=VALUE"), *_fields(ScanOptions, depth=1)]


def _metrics() -> Lines:
    from bench.score import CURVES, HEADLINES

    return [
        (1, f"{name:26} {(metric.__doc__ or '').strip().partition(chr(10))[0]}")
        for name, metric in (CURVES | HEADLINES).items()
    ]


def _suites() -> Lines:
    from bench.sweep import read, suites

    return [(1, f"{suite:16} {len(read(suite)[1])} runs") for suite in suites()]


def _settings(values: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Write nested settings as dotted name=value words."""
    words = []
    for name, value in values.items():
        inner = (
            _settings(value, f"{prefix}{name}.") if isinstance(value, dict) else [f"{prefix}{name}={value}"]
        )
        words += inner
    return words


def _fields(model: type, depth: int, prefix: str = "") -> Lines:
    """Describe a pydantic model's fields, nested ones by dotted names."""
    from pydantic import BaseModel

    lines: Lines = []
    for name, field in model.model_fields.items():  # type: ignore[attr-defined]
        default = field.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            lines += _fields(type(default), depth, f"{prefix}{name}.")
        else:
            lines.append((depth, f"{prefix}{name} = {default}  {field.description or ''}".rstrip()))
    return lines
