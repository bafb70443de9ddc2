"""`bench list` and `new`: what there is to choose from, and the repository of one more."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tactsim.bench.cli.shared_options import dotted
from tactsim.bench.config import SLIPS, Slip
from tactsim.bench.console import plain_console, plain_grid
from tactsim.core.errors import InputError, unknown

if TYPE_CHECKING:
    from pydantic import BaseModel

_MORE = {
    "estimators": "with its options: bench list estimators NAME",
    "likelihoods": "with its options: bench list likelihoods NAME; of the filters on maps: --set likelihood=NAME",
    "worlds": "all that can be set: bench list scan-options, bench list slip",
    "solids": "objects in space, of bench run --task solids; all that can be set: bench list solid-options",
    "formats": "of bench export; each is an extra, as in: pip install 'tactsim[parquet]'",
}

Row = tuple[str, str, str]  # a name, its default or status, what it is


def command_list(
    what: str | None = typer.Argument(
        None,
        help="Only this: estimators, likelihoods, letters, solids, worlds, scan-options, solid-options, slip, "
        "metrics, suites, formats.",
    ),
    name: str | None = typer.Argument(
        None, help="Of the estimators or likelihoods, only this one, with its options."
    ),
) -> None:
    """List estimators, likelihoods, letters, solids, worlds, metrics, suites, formats, or options of one or a scan."""
    from tactsim import models, press
    from tactsim.bench import kinds

    sections: dict[str, Callable[[], list[Row]]] = {
        "estimators": _estimators,
        "likelihoods": _likelihoods,
        "letters": lambda: [(" ".join(models.names()), "", "")],
        "solids": lambda: [(" ".join(models.solid_names()), "", "")],
        "worlds": _worlds,
        "scan-options": lambda: _options("--scan-set", press.ScanOptions),
        "solid-options": lambda: _options("--scan-set", kinds.load("solids").scan_options),
        "slip": lambda: _options("--slip", Slip),
        "metrics": _metrics,
        "suites": _suites,
        "formats": _formats,
    }
    if what is not None and what not in sections:
        raise unknown("list", what, sections)
    one = {"estimators": _estimator, "likelihoods": _likelihood}
    if name is not None and what is not None:
        if what not in one:
            raise InputError(f"bench list {what} {name}: only an estimator or a likelihood has its own list")
        sections[what] = partial(one[what], name)
    console = plain_console()
    # The options of a scan are many, so they are listed on request only, as an estimator's are.
    for section, rows in sections.items():
        if what == section or (what is None and section not in ("scan-options", "solid-options", "slip")):
            lines = rows()
            console.print(section, style="bold", end=" " if section in _MORE and not name else "\n")
            if section in _MORE and not name:
                console.print(f"({_MORE[section]})")
            # A name in two pieces cannot be copied; the letters are one long row.
            names = section not in ("letters", "solids")
            groups = groupby(lines, lambda row: row[0].rpartition(".")[0])
            grouped = section in ("scan-options", "solid-options")
            for group, alike in groups if grouped else [("", iter(lines))]:
                if group:
                    console.print(f"\n  {group}", style="bold")
                console.print(plain_grid([("  " + row[0], *row[1:]) for row in alike], names=names))


def _estimators() -> list[Row]:
    from tactsim.bench.kinds import PLANE
    from tactsim.estimators.registry import listing, load

    rows: list[Row] = []
    for entry in listing():
        try:
            kind = load(entry.name)
            said = f"; budget: {kind.budget}" if kind.budget else ""
            said += f"; of {kind.KIND}" if kind.KIND != PLANE else ""
        except InputError:
            said = ""  # its status says why
        rows.append((entry.name, entry.status, entry.summary + said))
    return rows


def _estimator(name: str) -> list[Row]:
    from tactsim.estimators.registry import listing, options_of

    options = _options("--set", options_of(name))  # which refuses an unknown name
    return [(entry.name, entry.status, entry.summary) for entry in listing() if entry.name == name] + options


def _likelihoods() -> list[Row]:
    from tactsim.estimators.likelihoods.likelihood import listing

    return [(entry.name, entry.status, entry.summary) for entry in listing()]


def _likelihood(name: str) -> list[Row]:
    from tactsim.estimators.likelihoods.likelihood import kind_of
    from tactsim.estimators.options import MapOptions

    own = kind_of(name).options_type.model_fields.keys() - MapOptions.model_fields.keys()
    rows = [row for row in _fields(kind_of(name).options_type) if row[0] in own]
    return [row for row in _likelihoods() if row[0] == name] + [("--set NAME=VALUE", "default", ""), *rows]


def _worlds() -> list[Row]:
    from tactsim.press import WORLDS

    worlds = WORLDS | SLIPS
    return [(name, "", ", ".join(dotted(world)) or "the defaults") for name, world in worlds.items()]


def _metrics() -> list[Row]:
    from tactsim.bench import kinds
    from tactsim.bench.score import figures

    rows: dict[str, Row] = {}
    for kind in kinds.names():
        own = kinds.load(kind).metrics
        rows |= {
            name: (name, f"of {kind}" if name in own else "", metric.description)
            for name, metric in figures(kind).items()
        }
    return list(rows.values())


def _suites() -> list[Row]:
    from tactsim.bench.sweep import count_runs, suites

    return [(suite, f"{count_runs(suite)} runs", what) for suite, what in suites().items()]


def _formats() -> list[Row]:
    from tactsim.bench.formats import FORMATS

    return [(one.name, "scans and runs", one.line) for one in FORMATS.values()]


def _options(flag: str, model: type[BaseModel]) -> list[Row]:
    """Head a configuration's options by the flag that sets them."""
    return [(f"{flag} NAME=VALUE", "default", ""), *_fields(model)]


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


def command_new(
    kind: str = typer.Argument(
        ..., metavar="KIND", help="What to make: estimator, likelihood (a measurement model) or source."
    ),
    name: str = typer.Argument(..., help="Its name: lower-case words with hyphens between them."),
    out: Path | None = typer.Option(None, help="A new folder. Default: one called as the repository."),
) -> None:
    """Make a repository of your own for an estimator, a measurement model or a source, with tests and a workflow."""
    from tactsim.bench.new import make

    folder = make(kind, name, out)
    console = plain_console()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            console.print(str(path))
    console.print(f"{folder / 'README.md'} says how to go on")
