"""What all formats of a scan have in common: bit for bit, whole or not at all, a mistake is one line."""

import importlib

import numpy as np
import pytest
from command_line import refused
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
