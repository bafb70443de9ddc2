"""What an environment presses: the task's own objects and errors, and which tasks have an environment at all."""

import numpy as np
import pytest

from tactsim.bench import tasks
from tactsim.bench.config import STILL
from tactsim.core import InputError, compose
from tactsim.env.world import NORMALS, World, world
from tactsim.press.engine import ideal_readings, press_at
from tactsim.press.scan_poses import random_poses
from tactsim.press.touches import Touches

TASK = 'line = "x"\nseeds = [0, 1, 2, 3, 4]\ntrials = 1\nreadings = 2\nscored = ["accuracy@2"]\n[words]\n'


@pytest.fixture(scope="module")
def letters():
    return world("letters-offgrid-v1", None, {}, False)


def pressed(world, letter, poses, normals):
    """Press one object at poses (n, 3), all of which come to rest: (n, taxels)."""
    readings, rests = zip(
        *(world.press(letter, *one) for one in zip(poses, normals, strict=True)), strict=True
    )
    assert all(rests)
    return np.array(readings)


def test_without_errors_it_is_the_ideal_press(letters):
    poses = random_poses(np.random.default_rng(0), 7)
    ideal = pressed(letters, 2, poses, np.zeros((7, NORMALS)))
    right, _ = ideal_readings(Touches.of(letters.letters[2], poses), letters.options)
    assert ideal == pytest.approx(right, abs=1e-9)


def test_the_numbers_that_were_drawn_say_how_far_a_press_is_off(letters):
    rng = np.random.default_rng(1)
    poses, normals = random_poses(rng, 5), rng.standard_normal((5, NORMALS))
    ideal = pressed(letters, 0, poses, normals)
    off = compose(poses, normals[:, :3] * [0.1, 0.1, 0.005])
    touches = Touches(letters.letters[0], off, 0.0044 * normals[:, 3:5])
    assert ideal == pytest.approx(press_at(touches, letters.options).readings(letters.options), abs=1e-9)


def test_the_forward_model_presses_with_the_same_errors_and_loads(tmp_path):
    path = tmp_path / "hand-v1.toml"
    path.write_text(TASK + 'world = "handheld"\nscan_set = { press.tilt_x = 0.01 }\n')
    rng = np.random.default_rng(3)
    poses, normals = random_poses(rng, 20), rng.standard_normal((20, NORMALS))
    own, fast = (
        pressed(World(tasks.task(str(path)), 0, STILL, fast), 1, poses, normals) for fast in (False, True)
    )
    assert fast == pytest.approx(own, abs=0.25, rel=0.005)  # kPa; the press has cells, the model has none
    assert own.max() > 40


def test_a_task_of_a_file_has_no_environment(tmp_path, letters):
    (tmp_path / "mine-v1.toml").write_text(TASK + 'scan = "mine.npz"\n')
    (tmp_path / "each-v1.toml").write_text(TASK + 'hold_out = "each"\n')
    letters.scan.save(tmp_path / "mine.npz")
    for name, said in (("mine-v1", "readings from a file"), ("each-v1", "its answer is always 'none'")):
        with pytest.raises(InputError, match=said):
            World(tasks.task(str(tmp_path / f"{name}.toml")), 0, STILL, False)
