"""Files from strangers: damaged, made to claim too much, or pointing elsewhere; each is one line, nothing else."""

import json
import os

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hostile import damage
from made_scans import make_scan

from tactsim.bench import formats
from tactsim.core import InputError

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
