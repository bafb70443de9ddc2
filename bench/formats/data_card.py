"""The README.md of an exported folder: a data card as Hugging Face reads it, with YAML before the text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tactsim.bench.results import Run
from tactsim.bench.runs.tables import markdown_table
from tactsim.core import Scan
from tactsim.core.scan import SPLITS

# Licences that Hugging Face knows by their SPDX names in small letters; there are more, which become "other".
_KNOWN_LICENCES = [
    "CC-BY-4.0",
    "CC-BY-SA-4.0",
    "CC-BY-NC-4.0",
    "CC0-1.0",
    "MIT",
    "Apache-2.0",
    "BSD-3-Clause",
]
_SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (np.inf, "1M<n<10M"))
_CITATION = """Cite the harness, and the paper whose experiment it re-creates:

```bibtex
@software{tactsim,
  title  = {tactsim: a harness for comparing ways to recognise an object by touch},
  author = {{The tactsim authors}},
}
@inproceedings{pezzementi2011object,
  title     = {Object Mapping, Recognition, and Localization from Tactile Geometry},
  author    = {Pezzementi, Zachary and Reyda, Caitlin and Hager, Gregory D.},
  booktitle = {IEEE International Conference on Robotics and Automation (ICRA)},
  year      = {2011},
}
```
"""


def card_of_scan(scan: Scan) -> str:
    """Write the card of a scan in Parquet: splits, columns with their units, frames, licence, how it was made."""
    unit, taxels = scan.about["units"]["readings"], scan.readings.shape[1]
    columns: list[tuple[str, dict[str, Any], str]] = [
        ("row", {"dtype": "int64"}, "the number of the reading in the scan, from 0"),
        ("label", {"dtype": "string"}, "the object that was pressed"),
        ("pose", {"list": "float64", "length": 3}, "sensor_in_object: x mm, y mm, theta rad"),
        ("readings", {"list": "float64", "length": taxels}, f"one value for each of {taxels} taxels, {unit}"),
    ]
    if scan.sequence_times is not None:
        frames = len(scan.sequence_times)
        image = {"list": "float32", "length": taxels}
        images = f"{frames} images of the press on its way to rest, {unit}; their times stand in scan.json, s"
        force = {"list": "float32", "length": frames}
        columns += [
            ("sequence", {"list": image, "length": frames}, images),
            ("sequence_force", force, "the contact force at these times, N"),
        ]
    splits = {split: int(np.count_nonzero(scan.split == split)) for split in SPLITS}
    text = [
        f"{len(scan):,} presses of a pad of {taxels} taxels against {len(scan.letters)} objects at known poses.",
        "The objects are",
        "    " + " ".join(scan.letters),
        markdown_table([("column", "what it holds"), *((name, what) for name, _, what in columns)]).rstrip(),
        "The taxels' centres (mm, in the frame of the sensor), the pad and all options stand in `scan.json`. "
        "`bench import FOLDER --out scan.npz` makes a scan of this folder again, bit for bit.",
        *_made(scan),
        _CITATION,
    ]
    features = [{"name": name, **kind} for name, kind, _ in columns]
    return _card("Tactile presses at known poses", _licence_of(scan), splits, text, features)


def card_of_run(run: Run) -> str:
    """Write the card of a run's trials in Parquet."""
    text = [
        f"What the estimator {run.described} said after each reading of "
        f"{len(run.trials.truth):,} trials of {run.readings} readings: one row a trial and reading.",
        "`truth`, `label`: the true and the estimated object. `x`, `y`, `theta`: the estimated robot_in_object, mm, "
        "mm, rad; `true_x` and so on: the true one. `p_truth`, `p_label`: the probabilities given to the right and to "
        "the estimated label. `update_s`, `estimate_s`, `propose_s`: seconds of processor time. "
        "`run.json` holds the configuration, the versions and the machine; the protocol is "
        + f"{run.protocol}.",
        _CITATION,
    ]
    return _card("Trials of recognition by touch", None, {"test": run.trials.label.size}, text)


def _card(
    title: str,
    licence: str | None,
    splits: Mapping[str, int],
    text: Iterable[str],
    features: list[dict[str, Any]] | None = None,
) -> str:
    """Put a card together: YAML (JSON is YAML) and paragraphs. splits: how many rows each has."""
    files = [{"split": split, "path": f"data/{split}-*"} for split, rows in splits.items() if rows]
    head: dict[str, Any] = {
        "pretty_name": title,
        **_licence(licence),
        "size_categories": [next(name for most, name in _SIZES if sum(splits.values()) < most)],
        "task_categories": ["robotics"],
        "tags": ["tactile", "touch", "tactsim"],
        "configs": [{"config_name": "default", "data_files": files}],
    }
    if features is not None:
        head["dataset_info"] = {"features": features}
    lines = [f"{name}: {json.dumps(value, ensure_ascii=False)}" for name, value in head.items()]
    return "\n".join(["---", *lines, "---", "", f"# {title}", "", "\n\n".join(text)])


def _licence_of(scan: Scan) -> str | None:
    """Name the one licence of all readings of a scan; None if they have none, or several."""
    about = scan.about
    licences = {about["licence"], *([about["train"]["licence"]] if about["train"] else [])}
    return licences.pop() if len(licences) == 1 else None


def _made(scan: Scan) -> list[str]:
    """Say in paragraphs under which licence a scan is, in which frames its numbers are and how it was made."""
    about = scan.about
    licence = _licence_of(scan)
    paragraphs = [
        "## Licence",
        f"{licence}." if licence else "None is stated: ask the owner before you use the data.",
        "## Frames and units",
        markdown_table([("numbers", "frame"), *about["frames"].items()]).rstrip(),
        markdown_table([("quantity", "unit"), *about["units"].items()]).rstrip(),
        "## How it was made",
    ]
    for whose, facts in (("", about), ("The training readings: ", about["train"])):
        if facts is not None:
            said = [facts["source"] or "not stated"]
            said += [] if facts["seed"] is None else [f"seed {facts['seed']}"]
            said += [f"{name} {version}" for name, version in (facts["versions"] or {}).items()]
            devices = {
                str(one.get("device")) for one in facts["recordings"] or [] if isinstance(one, Mapping)
            }
            said += [f"device {name}" for name in sorted(devices)]
            paragraphs.append(f"{whose}{'; '.join(said)}.")
    return paragraphs


def _licence(name: str | None) -> dict[str, str]:
    if name is None:
        return {"license": "unknown"}
    known = name in _KNOWN_LICENCES
    return {"license": name.lower()} if known else {"license": "other", "license_name": name}
