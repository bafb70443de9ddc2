"""Every kind of file that is read, damaged and made hostile: it works or is refused in one line; nothing else."""

import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import trimesh
from hostile import damage, damaged, reads_or_refuses, swapped

from tactsim import models
from tactsim.bench import results, sweep
from tactsim.bench.compare import compare
from tactsim.bench.config import run_config, scan_options
from tactsim.bench.experiment import perform
from tactsim.bench.placement import properties
from tactsim.bench.report.curves import tables
from tactsim.bench.report.page import page
from tactsim.bench.report.write import find
from tactsim.bench.runs.pooled import collect
from tactsim.bench.runs.saved import load
from tactsim.core import Pad, Scan
from tactsim.core.errors import InputError
from tactsim.core.reading import Reading
from tactsim.estimators import create
from tactsim.hardware.calibration import Calibration, Correction
from tactsim.hardware.device import Device, load_device
from tactsim.hardware.recorded import CsvReplay, Replay
from tactsim.hardware.recording import Kind, Recorder, RecordReader
from tactsim.hardware.scans import read_intervals, scan_of_sessions
from tactsim.hardware.stream import Stream
from tactsim.press import ScanOptions

GOOD = {}  # kind: the content of a good file, made once
CASES = 15
MANY = 1000


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, shared_cache):
    run = perform(run_config(letters="IO", trials=3, readings=4, bins=100))
    folder = tmp_path_factory.mktemp("run") / "run"
    folder.mkdir()
    results.save(run, folder)
    (folder / "sweep.json").write_text(json.dumps({"schema": 1, "runs": [{"name": "run", "config": {}}]}))
    return folder


@pytest.fixture(scope="module")
def small_scan():
    rng = np.random.default_rng(0)
    labels, split = np.repeat(["I", "O"], 6), np.tile(["train", "test"], 6)
    objects = {"I": {"symmetry": 2, "centre": [0.0, 0.0], "inertia_over_mass": 50.0}}
    meta = {"objects": objects, "options": ScanOptions().model_dump(mode="json")}
    return Scan(rng.random((12, 36)) * 50, rng.normal(size=(12, 3)), labels, split, Pad().taxel_xy, meta)


# ---- for each kind of file: a good one, and all that reads it


def toml_of(values):
    return tomli_w.dumps(values).encode()


def mesh(kind):
    body = trimesh.creation.box((0.012, 0.008, 0.004) if kind == "glb" else (12, 8, 4))
    content = trimesh.Scene(body).export(file_type=kind) if kind == "glb" else body.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


SVG = b"""<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" width="30mm" height="30mm" viewBox="0 0 30 30">
<style>.a{fill:red}</style><g transform="translate(5 5) rotate(10)" fill-rule="evenodd"><path class="a"
d="M0 0 h10 v10 h-10 z M3 3 C 4 2 6 2 7 3 A 2 2 0 0 1 7 7 Q 5 8 3 7 Z"/><circle cx="15" cy="4" r="3"/>
<rect x="0" y="12" width="4" height="3" rx="1"/><polygon points="10,12 14,12 12,16"/></g></svg>"""
DEVICE = {
    "name": "small", "deadline": 2.0, "pad": {"rows": 2, "columns": 3, "no_seam": True, "unread_columns": 0},
    "codec": {"kind": "fields", "kpa_per_count": 0.5, "zero": 100.0, "request": "01", "layout": [
        {"is": "header", "bytes": "AA 55"}, {"is": "length", "of": "after"}, {"is": "index", "size": 2},
        {"is": "clock", "size": 2, "tick_s": 0.001}, {"is": "taxels", "count": 6, "bits": 12},
        {"is": "checksum", "kind": "crc16-modbus"}, {"is": "footer", "bytes": "0D 0A"}]},
    "part": [{"port": 0, "taxels": [0, 1, 2, 3, 4, 5]}],
}  # fmt: skip
CALIBRATION = {
    "device": "small", "port": "p", "taken": "2026-01-01T00:00:00Z", "frames": 50, "tare": [1.0] * 6,
    "noise": [0.1] * 6, "gain": [1.0] * 6, "dead": [1], "stuck": [2],
}  # fmt: skip
PLAN = {"label": "I", "poses": [[0.0, 0.0, 0.0], [1.0, 1.0, 0.5]], "frames": 3}
WORLD = {"placement_mm": 0.2, "press": {"force": 3.0}, "sensor": {"noise": 1.5, "psf_sigma": 0.8}}
SWEEP = {
    "defaults": {"letters": "IO", "trials": 4, "set": {"gamma": 0.2}, "scan_set": {"press": {"force": 2.0}}},
    "run": [{"estimator": "histogram", "bins": [100, 1000]}, {"estimator": "particle", "particles": 9, "seed": [0, 1]}],
}  # fmt: skip
MARKS = b"label,split,x_mm,y_mm,theta_rad,first_s,last_s\nI,train,0,0,0,0,0.2\nO,test,1,2,0.5,0.3,0.5\n"
CSV = b"Time [ms],Elem0,Elem1,Elem2,Elem3,Elem4,Elem5\n" + b"".join(
    b"%d,1,2,3,4,5,6\n" % (10 * k) for k in range(60)
)


def read_world(path):
    scan_options(world=str(path))


def read_pad(path):
    assert Pad.load(path).taxel_xy.shape[1] == 2
    scan_options(scan_set={"pad": str(path)})


def read_sweep(path):
    for config in sweep.read(str(path))[1]:
        create(config.estimator, **config.options)


def read_device(path):
    device = load_device(str(path))
    stream = Stream(device)
    rng = np.random.default_rng(0)
    stream.request(0, 0.0)
    stream.received(0, rng.bytes(3000), 0.1)
    stream.received(0, bytes.fromhex("aa55") * 1000, 0.2)


def read_calibration(path):
    pad = Pad(rows=2, columns=3, seam=None)
    Correction(Calibration.load(path), pad).apply(Reading(np.zeros(6), 0.0))


def csv_device():
    return Device.model_validate(
        {"name": "csv", "codec": {"kind": "pps-csv", "taxels": 6}, "pad": DEVICE["pad"]}
    )


def read_csv(path):
    for _ in CsvReplay(path, csv_device()):
        pass


def read_recording(path):
    for _ in Replay(path):
        pass
    scan_of_sessions([path])


def read_scan(path):
    scan = Scan.load(path)
    properties(scan)
    assert len(scan.digest) == 64
    scan.where("train")


def read_run(path):
    groups = collect((folder, load(folder)) for folder in find([path.parent])[0])
    run = groups[0].entries[0].run
    compare(GOOD["good run"], run)
    compare(run, run)
    page(groups, [], [])
    tables(groups, [])


def recording(path):
    device = dict(DEVICE, codec={k: v for k, v in DEVICE["codec"].items() if k != "request"})
    with Recorder(path) as recorder:
        recorder.segment({"device": device, "calibration": CALIBRATION, "plan": PLAN, "urls": ["p"]}, 0.0)
        for k in range(20):
            recorder.reading(Reading(np.arange(6.0) + k, 0.1 * k))
        recorder.received(0, b"\xaa\x55" * 20, 2.5)
        recorder.sent(0, b"\x01", 2.6)
        recorder.lost(0, 2.7)
        recorder.mark({"number": 0, "what": "taken", "first": 2, "count": 3}, 3.0)
        recorder.mark({"number": 1, "what": "taken", "first": 9, "count": 3}, 3.1)
        recorder.end({"readings": 20}, 4.0)
    return path.read_bytes()


TEXTS = {
    "world.toml": (WORLD, read_world),
    "pad.toml": ({"rows": 4, "columns": 4, "pitch_x": 2.0, "no_seam": True}, read_pad),
    "sweep.toml": (SWEEP, read_sweep),
    "device.toml": (DEVICE, read_device),
    "calibration.toml": (CALIBRATION, read_calibration),
}
FILES = {
    "marks.csv": (lambda folder: MARKS, read_intervals),
    "vendor.csv": (lambda folder: CSV, read_csv),
    "recording.tactrec": (lambda folder: recording(folder / "made.tactrec"), read_recording),
    "thing.stl": (lambda folder: mesh("stl"), models.shape),
    "thing.obj": (lambda folder: mesh("obj"), models.shape),
    "thing.glb": (lambda folder: mesh("glb"), models.shape),
    "thing.svg": (lambda folder: SVG, models.shape),
}
OF_A_RUN = ("run.json", "summary.json", "times.json", "trials.csv", "times.csv", "sweep.json")


def how_many(count):
    return [count, pytest.param(MANY, marks=pytest.mark.slow)]


@pytest.mark.parametrize("count", how_many(CASES))
@pytest.mark.parametrize("name", [*TEXTS, *FILES])
def test_a_damaged_file_is_read_or_refused_in_one_line(name, count, tmp_path):
    if name in TEXTS:
        values, read = TEXTS[name]
        content = toml_of(values) if name.endswith(".toml") else json.dumps(values, indent=1).encode()
    else:
        make, read = FILES[name]
        content = make(tmp_path)
    damage(name, read, tmp_path / name, content, count)


@pytest.fixture
def copied_run(run_folder, tmp_path):
    GOOD["good run"] = load(run_folder)
    folder = tmp_path / "sweep" / "runs" / "run"
    folder.mkdir(parents=True)
    for path in run_folder.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    return folder


@pytest.mark.parametrize("count", how_many(4))  # each draws a page
@pytest.mark.parametrize("name", OF_A_RUN)
def test_a_damaged_run_is_shown_or_refused_in_one_line(name, count, copied_run):
    damage(name, read_run, copied_run / name, (copied_run / name).read_bytes(), count)
    if not name.endswith("json"):
        return
    values = json.loads((copied_run / name).read_text())
    for seed in range(count):
        content = json.dumps(swapped(values, np.random.default_rng(seed))).encode()
        note = f"{name}, seed {seed}: {content[:300]!r}"
        reads_or_refuses(read_run, copied_run / name, content, note)


# ---- files whose parts have checksums: damaged inside, and sealed again


@pytest.mark.parametrize("count", how_many(CASES))
def test_a_recording_with_hostile_records_is_read_or_refused(count, tmp_path):
    recording(tmp_path / "good.tactrec")
    records = list(RecordReader(tmp_path / "good.tactrec"))
    for seed in range(count):
        rng = np.random.default_rng(seed)
        path = tmp_path / f"{seed}.tactrec"
        which = rng.integers(len(records))
        with Recorder(path) as recorder:
            for number, record in enumerate(records):
                payload = record.payload
                if number == which or (record.kind is Kind.SEGMENT and rng.random() < 0.5):
                    if payload[:1] == b"{" and rng.random() < 0.7:
                        payload = json.dumps(swapped(json.loads(payload), rng)).encode()
                    elif payload:
                        payload = damaged(payload, rng)
                recorder.write(record.kind, record.link, record.time, payload)
        reads_or_refuses(read_recording, path, path.read_bytes(), f"seed {seed}")


def npy(shape, dtype, body=b"", version=1):
    """Write an array's file by hand, with whatever a header may claim."""
    header = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    size = len(header).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + size + header + body


ARRAYS = {
    "10^12 rows": npy((10**12, 36), "<f8"),
    "a negative shape": npy((-1, 36), "<f8"),
    "wide names": npy((10**6,), "<U1000000"),
    "objects": npy((3,), "|O", b"cos\nsystem\n(S'touch harmed'\ntR."),
    "a huge header": b"\x93NUMPY\x02\x00" + (2**31).to_bytes(4, "little") + b"{" * 1000,
    "code in the header": npy("__import__('os').system('touch harmed')", "<f8").replace(b'"', b""),
    "a pickle": b"\x80\x04cos\nsystem\n(S'touch harmed'\ntR.",
    "infinite": npy((12, 36), "<f8", np.full((12, 36), np.inf).tobytes()),
    "no text": npy((12,), "<U1", b"\xff\xff\xff\xff" * 12),
    "surrogates": npy((12,), "<U1", b"\x00\xd8\x00\x00" * 12),
    "control codes": npy((12,), "<U1", b"\x1b\x00\x00\x00" * 12),
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_hostile_arrays_in_a_scan_are_refused(kind, small_scan, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small_scan.save("good.npz")
    with zipfile.ZipFile("good.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for name in members:
        with zipfile.ZipFile("bad.npz", "w") as archive:
            for other, content in members.items():
                archive.writestr(other, ARRAYS[kind] if other == name else content)
        with pytest.raises(InputError) as caught:
            read_scan("bad.npz")
        assert "\n" not in str(caught.value)
    assert not Path("harmed").exists()


@pytest.mark.parametrize("meta", ["[]", '{"a": [1e999]}', "[" * 100_000])
def test_a_scan_whose_meta_is_no_json_object_is_refused(meta, small_scan, tmp_path):
    small_scan.save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as arrays:
        np.savez(tmp_path / "bad.npz", **(dict(arrays) | {"meta": np.array(meta)}))
    with pytest.raises(InputError, match=r"bad\.npz") as caught:
        read_scan(tmp_path / "bad.npz")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("count", how_many(CASES))
def test_a_damaged_scan_is_read_or_refused_in_one_line(count, small_scan, tmp_path):
    small_scan.save(tmp_path / "good.npz")
    damage("scan", read_scan, tmp_path / "a.npz", (tmp_path / "good.npz").read_bytes(), count)
    with zipfile.ZipFile(tmp_path / "good.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for seed in range(count):
        rng = np.random.default_rng(seed)
        chosen = list(members)[rng.integers(len(members))]
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w") as archive:
            for name, member in members.items():
                archive.writestr(name, damaged(member, rng) if name == chosen else member)
        reads_or_refuses(read_scan, tmp_path / "a.npz", content.getvalue(), f"{chosen}, seed {seed}")


# ---- what is no file


READERS = {
    **{name: read for name, (_, read) in {**TEXTS, **FILES}.items()},
    "scan.npz": read_scan,
}


@pytest.mark.parametrize("name", READERS)
def test_pipes_folders_devices_and_nothing_are_refused_at_once(name, tmp_path):
    read, path = READERS[name], tmp_path / name
    os.mkfifo(path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / name).mkdir()
    (tmp_path / "zeros").mkdir()
    (tmp_path / "zeros" / name).symlink_to("/dev/zero")
    for place in (path, tmp_path / "folder" / name, tmp_path / "zeros" / name, tmp_path / "none" / name):
        with pytest.raises(InputError) as caught:
            read(place)
        assert "\n" not in str(caught.value)
