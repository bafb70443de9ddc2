"""What is written is what the formats' own libraries read, without any of our code.

Those that take long to import are imported where they are used.
"""

import base64
import json
from dataclasses import replace

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from made_scans import make_scan
from mcap.reader import make_reader

from tactsim.bench import formats
from tactsim.core import InputError, Pad, Scan

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


def messages(path, topic):
    with path.open("rb") as stream:
        for schema, _, message in make_reader(stream, validate_crcs=True).iter_messages(topics=[topic]):
            yield schema, message.log_time / 1e9, json.loads(message.data)


def test_mcap_has_images_as_foxglove_shows_them(scan, tmp_path):
    formats.write(scan, tmp_path / "out.mcap", "mcap")
    images = list(messages(tmp_path / "out.mcap", "/tactile"))
    shown = scan.readings[:, None] if scan.sequence is None else scan.sequence
    wanted = np.clip(shown.reshape(-1, 2, 3) / scan.readings.max(), 0, 1).astype("f4")
    assert len(images) == len(wanted)
    for (schema, seconds, image), picture in zip(images, wanted, strict=True):
        assert (schema.name, schema.encoding, image["encoding"]) == (
            "foxglove.RawImage",
            "jsonschema",
            "32FC1",
        )
        assert (image["height"], image["width"], image["step"]) == (2, 3, 12)
        pixels = np.frombuffer(base64.b64decode(image["data"]), "<f4").reshape(2, 3)
        assert np.array_equal(pixels[::-1], picture)  # the row of largest y on top
        assert image["timestamp"]["sec"] + 1e-9 * image["timestamp"]["nsec"] == pytest.approx(seconds)
        assert set(image) == set(json.loads(schema.data)["properties"])


def test_mcap_has_the_exact_readings_and_the_poses_in_metres(scan, tmp_path):
    formats.write(scan, tmp_path / "out.mcap", "mcap")
    readings = list(messages(tmp_path / "out.mcap", "/reading"))
    assert [message["taxels"] for _, _, message in readings] == scan.readings.tolist()
    assert [message["pose"] for _, _, message in readings] == scan.poses.tolist()
    for (schema, begin, message), (x, y, theta) in zip(
        messages(tmp_path / "out.mcap", "/pose"), scan.poses.tolist(), strict=True
    ):
        assert schema.name == "foxglove.PoseInFrame"
        place, turn = message["pose"]["position"], message["pose"]["orientation"]
        assert (place["x"], place["y"], place["z"]) == (x / 1000, y / 1000, 0)
        assert np.exp(1j * theta) == pytest.approx((turn["w"] + 1j * turn["z"]) ** 2)
        assert begin == int(begin)
    if scan.sequence is not None:
        times = [seconds % 1 for _, seconds, _ in messages(tmp_path / "out.mcap", "/frame")]
        assert times == pytest.approx(np.tile(scan.sequence_times, len(scan)))


@pytest.mark.parametrize("times", [[1e-300, 2e-300, 3e-300], [1e8, 2e8, 1e9]])
def test_times_of_any_size_are_written_to_mcap_or_refused_in_one_line(times, tmp_path):
    made = make_scan(np.random.default_rng(0), count=12, frames=3)
    try:
        formats.write(replace(made, sequence_times=np.array(times)), tmp_path / "out.mcap", "mcap")
    except InputError:
        assert list(tmp_path.iterdir()) == []
