"""docs/environment.md says what the source says: options, observations, and how exact `fast` is."""

import inspect
import re

import gymnasium
import numpy as np
from building import ROOT

from tactsim.env.touch_env import TouchEnv
from tactsim.env.world import NORMALS, world
from tactsim.press.scan_poses import random_poses

PAGE = (ROOT / "docs" / "environment.md").read_text(encoding="utf-8")


def rows(heading):
    """The first cells of a section's table."""
    section = re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", PAGE, re.S | re.M)[1]
    return [line.split("|")[1:-1] for line in re.findall(r"^\| `.*$", section, re.M)]


def test_the_options_and_their_defaults_are_those_of_the_environment():
    parameters = inspect.signature(TouchEnv).parameters
    stated = {name.strip(" `"): default.strip() for name, default, _ in rows("Options")}
    assert set(stated) == set(parameters) - {"task"}
    for name, default in stated.items():
        if re.fullmatch(r"[\d.]+", default):
            assert float(default) == parameters[name].default, name
        else:
            assert not parameters[name].default, name


def test_the_observations_are_those_of_the_space():
    env = gymnasium.make("tactsim/letters-v1", belief="nearest")
    assert {name.strip(" `") for name, *_ in rows("Observation")} == set(env.observation_space)


def test_fast_readings_are_a_step_off_at_most():
    own, fast = (world("letters-offgrid-v1", None, {}, fast) for fast in (False, True))
    rng = np.random.default_rng(0)
    letters, poses, normals = (
        rng.integers(5, size=100),
        random_poses(rng, 100),
        rng.standard_normal((100, NORMALS)),
    )
    apart = np.abs(own.press(letters, poses, normals)[0] - fast.press(letters, poses, normals)[0])
    assert apart.max() < 0.35  # half of a step of 0.7 kPa: rounding then adds at most one step
    assert (apart < 0.07).mean() > 0.95
