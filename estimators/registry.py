"""Find estimators by name: the built-in ones and those of installed packages."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from estimators.base import Estimator
from models.checking import checked
from models.errors import InputError, unknown

GROUP = "tactsim.estimators"

# name: (where its class is, what it is), in the order in which `bench list` shows them. Nothing is
# imported before its name is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "histogram": ("estimators.histogram:HistogramFilter", "histogram filter, the paper's eq. 13 to 16"),
    "particle": ("estimators.particle:ParticleFilter", "particle filter, the paper's eq. 8 to 12"),
    "augmented-mcl": ("estimators.particle:AugmentedFilter", "particle filter that injects random particles"),
    "tempered": (
        "estimators.tempered:TemperedFilter",
        "particles, a population a letter, moved by their spread",
    ),
    "refined": (
        "estimators.refined:RefinedFilter",
        "coarse-to-fine histogram: the best bins are halved again",
    ),
}


@dataclass(frozen=True)
class Listed:
    """One line of `bench list`: a name, where it comes from, and whether it can be used."""

    name: str
    summary: str
    status: str


def names() -> tuple[str, ...]:
    """List every estimator that `create` knows, the built-in ones first."""
    return (*BUILT_IN, *(point.name for point in _plug_ins() if point.name not in BUILT_IN))


def create(name: str, **options: Any) -> Estimator:
    """Make the estimator of that name with these options.

    Raises InputError for an unknown name, a broken plug-in, or an option that is unknown or out of
    its bounds.
    """
    chosen = load(name)
    return chosen(checked(chosen.options_type, options, f"estimator {name}"))


def load(name: str) -> type[Estimator]:
    """Import the class of that name. Raises InputError if there is none or it is no Estimator."""
    if name in BUILT_IN:
        module, attribute = BUILT_IN[name][0].split(":")
        return getattr(import_module(module), attribute)
    for point in _plug_ins():
        if point.name == name:
            return _load_plug_in(point)
    raise unknown("estimator", name, names())


def listing() -> list[Listed]:
    """Describe every estimator; a plug-in that cannot be loaded is a status, not a crash."""
    rows = [Listed(name, summary, "built in") for name, (_, summary) in BUILT_IN.items()]
    for point in _plug_ins():
        origin = point.dist.name if point.dist else point.value
        if point.name in BUILT_IN:
            rows.append(Listed(point.name, f"from {origin}", "hidden by the built-in of that name"))
            continue
        try:
            summary = (_load_plug_in(point).__doc__ or "").strip().partition("\n")[0]
            rows.append(Listed(point.name, summary, f"from {origin}"))
        except InputError as error:
            rows.append(Listed(point.name, f"from {origin}", str(error)))
    return rows


def _plug_ins() -> tuple[EntryPoint, ...]:
    return tuple(sorted(entry_points(group=GROUP), key=lambda point: point.name))


def _load_plug_in(point: EntryPoint) -> type[Estimator]:
    origin = f"plug-in {point.name!r} ({point.value})"
    try:
        chosen = point.load()
    except (Exception, SystemExit) as error:  # whatever a stranger's module raises when it is imported
        said = next(iter(str(error).splitlines()), "")
        raise InputError(f"{origin} is broken: {type(error).__name__}: {said}") from error
    if not (isinstance(chosen, type) and issubclass(chosen, Estimator)):
        raise InputError(f"{origin} is no subclass of estimators.Estimator")
    missing = ", ".join(sorted(chosen.__abstractmethods__))
    if missing:
        raise InputError(f"{origin} does not define {missing}")
    return chosen
