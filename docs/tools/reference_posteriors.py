"""50 reference posteriors, and how far an estimator's belief is from them.

`python docs/tools/reference_posteriors.py` prints the table of all estimators, or of those that are named. With
`--fill PAGE` it replaces the table of a page, which says between two comments after which readings it wants distances:

    <!-- references: 1, 3, 10 -->
    <!-- end of references -->

With `--make` it works the references out anew and writes them; the same versions on the same machine give the same
bytes.

Ten objects, two of each vowel, are pressed ten times each, off the training grid, in the default world. Exact Bayes
says what can be known of letter and pose after 1, 2, 3, 5 and 10 readings. So a distance is all that an estimator
loses: by what it learned, by its measurement model and by its filter.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from page_blocks import asked_for, exit_status, fill_blocks, fill_page

from tactsim.bench.exact_bayes import ExactBayes, ExactBayesOptions
from tactsim.bench.placement import Properties, placement_error, properties
from tactsim.bench.runs.tables import markdown_table
from tactsim.bench.terminal import progress_bars
from tactsim.bench.trials import draw_true_pose, fit
from tactsim.core import InputError, Scan
from tactsim.core.files import write_bytes
from tactsim.core.poses import FloatArray, compose, invert
from tactsim.core.seeds import stream
from tactsim.core.source_digest import git_commit, short_commit
from tactsim.estimators import Estimate, Estimator, create, registry
from tactsim.estimators.estimator import PoseSamples
from tactsim.estimators.registry import BUILT_IN
from tactsim.press import ScanOptions, forward_model, scan_letters
from tactsim.press.engine import ideal_readings
from tactsim.press.scanning import letters_of
from tactsim.press.sensor import gains, sense
from tactsim.press.touches import Touches

SHIPPED = Path(__file__).with_name("reference_posteriors.npz")
OPTIONS = ScanOptions()
OBJECTS, READINGS = 2, 10  # of each letter; of each object
AT = (1, 2, 3, 5, 10)  # readings after which the posterior is kept
SAMPLES = 200  # poses that stand for a posterior
_REACH = 12.0  # mm along x and y, within which an object is pressed
_SPLIT = 1e-3  # of exact Bayes; three times as much changes a posterior by `error`


@dataclass(frozen=True, eq=False)
class References:
    """What was felt of each object, and what can be known of it.

    truth: (n,) letters. true_pose: (n, 3) robot_in_object. readings: (n, r, taxels) kPa. sensor_in_robot: (n, r, 3).
    probabilities: (n, a, letters), in the order of the options' letters. pose: (n, a, 3), of least expected error.
    samples: (n, a, s, 3), equally probable poses of the most probable letter. error: (n, a, 2), what the brute force
    itself is off by: total variation of the letters' probabilities, and mm of the pose.
    """

    truth: NDArray[np.str_]
    true_pose: FloatArray
    readings: FloatArray
    sensor_in_robot: FloatArray
    probabilities: FloatArray
    pose: FloatArray
    samples: FloatArray
    error: FloatArray


@lru_cache(maxsize=1)
def training() -> Scan:
    """Press the readings that estimators are trained on."""
    return scan_letters(OPTIONS)[0].where("train")


def felt() -> Iterator[tuple[str, FloatArray, FloatArray, FloatArray]]:
    """Press the objects: letter, robot_in_object (3,), readings (r, taxels) and sensor_in_robot (r, 3)."""
    for letter in letters_of(OPTIONS):
        for number in range(OBJECTS):
            rng = stream(OPTIONS.seed, "reference", letter.name, str(number))
            true_pose = draw_true_pose(rng)
            stated = rng.uniform((-_REACH, -_REACH, -np.pi), (_REACH, _REACH, np.pi), (READINGS, 3))
            spread = (OPTIONS.placement_mm, OPTIONS.placement_mm, OPTIONS.placement_rad)
            pressed = compose(stated, spread * rng.standard_normal((READINGS, 3)))
            tilts = OPTIONS.placement_tilt * rng.standard_normal((READINGS, 2))
            ideal, _ = ideal_readings(Touches(letter, pressed, tilts), OPTIONS)
            readings = sense(ideal, OPTIONS.sensor, gains(OPTIONS), rng, rows=OPTIONS.pad.rows)
            yield letter.name, true_pose, readings, compose(invert(true_pose), stated)


def make() -> References:
    """Work the references out: exact Bayes twice, the second time with cells three times as heavy."""
    exact, coarser = (ExactBayes(ExactBayesOptions(split=split)) for split in (_SPLIT, 3 * _SPLIT))
    letters = OPTIONS.letters
    for estimator in (exact, coarser):
        estimator.fit(training())
    objects = properties(training())
    kept: dict[str, list[FloatArray]] = {name: [] for name in ("probabilities", "pose", "samples", "error")}
    pressed = list(felt())
    for _, _, readings, sensor_in_robot in pressed:
        rng = np.random.default_rng(0)
        after = zip(
            believed(exact, readings, sensor_in_robot),
            believed(coarser, readings, sensor_in_robot),
            strict=True,
        )
        for estimate, check in after:
            assert estimate.samples is not None
            p, q = (np.array([one.probabilities[letter] for letter in letters]) for one in (estimate, check))
            of = objects[estimate.label]
            off = placement_error(estimate.robot_in_object, check.robot_in_object, of)
            kept["probabilities"].append(p)
            kept["pose"].append(estimate.robot_in_object)
            kept["samples"].append(drawn(estimate.samples, SAMPLES, rng))
            kept["error"].append(np.array([np.abs(p - q).sum() / 2, off]))
    shape = len(pressed), len(AT)
    return References(
        np.array([truth for truth, *_ in pressed]),
        *(np.stack([of[column] for of in pressed]) for column in (1, 2, 3)),
        **{name: np.stack(values).reshape(*shape, *values[0].shape) for name, values in kept.items()},
    )


def believed(estimator: Estimator, readings: FloatArray, sensor_in_robot: FloatArray) -> Iterator[Estimate]:
    """Feed one object's readings to a fitted estimator; gives its estimates after the readings AT."""
    estimator.reset(np.random.default_rng(0))
    for number, (reading, pose) in enumerate(zip(readings, sensor_in_robot, strict=True), start=1):
        estimator.update(reading, pose)
        if number in AT:
            yield estimator.estimate()


def drawn(samples: PoseSamples, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw poses (count, 3), as often as their weights say (systematic resampling)."""
    at = (np.arange(count) + rng.random()) / count
    rows = np.searchsorted(np.cumsum(samples.weights), at)
    return samples.poses[rows.clip(max=len(samples.weights) - 1)]


def energy_distance(one: FloatArray, other: FloatArray, of: Properties) -> float:
    """Compute the energy distance of two sets of poses, mm (Szekely and Rizzo 2013), by the placement error.

    sqrt(2 E d(X, Y) - E d(X, X') - E d(Y, Y')), squared distances being mm here as d is: so it is 2 E d(X, Y) - ...
    itself. It is 0 for equal sets, and twice the distance of two points.
    """

    def mean(a: FloatArray, b: FloatArray) -> float:
        return float(placement_error(a[:, None], b[None], of).mean())

    return 2 * mean(one, other) - mean(one, one) - mean(other, other)


def distances(estimator: Estimator, references: References) -> FloatArray:
    """Feed all objects to an estimator; gives its distance from every reference, (n, a, 3), NaN where it has none.

    Total variation of the letters' probabilities; then, where the most probable letter is the reference's, mm between
    the poses, and the energy distance of the beliefs about the pose in mm if the estimator shows its own.
    """
    fit(estimator, training(), forward_model)
    objects, letters = properties(training()), OPTIONS.letters
    result = np.full((*references.pose.shape[:2], 3), np.nan)
    for n, (readings, sensor_in_robot) in enumerate(
        zip(references.readings, references.sensor_in_robot, strict=True)
    ):
        for a, estimate in enumerate(believed(estimator, readings, sensor_in_robot)):
            p = np.array([estimate.probabilities.get(letter, 0.0) for letter in letters])
            result[n, a, 0] = np.abs(p - references.probabilities[n, a]).sum() / 2
            best = letters[int(references.probabilities[n, a].argmax())]
            if estimate.label != best or not estimate.robot_in_object[:2].any():
                continue  # one that places nothing says the middle of the prior, whose distance means nothing
            result[n, a, 1] = placement_error(estimate.robot_in_object, references.pose[n, a], objects[best])
            if estimate.samples is not None:
                mine = drawn(estimate.samples, SAMPLES, np.random.default_rng(0))
                result[n, a, 2] = energy_distance(mine, references.samples[n, a], objects[best])
    return result


def distances_of(names: Sequence[str], references: References) -> dict[str, FloatArray]:
    """Give the distances of estimators from the references, and show on standard error how far the work is."""
    found: dict[str, FloatArray] = {}
    estimators = {name: create(name) for name in names}  # a wrong name is reported before the work
    with progress_bars() as progress:
        progress("references", 0, len(estimators))
        for name, estimator in estimators.items():
            found[name] = distances(estimator, references)
            progress("references", len(found), len(estimators))
    return found


def recognisers() -> list[str]:
    """Name the estimators that come with the package and recognise letters in the plane."""
    return [name for name in BUILT_IN if registry.load(name).KIND == "plane"]


def means(of: FloatArray) -> FloatArray:
    """Average distances (n, a, 3) over the objects that have one: (a, 3); NaN where none has."""
    known = ~np.isnan(of)
    count = known.sum(axis=0)
    return np.divide(
        np.where(known, of, 0).sum(axis=0), count, out=np.full(of.shape[1:], np.nan), where=count > 0
    )


def save(references: References, path: Path) -> None:
    """Write references as a compressed .npz, in single precision; equal references give equal bytes."""
    content = BytesIO()
    arrays = {
        name: value if value.dtype.kind == "U" else value.astype(np.float32)
        for name, value in vars(references).items()
    }
    np.savez_compressed(content, **arrays)
    write_bytes(path, content.getvalue())


def load() -> References:
    """Read the references that are kept beside this file."""
    with np.load(SHIPPED, allow_pickle=False) as arrays:
        return References(**{field.name: arrays[field.name] for field in fields(References)})


def table(found: Mapping[str, FloatArray], after: Sequence[int] = AT) -> str:
    """Write mean distances after these readings as a table of Markdown, a row for each estimator."""
    heads = [
        "estimator",
        *(f"letter @{n}" for n in after),
        *(f"{what} @{n}, mm" for what in ("pose", "belief") for n in after),
    ]
    rows = [heads]
    for name, of in found.items():
        mean = means(of)[[AT.index(n) for n in after]].T.ravel()
        rows.append([name, *("-" if np.isnan(value) else f"{value:.3f}" for value in mean)])
    return markdown_table(rows)


def readings_asked_for(text: str) -> list[int]:
    """Find after which readings a page wants distances.

    Raises InputError if it has not one table with an end, or names a number of readings that there is no reference of.
    """
    found = asked_for(text, "references")
    if len(found) != 1:
        raise InputError("it lacks `<!-- references: 1, 3 -->`, or has several")
    words = [word.strip() for word in found[0].split(",")]
    for word in words:
        if word not in map(str, AT):
            raise InputError(
                f"there is no reference after {word!r} readings, but after {', '.join(map(str, AT))}"
            )
    return [int(word) for word in words]


def filled(text: str, references: References) -> str:
    """Replace the table of a page, worked out anew for all estimators."""
    after = readings_asked_for(text)  # a wrong page is reported before the work
    made = table(distances_of(recognisers(), references), after)
    origin = f"*`make references`: {len(references.truth)} objects; commit {short_commit(git_commit())}.*"
    return fill_blocks(text, "references", lambda _: f"{made}\n{origin}\n")


def main(words: Sequence[str]) -> int:
    """Print how far estimators are from the references, fill a page, or make them anew; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("estimators", nargs="*", help="which ones; all that come with the package by default")
    parser.add_argument("--fill", type=Path, metavar="PAGE", help="replace the table of this page")
    parser.add_argument("--make", action="store_true", help="work the references out and write them")
    asked = parser.parse_args(words)

    def work() -> None:
        if asked.make:
            save(make(), SHIPPED)
        references = load()
        if asked.fill:
            fill_page(asked.fill, lambda text: filled(text, references))
            return
        print(table(distances_of(asked.estimators or recognisers(), references)), end="")
        off = references.error.reshape(-1, 2)
        print(
            f"\nMeans over {len(references.truth)} objects. Cells three times as heavy change in the references: "
            f"letter {np.median(off[:, 0]):.4f} (median), {off[:, 0].max():.3f} (most), pose "
            f"{np.median(off[:, 1]):.3f} and {off[:, 1].max():.3g} mm, where two places are as probable."
        )

    return exit_status("references", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
