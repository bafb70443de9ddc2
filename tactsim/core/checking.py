"""Check values by a pydantic model, and say in one line what is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidatorFunctionWrapHandler, field_validator

from tactsim.core.errors import InputError, short, some, unknown

Model = TypeVar("Model", bound=BaseModel)

_MOST_NAMED = 10  # values that are missing

# What would be right, by the kind of fault; pydantic's own words speak of Python's types.
_WANTED = {
    **dict.fromkeys(("int_type", "int_parsing", "int_parsing_size", "int_from_float"), "give a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "give a number"),
    "finite_number": "give a finite number",
    "greater_than_equal": "give a number of at least {ge}",
    "greater_than": "give a number above {gt}",
    "less_than_equal": "give a number of at most {le}",
    "less_than": "give a number below {lt}",
    "literal_error": "give {expected}",
    **dict.fromkeys(("bool_type", "bool_parsing"), "say true or false"),
    "string_type": "give a text",
    "string_too_short": "give a text of at least {min_length} characters",
    "string_too_long": "give a text of at most {max_length} characters",
    "string_pattern_mismatch": "give a text of the form {pattern}",
    "path_type": "give the path of a file or folder",
    **dict.fromkeys(("tuple_type", "list_type"), "give a list"),
    "too_short": "give a list of at least {min_length}",
    "too_long": "give a list of at most {max_length}",
    **dict.fromkeys(("dict_type", "model_type"), "give a table of names and values"),
}


class Settings(BaseModel):
    """Options that cannot be changed, of which no other is taken and no number is infinite or NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="wrap")
    @classmethod
    def _none(cls, value: Any, read: ValidatorFunctionWrapHandler) -> Any:
        """Read "none" as None where an option may be None: neither TOML nor the command line can say that."""
        if isinstance(value, str) and value.strip().lower() == "none":
            with suppress(ValidationError):
                return read(None)
        return read(value)


def without_gone(values: Any, gone: Mapping[str, Any]) -> Any:
    """Leave out of a table the options that are gone, where it states what they always are now.

    gone: by name what each option's default was, which files of earlier versions state; a table in it is one of such
    options. Raises ValueError for another value.
    """
    if not isinstance(values, dict):
        return values
    for name in values.keys() & gone.keys():
        if values[name] != gone[name]:
            raise ValueError(f"{name} is always {gone[name]} now, and no option; leave it out")
    return {name: value for name, value in values.items() if name not in gone}


def checked(model: type[Model], values: Any, where: str) -> Model:
    """Check values that a user typed or a file held, and return them as `model`.

    where: begins the message. Raises InputError for the first value that is wrong.
    """
    try:
        result = model.model_validate(values)
    except ValidationError as error:
        raise InputError(f"{where}: {_first_fault(error, model)}") from None
    if (fault := another_type(values, result)) is not None:
        raise InputError(f"{where}: {fault}")
    return result


def another_type(given: Any, taken: Any, place: str = "") -> str | None:
    """Find what was taken for another type: true or false for a number or the reverse, the text 10.000 for 10.

    Returns what to say of it, with its place; None if there is no such value.
    """
    if isinstance(taken, BaseModel) and isinstance(given, dict):
        names = ((name, field.alias or name) for name, field in type(taken).model_fields.items())
        pairs = [(key, given[key], getattr(taken, name)) for name, key in names if key in given]
    elif isinstance(taken, dict) and isinstance(given, dict):
        pairs = [(str(key), given[key], value) for key, value in taken.items() if key in given]
    elif isinstance(taken, tuple | list) and isinstance(given, tuple | list):
        pairs = [(str(number), *pair) for number, pair in enumerate(zip(given, taken, strict=False))]
    else:
        if isinstance(taken, bool) and isinstance(given, int | float) and not isinstance(given, bool):
            return f"{place}: say true or false, not {given!r}"
        if isinstance(given, bool) and isinstance(taken, int | float) and not isinstance(taken, bool):
            return f"{place}: a number is wanted, not {str(given).lower()}"
        if isinstance(given, str) and "." in given and type(taken) is int:
            return f"{place}: give a whole number without a point, got {given!r}"
        return None
    faults = (another_type(one, other, f"{place}.{key}".lstrip(".")) for key, one, other in pairs)
    return next((fault for fault in faults if fault is not None), None)


def _first_fault(error: ValidationError, model: type[BaseModel]) -> str:
    """Describe the first fault in one line: where it is, what is wrong, and the value that was given."""
    faults = error.errors(include_url=False)
    if faults[0]["type"] == "missing":
        return _missing([one["loc"] for one in faults if one["type"] == "missing"], model)
    fault, where = faults[0], faults[0]["loc"]
    if where[-1:] == ("str",):
        # A text or something else was wanted: what is wrong with the latter is nearer to what was meant.
        where = where[:-1]
        fault = next((other for other in faults[1:] if other["loc"][:-1] == where), fault)
    place = ".".join(map(str, where))
    if fault["type"] == "extra_forbidden":
        return str(unknown("option", _whole_name(place, fault["input"]), _options(model)))
    if fault["type"] == "model_type" and (inner := _below(place, model)):
        return f"{place} is a group of options, got {short(fault['input'])}; give one of {some(inner)}"
    message = plain(fault)
    if fault["type"] == "value_error" and (not place or isinstance(fault["input"], dict)):
        return f"{place}: {message}".removeprefix(": ")  # of several options together: it names them
    return f"{place or 'options'}: {message}, got {short(fault['input'])}"


def plain(fault: Mapping[str, Any]) -> str:
    """Say of one of pydantic's errors what would be right."""
    wanted = _WANTED.get(fault["type"])
    if wanted is None:
        return str(fault["msg"]).removeprefix("Value error, ")
    return wanted.format(**{name: _bound(value) for name, value in fault.get("ctx", {}).items()})


def _bound(bound: Any) -> str:
    """Write a bound as one would type it: 0 and not 0.0."""
    return f"{bound:g}" if isinstance(bound, float) else str(bound)


def _whole_name(place: str, given: Any) -> str:
    """Name the first option in an unknown group, which is nearer to a known option than the group's name alone."""
    while isinstance(given, dict) and given:
        name, given = next(iter(given.items()))
        place = f"{place}.{name}"
    return place


def _below(place: str, model: type[BaseModel]) -> list[str]:
    """List the options of a group by dotted names; none if `place` is no group, as within a list."""
    return [name for name in _options(model) if name.startswith(f"{place}.")]


def _missing(places: Sequence[tuple[int | str, ...]], model: type[BaseModel]) -> str:
    """Name all that has to be given and is not, and say what it is."""
    meant = {field.alias or name: field.description for name, field in model.model_fields.items()}
    names = [".".join(map(str, place)) for place in places[:_MOST_NAMED]]
    said = [f"{name} ({meant[name]})" if meant.get(name) else name for name in names]
    more = f" and {len(places) - len(said)} more" if len(places) > len(said) else ""
    return f"missing {'is' if len(places) == 1 else 'are'} {', '.join(said)}{more}"


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
