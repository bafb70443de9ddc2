"""The library `datasets` loads what is exported."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from made_scans import make_scan

from tactsim.bench import formats

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
