"""`bench devices`: list what readings can come from, and whether it can be used."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    from tactsim.core.plug_ins import Listed


def command(as_json: shared.AsJson = False) -> None:
    """List ports, sources of readings, codecs and device files, each with its status."""
    import json

    from rich.table import Table

    from tactsim.bench.console import plain_console

    found = _found()
    if as_json:
        typer.echo(json.dumps(found, indent=1))
        return
    console = plain_console()
    for heading, rows in found.items():
        table = Table(title=heading.replace("_", " "), title_justify="left", box=None, pad_edge=False)
        for column in ("name", "what", "status"):
            table.add_column(column, overflow="fold")
        for row in rows:
            table.add_row(*(row[column] for column in ("name", "what", "status")))
        if not rows:
            table.add_row("none found", "", "")
        console.print(table)
        console.print()


def _found() -> dict[str, list[dict[str, Any]]]:
    from tactsim.hardware import sources
    from tactsim.hardware.codecs import codec_registry as registry
    from tactsim.hardware.device import built_in_devices, load_device

    return {
        "ports": _ports(),
        "sources": _rows(sources.listing()),
        "codecs": _rows(registry.listing()),
        "device_files": [
            {"name": name, "what": load_device(name).name, "status": "built in"}
            for name in built_in_devices()
        ],
    }


def _rows(listed: list[Listed]) -> list[dict[str, Any]]:
    return [{"name": row.name, "what": row.summary, "status": row.status} for row in listed]


def _ports() -> list[dict[str, Any]]:
    """List serial ports without opening any, because opening would restart an Arduino."""
    import os

    from serial.tools.list_ports import comports

    rows = []
    for port in sorted(comports()):
        readable = os.access(port.device, os.R_OK | os.W_OK)
        status = "may be opened" if readable else "no permission; join the group that owns it"
        what = port.description if port.description not in (None, "n/a") else ""
        rows.append({"name": port.device, "what": what, "status": status})
    return rows
