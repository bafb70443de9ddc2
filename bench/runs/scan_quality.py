"""What a reader of a run must know of its readings: how often eq. 3 classifies rightly, near copies, a single load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim import models
from tactsim.core import Scan
from tactsim.core.poses import transform, wrap_angle
from tactsim.core.provenance import poses_unknown
from tactsim.estimators import Options
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify, threshold_of
from tactsim.press.clip import covers


def classifier_agreement(
    scan: Scan,
    in_contact: NDArray[np.bool_],
    no_contact: NDArray[np.bool_],
    letters: dict[str, models.Letter],
) -> tuple[float, int]:
    """Score a classification of every taxel against the letters' outlines.

    in_contact, no_contact: (n, taxels); a taxel in neither is Unknown and does not count as decided. A taxel lies on
    the letter if its centre is on the footprint at the stated pose. So a placement error counts as the classifier's
    error, as it does when real readings are labelled by their stated poses. The paper reports about 90 % right.
    Returns the share of the decided taxels that are classified rightly, NaN if none is decided, and how many are.
    """
    truth = np.zeros(scan.readings.shape, dtype=bool)
    for label in scan.letters:
        rows = scan.labels == label
        points = transform(scan.poses[rows], scan.taxel_xy)
        truth[rows] = covers(letters[label].contours, points.reshape(-1, 2)).reshape(points.shape[:-1])
    decided = in_contact | no_contact
    right = (in_contact & truth) | (no_contact & ~truth)
    count = int(decided.sum())
    return float(right.sum() / count) if count else float("nan"), count


def eq3_agreement(scan: Scan, options: Options) -> float | None:
    """Give the share of the taxels decided by eq. 3 that are classified rightly; None for unknown shapes.

    The training readings are judged: a taxel is in contact if its centre lies on the letter. Eq. 3 uses the
    estimator's own `threshold` (kPa) and `ratio` if its options have them.
    """
    if not set(scan.letters) <= set(models.names()):
        return None
    train = scan.where("train")
    own = {name: getattr(options, name) for name in ("threshold", "ratio") if hasattr(options, name)}
    if "threshold" in own:
        own["threshold"] = threshold_of(own["threshold"], train.readings)
    kinds = classify(train.readings, **own)
    letters = {label: models.letter(label) for label in train.letters}
    share, decided = classifier_agreement(train, kinds == CONTACT, kinds == NO_CONTACT, letters)
    return share if decided else None


_SAME = 1e-2  # mm and rad: presses at poses that are as near were made at one pose
# Presses at one pose whose readings correlate so well are near copies; so many of the test presses make a warning.
_ALIKE, _MANY = 0.998, 0.5
_ONE_LOAD = 0.02  # loads that differ by less than this share are one


def notes_on(scan: Scan) -> list[str]:
    """Say in a line each what limits a run on this scan; nothing if nothing is known to."""
    notes = []
    share, correlation = near_copies(scan)
    if share >= _MANY:
        notes.append(
            f"{share:.0%} of the test presses are near copies of training presses (same pose, correlation "
            f"{correlation:.4f}): this measures how well presses repeat, not how well new ones are recognised"
        )
    if poses_unknown(scan.meta):
        of = scan.press_numbers
        train, test = (np.unique(of[scan.split == split]) for split in ("train", "test"))
        if both := len(np.intersect1d(train, test)):
            notes.append(
                f"{both} of {len(test)} test presses have training readings, too: this measures how well readings of "
                "a press repeat, not how well new presses are recognised"
            )
    loads = scan.where("train").loads
    known = np.array([]) if loads is None else loads[~np.isnan(loads)]
    if len(known) > 1 and np.ptp(known) <= _ONE_LOAD * known.max():
        notes.append(
            f"all training presses are of one load, {np.median(known):.3g} N; other loads are recognised better with "
            "several moments of each press (bench replay --moments auto)"
        )
    return notes


def near_copies(scan: Scan) -> tuple[float, float]:
    """Find the share of the test presses that are near copies of a training press, and their median correlation.

    A near copy is of the same object, at the same pose within 0.01 mm and 0.01 rad, and its reading correlates with the
    other's by .998 or more. Readings that are the same all over, such as those beside the object, do not count.
    """
    train, test = scan.where("train"), scan.where("test")
    counted, alike = 0, []
    for label in test.letters:
        known, new = train.where(label=label), test.where(label=label)
        varied = np.ptp(new.readings, axis=1) > 0
        counted += int(varied.sum())
        if not len(known):
            continue
        order = np.argsort(known.poses[:, 0])  # so that few have to be compared with each press
        along = known.poses[order, 0]
        for row in np.flatnonzero(varied):
            pose = new.poses[row]
            first, last = np.searchsorted(along, [pose[0] - _SAME, pose[0] + _SAME])
            some = order[first:last]
            apart = known.poses[some] - pose
            apart[:, 2] = wrap_angle(apart[:, 2])
            near = some[np.linalg.norm(apart, axis=1) <= _SAME]
            best = max((_correlation(new.readings[row], known.readings[k]) for k in near), default=0.0)
            if best >= _ALIKE:
                alike.append(best)
    return len(alike) / max(counted, 1), float(np.median(alike)) if alike else 0.0


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Give Pearson's correlation of two readings; 0 if one is the same all over."""
    a, b = one - one.mean(), other - other.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0 else 0.0
