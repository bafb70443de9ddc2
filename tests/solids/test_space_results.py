"""The folder of a run in space: what was written is read back, and what is damaged is refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from made_up_space import make_space_run

from tactsim.bench import formats
from tactsim.bench.results import load, task_name
from tactsim.core import InputError
from tactsim.solids.score import SpaceTrials


@pytest.fixture
def folder(tmp_path):
    return make_space_run().save(tmp_path / "run")


def test_a_run_is_read_back_to_the_bit(folder, tmp_path):
    run, again = make_space_run(), load(folder)
    for field in fields(SpaceTrials):
        assert np.array_equal(
            getattr(again.trials, field.name),
            getattr(run.trials, field.name),
            equal_nan=field.name in ("credibility", "radius_90", "nees"),
        ), field.name
    assert again.summary == run.summary
    assert again.config == run.config
    assert again.work == run.work
    for label, surface in run.objects.items():
        assert np.array_equal(again.objects[label].vertices, surface.vertices)
        assert np.array_equal(again.objects[label].points, surface.points)
    assert again.kind.name == "solids"
    assert again.save(tmp_path / "again")
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name


def test_hdf5_says_of_all_three_axes_of_a_place_that_they_are_in_millimetres(tmp_path):
    import h5py

    formats.write(make_space_run(), tmp_path / "run.h5", "hdf5")
    with h5py.File(tmp_path / "run.h5") as file:
        for of in ("", "true_", "start_"):
            assert [file[f"{of}{axis}"].attrs["unit"] for axis in "xyz"] == ["mm"] * 3
            assert "unit" not in file[f"{of}qw"].attrs


@pytest.mark.parametrize("missing", ["trials.csv", "times.csv", "times.json", "objects.npz"])
def test_a_folder_that_is_not_whole_is_refused_in_one_line(folder, missing):
    (folder / missing).unlink()
    with pytest.raises(InputError, match="not a whole run") as refusal:
        load(folder)
    assert "\n" not in str(refusal.value)


def test_own_meshes_alone_are_called_by_their_files():
    run = make_space_run()
    scan = {"options": {"objects": [], "meshes": ["parts/plate.stl"]}}
    run = replace(run, about=run.about | {"scan": scan})
    assert task_name(run) == "meshes parts/plate.stl"
