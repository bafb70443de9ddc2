"""`SpaceScan`: readings of objects in space, each touched from a side of its own, and the file that holds them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core.documents import parse_json
from tactsim.core.errors import InputError, unknown
from tactsim.core.finite import finite
from tactsim.core.npz import read_npz, write_npz
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import check_statements
from tactsim.core.rigid import checked_poses
from tactsim.core.scan import SPLITS, digest_of, is_label

_ARRAYS = ("readings", "poses", "labels", "split", "taxel_points", "taxel_normals", "touch")
_SEQUENCE = ("sequence", "sequence_force")


@dataclass(frozen=True, eq=False, repr=False)
class SpaceScan:
    """Readings of objects that a pad touched from known poses in space.

    readings: (n, taxels) kPa at rest. poses: (n, 7) sensor_in_object at rest, where the robot says that it is. The
    sensor's z axis looks out of the pad, into the object; the pad came along it, over the last `meta["stroke"]` mm.
    A touch that met nothing reads 0 at the end of its stroke. labels: (n,). split: (n,) "train" or "test".
    taxel_points, taxel_normals: (taxels, 3) mm in the sensor frame and unit vectors: the taxels' centres on the pad's
    unloaded surface and where they look; z = 0 and +z on a flat pad. touch: (n,) whole numbers: readings of one number
    were taken together, by several pads.

    meta: how it was made, a JSON object. `meta["objects"][label]` holds, where known, `rotations` (k, 4) the finite
    group of turns about the origin that leave the object as it is, `axis` (3,) where every turn about it does, or null,
    and `radius` mm about the origin that holds all of it.

    The images on the way to rest may be there: sequence (n, frames, taxels) kPa, float32, the last at rest, and
    sequence_force (frames,) N, how hard the pad pressed at each. Both or none.

    Raises InputError when shapes disagree, a number is not finite, a rotation is none, or a name is wrong.
    """

    readings: FloatArray
    poses: FloatArray
    labels: NDArray[np.str_]
    split: NDArray[np.str_]
    taxel_points: FloatArray
    taxel_normals: FloatArray
    touch: NDArray[np.intp]
    meta: Mapping[str, Any] = field(default_factory=dict)
    sequence: NDArray[np.float32] | None = None
    sequence_force: FloatArray | None = None

    def __post_init__(self) -> None:
        for name, axes in (("readings", 2), ("taxel_points", 2), ("taxel_normals", 2)):
            values = finite(getattr(self, name), f"scan: {name}")
            if values.ndim != axes:
                raise InputError(f"scan: {name} has {values.ndim} axes; it is a table")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "poses", checked_poses(self.poses, "scan: poses"))
        for name in ("labels", "split"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.str_))
        object.__setattr__(self, "touch", np.asarray(self.touch).astype(np.intp))
        count, taxels = self.readings.shape
        wanted = {
            "poses": (count, 7), "labels": (count,), "split": (count,), "touch": (count,),
            "taxel_points": (taxels, 3), "taxel_normals": (taxels, 3),
        }  # fmt: skip
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"scan: {name} has shape {getattr(self, name).shape}, but readings of shape "
                    f"{self.readings.shape} ask for {shape}"
                )
        if not taxels:
            raise InputError("scan: readings have no taxels")
        if np.abs(np.linalg.norm(self.taxel_normals, axis=1) - 1).max() > 1e-6:
            raise InputError("scan: taxel_normals are not of length 1")
        self._check_sequence()
        for label in self.objects:
            if not is_label(label):
                raise InputError(f"scan: the label {label[:100]!r} is empty, too long or not printable")
        other = sorted(set(self.split.tolist()) - set(SPLITS))
        if other:
            raise InputError(f"scan: split says {other[0]!r}; only 'train' and 'test' have a meaning")
        try:
            json.dumps(self.meta, allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"scan: meta is no JSON without NaN and infinity: {error}") from None
        check_statements(self.meta)

    def _check_sequence(self) -> None:
        if self.sequence is None and self.sequence_force is None:
            return
        if self.sequence is None or self.sequence_force is None:
            raise InputError("scan: a sequence has both, sequence and sequence_force")
        force = finite(self.sequence_force, "scan: sequence_force")
        sequence = finite(self.sequence, "scan: sequence").astype(np.float32)
        count, taxels = self.readings.shape
        if force.ndim != 1 or not len(force) or sequence.shape != (count, len(force), taxels):
            raise InputError(
                f"scan: sequence has shape {sequence.shape} and sequence_force {force.shape}; they are "
                f"({count}, frames, {taxels}) and (frames,)"
            )
        object.__setattr__(self, "sequence", sequence)
        object.__setattr__(self, "sequence_force", force)

    def __len__(self) -> int:
        return len(self.readings)

    def __repr__(self) -> str:
        """Say in one line what was touched: a notebook shows it."""
        counts = ", ".join(f"{np.count_nonzero(self.split == split):,} to {split}" for split in SPLITS)
        return f"<SpaceScan of {' '.join(self.objects)}: {counts}, {self.readings.shape[1]} taxels>"

    @property
    def objects(self) -> tuple[str, ...]:
        """List the labels in the order of their first appearance."""
        return tuple(dict.fromkeys(self.labels.tolist()))

    @property
    def _arrays(self) -> tuple[str, ...]:
        return _ARRAYS if self.sequence is None else _ARRAYS + _SEQUENCE

    @cached_property
    def digest(self) -> str:
        """Name the scan by its content: equal scans have equal digests (SHA-256, hex)."""
        return digest_of(self.meta, {name: getattr(self, name) for name in self._arrays})

    def where(self, split: str | None = None, label: str | None = None) -> SpaceScan:
        """Select the readings of one split and/or one label, in their order; none of a label that is not there.

        Raises InputError for a split that is neither "train" nor "test".
        """
        chosen = np.ones(len(self), dtype=bool)
        if split is not None:
            if split not in SPLITS:
                raise unknown("split", split, SPLITS)
            chosen &= self.split == split
        if label is not None:
            chosen &= self.labels == label
        return self.some(chosen)

    def some(self, chosen: NDArray[Any]) -> SpaceScan:
        """Select readings by a mask or by their numbers."""
        names = ["readings", "poses", "labels", "split", "touch"]
        if self.sequence is not None:
            names.append("sequence")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def save(self, path: str | Path) -> None:
        """Write the scan as .npz: its arrays and `meta`, a JSON string. Whole or not at all; equal scans, equal bytes.

        Raises InputError if `path` cannot be written.
        """
        write_npz(path, self.meta, {name: getattr(self, name) for name in self._arrays})

    @classmethod
    def load(cls, path: str | Path) -> SpaceScan:
        """Read a scan written by `save`; nothing in the file is unpickled or run.

        Raises InputError if the file is missing, cut short, of another kind, claims more than 1 GiB or holds what
        `SpaceScan` refuses.
        """
        try:
            arrays = read_npz(path, (*_ARRAYS, "meta"), _SEQUENCE)
            return cls(meta=parse_json(str(arrays.pop("meta")), "meta"), **arrays)
        except InputError as error:
            raise InputError(
                f"scan {path}: {error}; make one with `bench scan --task solids --out FILE`"
            ) from error
