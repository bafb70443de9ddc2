"""The filters in space on solids known in closed form: contract, brute force, symmetry, mirror images, the whole world."""

import numpy as np
import pytest
import toy_solids as toy

from tactsim import estimators
from tactsim.core import InputError, rigid
from tactsim.estimators.contract import SPACE_CHECKS, SpaceCase

SPACE = ("space-refined", "space-tempered")
QUICK = {"rotations": 4, "voxel": 9.0, "cells": 100, "halvings": 3, "particles": 100, "rounds": 6}
HOOK = toy.Union((toy.Box((14.0, 4.0, 4.0)), toy.Box((4.0, 9.0, 4.0), (10.0, 13.0, 0.0)), toy.Box((4.0, 4.0, 8.0), (-10.0, 0.0, 12.0))))
MIRRORED = toy.Union(
    tuple(toy.Box(part.half, (-part.centre[0], *part.centre[1:])) for part in HOOK.parts)
)


@pytest.fixture(scope="module")
def scan():
    return toy.toy_scan(200, 1, ("ball", "block", "tee"))


@pytest.fixture(scope="module", params=SPACE)
def case(request, scan):
    return SpaceCase(lambda: estimators.create(request.param, **QUICK), scan)


@pytest.mark.parametrize("check", SPACE_CHECKS)
def test_an_estimator_in_space_keeps_its_contract(check, case):
    check(case)
