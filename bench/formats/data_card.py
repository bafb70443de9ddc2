"""The README.md of an exported folder: a data card as Hugging Face reads it, with YAML before the text."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from tactsim.bench.results import Run
from tactsim.bench.runs.tables import markdown_table
from tactsim.core import Scan
from tactsim.core.scan import SPLITS

# Licences that Hugging Face knows by their SPDX names in small letters; there are more, which become "other".
_CC = ("CC-BY-4.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC0-1.0")
_KNOWN_LICENCES = (*_CC, "MIT", "Apache-2.0", "BSD-3-Clause")


def card_of_scan(scan: Scan) -> str:
    """Write the card of a scan in Parquet: splits, columns with their units, licence; `scan.json` says all else."""
    about, taxels = scan.about, scan.readings.shape[1]
    unit = about["units"]["readings"]
    columns = [
        ("column", "what it holds"),
        ("row", "the number of the reading in the scan, from 0"),
        ("label", "the object that was pressed"),
        ("pose", "sensor_in_object: x mm, y mm, theta rad"),
        ("readings", f"one value for each of {taxels} taxels, {unit}"),
    ]
    if scan.sequence_times is not None:
        frames = len(scan.sequence_times)
        columns += [
            ("sequence", f"{frames} images of the press on its way to rest, {unit}"),
            ("sequence_force", "the contact force at these times, N"),
        ]
    # Of readings under several licences no one licence can be named.
    licences = {about["licence"], *([about["train"]["licence"]] if about["train"] else [])}
    licence = licences.pop() if len(licences) == 1 else None
    text = [
        f"{len(scan):,} presses of a pad of {taxels} taxels against {len(scan.letters)} objects at known poses:",
        "    " + " ".join(scan.letters),
        markdown_table(columns).rstrip(),
        "`scan.json` says where the taxels' centres lie (mm, in the frame of the sensor), which frames and units all "
        "numbers have, and how the scan was made. `bench import FOLDER --out scan.npz` makes it of this folder again, "
        "bit for bit.",
        f"Licence: {licence or 'none is stated; ask the owner before you use the data'}.",
    ]
    splits = [split for split in SPLITS if np.any(scan.split == split)]
    return _card("Tactile presses at known poses", licence, splits, text)


def card_of_run(run: Run) -> str:
    """Write the card of a run's trials in Parquet."""
    text = [
        f"What the estimator {run.described} said after each reading of "
        f"{len(run.trials.truth):,} trials of {run.readings} readings: one row a trial and reading.",
        "`truth`, `label`: the true and the estimated object. `x`, `y`, `theta`: the estimated robot_in_object, mm, "
        "mm, rad; `true_x` and so on: the true one. `p_truth`, `p_label`: the probabilities given to the right and to "
        "the estimated label. `update_s`, `estimate_s`, `propose_s`: seconds of processor time. "
        f"`run.json` holds the configuration, the versions and the machine; the protocol is {run.protocol}.",
    ]
    return _card("Trials of recognition by touch", None, ["test"], text)


def _card(title: str, licence: str | None, splits: Iterable[str], text: Iterable[str]) -> str:
    """Put a card together: YAML (JSON is YAML) and paragraphs."""
    known = licence in _KNOWN_LICENCES
    head = {
        "pretty_name": title,
        "license": "unknown" if licence is None else licence.lower() if known else "other",
        **({} if licence is None or known else {"license_name": licence}),
        "task_categories": ["robotics"],
        "tags": ["tactile", "touch", "tactsim"],
        "configs": [
            {
                "config_name": "default",
                "data_files": [{"split": split, "path": f"data/{split}-*"} for split in splits],
            }
        ],
    }
    lines = [f"{name}: {json.dumps(value, ensure_ascii=False)}" for name, value in head.items()]
    return "\n".join(["---", *lines, "---", "", f"# {title}", "", "\n\n".join(text)]) + "\n"
