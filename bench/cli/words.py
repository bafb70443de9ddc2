"""Make the options of a verb from the fields of a configuration: names, types, defaults and help texts."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, get_origin

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tactsim.bench.config import flags_of, flat, key_values
from tactsim.core.errors import InputError

Words = Mapping[str, Any]


def with_options_of(model: type[BaseModel]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Let a verb, whose first parameter is `words`, take the model's fields as options before its own.

    Options that the user did not type are left out of `words`, so that the model's defaults hold.
    """
    # A model's own fields come before those that it inherits.
    names = sorted(model.model_fields, key=lambda name: name not in model.__annotations__)
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
    option = typer.Option(*flags_of(name, field), help=field.description, show_default=default is not None)
    kind: Any = field.annotation
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
