"""Scans of arrays that others saved with NumPy or MATLAB."""

import h5py
import numpy as np
import pytest
from command_line import refused
from hostile import damaged, reads_or_refuses
from made_scans import as_matlab_saves
from scipy.io import savemat

from tactsim.bench import formats
from tactsim.bench.formats.arrays_file import read_arrays
from tactsim.core import InputError, Pad, Scan

PAD = Pad(rows=2, columns=3, seam=None, unread_columns=0)
NAMES = {"readings": "readings", "poses": "poses", "labels": "labels", "split": "split"}
READINGS = np.random.default_rng(0).normal(size=(4, 6))
POSES = np.arange(12.0).reshape(4, 3)
WORDS = ("--pad", "pad.toml", "--unit", "count", "--out", "scan.npz")


@pytest.fixture(autouse=True)
def pad_file(tmp_path):
    (tmp_path / "pad.toml").write_text("rows = 2\ncolumns = 3\nno_seam = true\nunread_columns = 0\n")


def save(path, **arrays):
    given = {
        "readings": READINGS, "poses": POSES, "labels": np.array(["A", "B", "A", "long"]),
        "split": np.array(["train", "test", "train", "test"]), **arrays,
    }  # fmt: skip
    if path.suffix == ".npz":
        np.savez(path, **given)
    else:
        savemat(path, given)
    return path


def save_hdf5(path):
    with h5py.File(path, "w") as file:
        file["a/readings"], file["a/poses"] = READINGS.reshape(4, 2, 3), POSES
        file["who"] = ["A", "B", "A", "long"]


def test_datasets_of_hdf5_are_imported_by_their_names(tmp_path, here):
    save_hdf5(tmp_path / "lab.h5")
    names = ("--readings", "a/readings", "--poses", "/a/poses", "--labels", "who")
    done = here("import", "lab.h5", *WORDS, *names)
    assert done.returncode == 0, done.stderr
    wanted = Scan.from_arrays(READINGS, POSES, ["A", "B", "A", "long"], pad=PAD, unit="count")
    assert Scan.load(tmp_path / "scan.npz").digest == wanted.digest


def test_what_attributes_of_hdf5_say_of_numbers_counts(tmp_path, here):
    """As netCDF has them: a scale, an offset and a number for none; and names for numbers."""
    with h5py.File(tmp_path / "lab.h5", "w") as file:
        file["readings"], file["poses"] = np.where(READINGS[0, 0] == READINGS, -99, 4 * READINGS), POSES
        stated = {"scale_factor": 0.5, "add_offset": 3.0, "_FillValue": -99.0}
        file["readings"].attrs.update(stated)
        kind = h5py.enum_dtype({"nut": 3, "bolt": 7})
        file.create_dataset("labels", data=[3, 7, 7, 3], dtype=kind)
    done = here("import", "lab.h5", *WORDS)
    assert done.returncode == 0, done.stderr
    scan = Scan.load(tmp_path / "scan.npz")
    lost = (READINGS[0, 0] == READINGS).any(axis=0)
    assert scan.readings == pytest.approx(2 * READINGS[:, ~lost] + 3)
    assert scan.labels.tolist() == ["nut", "bolt", "bolt", "nut"]
    with h5py.File(tmp_path / "lab.h5", "a") as file:
        file["poses"].attrs["units"] = "cm, cm, rad"
    (tmp_path / "scan.npz").unlink()
    refused(here("import", "lab.h5", *WORDS), "its poses says that its unit is 'cm, cm, rad'")


@pytest.mark.parametrize("kind", ["float16", "float32", "int16"])
def test_images_of_a_press_are_averaged_in_whatever_type_they_are(kind):
    images = (np.random.default_rng(0).random((4, 9, 6)) * 30_000).astype(kind)
    scan = Scan.from_arrays(images, POSES, list("ABAB"), pad=PAD, unit="count")
    assert np.array_equal(scan.readings, images.mean(axis=1).astype(float))


def test_a_taxel_without_a_number_in_a_press_is_left_out_and_said(tmp_path, caplog):
    images = np.repeat(READINGS[:, None], 3, axis=1)
    images[2, :, 5] = images[1, 1, 0] = np.nan
    scan = read_arrays(save(tmp_path / "a.npz", readings=images), NAMES, PAD, "N")
    assert scan.readings == pytest.approx(READINGS[:, :5])
    assert np.array_equal(scan.taxel_xy, PAD.taxel_xy[:5])
    assert scan.meta["left_out"] == {"5": "no number (NaN) in 1 of 4 presses"}
    averaged = "each reading is the mean of 3 images of its press; of taxels with several axes give one"
    assert caplog.messages == [averaged, "taxel 5 is left out: no number (NaN) in 1 of 4 presses"]
    images[0] = np.nan
    with pytest.raises(InputError, match=r"in readings\[0\] 6 do: leave out the presses that failed"):
        read_arrays(save(tmp_path / "a.npz", readings=images), NAMES, PAD, "N")


def test_a_press_in_which_a_taxel_has_no_number_for_once_is_left_out_as_with_a_failed_cell(caplog):
    """Of names, two that look the same are one."""
    values = np.random.default_rng(0).random((40, 6))
    values[[3, 17], [1, 5]] = np.nan
    names = ["n\u00fct", "nu\u0308t"] * 20
    scan = Scan.from_arrays(
        values, np.tile(POSES, (10, 1)), names, None, PAD, unit="N", loads=np.arange(40.0)
    )
    assert np.array_equal(scan.readings, np.delete(values, [3, 17], axis=0))
    assert np.array_equal(scan.loads, np.delete(np.arange(40.0), [3, 17]))
    assert {*scan.labels.tolist()} == {"n\u00fct"}
    assert caplog.messages == ["2 of 40 readings have a cell without a number (NaN), and are left out"]


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_arrays_are_a_scan(suffix, tmp_path):
    scan = read_arrays(save(tmp_path / f"a{suffix}"), NAMES, PAD, "N")
    wanted = Scan.from_arrays(READINGS, POSES, ["A", "B", "A", "long"], ["train", "test"] * 2, PAD, unit="N")
    assert scan.digest == wanted.digest


def test_matlab_s_ways_of_saving_are_read(tmp_path):
    cell = np.empty((4, 1), dtype=object)
    cell[:, 0] = ["A", "B", "A", "long"]
    arrays = {
        "force": np.round(READINGS * 100).astype(np.int16).reshape(4, 2, 3),
        "where": POSES, "who": cell, "learn": np.array([[True], [False], [True], [False]]),
    }  # fmt: skip
    savemat(tmp_path / "a.mat", arrays, do_compression=True)
    names = {"readings": "force", "poses": "where", "labels": "who", "split": "learn"}
    scan = read_arrays(tmp_path / "a.mat", names, PAD, "count")
    assert np.array_equal(scan.readings, np.round(READINGS * 100))
    assert scan.labels.tolist() == ["A", "B", "A", "long"]
    assert scan.split.tolist() == ["train", "test", "train", "test"]


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"labels": np.array(["A", "B", "A", "B"], dtype=object)}, "labels.astype(str)"),
        ({"labels": np.array(["A", "none", "A", "none"])}, "a letter is called 'none'"),
        ({"poses": POSES * 30}, "poses turn by 330.0 rad; are these degrees?"),
        ({"poses": np.tile(np.eye(4), (4, 1, 1))}, "poses are (4, 4, 4); give (4, 3): x mm, y mm, theta rad"),
        ({"readings": READINGS[:0], "poses": POSES[:0], "labels": [""][:0], "split": [""][:0]}, "no presses"),
    ],
)  # fmt: skip
def test_what_no_run_could_use_is_refused_at_import(arrays, says, tmp_path, here):
    save(tmp_path / "a.npz", **arrays)
    refused(here("import", "a.npz", "--split", "split", *WORDS), says)
    assert not (tmp_path / "scan.npz").exists()


def test_a_file_of_no_format_is_refused_for_that(tmp_path, here):
    np.save(tmp_path / "one.npy", READINGS)
    refused(here("import", "one.npy", *WORDS), "numpy.savez")


def test_arrays_are_imported_by_their_names(tmp_path, here):
    np.savez(tmp_path / "a.npz", X=READINGS, T=POSES, y=np.array([0, 1, 0, 1]))
    done = here(
        "import", "a.npz", *WORDS, "--readings", "X", "--poses", "T", "--labels", "y", "--licence", "CC0-1.0"
    )
    assert done.returncode == 0, done.stderr
    scan = Scan.load(tmp_path / "scan.npz")
    assert (scan.letters, scan.split.tolist()) == (("0", "1"), ["train"] * 4)
    assert (scan.about["units"]["readings"], scan.about["licence"]) == ("count", "CC0-1.0")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["a.npz", "--out", "scan.npz"], "give --pad and --unit"),
        (["a.npz", "--pad", "emulated", "--out", "scan.npz"], "give --unit"),
        (["ours.npz", "--out", "scan.npz"], "ours.npz is a scan already"),
        (["ours.npz", *WORDS], "ours.npz is a scan already"),
        (
            ["solids.npz", "--poses", "none", "--out", "scan.npz"],
            "objects in space, which only `bench run --task",
        ),
        (["half.npz", "--out", "scan.npz"], "cannot read half.npz: it is not a whole .npz file"),
        (["none.npz", "--out", "scan.npz"], "cannot read none.npz: there is no such file"),
        (["a.npz", "--readings", "reading", *WORDS], "it has no array 'reading'; it has 'labels', 'poses', "),
        (["b.h5", *WORDS], "says its pad and unit itself"),
        (
            ["a.mat", "--labels", "who", *WORDS],
            "'poses', 'readings', 'split', shapes (4,), (4, 3), (4, 6), (4,); --",
        ),
        (
            ["lab.h5", *WORDS],
            "it has 'a/poses', 'a/readings', 'who', shapes (4, 3), (4, 2, 3), (4,); --readings",
        ),
        (["lab.h5", "--out", "scan.npz"], "give --pad and --unit"),
    ],
)
def test_a_mistake_is_one_line(words, says, tmp_path, here):
    save(tmp_path / "a.npz")
    save(tmp_path / "a.mat")
    ours = Scan.from_arrays(READINGS, POSES, list("ABAB"), pad=PAD, unit="N")
    ours.save(tmp_path / "ours.npz")
    (tmp_path / "half.npz").write_bytes((tmp_path / "ours.npz").read_bytes()[:500])
    np.savez(tmp_path / "solids.npz", taxel_points=np.zeros((6, 3)), readings=READINGS, meta="{}")
    formats.write(ours, tmp_path / "b.h5", "hdf5")
    save_hdf5(tmp_path / "lab.h5")
    refused(here("import", *words), says)
    assert not (tmp_path / "scan.npz").exists()


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"readings": {"a": READINGS}}, "is a struct, no numbers"),
        ({"readings": np.array([[READINGS, 1]], dtype=object)}, "cell of more than texts"),
    ],
)
def test_a_mat_file_of_anything_else_is_refused(arrays, says, tmp_path):
    with pytest.raises(InputError, match=says):
        read_arrays(save(tmp_path / "a.mat", **arrays), NAMES, PAD, "N")


def test_a_mat_file_that_claims_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tactsim.bench.formats.arrays_file.LARGEST", 1_000_000)
    savemat(tmp_path / "a.mat", {"readings": np.zeros((200_000, 1))}, do_compression=True)
    with pytest.raises(InputError, match="claims 1,600,000 bytes, more than a scan may hold"):
        read_arrays(tmp_path / "a.mat", {"readings": "readings"}, PAD, "N")


def test_a_damaged_mat_file_is_read_or_refused_in_one_line(tmp_path):
    cell = np.array(["A", "B", "A", "long"], dtype=object)
    arrays = {"readings": READINGS, "poses": POSES, "labels": cell, "split": np.array([1, 0, 1, 0])}
    path = tmp_path / "a.mat"
    savemat(path, arrays)
    content = path.read_bytes()
    for seed in range(100):  # of 1,200 files that are damaged like this SciPy's reader dies of one
        bad = damaged(content, np.random.default_rng(seed))
        reads_or_refuses(lambda path: read_arrays(path, NAMES, PAD, "N"), path, bad, f"seed {seed}")


def test_arrays_without_poses_say_that_nobody_noted_them(tmp_path, here):
    np.savez(tmp_path / "lab.npz", readings=READINGS, labels=list("ABAB"))
    refused(here("import", "lab.npz", *WORDS), "--poses none")
    assert here("import", "lab.npz", *WORDS, "--poses", "none", "--test", "50%").returncode == 0
    scan = Scan.load(tmp_path / "scan.npz")
    assert (scan.meta["poses"], scan.split.tolist()) == ("unknown", ["train", "train", "test", "test"])


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
@pytest.mark.parametrize("last", ["neither", "readings", "poses", "both"])
@pytest.mark.parametrize(
    "labels",
    [np.array([[1.0, 2.0, 1.0, 7.0]]), np.array(["AAA", "BB ", "AAA", "C  "]), ["AAA", "BB", "AAA", "C"]],
)
def test_arrays_that_matlab_saved_keep_rows_and_columns(tmp_path, last, labels, suffix):
    pictures = READINGS.reshape(4, 2, 3)
    pictures = np.moveaxis(pictures, 0, -1) if last in ("readings", "both") else pictures
    poses = POSES.T if last in ("poses", "both") else POSES
    as_matlab_saves(tmp_path / f"lab{suffix}", readings=pictures, poses=poses, labels=labels)
    names = {role: role for role in ("readings", "poses", "labels")}
    scan = read_arrays(tmp_path / f"lab{suffix}", names, PAD, "count")
    assert np.array_equal(scan.readings, READINGS)
    assert np.array_equal(scan.poses, POSES)
    assert scan.labels[3] in ("7", "C")


@pytest.mark.parametrize("name", ["trial", "trials"])
def test_fields_of_a_struct_are_arrays(tmp_path, name):
    whole = {"X": READINGS.reshape(4, 2, 3), "T": POSES, "y": np.array(list("ABAC"))}
    apart = np.zeros(4, dtype=[(field, "O") for field in whole])
    for at in range(4):
        apart[at] = tuple(array[at] for array in whole.values())
    savemat(tmp_path / "lab.mat", {name: whole if name == "trial" else apart})
    names = {"readings": f"{name}.X", "poses": f"{name}.T", "labels": f"{name}.y"}
    scan = read_arrays(tmp_path / "lab.mat", names, PAD, "count")
    assert np.array_equal(scan.readings, READINGS)
    assert np.array_equal(scan.poses, POSES)
    assert scan.labels.tolist() == list("ABAC")
    with pytest.raises(InputError, match=r"no 'trials?.Z'; its fields are X, T, y"):
        read_arrays(tmp_path / "lab.mat", names | {"poses": f"{name}.Z"}, PAD, "count")


@pytest.mark.parametrize("last", [False, True])
def test_dimensions_that_h5create_turned_round_are_turned_back(tmp_path, last):
    """MATLAB's h5create says not that it does so; poses of (3, n) do."""
    pictures = np.moveaxis(READINGS.reshape(4, 2, 3), 0, -1) if last else READINGS.reshape(4, 2, 3)
    names = {role: role for role in ("readings", "poses", "labels")}
    with h5py.File(tmp_path / "lab.h5", "w") as file:
        file.update({"readings": pictures.T, "poses": POSES.T, "labels": np.arange(4)[None]})
    scan = read_arrays(tmp_path / "lab.h5", names, PAD, "count")
    assert np.array_equal(scan.readings, READINGS)
    assert np.array_equal(scan.poses, POSES)
    with h5py.File(tmp_path / "square.h5", "w") as file:
        file.update({"readings": np.zeros((2, 2, 4)), "poses": POSES.T, "labels": np.arange(4)})
    with pytest.raises(InputError, match="may be MATLAB's, whose dimensions h5create"):
        read_arrays(tmp_path / "square.h5", names, PAD.model_copy(update={"columns": 2}), "count")


def test_presses_that_may_be_first_or_last_are_one_line(tmp_path):
    readings = np.arange(27.0).reshape(3, 3, 3)
    as_matlab_saves(tmp_path / "lab.h5", readings=readings, poses=np.zeros((3, 3)), labels=np.arange(3.0))
    names = {role: role for role in ("readings", "poses", "labels")}
    pad = PAD.model_copy(update={"rows": 3, "columns": 3})
    with pytest.raises(InputError, match="may have the 3 presses first or last"):
        read_arrays(tmp_path / "lab.h5", names, pad, "count")
