"""Where the objects of a scan lie in its frame, and the scan as seen from there.

Poses may be given in a frame whose origin is far from the object: in a robot's base frame the object lies hundreds of
mm away. What turns then turns about that origin. An angle that is off by a degree moves the object by 17 mm at 1 m, and
no search over coarse angles finds anything. And the frame of an object is its owner's choice: objects that were pressed
where they lay on a table have centres of their own, and where the pad is would say which object it is. So poses are
worked with as seen from the object.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tactsim.core.pad import OFFSET
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan

# mm. Positions whose mean and whose middle differ by less lie evenly about both; an origin that is nearer is the same.
_SAME = 1e-6
# mm, and standard errors: centres of objects that lie no farther apart are those of one frame.
_TOGETHER, _CHANCE = OFFSET / 2, 5.0
_DIGITS = 9  # decimals of mm that are kept when an origin moves: at 10 m the others are rounding


def object_origin(scan: Scan) -> FloatArray:
    """Find the origin (2,) mm from which to look at the objects of a scan: the centre of its training poses.

    Training poses that lie evenly about their middle, as on a grid, name it exactly; on grids about the origin, as all
    simulated scans have, it is 0 exactly. Others only say about where the objects are: then it is rounded to 10 mm,
    so that frames which were laid out by hand stay as they are. Without training poses all poses stand for them.
    """
    xy = scan.poses[scan.split == "train", :2]
    xy = xy if len(xy) else scan.poses[:, :2]
    if not len(xy):
        return np.zeros(2)
    middle, mean = (xy.min(axis=0) + xy.max(axis=0)) / 2, xy.mean(axis=0)
    if np.abs(mean - middle).max() > _SAME:
        return np.round(mean / OFFSET) * OFFSET + 0.0  # no -0
    return np.where(np.abs(middle) > _SAME, middle, 0.0)


def object_origins(scan: Scan) -> dict[str, FloatArray]:
    """Find for each object of a scan the origin (2,) mm from which to look at it.

    That is `object_origin` of all, if the centres of the objects' training poses lie together, but for chance; else
    each object lies in a frame of its own, and this centre is its origin.
    """
    centres, errors = {}, []
    for label in scan.letters:
        own = scan.where("train", label)
        xy = (own if len(own) else scan.where(label=label)).poses[:, :2]
        mean = xy.mean(axis=0)
        centres[label] = np.where(np.abs(mean) > _SAME, mean, 0.0)
        errors.append(float(np.hypot(*xy.std(axis=0))) / np.sqrt(len(xy)))
    apart = np.ptp(list(centres.values()), axis=0).max() if centres else 0.0
    if apart > _TOGETHER + _CHANCE * max(errors, default=0.0):
        return centres
    return dict.fromkeys(centres, object_origin(scan))


def seen_from(scan: Scan, origins: Mapping[str, FloatArray]) -> Scan:
    """Give a scan with the poses of each object seen from its origin (2,) mm; the scan itself if all are 0.

    `meta["object_origin"]` of what is returned is where its origin lies in the frame of the file, mm, or where that of
    each object does. The centres of objects in `meta` are moved too, unless they are given in the frame of a drawing:
    nearer to 0 than to the origin.
    """
    if not any(origin.any() for origin in origins.values()):
        return scan
    before = scan.meta.get("object_origin", (0.0, 0.0))
    at = {
        label: (np.array(before[label] if isinstance(before, Mapping) else before) + origin).tolist()
        for label, origin in origins.items()
    }
    first = next(iter(at.values()))
    meta: dict[str, Any] = {**scan.meta, "object_origin": first if at == dict.fromkeys(at, first) else at}
    objects = scan.meta.get("objects")
    if isinstance(objects, Mapping):
        meta["objects"] = {
            label: _facts_seen_from(facts, origins[label]) if label in origins else facts
            for label, facts in objects.items()
        }
    by_row = np.array([origins[label] for label in scan.labels.tolist()]).reshape(-1, 2)
    return replace(scan, poses=positions_from(scan.poses, by_row), meta=meta)


def positions_from(poses: FloatArray, origin: FloatArray) -> FloatArray:
    """Give poses (..., 3) as seen from `origin` (2,) mm, or one each, rounded to what doubles hold at 10 m."""
    return np.concatenate([np.round(poses[..., :2] - origin, _DIGITS), poses[..., 2:]], axis=-1)


def _facts_seen_from(facts: Mapping[str, Any], origin: FloatArray) -> Mapping[str, Any]:
    centre = np.array(facts.get("centre", (0.0, 0.0)), dtype=float)
    moved = centre - origin
    if np.hypot(*centre) <= np.hypot(*moved):
        return facts
    return {**facts, "centre": moved.tolist()}
