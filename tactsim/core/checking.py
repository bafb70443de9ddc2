"""Check values by a pydantic model, and say in one line what is wrong."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from tactsim.core.errors import InputError, short, unknown

Model = TypeVar("Model", bound=BaseModel)


def checked(model: type[Model], values: Any, where: str) -> Model:
    """Check values that a user typed or a file held, and return them as `model`.

    where: begins the message. Raises InputError for the first value that is wrong.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise InputError(f"{where}: {_first_fault(error, model)}") from None


def _first_fault(error: ValidationError, model: type[BaseModel]) -> str:
    """Describe the first fault in one line: where it is, what is wrong, and the value that was given."""
    fault = error.errors(include_url=False)[0]
    place = ".".join(map(str, fault["loc"]))
    if fault["type"] == "extra_forbidden":
        return str(unknown("option", place, _options(model)))
    message = fault["msg"].removeprefix("Value error, ")
    if fault["type"] == "value_error" and not place:
        return message  # of several options together: it names them
    given = "" if fault["type"] == "missing" else f", got {short(fault['input'])}"
    return f"{place or 'options'}: {message}{given}"


def _options(model: type[BaseModel], prefix: str = "") -> list[str]:
    """List a configuration's options, nested ones by dotted names."""
    names = []
    for name, field in model.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            names += _options(inner, f"{prefix}{name}.")
        else:
            names.append(prefix + (field.alias or name))
    return names
