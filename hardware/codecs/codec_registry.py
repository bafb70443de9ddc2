"""Find codecs by the `kind` in a device file: the built-in ones and those of installed packages."""

from __future__ import annotations

from typing import Annotated, Any, cast

from pydantic import BeforeValidator, SerializeAsAny

from tactsim.core.errors import InputError
from tactsim.core.plug_ins import Registry, fault_of_class
from tactsim.hardware.codecs.codec import CodecFormat

GROUP = "tactsim.codecs"

# kind: (where its format is, what it is). Nothing is imported before its kind is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "singletact": (
        "tactsim.hardware.codecs.singletact:SingleTactFormat",
        "SingleTact sensors and arrays behind the maker's Arduino bridge",
    ),
    "fields": (
        "tactsim.hardware.codecs.fields:FieldsFormat",
        "frames of a layout that the device file describes",
    ),
    "csv": ("tactsim.hardware.codecs.lines:LinesFormat", "lines of numbers, as an Arduino prints them"),
    "pps-csv": (
        "tactsim.hardware.codecs.pps_csv:CsvFormat",
        "lines 'Time [ms], Elem0, ...' as the PPS demonstration tool records them",
    ),
}


def _fault(found: Any) -> str | None:
    return fault_of_class(found, CodecFormat, "tactsim.hardware.codecs.codec.CodecFormat")


_CODECS = Registry("codec", GROUP, BUILT_IN, _fault)
names, listing = _CODECS.names, _CODECS.listing


def load(kind: str) -> type[CodecFormat]:
    """Give the format of that kind, whose fields are the keys of `[codec]`.

    Raises InputError for an unknown kind or a broken plug-in.
    """
    return cast("type[CodecFormat]", _CODECS.load(kind))


def _read(value: Any) -> Any:
    """Read the table `[codec]` as the format of its `kind`."""
    if not isinstance(value, dict):
        return value
    kind = value.get("kind")
    if not isinstance(kind, str):
        raise InputError(f"kind must say which codec: {', '.join(names())}")
    return load(kind).model_validate(value)


Format = Annotated[SerializeAsAny[CodecFormat], BeforeValidator(_read)]
