"""The data of every task are those that its file states, and the hash sees all that a method is given."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tactsim.bench import plane, trials
from tactsim.bench.config import Slip
from tactsim.bench.experiment import gather
from tactsim.bench.formats.public_recordings import prepared_scan
from tactsim.bench.tasks import data, names, task
from tactsim.core import InputError
from tactsim.core.cache_folder import cache_folder
from tactsim.core.scan import Scan

SMALL = """
line = "Two letters."
seeds = [0, 1, 2, 3, 4]
trials = 2
readings = 3
scored = ["accuracy@1"]

[words]
letters = "IO"
"""
PRESSED_FOR_SECONDS = {"glyphs36-v1", "glyphs36-by-hand-v1"}
LONG = {"active-v1", "letters10-faulty-v1", "open-set-v1", "worn-pad-v1"}
PRESSED = [name for name in names() if "scan" not in task(name).words]
KEPT = cache_folder()  # where `bench data get` keeps the recordings of who runs the tests
CHANGED = (
    "{name} gives other data than before. Was that wanted? Then leave it as it was (say the old value in its [words]) "
    "and add a new version, a file of its own; else something broke what is pressed, sensed or drawn"
)


def check(name, seeds):
    one = task(name)
    stated = dict(zip(one.seeds, one.hashes, strict=True))
    found = {seed: data.hash_data(one, seed) for seed in seeds(one)}
    assert found == {seed: stated[seed] for seed in found}, CHANGED.format(name=name)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.long) if name in LONG else name
        for name in PRESSED
        if name not in PRESSED_FOR_SECONDS
    ],
)
def test_the_first_seed_of_a_task_gives_the_data_that_it_states(name):
    check(name, lambda one: one.seeds[:1])


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_every_seed_of_a_task_gives_the_data_that_it_states(name, monkeypatch):
    if name not in PRESSED:
        monkeypatch.setenv("TACTSIM_CACHE_DIR", str(KEPT))
        try:
            prepared_scan(task(name).words["scan"].removeprefix("recording:"), 0)
        except InputError as error:
            pytest.skip(str(error))
    check(name, lambda one: one.seeds)


@pytest.fixture
def small(tmp_path):
    """Write a small task, changed as asked; gives it, read."""

    def write(old="", new="", name="small-v1"):
        path = tmp_path / f"{name}.toml"
        path.write_text(SMALL.replace(old, new, 1))
        return task(str(path))

    return write


@pytest.mark.long
def test_the_hash_depends_on_what_is_asked_and_not_on_names_or_the_cache(small):
    base = data.hash_data(small(), 0)
    assert data.hash_data(small('"Two letters."', '"Two others."'), 0) == base
    assert data.hash_data(small('["accuracy@1"]', '["error_mm@1"]'), 0) == base
    assert data.hash_data(small(name="other-v2"), 0) == base
    assert data.hash_data(small(), 0, cache=False) == base
    others = [data.hash_data(small(), 1)]
    for old, new in (
        ("trials = 2", "trials = 3"),
        ("readings = 3", "readings = 2"),
        ('"IO"', '"OI"'),
        ('letters = "IO"', 'letters = "IO"\ntest_poses = "same"'),
        ('letters = "IO"', 'letters = "IO"\nhold_out = "O"'),
        ('letters = "IO"', 'letters = "IO"\nslip = {walk_mm = 0.1}'),
        ('letters = "IO"', 'letters = "IO"\nexplore = "information"'),
        ('letters = "IO"', 'letters = "IO"\nscan_set = {sensor.noise = 2.1}'),
    ):
        others.append(data.hash_data(small(old, new), 0))
    assert len({base, *others}) == len(others) + 1


def altered(monkeypatch, change):
    """Let the press give a scan that was changed."""

    def changed(config, **words):
        return gather(config, scan=change(gather(config, **words).scan), **words)

    monkeypatch.setattr(data, "gather", changed)


def with_array(name, place, difference):
    def change(scan):
        values = np.array(getattr(scan, name))
        values[place] += difference
        return replace(scan, **{name: values})

    return change


def other_inertia(scan):
    meta = json.loads(json.dumps(scan.meta))
    meta["objects"]["I"]["inertia_over_mass"] += 1e-3
    return replace(scan, meta=meta)


def swapped_splits(scan):
    names = np.where(np.arange(len(scan)) < 192, "test", "train")
    return replace(scan, split=np.concatenate([names[:384], scan.split[384:]]))


@pytest.mark.parametrize(
    "change",
    [
        with_array("readings", (-1, -1), -0.7),
        with_array("poses", (300, 2), 1e-5),
        with_array("taxel_xy", (3, 0), 1e-5),
        other_inertia,
        swapped_splits,
        lambda scan: Scan(scan.readings[1:], scan.poses[1:], scan.labels[1:], scan.split[1:], scan.taxel_xy, scan.meta),
    ],
)  # fmt: skip
def test_the_hash_sees_every_part_of_a_scan(monkeypatch, small, change):
    base = data.hash_data(small(), 0)
    altered(monkeypatch, change)
    assert data.hash_data(small(), 0) != base


def test_the_hash_does_not_see_meta_nor_the_last_bits_of_a_number(monkeypatch, small):
    base = data.hash_data(small(), 0)
    rng = np.random.default_rng(0)

    def change(scan):
        return replace(
            scan,
            readings=scan.readings + 1e-9 * rng.standard_normal(scan.readings.shape),
            poses=scan.poses * (1 + 1e-15),
            meta={**scan.meta, "licence": "CC0-1.0"},
        )

    altered(monkeypatch, change)
    assert data.hash_data(small(), 0) == base


def shifted(function, by):
    return lambda *words, **named: function(*words, **named) + by


@pytest.mark.parametrize(
    ("where", "name", "make"),
    [
        (plane, "draw_true_pose", lambda right: shifted(right, [0, 0, 1e-5])),
        (Slip, "poses", lambda right: shifted(right, [1e-5, 0, 0])),
        (trials, "generator",
         lambda right: lambda seed, one, stream: right(seed + (stream == 1), one, stream)),
        (trials, "generator",
         lambda right: lambda seed, one, stream: right(seed + (stream == 0), one, stream)),
    ],
)  # fmt: skip
def test_the_hash_sees_what_a_trial_draws(monkeypatch, small, where, name, make):
    moving = small('letters = "IO"', 'letters = "IO"\nslip = {walk_mm = 0.1}')
    base = data.hash_data(moving, 0)
    monkeypatch.setattr(where, name, make(getattr(where, name)))
    assert data.hash_data(moving, 0) != base


def test_other_touches_that_are_offered_change_the_hash(monkeypatch, small):
    from tactsim.bench.on_demand import PressedTouches

    offered = small('letters = "IO"', 'letters = "I"\nexplore = "information"')
    base = data.hash_data(offered, 0)
    right = PressedTouches.sensor_in_robot

    def last_one_moved(self, robot_in_object):
        poses = np.array(right(self, robot_in_object))
        poses[-1, 0] += 1e-5  # none of the touches that are taken
        return poses

    monkeypatch.setattr(PressedTouches, "sensor_in_robot", last_one_moved)
    assert data.hash_data(offered, 0) != base


@pytest.mark.long
def test_a_task_that_states_its_data_is_checked_against_them(small):
    hashes = data.check_data(small())
    assert len(set(hashes)) == 5
    right = small("[words]", f"hashes = {json.dumps(list(hashes))}\n[words]")
    assert data.check_data(right, seeds=[3]) == hashes[3:4]
    assert data.check_data(right) == hashes
    wrong = small("[words]", f"hashes = {json.dumps([*hashes[:4], hashes[0]])}\n[words]")
    assert data.check_data(wrong, seeds=[0, 1]) == hashes[:2]
    with pytest.raises(InputError, match=r"the data of seed 4 have the hash .*new version"):
        data.check_data(wrong)
    assert right.data != wrong.data


def test_a_task_on_a_file_of_readings_has_a_hash(small, tmp_path):
    pressed = gather(small().configs("nearest")[0], jobs=1, cache=True, progress=data.silent).scan
    pressed.save(tmp_path / "own.npz")
    recorded = small('letters = "IO"', 'scan = "own.npz"')
    first, second = (data.hash_data(recorded, seed) for seed in (0, 1))
    assert first != second
    finer = replace(pressed, readings=pressed.readings + 2e-6)
    finer.save(tmp_path / "own.npz")
    assert data.hash_data(recorded, 0) != first, "what was recorded is compared to the last digit that counts"
