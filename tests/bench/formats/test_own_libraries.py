"""What is written is what the formats' own libraries read, without any of our code.

Those that take long to import are imported where they are used.
"""

import json
import os
import subprocess
import sys

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from made_scans import make_scan

from tactsim.bench import formats
from tactsim.core import Pad, Scan

PAD = Pad(rows=2, columns=3, seam=None)


@pytest.fixture(params=[0, 4], ids=["readings", "sequences"])
def scan(request):
    made = make_scan(
        np.random.default_rng(1), count=7, taxels=6, frames=request.param, meta={"licence": "CC0-1.0"}
    )
    moving = {name: getattr(made, name) for name in ("sequence", "sequence_times", "sequence_force")}
    return Scan(made.readings, made.poses, made.labels, made.split, PAD.taxel_xy, made.meta, **moving)


def halves(scan):
    return {split: scan.where(split) for split in ("train", "test")}


@pytest.mark.long
def test_parquet_is_read_by_pyarrow_polars_and_duckdb(scan, tmp_path):
    import duckdb
    import polars

    formats.write(scan, tmp_path / "out", "parquet")
    for split, half in halves(scan).items():
        path = tmp_path / "out" / "data" / f"{split}-00000-of-00001.parquet"
        table = pq.read_table(path)
        assert np.array_equal(table["readings"].to_pylist(), half.readings)
        assert np.array_equal(table["pose"].to_pylist(), half.poses)
        assert table["label"].to_pylist() == half.labels.tolist()
        assert np.array_equal(table["row"].to_numpy(), np.flatnonzero(scan.split == split))
        if scan.sequence is not None:
            assert np.array_equal(table["sequence"].to_pylist(), half.sequence)
            assert np.array_equal(table["sequence_force"].to_pylist(), half.sequence_force)
        assert np.array_equal(polars.read_parquet(path)["readings"].to_numpy(), half.readings)
        largest = duckdb.sql(f"SELECT max(list_max(readings::DOUBLE[])) FROM '{path}'").fetchall()
        assert largest == [(half.readings.max(),)]


def test_hdf5_says_unit_and_description_of_every_array(scan, tmp_path):
    formats.write(scan, tmp_path / "out.h5", "hdf5")
    with h5py.File(tmp_path / "out.h5") as file:
        for name in ("readings", "poses", "taxel_xy", "sequence", "sequence_times", "sequence_force"):
            if getattr(scan, name) is not None:
                assert np.array_equal(file[name][()], getattr(scan, name))
                assert file[name].attrs["unit"]
        assert file["labels"].asstr()[()].tolist() == scan.labels.tolist()
        assert json.loads(file["meta"].asstr()[()]) == scan.meta
        assert file["readings"].attrs["unit"] == "kPa"
        assert file["readings"].compression == "gzip"
        assert [axis.label for axis in file["readings"].dims] == ["press", "taxel"]
        assert file.attrs["licence"] == "CC0-1.0"
        assert all(dataset.attrs["description"] for dataset in file.values())
        if scan.sequence is not None:
            assert np.array_equal(file["sequence"].dims[1][0][()], scan.sequence_times)


DATASETS = """
import json, sys
from datasets import load_dataset
found = {}
for split, rows in load_dataset(sys.argv[1]).items():
    found[split] = {name: rows[name][:] for name in rows.column_names}
print(json.dumps(found))
"""


def loaded(folder, home):
    """Load a folder in a process of its own, without a network: {split: {column: values}}."""
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(home)}
    done = subprocess.run(
        [sys.executable, "-c", DATASETS, folder], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.long
@pytest.mark.parametrize(("splits", "frames"), [(["train", "test"], 3), (["test"], 0)])
def test_datasets_loads_a_folder_of_parquet(frames, splits, tmp_path):
    scan = make_scan(np.random.default_rng(0), frames=frames, splits=splits)
    formats.write(scan, tmp_path / "out", "parquet")
    found = loaded(tmp_path / "out", tmp_path / "home")
    assert list(found) == splits
    for split, rows in found.items():
        half = scan.where(split)
        assert rows["label"] == half.labels.tolist()
        assert (rows["pose"], rows["readings"]) == (half.poses.tolist(), half.readings.tolist())
        if half.sequence is not None:
            assert np.array_equal(rows["sequence"], half.sequence)
            assert np.array_equal(rows["sequence_force"], half.sequence_force)
