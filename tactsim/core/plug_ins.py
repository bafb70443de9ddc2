"""Find, load and list what installed packages add through entry points, even where an import fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from tactsim.core.errors import InputError, unknown

# Says what is wrong with a loaded object, in words that follow its name in a message; None if nothing is.
Check = Callable[[Any], "str | None"]


@dataclass(frozen=True)
class Listed:
    """One line of a list: a name, what it is, and whether it can be used."""

    name: str
    summary: str
    status: str


def fault_of_class(found: Any, base: type, called: str, options: type | None = None) -> str | None:
    """Say why what was found is no class of `base`, `called` so in the message, that can be made; None if it is one.

    options: the base of its `options_type`, if it must have one.
    """
    if not (isinstance(found, type) and issubclass(found, base)):
        return f"is no subclass of {called}"
    if missing := ", ".join(sorted(getattr(found, "__abstractmethods__", ()))):
        return f"does not define {missing}"
    stated = getattr(found, "options_type", None)
    if options is not None and not (isinstance(stated, type) and issubclass(stated, options)):
        return "has options_type that is no class of options"
    return None


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


@dataclass(frozen=True)
class Registry:
    """What can be asked for by name: the built-in ones, and those of installed packages behind them.

    what: one word for messages. group: of the entry points. built_in: {name: (where, what it is)}, in the order of
    lists; nothing is imported before its name is asked for. check: finds the fault of one that is added.
    """

    what: str
    group: str
    built_in: Mapping[str, tuple[str, str]]
    check: Check

    def added(self) -> tuple[EntryPoint, ...]:
        """List the entry points whose names are not built in."""
        return tuple(point for point in plug_ins(self.group) if point.name not in self.built_in)

    def names(self) -> tuple[str, ...]:
        """List every name, the built-in ones first."""
        return (*self.built_in, *(point.name for point in self.added()))

    def load(self, name: str) -> Any:
        """Import what has that name. Raises InputError for an unknown name or a broken plug-in."""
        if name in self.built_in:
            module, attribute = self.built_in[name][0].split(":")
            return getattr(import_module(module), attribute)
        for point in self.added():
            if point.name == name:
                return load_plug_in(point, self.check)
        raise unknown(self.what, name, self.names())

    def listing(self) -> list[Listed]:
        """Describe all that have a name; a plug-in that cannot be loaded is a status, not a crash."""
        rows = [Listed(name, summary, "built in") for name, (_, summary) in self.built_in.items()]
        for point in plug_ins(self.group):
            origin = point.dist.name if point.dist else point.value
            if point.name in self.built_in:
                rows.append(Listed(point.name, f"from {origin}", "hidden by the built-in of that name"))
                continue
            try:
                summary = str(load_plug_in(point, self.check).__doc__ or "").strip().partition("\n")[0]
                rows.append(Listed(point.name, summary, f"from {origin}"))
            except InputError as error:
                rows.append(Listed(point.name, f"from {origin}", str(error)))
        return rows
