"""Fill the tables of docs/performance.md with what a reading takes: `python docs/tools/page_performance.py PAGE`.

Milliseconds of processor time, an update and an estimate. What stands between two comments is replaced; the first
says what grows: letters, readings or taxels.

    <!-- time: letters -->
    <!-- end of time -->
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from page_blocks import asked_for, fill_blocks, fill_one

import tactsim
from tactsim.bench.machine import machine
from tactsim.bench.runs.tables import markdown_table
from tactsim.bench.trials import draw_true_pose
from tactsim.core import InputError, Scan, compose, invert
from tactsim.core.poses import FloatArray
from tactsim.core.source_digest import git_commit, short_commit

READINGS, EARLY, TRIALS = 60, 8, 5
LETTERS = (5, 36, 200)
SIDES = (6, 16, 32)  # taxels along each side of a pad of 11.4 mm
WIDTH = 11.4  # mm
LONG = {"histogram": 10_000, "refined": 1_000, "force-mosaic": 1_000}
GROWING = ("histogram", "refined", "force-mosaic")


class Timed(NamedTuple):
    """What an estimator takes: ms of each reading (readings,), the median of the trials, and seconds of the fit."""

    spent: FloatArray
    fit: float


def in_turns(name: str, scans: Sequence[Scan], readings: int, trials: int = TRIALS) -> list[Timed]:
    """Time an estimator on several scans: a trial of each in turn, since a machine's speed changes by the minute."""
    fits, spent = [], np.zeros((len(scans), 1 + trials, readings))  # the first trial of each warms up
    estimators = [tactsim.create(name) for _ in scans]
    for estimator, scan in zip(estimators, scans, strict=True):
        begin = time.process_time()
        estimator.fit(scan)
        fits.append(time.process_time() - begin)
    for trial in range(1 + trials):
        for estimator, scan, of_scan in zip(estimators, scans, spent, strict=True):
            rng = np.random.default_rng(trial)
            test = scan.where("test", str(rng.choice(scan.letters)))
            chosen = rng.integers(len(test), size=readings)
            poses = compose(invert(draw_true_pose(rng)), test.poses[chosen])
            estimator.reset(rng)
            for k, (reading, pose) in enumerate(zip(test.readings[chosen], poses, strict=True)):
                begin = time.process_time()
                estimator.update(reading, pose)
                estimator.estimate()
                of_scan[trial, k] = 1e3 * (time.process_time() - begin)
    return [Timed(np.median(of_scan[1:], axis=0), fit) for of_scan, fit in zip(spent, fits, strict=True)]


def enlarged(scan: Scan, count: int) -> Scan:
    """Add copies of a scan's letters, stretched by up to a fifth along x and y, until there are `count`."""
    rng, letters = np.random.default_rng(0), scan.letters
    parts = [(scan.readings, scan.poses, scan.labels.astype("U4"), scan.split)]
    for number in range(count - len(letters)):
        label = letters[number % len(letters)]
        like = scan.where(label=label)
        poses = like.poses * [*rng.uniform(0.8, 1.2, 2), 1]
        parts.append(
            (like.readings, poses, np.full(len(like), f"{label}{number // len(letters) + 1}"), like.split)
        )
    return Scan(*map(np.concatenate, zip(*parts, strict=True)), scan.taxel_xy)


def by_letters() -> list[list[str]]:
    """Time estimators that know few letters and many."""
    glyphs = tactsim.scan(letters="AEIOUBCDFGHJKLMNPQRSTVWXYZ0123456789", test_poses="random")
    rows = [
        ["", "letters", f"ms a reading of {READINGS}", f"of the first {EARLY}", "fit, s", "times 5 letters"]
    ]
    scans = [glyphs.of_letters(glyphs.letters[:count]) for count in LETTERS[:2]]
    scans.append(enlarged(glyphs, LETTERS[2]))
    for name in GROWING:
        timed = in_turns(name, scans, READINGS)
        for count, (spent, fit) in zip(LETTERS, timed, strict=True):
            figures = (spent.mean(), spent[:EARLY].mean(), fit, spent.mean() / timed[0].spent.mean())
            rows.append([f"`{name}`" if count == LETTERS[0] else "", str(count), *map(_short, figures)])
    return rows


def by_readings() -> list[list[str]]:
    """Time the readings of long sequences."""
    scan, at = tactsim.scan(test_poses="random"), (100, 1_000, 10_000)
    rows = [["ms a reading", *(f"at reading {k:,}" for k in at), "last beside 100"]]
    for name, most in LONG.items():
        ((spent, _),) = in_turns(name, [scan], most, trials=3)
        around = [np.median(spent[k - 50 : k + 1]) for k in at if k <= most]
        figures = [*map(_short, around), *[""] * (len(at) - len(around)), f"{around[-1] / around[0]:.1f}"]
        rows.append([f"`{name}`", *figures])
    return rows


def by_taxels() -> list[list[str]]:
    """Time pads of one size with more and more taxels."""
    rows = [["ms a reading", *(str(side**2) for side in SIDES), f"{SIDES[-1] ** 2:,} beside {SIDES[0] ** 2}"]]
    scans = []
    for side in SIDES:
        pitch = WIDTH / side
        pad = {
            "rows": side,
            "columns": side,
            "pitch_x": pitch,
            "pitch_y": pitch,
            "seam": None,
            "unread_columns": 0,
        }
        pad |= {"taxel_width": 0.95 * pitch, "taxel_height": 0.95 * pitch}
        scans.append(
            tactsim.scan(scan_set={f"pad.{key}": value for key, value in pad.items()}, test_poses="random")
        )
    for name in GROWING:
        means = [spent.mean() for spent, _ in in_turns(name, scans, 20)]
        rows.append([f"`{name}`", *map(_short, means), f"{means[-1] / means[0]:.1f}"])
    return rows


TABLES = {"letters": by_letters, "readings": by_readings, "taxels": by_taxels}


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def fill(text: str) -> str:
    """Replace the tables of a page. Raises InputError unless it asks for the three."""
    if sorted(asked_for(text, "time")) != sorted(TABLES):
        raise InputError(f"it lacks one of {', '.join(f'`<!-- time: {name} -->`' for name in TABLES)}")
    origin = f"*Commit {short_commit(git_commit())}, {machine()['processor']}.*"
    return fill_blocks(text, "time", lambda asked: f"{markdown_table(TABLES[asked]())}\n{origin}\n")


def main(words: Sequence[str]) -> int:
    """Fill the page `words[0]`; returns the exit status."""
    return fill_one("performance", words, fill)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
