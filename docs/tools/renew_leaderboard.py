"""Do all that a folder of bundles holds again with the code here: `renew_leaderboard.py FOLDER WORKSHOP`.

It makes for each bundle of FOLDER one of the same task, estimator, options and title in
WORKSHOP, and `bench verify --record` checks it. When all are there, they replace those of FOLDER, and not sooner: a
bundle names its commit, and a changed file in the checkout would make that another one. What WORKSHOP has of this
commit is left alone, so that the command goes on where it was stopped.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from page_blocks import exit_status

from tactsim.bench.leaderboard.bundle import SUFFIX, Bundle, read_bundle, record_path
from tactsim.core import InputError
from tactsim.core.source_digest import git_commit

_BENCH = Path(sys.executable).with_name("bench")


def submission(bundle: Bundle) -> list[str]:
    """Give the words after `bench submit` that do the trials of a bundle again, without --out.

    Raises InputError for a bundle without runs, whose options are not known as they were given.
    """
    if not bundle.runs:
        raise InputError(f"{bundle.method} on {bundle.task} has the status {bundle.status} and no runs")
    options = bundle.runs[0].config["set"]
    chosen = [word for name, value in options.items() for word in ("--set", f"{name}={value}")]
    fixed = [] if bundle.reproducible else ["--not-reproducible"]
    return [bundle.task, "--estimator", bundle.estimator, *chosen, "--title", bundle.method, *fixed]


def renew(folder: Path, workshop: Path, commit: str | None) -> int:
    """Renew the bundles of a folder, one after another; returns how many they are.

    commit: that which the new bundles name. Raises InputError for a bundle that cannot be read, or of which `bench`
    makes no other one that it can confirm.
    """
    paths = sorted(folder.glob(f"*{SUFFIX}"))
    if not paths:
        raise InputError(f"{folder} holds no bundle (*{SUFFIX})")
    wanted = {path: submission(read_bundle(path)) for path in paths}
    workshop.mkdir(parents=True, exist_ok=True)
    for number, (path, words) in enumerate(wanted.items(), start=1):
        fresh = workshop / path.name
        if fresh.exists() and read_bundle(fresh).commit == commit and record_path(fresh).exists():
            continue
        print(f"{number} of {len(paths)}: {path.stem}", file=sys.stderr, flush=True)
        fresh.unlink(missing_ok=True)
        _bench("submit", *words, "--out", str(fresh))
        _bench("verify", str(fresh), "--record")
    for path in paths:
        for place in (path, record_path(path)):
            place.write_bytes((workshop / place.name).read_bytes())
    shutil.rmtree(workshop)
    return len(paths)


def _bench(*words: str) -> None:
    if subprocess.run([_BENCH, *words], stdout=subprocess.DEVNULL).returncode:
        raise InputError(f"`bench {' '.join(words)}` failed")


def main(words: Sequence[str]) -> int:
    """Renew the folder `words[0]` by way of the folder `words[1]`; returns the exit status."""
    folder, workshop = map(Path, words)

    def work() -> None:
        commit = git_commit()
        if commit is None or not commit.isalnum():
            raise InputError("files differ from the last commit, which bundles name; commit them first")
        print(f"{renew(folder, workshop, commit)} renewed")

    return exit_status("renew", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
