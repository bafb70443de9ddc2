"""A made-up bundle, and how to change one."""

import io
import zipfile
from dataclasses import replace

from made_up import make_run

from tactsim.bench.leaderboard.bundle import DONE, Bundle


def make_bundle(seeds=(0, 1), **changes):
    runs = []
    for seed in seeds:
        run = make_run(seed=seed)
        runs.append(replace(run, config=run.config | {"seed": seed}))
    said = {
        "task": "letters-offgrid-v1", "task_data": "a" * 64, "method": "Histogram, 10,000 bins",
        "estimator": "histogram", "options": {"bins": 10_000}, "reproducible": True, "status": DONE,
        "versions": {"python": "3"},
        "source_hash": "b" * 64, "machine": {"processor": "made up", "cores": 1, "system": "none"}, "commit": None,
        "made": "2026-01-01T00:00:00+00:00",
    }  # fmt: skip
    return Bundle(**said | changes, runs=tuple(runs))


def members_of(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(members):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return content.getvalue()
