"""What all formats of a scan have in common: bit for bit, whole or not at all, a mistake is one line."""

import dataclasses
import importlib
import json
import os

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import refused
from hostile import damage
from hypothesis import HealthCheck, given, settings
from made_scans import make_scan, scans
from small_runs import make_run_in

from tactsim.bench import formats
from tactsim.core import InputError, Scan


def place(folder, name, stem="out"):
    return folder / (stem + (formats.FORMATS[name].suffixes or ("",))[0])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("name", formats.FORMATS)
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scan=scans())
def test_any_scan_comes_back_bit_for_bit(name, scan, tmp_path_factory):
    path = place(tmp_path_factory.mktemp("any"), name)
    formats.write(scan, path, name)
    assert formats.read(path).digest == scan.digest


@pytest.mark.parametrize("frames", [0, 3])
@pytest.mark.parametrize("name", formats.FORMATS)
def test_the_same_scan_gives_the_same_bytes(name, frames, tmp_path, rng):
    scan = make_scan(rng, frames=frames)
    contents = []
    for stem in ("first", "second"):
        path = place(tmp_path, name, stem)
        formats.write(scan, path, name)
        files = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
        contents.append([(one.relative_to(path).as_posix(), one.read_bytes()) for one in files])
    assert contents[0] == contents[1]


@pytest.mark.parametrize("name", formats.FORMATS)
def test_a_failure_leaves_nothing_behind(name, tmp_path, rng, monkeypatch):
    broken = {"parquet": "document_of", "hdf5": "_add"}[name]
    monkeypatch.setattr(formats.FORMATS[name].load(), broken, lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        formats.write(make_scan(rng), place(tmp_path, name), name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", formats.FORMATS)
def test_a_missing_library_is_one_line_that_names_the_extra(name, tmp_path, rng, monkeypatch):
    def absent(wanted, *rest):
        if not wanted.startswith("tactsim"):
            raise ModuleNotFoundError(f"No module named {wanted!r}")
        return importlib.import_module(wanted, *rest)

    monkeypatch.setattr(formats, "import_module", absent)
    with pytest.raises(InputError, match=rf"pip install 'tactsim\[{name}\]'"):
        formats.write(make_scan(rng), place(tmp_path, name), name)
    assert list(tmp_path.iterdir()) == []


def test_a_card_says_of_poses_what_the_scan_says(tmp_path, rng):
    scan = make_scan(rng)
    unposed = dataclasses.replace(scan, meta={**scan.meta, "poses": "unknown"})
    for stem, one, said in (("a", scan, "at known poses"), ("b", unposed, "in poses that nobody noted")):
        formats.write(one, tmp_path / stem, "parquet")
        card = (tmp_path / stem / "README.md").read_text(encoding="utf-8")
        assert card.count(said) == 3  # the name twice
        assert ("sensor_in_object" in card) == (one is scan)


@pytest.mark.parametrize("source", ["scan.npz", "own", "own.h5"])
def test_of_a_scan_of_ones_own_it_is_said_that_nobody_noted_poses(source, tmp_path, here, rng):
    scan = dataclasses.replace(make_scan(rng), presses=None)
    scan.save(tmp_path / "scan.npz")
    formats.write(scan, tmp_path / "own", "parquet")
    formats.write(scan, tmp_path / "own.h5", "hdf5")
    done = here("import", source, "--poses", "none", "--out", "new.npz")
    assert done.returncode == 0, done.stderr
    new = Scan.load(tmp_path / "new.npz")
    assert not new.poses.any()
    wanted = dataclasses.replace(scan, poses=new.poses, meta={**scan.meta, "poses": "unknown"})
    assert new.digest == wanted.digest
    done = here("import", "new.npz", "--poses", "none", "--out", "again.npz")
    assert done.returncode == 0, done.stderr
    assert Scan.load(tmp_path / "again.npz").digest == new.digest
    words = ["import", source, "--poses", "none", "--out", "other.npz"]
    refused(here(*words, "--zero", "3"), f"--zero is of files of other programs; {source} is a scan")
    refused(here(*words, "--labels", "y"), "--labels is of files of other programs")
    refused(here(*words, "--pad", "emulated", "--unit", "count"), f"{source} says its pad and unit itself")


def test_a_folder_that_holds_something_is_refused(tmp_path, here, rng):
    make_scan(rng).save(tmp_path / "scan.npz")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").write_text("precious")
    result = here("export", "scan.npz", "--to", "parquet", "--out", "full")
    refused(result, "holds something already")
    assert [one.name for one in (tmp_path / "full").iterdir()] == ["mine"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--to", "parqet", "--out", "x"], "did you mean 'parquet'"),
        (["--to", "hdf5", "--out", "x.bag"], "ends in .h5 or .hdf5"),
        (["--to", "parquet", "--out", "scan.npz"], "that is a file"),
        (["--to", "hdf5", "--out", "x.h5", "--licence", "bogus"], "licence 'bogus' is no SPDX name"),
    ],
)
def test_a_mistake_is_one_line(words, says, tmp_path, here, rng):
    make_scan(rng).save(tmp_path / "scan.npz")
    before = sorted(tmp_path.iterdir())
    refused(here("export", "scan.npz", *words), says)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("name", formats.FORMATS)
def test_a_scan_travels_by_the_command_line(name, tmp_path, here, scan_file):
    path = place(tmp_path, name)
    done = here("export", scan_file, "--to", name, "--out", path)
    assert done.returncode == 0, done.stderr
    assert f"768 readings of I O, 36 taxels, as {name}" in done.stdout
    assert here("import", path, "--out", "again.npz").returncode == 0
    assert (tmp_path / "again.npz").read_bytes() == scan_file.read_bytes()


def test_a_licence_is_stated_once(tmp_path, here, rng, scan_file):
    make_scan(rng).save(tmp_path / "own.npz")
    assert (
        here("export", "own.npz", "--to", "hdf5", "--out", "own.h5", "--licence", "CC0-1.0").returncode == 0
    )
    assert formats.read(tmp_path / "own.h5").about["licence"] == "CC0-1.0"
    refused(
        here("export", scan_file, "--to", "hdf5", "--out", "ours.h5", "--licence", "MIT"), "CC-BY-4.0", "MIT"
    )
    assert here("import", "own.h5", "--out", "again.npz", "--licence", "CC0-1.0").returncode == 0
    refused(here("import", "own.h5", "--out", "other.npz", "--licence", "MIT"), "CC0-1.0")
    assert Scan.load(tmp_path / "again.npz").meta == {"licence": "CC0-1.0"}


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, shared_cache):
    return make_run_in(tmp_path_factory.mktemp("run") / "run", letters="IO", trials=2, readings=3, bins=100)


def test_a_run_s_trials_are_the_same_in_every_format(run_folder, tmp_path, here):
    import h5py
    import pyarrow.parquet

    from tactsim.bench.results import Run

    columns = Run.load(run_folder).columns()
    assert here("export", run_folder, "--to", "parquet", "--out", "trials").returncode == 0
    assert here("export", run_folder, "--to", "hdf5", "--out", "trials.h5").returncode == 0
    for place in ("trials", "trials.h5", run_folder):
        refused(here("import", place, "--out", "scan.npz"), "the trials of a run", "an export of a scan")
    table = pyarrow.parquet.read_table(tmp_path / "trials" / "data" / "test-00000-of-00001.parquet")
    assert table.column_names == list(columns)
    with h5py.File(tmp_path / "trials.h5") as file:
        assert set(file) == {*columns, "run"}
        assert file["x"].attrs["unit"] == "mm"
        for name, values in columns.items():
            text = values.dtype.kind == "U"
            stored = file[name].asstr()[()] if text else file[name][()]
            assert np.array_equal(stored, values, equal_nan=not text), name
            assert np.array_equal(np.array(table[name].to_pylist()), values, equal_nan=not text), name


CASES = 30
TRAIN = "data/train-00000-of-00001.parquet"


@pytest.fixture
def written(tmp_path):
    """Write a small scan in a format; gives its path and the file of it that is damaged."""

    def write(name, **words):
        form = formats.FORMATS[name]
        path = tmp_path / ("scan" + (form.suffixes or ("",))[0])
        formats.write(make_scan(np.random.default_rng(0), splits=["train"], **words), path, name)
        return path

    return write


def refuses(path, says=None):
    with pytest.raises(InputError, match=says) as error:
        formats.read(path)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 3000


@pytest.mark.parametrize(("name", "file"), [("parquet", TRAIN), ("parquet", "scan.json"), ("hdf5", "")])
def test_a_damaged_file_is_read_or_refused_in_one_line(name, file, written):
    path = written(name, frames=3)
    target = path / file if file else path
    damage(f"{name}{file}", lambda _: formats.read(path), target, target.read_bytes(), CASES)


# ---- Parquet


def rewritten(path, change):
    table = pq.read_table(path / TRAIN)
    (path / TRAIN).unlink()
    pq.write_table(change(table), path / TRAIN)


def with_column(table, name, array):
    return table.set_column(table.column_names.index(name), name, array)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t.drop_columns(["readings"]), "column readings should be once"),
        (
            lambda t: with_column(t, "readings", t["pose"]),
            r"column readings should be .*fixed_size_list.*\[4\]",
        ),
        (lambda t: with_column(t, "label", pa.array(["x" * 500] * len(t))), "too long or not printable"),
        (lambda t: with_column(t, "row", pa.array([0] * len(t))), "not numbered from 0"),
    ],
)
def test_a_table_of_another_make_is_refused(change, says, written):
    path = written("parquet")
    rewritten(path, change)
    refuses(path, says)


def test_more_rows_than_a_scan_may_have_are_refused_before_they_are_read(written):
    path = written("parquet", count=1, taxels=1)
    rows = 2_000_000  # a run of zeros: 2 kB in the file
    zeros = pa.array(np.zeros(rows, dtype=np.int64))
    document = json.loads((path / "scan.json").read_text())
    taxels = 1000
    (path / "scan.json").write_text(json.dumps(document | {"taxel_xy": [[0, 0]] * taxels}))
    labels = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int8)), pa.array(["A"]))
    pq.write_table(pa.table({"row": zeros, "label": labels}), path / TRAIN)
    refuses(path, "claims .* bytes")


# ---- HDF5


def hdf5(written, change, **words):
    path = written("hdf5", **words)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def replace(file, name, **words):
    del file[name]
    file.create_dataset(name, **words)


def outside(file):
    file["readings_elsewhere"] = np.zeros((6, 4))
    del file["readings"]
    file["readings"] = h5py.ExternalLink("/etc/passwd", "/readings")


def virtual(file):
    del file["readings"]
    layout = h5py.VirtualLayout(shape=(6, 4), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", shape=(6, 4))
    file.create_virtual_dataset("readings", layout)


def huge(file):
    replace(file, "readings", shape=(10**9, 4), dtype="f8", chunks=(1000, 4))


@pytest.mark.parametrize(
    ("change", "says"),
    [(outside, "no dataset readings of its own"), (virtual, "lies in another file"), (huge, "claims")],
)
def test_an_hdf5_file_that_points_elsewhere_or_claims_too_much_is_refused(change, says, written):
    path = hdf5(written, change)
    os.mkfifo(path.with_name("pipe.h5"))  # whoever follows a link to it waits for ever
    refuses(path, says)


def test_a_pipe_is_not_waited_for(tmp_path):
    path = tmp_path / "x.h5"
    os.mkfifo(path)
    refuses(path, "not a regular file")
