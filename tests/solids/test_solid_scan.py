"""The file of readings in space: what comes back, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactsim.core.errors import InputError
from tactsim.core.rigid import random_rotations
from tactsim.core.scan import Scan
from tactsim.solids.scan import SpaceScan


@pytest.fixture
def scan() -> SpaceScan:
    rng = np.random.default_rng(0)
    poses = np.concatenate([rng.normal(0, 20, (6, 3)), random_rotations(6, rng)], axis=1)
    return SpaceScan(
        readings=rng.random((6, 4)), poses=poses,
        labels=np.array(["nut", "nut", "bolt", "bolt", "nut", "egg"]), split=np.array(["train", "test"] * 3),
        taxel_points=np.array([[x, y, 0.0] for y in (-1, 1) for x in (-1, 1)]),
        taxel_normals=np.tile([0.0, 0.0, 1.0], (4, 1)), touch=np.array([0, 1, 2, 2, 3, 4]),
        meta={"stroke": 40.0},
    )  # fmt: skip


def test_comes_back_from_its_file(scan: SpaceScan, tmp_path: Path) -> None:
    scan.save(tmp_path / "scan.npz")
    again = SpaceScan.load(tmp_path / "scan.npz")
    assert again.digest == scan.digest
    assert again.objects == ("nut", "bolt", "egg")
    assert again.meta == {"stroke": 40.0}


def test_selects_by_label_and_split(scan: SpaceScan) -> None:
    nuts = scan.where("train", "nut")
    assert nuts.labels.tolist() == ["nut", "nut"]
    assert nuts.touch.tolist() == [0, 3]


@pytest.mark.parametrize(
    ("change", "says"),
    [({"poses": np.zeros((6, 7))}, "length 1"), ({"poses": np.zeros((6, 3))}, "pose in space"),
     ({"readings": np.full((6, 4), np.nan)}, "readings"), ({"taxel_normals": np.zeros((4, 3))}, "length 1")],
)  # fmt: skip
def test_refuses(scan: SpaceScan, change: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        replace(scan, **change)


def test_is_not_taken_for_readings_of_letters_though_it_is_damaged(scan: SpaceScan, tmp_path: Path) -> None:
    scan.save(tmp_path / "whole.npz")
    with np.load(tmp_path / "whole.npz") as arrays:
        np.savez(tmp_path / "scan.npz", **{name: arrays[name] for name in arrays if name != "poses"})
    with pytest.raises(InputError, match="it holds objects in space"):
        Scan.load(tmp_path / "scan.npz")


def test_letters_without_their_taxels_are_not_taken_for_objects_in_space(tmp_path: Path) -> None:
    np.savez(tmp_path / "taxel_xy.npz", readings=np.zeros((1, 1)))  # its name tells nothing
    with pytest.raises(
        InputError,
        match=r"taxel_xy\.npz: it has no array 'poses'; it has 'readings'; make one with `bench scan",
    ):
        Scan.load(tmp_path / "taxel_xy.npz")
