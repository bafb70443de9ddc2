"""Find the runs that a report is asked for, and put together what may be compared.

Runs of one protocol share a section. Within a section, runs on the same data (a task) share plots. A method is
an estimator with its options but without its budget; it is one curve of the picture of time against error.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tactsim.bench.results import sweep_order
from tactsim.core.errors import InputError


def find(paths: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """List the folders of runs: each path is one, or holds them, or is a sweep with runs/ below it.

    Returns them, a sweep's in its own order, and a remark on every sweep that has not ended.
    Raises InputError for a path that is none of these.
    """
    found: dict[Path, Path] = {}
    remarks = []
    for path in paths:
        folders = _runs_of(path)
        for folder in folders:
            found.setdefault(folder.resolve(), folder)
        if (path / "sweep.json").is_file():
            asked = sweep_order(path)
            if len(folders) < len(asked):
                remarks.append(f"{path} has not ended: {len(folders)} of its {len(asked)} runs are there")
    return list(found.values()), remarks


def check_folder(path: Path) -> None:
    """Raise InputError unless a folder stands at `path`, as of a run or a sweep."""
    if not path.is_dir():
        why = "it is no folder" if path.exists() else "there is no such folder"
        raise InputError(f"{path}: {why}; name folders of runs or of a sweep")


def _runs_of(path: Path) -> list[Path]:
    if (path / "run.json").is_file():
        return [path]
    check_folder(path)
    holder = path / "runs" if (path / "runs").is_dir() else path
    # A name with a dot in front is a run that is being written.
    inside = sorted(entry for entry in holder.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    if not any((folder / "run.json").is_file() for folder in inside):
        raise InputError(f"{path} is neither the folder of a run nor of a sweep: no run.json there or below")
    if (path / "sweep.json").is_file():
        order = sweep_order(path)
        inside.sort(key=lambda folder: order.get(folder.name, len(order)))
    return inside
