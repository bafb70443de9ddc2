"""What a scan says of itself beside its numbers: units, frames, pad, licence, and how it was made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactsim.core.errors import InputError, short

# What a taxel may say: a pressure, a force, a voltage or what the device counts.
UNITS = ("kPa", "N", "V", "count")
# kPa of other units of pressure, which are converted where readings come in.
IN_KPA = {
    "Pa": 1e-3,
    "hPa": 0.1,
    "mbar": 0.1,
    "MPa": 1e3,
    "bar": 100.0,
    "psi": 6.894757293,
    "mmHg": 0.1333223874,
}
SOURCES = ("simulated", "recorded", "imported")
# The licence of readings of shapes that come with tactsim: made for data, it asks to name the authors and nothing
# else. The code's own, MIT, speaks of software only.
OWN_LICENCE = "CC-BY-4.0"

_LONGEST_LICENCE = 100  # characters


def check_statements(meta: Mapping[str, Any]) -> None:
    """Raise InputError if `meta` states a unit or a licence that makes no sense."""
    unit, licence = meta.get("unit", "kPa"), meta.get("licence")
    if unit not in UNITS:
        raise InputError(
            f"scan: the unit of the readings is {short(unit)}; known are {', '.join(UNITS)}, so convert them first"
        )
    if licence is not None and not _may_name_a_licence(licence):
        raise InputError(
            f"scan: the licence is {short(licence)}; give its SPDX name, like {OWN_LICENCE}, in at most "
            f"{_LONGEST_LICENCE} printable characters"
        )
    if isinstance(meta.get("train"), Mapping):
        check_statements(meta["train"])


def had_another_shape(meta: Mapping[str, Any], name: str, digest: str) -> bool:
    """Tell whether a scan's `meta` says that its object of this name was not of the shape with this digest."""
    return shape_digest(meta, name) not in (None, digest)


def shape_digest(meta: Mapping[str, Any], name: str) -> Any:
    """Return the digest of the shape that an object of a scan had, as `meta` states it; None if it does not."""
    objects = meta.get("objects")
    about = objects.get(name) if isinstance(objects, Mapping) else None
    return about.get("digest") if isinstance(about, Mapping) else None


def _may_name_a_licence(licence: object) -> bool:
    return isinstance(licence, str) and licence.isprintable() and 0 < len(licence) <= _LONGEST_LICENCE


def spdx_name(licence: str) -> str:
    """Return a licence that is stated now, or an expression of several, in the letters that SPDX writes it in.

    Raises InputError for a name that is not on SPDX's list and does not begin with LicenseRef-. What a file states is
    not asked for this: readings under an odd name can still be read.
    """
    from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

    try:
        if _may_name_a_licence(licence):
            return str(canonicalize_license_expression(licence))
    except InvalidLicenseExpression:
        pass
    raise InputError(
        f"licence {short(licence)} is no SPDX name; give one of spdx.org/licenses, like {OWN_LICENCE}, or "
        "LicenseRef-NAME for terms of your own"
    )


def statements(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Collect from a scan's `meta` what a stranger needs to use the readings; what is not known is None.

    units: of each kind of number. frames: in which frame the numbers are. pad: the fields of a `Pad`. licence: an
    SPDX name; without one nobody but the owner may use the data. source: one of `SOURCES`.
    versions, seed, options: of the program and the press that made simulated readings. recordings: the sessions
    that recorded ones come from. train: the same of the training readings where they come from another scan.
    """
    tables = {name: meta.get(name) for name in ("versions", "options", "train")}
    versions, options, train = (value if isinstance(value, Mapping) else None for value in tables.values())
    source, recordings = meta.get("source", "simulated" if options else None), meta.get("recordings")
    return {
        "units": {
            "readings": meta.get("unit", "kPa"),
            "lengths": "mm",
            "angles": "rad",
            "times": "s",
            "force": "N",
        },
        "frames": {
            "poses": "sensor_in_object: the pose [x, y, theta] of the sensor in the frame of the object",
            "taxel_xy": "the centres of the taxels in the frame of the sensor",
            "taxels": "taxel = columns * row + column on a whole grid; rows run along +y, columns along +x",
        },
        "pad": meta.get("pad", (options or {}).get("pad")),
        "licence": meta.get("licence"),
        "source": source if source in SOURCES else None,
        "versions": versions,
        "options": options,
        "seed": (options or {}).get("seed"),
        "recordings": recordings if isinstance(recordings, list) else None,
        "train": statements(train) if train is not None else None,
    }
