"""Options that verbs share, and options made from the fields of a configuration: names, types, defaults, help texts."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_origin

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tactsim.bench.config import Panel, flags_of, flat, key_values
from tactsim.core.errors import InputError, short


def finite_number(text: str) -> float | None:
    """Read a finite number; None if `text` is not one."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def number(
    help: str, *, default: Any = ..., least: float | None = None, most: float | None = None, **words: Any
) -> Any:
    """Describe an option that takes a finite number, from `least` to `most` where they are given.

    words: what else `typer.Option` takes. Its own bounds alone would let infinity pass, and say of NaN that it is
    too small or too large.
    """
    among = (
        "" if least is None else f" of at least {least:g}" if most is None else f" from {least:g} to {most:g}"
    )

    def read(typed: Any) -> float:
        from pydantic_core import PydanticCustomError

        value = finite_number(str(typed))
        if value is None or (least is not None and value < least) or (most is not None and value > most):
            raise PydanticCustomError(
                "number", "give a finite number{among}, not {given}", {"among": among, "given": short(typed)}
            )
        return value

    return typer.Option(default, parser=read, min=least, max=most, help=help, **words)


ScanSet = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-set", help="Any option of the scan, e.g. press.force=5; `bench list scan-options` names them."
    ),
]

Seed = Annotated[int, typer.Option(min=0, help="Seed of all randomness.")]
_COST = "What it may cost"
Jobs = Annotated[
    int,
    typer.Option(min=1, rich_help_panel=_COST, help="Processes; the results do not depend on their number."),
]

Cache = Annotated[
    bool,
    typer.Option(
        "--cache/--no-cache",
        rich_help_panel=_COST,
        help="Take pressed readings from the cache, and keep them there.",
    ),
]

AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
]

PAD_PANEL = "On a real pad"
Side: TypeAlias = Literal["behind", "front"]
Frames = Annotated[
    int, typer.Option(min=1, help="Readings whose mean is a press.", rich_help_panel=PAD_PANEL)
]

Force = Annotated[
    str, typer.Option(help="Least and most force of a press on the taxels, N.", rich_help_panel=PAD_PANEL)
]

Patience = Annotated[
    float | None,
    number(
        "Seconds after which a press is taken as it is, for a machine that presses.",
        rich_help_panel=PAD_PANEL,
    ),
]

Seen = Annotated[
    Side,
    typer.Option(
        help="behind: you see the object's back as you press it; front: the pad is pressed on it.",
        rich_help_panel=PAD_PANEL,
    ),
]

# Of objects in space, which `bench run` and `bench scan` have with --task solids.
SOLIDS_PANEL = "Objects in space (--task solids)"

# Of an option, where the task is another.
OUTSIDE = "is for objects in space; add --task solids, or leave it out"

Objects = Annotated[
    str | None,
    typer.Option(
        help="Which objects: bolt,nut,key, or 30 for the first thirty (of 50), or none beside shapes. Default: 12.",
        rich_help_panel=SOLIDS_PANEL,
    ),
]

Touches = Annotated[int | None, typer.Option(help="Touches a trial (20).", rich_help_panel=SOLIDS_PANEL)]

Hand = Annotated[
    Path | None,
    typer.Option(
        help="Several pads that touch at once: gripper, or a hand file (.toml).", rich_help_panel=SOLIDS_PANEL
    ),
]


Words = Mapping[str, Any]


def with_options_of(
    model: type[BaseModel], only: Sequence[str] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Let a verb, whose first parameter is `words`, take the model's fields, or some, as options before its own.

    Options that the user did not type are left out of `words`, so that the model's defaults hold.
    """
    # A model's own fields come before those that it inherits.
    names = only or sorted(model.model_fields, key=lambda name: name not in model.__annotations__)
    fields = {name: model.model_fields[name] for name in names if flags_of(name, model.model_fields[name])}

    def decorate(verb: Callable[..., None]) -> Callable[..., None]:
        def command(**typed: Any) -> None:
            words = {name: typed.pop(name) for name in fields}
            words = {name: value for name, value in words.items() if value is not None}
            for name, field in fields.items():
                if name in words and get_origin(field.annotation) is dict:
                    words[name] = key_values(words[name], flags_of(name, field)[0])
            verb(words, **typed)

        own = [
            parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
            for parameter in list(inspect.signature(verb, eval_str=True).parameters.values())[1:]
        ]
        options = [_parameter(name, field) for name, field in fields.items()]
        command.__signature__ = inspect.Signature([*options, *own])  # type: ignore[attr-defined]
        command.__doc__ = verb.__doc__
        return command

    return decorate


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    """Make a field's option: it takes a count, a path, a list if it repeats, or else a text."""
    default = field.default if isinstance(field.default, str | int) else None
    panel = next((mark.title for mark in field.metadata if isinstance(mark, Panel)), None)
    kind: Any = field.annotation
    metavar = "NAME=VALUE" if get_origin(kind) is dict else "FILE" if kind == tuple[Path, ...] else None
    option = typer.Option(
        *flags_of(name, field), help=field.description, show_default=default is not None, metavar=metavar,
        rich_help_panel=panel,
    )  # fmt: skip
    if kind == tuple[Path, ...]:
        kind = list[Path] | None
    elif get_origin(kind) is dict:
        kind = list[str] | None
    elif kind not in (bool, int, int | None, Path | None):
        kind = str | None
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option]
    )


def is_typed(context: typer.Context, name: str) -> bool:
    """Tell whether the user typed an option, rather than leave it at its default."""
    source = context.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def refuse_typed(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Raise InputError for the first of these options that the user typed: it would mean nothing.

    why: what it is for, as the end of a sentence that begins with the option.
    """
    for name in names:
        if is_typed(context, name):
            raise InputError(f"--{name.replace('_', '-')} {why}")


def dotted(values: Mapping[str, Any]) -> list[str]:
    """Write nested settings as dotted name=value words, as they can be typed."""
    return [f"{name}={'none' if value is None else value}" for name, value in flat(values).items()]
