"""Press letters at every pose of a scan: training and test readings, the same for the same seed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from tactsim import models
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray, compose
from tactsim.core.scan import SPLITS, Scan
from tactsim.core.seeds import stream
from tactsim.core.workers import worker_processes
from tactsim.press import cache as cached
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scan_poses import grid_poses, random_poses
from tactsim.press.sensor import gains, sense

if TYPE_CHECKING:
    from tactsim.press.sequences import Course

Progress = Callable[[int, int], None]

# Presses that a worker is given at a time. They do not depend on the number of workers, so neither do the readings.
_CHUNK = 64
WORTH_A_WORKER = 2.0  # s of one core; a worker takes most of a second to start


@dataclass(frozen=True, eq=False)
class _Batch:
    """The presses of one letter and split: stated and true poses, (n, 3) each."""

    letter: models.Letter
    split: str
    stated: FloatArray
    true: FloatArray


def scan_letters(
    options: ScanOptions,
    *,
    jobs: int = 1,
    cache: bool = True,
    sequence: bool = False,
    progress: Progress | None = None,
) -> tuple[Scan, dict[str, Any]]:
    """Press every letter at 192 training and 192 test poses (paper, section II).

    jobs: processes to use at most, where the work is worth them. cache: whether readings of earlier
    scans are used and new ones are kept. sequence: whether the images of every press on its way to rest are
    kept in the scan; they are of full dynamics and not in the cache. progress(done, total): called as presses
    are done.
    Returns the scan and its work: `presses`, those that were worked out now, and `skipped` {reason:
    count}; of presses through time also `settle_time` {"median", "longest"} s and the largest `overshoot`.
    The same options give the same bits whatever `jobs` and `cache` are, and a letter's readings do not
    depend on the other letters.

    Raises InputError for a letter, shape or option that does not exist, and if a press does not settle.
    """
    if sequence and options.press.dynamics != "full":
        raise InputError("a sequence is of presses through time; set press.dynamics to full")
    letters = letters_of(options)
    batches = [_batch(letter, split, options) for letter in letters for split in SPLITS]
    ideal, work, courses = _ideal(batches, options, jobs, cache, sequence, progress)
    gain = gains(options)
    readings = [
        sense(values, options.sensor, gain, stream(options.seed, batch.letter.name, batch.split, "sense"))
        for batch, values in zip(batches, ideal, strict=True)
    ]
    scan = Scan(
        np.concatenate(readings),
        np.concatenate([batch.stated for batch in batches]),
        np.array([batch.letter.name for batch in batches for _ in batch.stated]),
        np.array([batch.split for batch in batches for _ in batch.stated]),
        options.pad.taxel_xy,
        _meta(options, letters),
        **(_sequences(batches, courses, options) if sequence else {}),
    )
    presses = work.pop("presses")
    return scan, {"presses": presses, "skipped": dict(work)} | _settling(courses)


def letters_of(options: ScanOptions) -> list[models.Letter]:
    """Build the letters and read the shapes that a scan presses, in its order.

    Raises InputError for a letter or shape that does not exist, and if two have the same name.
    """
    letters = [models.letter(name, rounding=options.rounding) for name in options.letters]
    letters += [models.shape(path, rounding=options.rounding) for path in options.shapes]
    twice = [name for name, count in Counter(letter.name for letter in letters).items() if count > 1]
    if twice:
        raise InputError(f"two letters or shapes are called {twice[0]!r}; each needs a name of its own")
    if not letters:
        raise InputError("there is nothing to press: name a letter or a shape")
    return letters


def _batch(letter: models.Letter, split: str, options: ScanOptions) -> _Batch:
    stated = grid_poses()
    if split == "test" and options.test_poses == "random":
        stated = random_poses(stream(options.seed, letter.name, split, "poses"))
    spread = (options.placement_mm, options.placement_mm, options.placement_rad)
    if not any(spread):
        return _Batch(letter, split, stated, stated)
    error = stream(options.seed, letter.name, split, "placement").standard_normal(stated.shape)
    return _Batch(letter, split, stated, compose(stated, error * spread))


def _ideal(
    batches: Sequence[_Batch],
    options: ScanOptions,
    jobs: int,
    cache: bool,
    sequence: bool,
    progress: Progress | None,
) -> tuple[list[FloatArray], Counter[str], list[list[Course]]]:
    """Get each batch's ideal readings, (n, taxels) kPa: known already, from the cache, or pressed now.

    Returns them, the work, and for each batch the courses of its presses; none of what was not pressed through
    time now.
    """
    keys = [cached.key(batch.letter, batch.true, options) for batch in batches]
    names = [(key, 0 if options.press.skip.known else index) for index, key in enumerate(keys)]
    work = Counter(presses=0, known=0, cached=0, no_contact=0, cells=0, parts=0, stages=0)
    wanted: dict[tuple[str, int], _Batch] = {}
    ideal: dict[tuple[str, int], FloatArray] = {}
    for name, batch in zip(names, batches, strict=True):
        count = len(batch.true)
        if name in ideal or name in wanted:
            work["known"] += count
            continue
        stored = cached.load(name[0], (count, options.pad.taxels)) if cache and not sequence else None
        if stored is None:
            wanted[name] = batch
        else:
            ideal[name] = stored
            work["cached"] += count

    total = sum(len(batch.true) for batch in batches)
    done = work["known"] + work["cached"]
    if progress is not None and done:
        progress(done, total)
    tasks = [
        (name, batch.letter, batch.true[first : first + _CHUNK], options, sequence)
        for name, batch in wanted.items()
        for first in range(0, len(batch.true), _CHUNK)
    ]
    pressed: dict[tuple[str, int], list[FloatArray]] = {name: [] for name in wanted}
    courses: dict[tuple[str, int], list[Course]] = {name: [] for name in names}
    with _workers(jobs, len(tasks) * _CHUNK * _seconds_per_press(options)) as mapped:
        for (name, *_), (readings, piece, course) in zip(tasks, mapped(_press, tasks), strict=True):
            pressed[name].append(readings)
            courses[name] += [] if course is None else [course]
            work.update(piece)
            done += len(readings)
            if progress is not None:
                progress(done, total)
    for name, pieces in pressed.items():
        ideal[name] = np.concatenate(pieces)
        if cache:
            cached.store(name[0], ideal[name])
    if cache and wanted:
        cached.prune()
    return [ideal[name] for name in names], work, [courses[name] for name in names]


def _press(
    task: tuple[Any, models.Letter, FloatArray, ScanOptions, bool],
) -> tuple[FloatArray, Counter[str], Course | None]:
    # Brings MuJoCo, which a scan from the cache does without.
    from tactsim.press.engine import ideal_readings
    from tactsim.press.sequences import press_each

    _, letter, poses, options, sequence = task
    if options.press.dynamics == "full":
        return press_each(letter, poses, options, keep=sequence)
    return *ideal_readings(letter, poses, options), None


def _sequences(
    batches: Sequence[_Batch], courses: Sequence[Sequence[Course]], options: ScanOptions
) -> dict[str, Any]:
    """Sense the images of all presses; each batch has a random stream for them of its own.

    The zero drifts from press to press, so images on the way to one reading have no drift of their own.
    """
    from tactsim.press.sequences import aligned

    presses = [moving for batch in courses for course in batch for moving in course.moving]
    images, times, force = aligned(presses, options.press.frame_rate, options.pad.taxels)
    gain, sensor = gains(options), options.sensor.model_copy(update={"drift": 0.0})
    left = iter(images)
    for batch in batches:
        rng = stream(options.seed, batch.letter.name, batch.split, "sequence")
        for image in islice(left, len(batch.true)):
            image[:] = sense(image, sensor, gain, rng)
    return {"sequence": images, "sequence_times": times, "sequence_force": force}


def _settling(courses: Sequence[Sequence[Course]]) -> dict[str, Any]:
    """Sum up how the presses settled that were stepped through time now; nothing if there are none."""
    touching = [course for batch in courses for course in batch if len(course.settle_time)]
    if not touching:
        return {}
    settle_time = np.concatenate([course.settle_time for course in touching])
    return {
        "settle_time": {"median": float(np.median(settle_time)), "longest": float(settle_time.max())},
        "overshoot": max(float(course.overshoot.max()) for course in touching),
    }


@contextmanager
def _workers(jobs: int, seconds: float) -> Iterator[Callable[..., Iterator[Any]]]:
    """Give a `map` that keeps the order of its results: over processes if the work is worth them."""
    workers = min(jobs, int(seconds / WORTH_A_WORKER))
    if workers < 2:
        yield map
        return
    with worker_processes(workers) as executor:
        yield executor.map


def _seconds_per_press(options: ScanOptions) -> float:
    """Guess the time of a press on one core, s."""
    if options.press.dynamics == "full":
        return 5e-3
    return 1e-3 if options.rounding or not options.press.skip.parts else 1e-4


def _meta(options: ScanOptions, letters: Sequence[models.Letter]) -> dict[str, Any]:
    return {
        "options": options.model_dump(mode="json"),
        "objects": {letter.name: object_facts(letter) for letter in letters},
        "versions": cached.versions(),
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
