"""Measure the trials of a run on a pad, press by press, led by the guide; what is measured already is kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactsim.bench.pad.guided import Station
from tactsim.bench.pad.guided import record as record_presses
from tactsim.bench.pad.measured import poses_to_press, recording_of
from tactsim.core import InputError, Pad, Scan
from tactsim.core.checking import checked
from tactsim.hardware.recording import Kind, RecordReader
from tactsim.hardware.session import Plan, Press, count_taken, note, parse_press


@dataclass(frozen=True)
class Wanted:
    """The trials to be measured: of each letter `trials`, each of `readings` presses. seed: of their poses."""

    letters: Sequence[str]
    trials: int
    readings: int
    seed: int


def measure(station: Station, wanted: Wanted, folder: Path, settings: Mapping[str, Any]) -> bool:
    """Lead through the trials that are missing in `folder`; returns whether all are there now.

    settings: fields of the sessions' plans (`Plan`). Stops where the person stops, and can be called again.
    Raises InputError if a recording in the folder does not fit, or too many presses were skipped.
    """
    trials = [(letter, trial) for letter in wanted.letters for trial in range(wanted.trials)]
    pad = station.device.pad
    # Wrong settings come to light before anything is pressed.
    plans = [_plan(letter, trial, wanted, settings, pad) for letter, trial in trials]
    notice = f"presses are kept in {folder}"
    for number, ((letter, trial), plan) in enumerate(zip(trials, plans, strict=True), start=1):
        path = recording_of(folder, letter, trial)
        begun = path.exists()
        if begun and _taken(path, plan) >= wanted.readings:
            continue
        title = f"trial {number} of {len(trials)}: "
        sitting = record_presses(station, plan, path, resume=begun, title=title, notice=notice)
        notice = ""
        if not sitting.done:
            return False
        if _taken(path, plan) < wanted.readings:
            raise InputError(
                f"{path} has too few presses, since too many were skipped; remove it and measure this trial again"
            )
    return True


def count_measured(wanted: Wanted, folder: Path) -> int:
    """Count the presses that are in the folder for these trials."""
    paths = [
        recording_of(folder, letter, trial) for letter in wanted.letters for trial in range(wanted.trials)
    ]
    return sum(count_taken(_progress(path)[1]) for path in paths if path.exists())


def check_pads(train: Scan, station: Station) -> None:
    """Raise InputError unless the training readings have a taxel where the pad has one."""
    shared = (abs(train.taxel_xy[:, None] - station.device.pad.taxel_xy[None]).max(axis=-1) < 1e-3).any()
    if not shared:
        raise InputError(
            f"--train-scan was taken on another pad than that of {station.device.name!r}: no taxel is at the same place"
        )


def _plan(letter: str, trial: int, wanted: Wanted, settings: Mapping[str, Any], pad: Pad) -> Plan:
    poses = poses_to_press(letter, trial, wanted.readings, wanted.seed, pad)
    content = {
        "label": letter, "split": "test", "poses": [tuple(pose) for pose in poses.tolist()],
        "enough": wanted.readings,
    }  # fmt: skip
    return checked(Plan, {**content, **settings}, "session")


def _taken(path: Path, plan: Plan) -> int:
    """Count the presses of a recording that was begun. Raises InputError if it was not made for this trial."""
    before, presses = _progress(path)
    if before is not None and (before.label, before.poses) != (plan.label, plan.poses):
        raise InputError(
            f"{path} is a session of {before.label!r} with other poses: it was measured with another seed or number of "
            "readings; name another folder"
        )
    return count_taken(presses)


def _progress(path: Path) -> tuple[Plan | None, dict[int, Press]]:
    """Read plan and marks of a recording, without its readings; there is no plan if it was killed before it began."""
    plan: Plan | None = None
    presses: dict[int, Press] = {}
    for record in RecordReader(path):
        if record.kind is Kind.SEGMENT:
            plan = checked(Plan, record.json().get("plan"), f"plan of {path}")
        elif record.kind is Kind.MARK and plan is not None:
            note(presses, parse_press(record.json(), len(plan.poses)))
    return plan, presses
