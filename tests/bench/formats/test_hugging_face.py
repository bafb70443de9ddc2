"""The libraries `datasets` and `lerobot` load what is exported.

They need torch, so they have an environment of their own: `make test-formats` makes it and runs these tests.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from made_scans import make_scan

from tactsim.bench import formats

PYTHON = Path(sys.prefix) / "formats" / "bin" / "python"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not PYTHON.exists(), reason="`make test-formats` installs the libraries"),
]

DATASETS = """
import json, sys
from datasets import load_dataset
found = {}
for split, rows in load_dataset(sys.argv[1]).items():
    found[split] = {name: rows[name][:] for name in rows.column_names}
print(json.dumps(found))
"""
LEROBOT = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
dataset = LeRobotDataset("local/exported", root=sys.argv[1])
found = [{name: getattr(value, "tolist", lambda: value)() for name, value in frame.items()} for frame in dataset]
stats = {name: {kind: value.tolist() for kind, value in of.items()} for name, of in dataset.meta.stats.items()}
print(json.dumps({"frames": found, "episodes": dataset.num_episodes, "fps": dataset.fps, "stats": stats}))
"""


def said_by(program, folder, home):
    """Run a program in the environment of the formats, without a network; gives the JSON that it prints last."""
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(home)}
    done = subprocess.run(
        [PYTHON, "-c", program, folder], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("splits", [["train", "test"], ["test"]], ids=["both", "test"])
@pytest.mark.parametrize("frames", [0, 3])
def test_datasets_loads_a_folder_of_parquet(frames, splits, tmp_path):
    scan = make_scan(np.random.default_rng(0), frames=frames, splits=splits)
    formats.write(scan, tmp_path / "out", "parquet")
    found = said_by(DATASETS, tmp_path / "out", tmp_path / "home")
    assert list(found) == splits
    for split, rows in found.items():
        half = scan.where(split)
        assert rows["label"] == half.labels.tolist()
        assert (rows["pose"], rows["readings"]) == (half.poses.tolist(), half.readings.tolist())
        if half.sequence is not None:
            assert np.array_equal(rows["sequence"], half.sequence)
            assert np.array_equal(rows["sequence_force"], half.sequence_force)


@pytest.mark.parametrize("taxels", [1, 4])
@pytest.mark.parametrize("frames", [0, 3])
def test_lerobot_loads_its_dataset(frames, taxels, tmp_path):
    scan = make_scan(np.random.default_rng(0), taxels=taxels, frames=frames, splits=["train"])
    formats.write(scan, tmp_path / "out", "lerobot")
    found = said_by(LEROBOT, tmp_path / "out", tmp_path / "home")
    assert (found["episodes"], found["fps"]) == (len(scan), 200 if frames else 1)
    shown = scan.readings[:, None] if scan.sequence is None else scan.sequence
    assert len(found["frames"]) == shown.shape[0] * shown.shape[1]
    for number, frame in enumerate(found["frames"]):
        press, image = divmod(number, shown.shape[1])
        assert np.array_equal(np.atleast_1d(frame["observation.tactile"]), shown[press, image].astype("f4"))
        assert np.array_equal(frame["action"], scan.poses[press].astype("f4"))
        assert (frame["episode_index"], frame["frame_index"], frame["index"]) == (press, image, number)
        assert frame["task"] == f"touch {scan.labels[press]}"
    assert found["stats"]["action"]["max"] == pytest.approx(scan.poses.astype("f4").max(axis=0).tolist())
