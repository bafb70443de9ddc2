"""What a scan may state of itself beside its numbers: unit, licence, and the shapes that its objects had."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactsim.core.errors import InputError, short

# What a taxel may say: a pressure, a force, a voltage or what the device counts.
UNITS = ("kPa", "N", "V", "count")
# The licence of readings of shapes that come with tactsim: made for data, it asks to name the authors and nothing
# else. The code's own, MIT, speaks of software only.
OWN_LICENCE = "CC-BY-4.0"
# Of a scan's `meta`, where nobody noted how its presses lie to the object, and to each other.
NO_POSES = {"poses": "unknown"}
_POSES = (NO_POSES["poses"], "one")  # what may be said of them: "one" if all presses were at one pose

_LONGEST_LICENCE = 100  # characters


def check_statements(meta: Mapping[str, Any]) -> None:
    """Raise InputError if `meta` states a unit, a licence or poses that make no sense."""
    unit, licence, poses = meta.get("unit", "kPa"), meta.get("licence"), meta.get("poses")
    if unit not in UNITS:
        raise InputError(
            f"scan: the unit of the readings is {short(unit)}; known are {', '.join(UNITS)}, so convert them first"
        )
    if licence is not None and not may_name_a_licence(licence):
        raise InputError(
            f"scan: the licence is {short(licence)}; give its SPDX name, like {OWN_LICENCE}, in at most "
            f"{_LONGEST_LICENCE} printable characters"
        )
    if poses is not None and poses not in _POSES:
        raise InputError(
            f"scan: meta['poses'] is {short(poses)}; say 'unknown' where nobody noted them, 'one' where all presses "
            "were at one, or leave it out"
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


def may_name_a_licence(licence: object) -> bool:
    """Tell whether a scan may state it as its licence, whatever SPDX calls it."""
    return isinstance(licence, str) and licence.isprintable() and 0 < len(licence) <= _LONGEST_LICENCE


def poses_unknown(meta: Mapping[str, Any]) -> bool:
    """Tell whether a scan's `meta` says that nobody knows how its test presses lie to the object, and to each other."""
    return bool(meta.get("poses") == NO_POSES["poses"])


def training_poses_unknown(meta: Mapping[str, Any]) -> bool:
    """Tell whether `meta` says so of the presses that train, which may be of another scan."""
    train = meta.get("train")
    return poses_unknown(train if isinstance(train, Mapping) else meta)
