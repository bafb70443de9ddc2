"""`bench list`: what there is to choose from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from pydantic import BaseModel

Row = tuple[str, str, str]  # a name, its default or status, what it is


def command(
    what: Annotated[
        str | None,
        typer.Argument(
            help="Only this: estimators, letters, worlds, scan-options, metrics, suites.", show_default=False
        ),
    ] = None,
) -> None:
    """List estimators with their options, letters, worlds, the scan's options, metrics and suites."""
    from rich.table import Table

    from tactsim.bench.console import plain_console
    from tactsim.core.errors import unknown

    sections: dict[str, Callable[[], list[Row]]] = {
        "estimators": _estimators,
        "letters": _letters,
        "worlds": _worlds,
        "scan-options": _scan_options,
        "metrics": _metrics,
        "suites": _suites,
    }
    if what is not None and what not in sections:
        raise unknown("list", what, sections)
    console = plain_console()
    for name, rows in sections.items():
        if what in (None, name):
            console.print(name, style="bold")
            table = Table.grid(padding=(0, 2))
            for _ in range(3):
                table.add_column(overflow="fold")
            for row in rows():
                table.add_row(*("  " + row[0], *row[1:]))
            console.print(table)


def _estimators() -> list[Row]:
    from tactsim.core.errors import InputError
    from tactsim.estimators.registry import listing, load

    rows: list[Row] = []
    for entry in listing():
        rows.append((entry.name, entry.status, entry.summary))
        try:
            rows += _fields(load(entry.name).options_type, "    ")
        except InputError:
            continue  # its status, on the line above, says why
    return rows


def _letters() -> list[Row]:
    from tactsim.models import names

    return [(" ".join(names()), "", "")]


def _worlds() -> list[Row]:
    from tactsim.press import WORLDS

    return [(name, "", ", ".join(_settings(world)) or "the defaults") for name, world in WORLDS.items()]


def _scan_options() -> list[Row]:
    from tactsim.press import ScanOptions

    return [("--scan-set NAME=VALUE", "default", ""), *_fields(ScanOptions)]


def _metrics() -> list[Row]:
    from tactsim.bench.score import CURVES, HEADLINES

    return [
        (name, "", (metric.__doc__ or "").strip().partition("\n")[0])
        for name, metric in (CURVES | HEADLINES).items()
    ]


def _suites() -> list[Row]:
    from tactsim.bench.sweep import read, suites

    return [(suite, f"{len(read(suite)[1])} runs", "") for suite in suites()]


def _settings(values: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Write nested settings as dotted name=value words."""
    words = []
    for name, value in values.items():
        path = f"{prefix}{name}"
        words += _settings(value, f"{path}.") if isinstance(value, Mapping) else [f"{path}={value}"]
    return words


def _fields(model: type[BaseModel], prefix: str = "") -> list[Row]:
    """Describe a configuration's options, nested ones by dotted names."""
    from pydantic import BaseModel

    rows: list[Row] = []
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            rows += _fields(type(default), f"{prefix}{name}.")
        else:
            rows.append((f"{prefix}{name}", str(default), field.description or ""))
    return rows
