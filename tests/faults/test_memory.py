"""Small files that claim, or make a careless reader ask for, more memory than there is."""

import json
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from test_hostile_files import npy

from tactsim.core import Pad, Scan

# Reads every file named with at most half a GB more than the program itself takes.
READ = """
import json, re, resource, sys
from pathlib import Path
from tactsim.bench import sweep
from tactsim.bench.config import scan_options
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.device import load_device
from tactsim.hardware.recorded import Replay
from tactsim.models import shape
from tactsim.core.errors import InputError
from tactsim import Scan
import trimesh, svg.path, tinycss2, cssselect2
taken = int(re.search(r"VmSize:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) << 10
resource.setrlimit(resource.RLIMIT_AS, (taken + (1 << 29),) * 2)
readers = {
    "npz": Scan.load, "toml": sweep.read, "world": lambda path: scan_options(world=path),
    "device": load_device, "calibration": Calibration.load, "shape": shape,
    "recording": lambda path: list(Replay(path)),
}
for kind, path in json.loads(sys.argv[1]):
    try:
        readers[kind](path)
        print("read", path)
    except InputError as error:
        print("refused", path, str(error).replace(chr(10), "<newline>")[:200])
"""


@pytest.fixture
def bombs(tmp_path):
    """Write the files: (kind of reader, path)."""
    rng = np.random.default_rng(0)
    scan = Scan(rng.random((4, 36)), rng.random((4, 3)), ["A"] * 4, ["train", "test"] * 2, Pad().taxel_xy)
    scan.save(tmp_path / "good.npz")
    with zipfile.ZipFile(tmp_path / "good.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    found = []

    def scan_with(name, content, kind=zipfile.ZIP_DEFLATED):
        path = tmp_path / f"{len(found)}.npz"
        with zipfile.ZipFile(path, "w", kind, compresslevel=1) as archive:
            for other, member in members.items():
                archive.writestr(other, content if other == name else member)
        found.append(("npz", path))

    scan_with("readings.npy", npy((10**12, 36), "<f8"))
    scan_with("labels.npy", npy((4,), "<U1000000000"))
    scan_with("readings.npy", npy((2**27 - 1, 36), "<f8"))
    scan_with("meta.npy", npy((), "<U50000", ("[" * 50_000).encode("utf-32-le")))

    def text(kind, name, content):
        (tmp_path / name).write_text(content)
        found.append((kind, tmp_path / name))

    key = "a." * 400_000 + "b = 1"
    for kind in ("toml", "world", "device", "calibration"):
        text(kind, f"{kind}.toml", key)
    text("toml", "many.toml", "[[run]]\n" + "\n".join(f"set.x{k} = [1, 2]" for k in range(60)))
    text("device", "wide.toml", 'name = "x"\n[codec]\nkind = "pps-csv"\ntaxels = 9999999999999\n')
    text("shape", "claims.stl", "")
    (tmp_path / "claims.stl").write_bytes(bytes(80) + (2**32 - 1).to_bytes(4, "little") + bytes(1000))
    text("shape", "rows.obj", "v 0 0 0\n" * 10 + "f 1 2 999999999999\n")
    (tmp_path / "sparse.npz").touch()
    with (tmp_path / "sparse.npz").open("r+b") as stream:
        stream.truncate(1 << 42)
    found.append(("npz", tmp_path / "sparse.npz"))
    start = b"\x89TACTREC\r\n\x1a\n" + b"\x01\x00"
    (tmp_path / "long.tactrec").write_bytes(start + b"\x01\x00\x00\x00" + b"\xff" * 4 + bytes(8) + b"{}")
    found.append(("recording", tmp_path / "long.tactrec"))
    return found


def read_with_little_memory(files):
    done = subprocess.run(
        [sys.executable, "-c", READ, json.dumps([(kind, str(path)) for kind, path in files])],
        capture_output=True, text=True, check=False, timeout=240,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.splitlines()


@pytest.mark.long
def test_no_claim_of_a_file_is_believed(bombs):
    lines = read_with_little_memory(bombs)
    assert [line.split()[0] for line in lines] == ["refused"] * len(bombs), "\n".join(lines)
    assert not any("<newline>" in line for line in lines)
