"""Press letters at every pose of a scan: training and test readings, the same for the same seed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import OWN_LICENCE
from tactsim.core.scan import SPLITS, Scan
from tactsim.core.seeds import stream
from tactsim.press import cache as cached
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scan_poses import grid_poses, random_poses, stage_for
from tactsim.press.sensor import gains, sense
from tactsim.press.touches import Touches, as_pressed

if TYPE_CHECKING:
    from tactsim.press.dynamics import Moving

Progress = Callable[[int, int], None]

# Presses that a worker is given at a time. They do not depend on the number of workers, so neither do the readings.
_CHUNK = 64
WORTH_A_WORKER = 2.0  # s of one core; a worker takes most of a second to start


# Share of a letter's presses in one split that may fail to come to rest. A scan with more of them is no scan of that
# letter any more.
MOST_BLANKS = 0.05


@dataclass(frozen=True, eq=False)
class _Ideal:
    """What a batch reads without imperfections: (n, taxels) kPa, and why a press has no reading, if any has none.

    moving: how each press went, if they were stepped through time now; None where nothing touches and in a blank.
    """

    readings: FloatArray
    blanks: dict[int, str]
    moving: tuple[Moving | None, ...] = ()


@dataclass(frozen=True, eq=False)
class _Batch:
    """The presses of one letter and split: poses (n, 3) as stated, and how the letter is truly pressed."""

    letter: models.Letter
    split: str
    stated: FloatArray
    touches: Touches


def scan_letters(
    options: ScanOptions,
    *,
    jobs: int = 1,
    cache: bool = True,
    sequence: bool = False,
    progress: Progress | None = None,
) -> tuple[Scan, dict[str, Any]]:
    """Press every letter at 192 training and 192 test poses (paper, section II); for other pads see `stage_for`.

    A press that does not come to rest, such as one that tips over, is a blank: it has no reading, and the
    scan's `meta["blanks"]` says why. jobs: processes to use at most, where the work is worth them. cache:
    whether readings of earlier scans are used and new ones are kept. sequence: whether the scan holds the images of
    every press on its way to rest, which are not in the cache; dynamics must be full.
    progress(done, total): called as presses are done. Returns the scan and its work: `presses`, those that
    were worked out now, and by which engine, `blanks`, and `skipped` {reason: count}; of presses through time
    also `settle_time` {"median", "longest"} s and the largest `overshoot`. The same options give the same bits
    whatever `jobs` and `cache` are, and a letter's readings do not depend on the other letters.

    Raises InputError for a letter, shape or option that does not exist, and if more than MOST_BLANKS of a
    letter's presses do not come to rest.
    """
    letters = letters_of(options)
    batches = [_batch(letter, split, options) for letter in letters for split in SPLITS]
    if sequence and options.press.dynamics != "full":
        raise InputError(
            "the images of a press on its way to rest are of full dynamics: set press.dynamics=full"
        )
    ideal, work = _ideal(batches, options, jobs, cache, sequence, progress)
    gain = gains(options)
    kept = [
        np.setdiff1d(np.arange(len(batch.touches)), list(found.blanks))
        for batch, found in zip(batches, ideal, strict=True)
    ]
    readings = [
        sense(
            found.readings[rows], options.sensor, gain,
            stream(options.seed, batch.letter.name, batch.split, "sense"), rows=options.pad.rows,
        )
        for batch, found, rows in zip(batches, ideal, kept, strict=True)
    ]  # fmt: skip
    blanks = [
        {
            "letter": batch.letter.name,
            "split": batch.split,
            "pose": batch.stated[row].tolist(),
            "reason": reason,
        }
        for batch, found in zip(batches, ideal, strict=True)
        for row, reason in sorted(found.blanks.items())
    ]
    more = {}
    if sequence:
        from tactsim.press.dynamics import sequences

        of_batches = [[found.moving[row] for row in rows] for found, rows in zip(ideal, kept, strict=True)]
        more = sequences([(one.letter.name, one.split) for one in batches], of_batches, options)
    scan = Scan(
        np.concatenate(readings),
        np.concatenate([batch.stated[rows] for batch, rows in zip(batches, kept, strict=True)]),
        np.array([batch.letter.name for batch, rows in zip(batches, kept, strict=True) for _ in rows]),
        np.array([batch.split for batch, rows in zip(batches, kept, strict=True) for _ in rows]),
        options.pad.taxel_xy,
        _meta(options, letters) | ({"blanks": blanks} if blanks else {}),
        **more,
    )
    engines = {name: count for name, count in work.items() if name.startswith("engine_")}
    skipped = {name: count for name, count in work.items() if name != "presses" and name not in engines}
    done = {"presses": work["presses"], **engines, **({"blanks": len(blanks)} if blanks else {})}
    return scan, {**done, **_settling(ideal), "skipped": skipped}


def letters_of(options: ScanOptions) -> list[models.Letter]:
    """Build the letters and read the shapes that a scan presses, in its order.

    Raises InputError for a letter or shape that does not exist, and if two have the same name.
    """
    letters = [models.letter(name, rounding=options.rounding) for name in options.letters]
    letters += [models.shape(path, rounding=options.rounding) for path in options.shapes]
    check_names([letter.name for letter in letters], "letters or shapes", "press: name a letter or a shape")
    return letters


def check_names(names: Sequence[str], what: str, nothing: str) -> None:
    """Raise InputError if there is no name, or one twice. what, nothing: for the two messages."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"two {what} are called {twice[0]!r}; each needs a name of its own")
    if not names:
        raise InputError(f"there is nothing to {nothing}")


def _batch(letter: models.Letter, split: str, options: ScanOptions) -> _Batch:
    stage = stage_for(options.pad, letter)
    stated = grid_poses(stage)
    if split == "test" and options.test_poses == "random":
        stated = random_poses(stream(options.seed, letter.name, split, "poses"), stage.poses, stage.reach)
    touches = as_pressed(
        letter, stated, split, options, lambda purpose: stream(options.seed, letter.name, split, purpose)
    )
    return _Batch(letter, split, stated, touches)


def _ideal(
    batches: Sequence[_Batch],
    options: ScanOptions,
    jobs: int,
    cache: bool,
    sequence: bool,
    progress: Progress | None,
) -> tuple[list[_Ideal], Counter[str]]:
    """Get what each batch reads without imperfections: known already, from the cache, or pressed now."""
    keys = [cached.key(batch.touches, options) for batch in batches]
    names = [(key, 0 if options.press.skip.known else index) for index, key in enumerate(keys)]
    work = Counter(presses=0, known=0, cached=0, no_contact=0)
    wanted: dict[tuple[str, int], _Batch] = {}
    ideal: dict[tuple[str, int], _Ideal] = {}
    for name, batch in zip(names, batches, strict=True):
        count = len(batch.touches)
        if name in ideal or name in wanted:
            work["known"] += count
            continue
        stored = cached.load(name[0], (count, options.pad.taxels)) if cache and not sequence else None
        if stored is None:
            wanted[name] = batch
        else:
            ideal[name] = _Ideal(stored, {})
            work["cached"] += count

    total = sum(len(batch.touches) for batch in batches)
    done = work["known"] + work["cached"]
    if progress is not None and done:
        progress(done, total)
    tasks = [
        (name, batch.touches.some(slice(first, first + _CHUNK)), options, sequence)
        for name, batch in wanted.items()
        for first in range(0, len(batch.touches), _CHUNK)
    ]
    pressed: dict[tuple[str, int], list[_Ideal]] = {name: [] for name in wanted}
    worth = int(len(tasks) * _CHUNK * _seconds_per_press(options) / WORTH_A_WORKER)
    refusal = ""
    several = min(jobs, worth) > 1
    if several:
        from tactsim.core.workers import process_map
    with process_map(min(jobs, worth)) if several else nullcontext(map) as mapped:
        for (name, *_), (piece, of_piece) in zip(tasks, mapped(_press, tasks), strict=True):
            pressed[name].append(piece)
            if refusal := _too_many_blanks(wanted[name], pressed[name]):
                break  # not raised here: what waits is dropped, and no process is killed
            work.update(of_piece)
            done += len(piece.readings)
            if progress is not None:
                progress(done, total)
    if refusal:
        raise InputError(refusal)
    for name, pieces in pressed.items():
        blanks = {
            number * _CHUNK + row: reason
            for number, piece in enumerate(pieces)
            for row, reason in piece.blanks.items()
        }
        moving = tuple(press for piece in pieces for press in piece.moving)
        ideal[name] = _Ideal(np.concatenate([piece.readings for piece in pieces]), blanks, moving)
        if cache and not ideal[name].blanks:  # a file of the cache has no room for reasons
            cached.store(name[0], ideal[name].readings)
    if cache and wanted:
        cached.prune()
    return [ideal[name] for name in names], work


def _too_many_blanks(batch: _Batch, pieces: Sequence[_Ideal]) -> str:
    """Say that too many of the presses so far are blank for the whole of a batch; nothing if they are not."""
    reasons = Counter(reason for piece in pieces for reason in piece.blanks.values())
    if reasons.total() <= MOST_BLANKS * len(batch.touches):
        return ""
    done = sum(len(piece.readings) for piece in pieces)
    return (
        f"{reasons.total()} of {done} presses of {batch.letter.name!r} do not come to rest, and a scan takes "
        f"{MOST_BLANKS:.0%} at most: {reasons.most_common(1)[0][0]}"
    )


def _press(task: tuple[Any, Touches, ScanOptions, bool]) -> tuple[_Ideal, Counter[str]]:
    # Brings MuJoCo, which a scan from the cache does without.
    from tactsim.press.engine import press_at

    _, touches, options, sequence = task
    pressed = press_at(touches, options)
    moving: list[Moving | None] = []
    if options.press.dynamics == "full":
        from tactsim.press.dynamics import Moved

        assert isinstance(pressed.load, Moved)
        # Without a sequence a worker need not send the images.
        kept = slice(None) if sequence else slice(-1, None)
        moving = [
            press and replace(press, times=press.times[kept], images=press.images[kept])
            for press in pressed.load.presses
        ]
    return _Ideal(pressed.readings(options), pressed.blanks, tuple(moving)), pressed.work


def _settling(ideal: Sequence[_Ideal]) -> dict[str, Any]:
    """Sum up how the presses settled that were stepped through time now; nothing if there are none."""
    traces = [press.trace for found in ideal for press in found.moving if press is not None]
    if not traces:
        return {}
    settle_time = np.array([trace.settle_time for trace in traces])
    return {
        "settle_time": {"median": float(np.median(settle_time)), "longest": float(settle_time.max())},
        "overshoot": max(trace.overshoot for trace in traces),
    }


def _seconds_per_press(options: ScanOptions) -> float:
    """Guess the time of a press on one core, s."""
    if options.press.dynamics == "full":
        return 5e-3
    level = options.press.wrist_stiffness is None and not options.placement_tilt
    if options.press.engine == "collide":
        return 1e-3
    return 1e-3 if options.rounding or not level else 1e-4


def _meta(options: ScanOptions, letters: Sequence[models.Letter]) -> dict[str, Any]:
    return {
        "source": "simulated",
        "options": options.model_dump(mode="json"),
        "objects": {letter.name: object_facts(letter) for letter in letters},
        "versions": {**cached.versions(), "tactsim": version("tactsim")},
        # Whose a user's own shapes are is not ours to say.
        **({} if options.shapes else {"licence": OWN_LICENCE}),
        **({} if options.unit == "kPa" else {"unit": options.unit}),
    }


def object_facts(letter: models.Letter) -> dict[str, Any]:
    """Say of a letter what scores need: symmetry (0 for a disc), centre mm, inertia over mass mm^2."""
    return {
        "symmetry": 0 if math.isinf(letter.symmetry) else int(letter.symmetry),
        "centre": [0.0, 0.0],  # the footprint's centre of area is the origin of the object frame
        "inertia_over_mass": letter.inertia_over_mass,
        "mass": letter.mass,
        "area": letter.area,
        "digest": letter.digest,
    }
