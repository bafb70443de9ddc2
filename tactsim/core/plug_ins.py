"""Find, load and list what installed packages add through entry points, even where an import fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from tactsim.core.errors import InputError

# Says what is wrong with a loaded object, in words that follow its name in a message; None if nothing is.
Check = Callable[[Any], "str | None"]


@dataclass(frozen=True)
class Listed:
    """One line of a list: a name, what it is, and whether it can be used."""

    name: str
    summary: str
    status: str


def plug_ins(group: str) -> tuple[EntryPoint, ...]:
    """List a group's entry points by name."""
    return tuple(sorted(entry_points(group=group), key=lambda point: point.name))


def load_plug_in(point: EntryPoint, check: Check) -> Any:
    """Import what an entry point names. Raises InputError that names it if that fails or `check` finds a fault."""
    origin = f"plug-in {point.name!r} ({point.value})"
    try:
        found = point.load()
        fault = check(found)
    except (Exception, SystemExit) as error:  # importing a plug-in may raise anything
        said = next(iter(str(error).splitlines()), "")
        raise InputError(f"{origin} is broken: {type(error).__name__}: {said}") from error
    if fault is not None:
        raise InputError(f"{origin} {fault}")
    return found


def listing(group: str, built_in: Mapping[str, tuple[str, str]], check: Check) -> list[Listed]:
    """Describe the built-in entries, {name: (where, what)}, then the plug-ins; the status says which are broken."""
    rows = [Listed(name, summary, "built in") for name, (_, summary) in built_in.items()]
    for point in plug_ins(group):
        origin = point.dist.name if point.dist else point.value
        if point.name in built_in:
            rows.append(Listed(point.name, f"from {origin}", "hidden by the built-in of that name"))
            continue
        try:
            summary = str(load_plug_in(point, check).__doc__ or "").strip().partition("\n")[0]
            rows.append(Listed(point.name, summary, f"from {origin}"))
        except InputError as error:
            rows.append(Listed(point.name, f"from {origin}", str(error)))
    return rows
