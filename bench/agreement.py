"""How often the contact classification of eq. 3 is right, judged by the letters' outlines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim import models
from tactsim.core.poses import transform
from tactsim.core.scan import Scan
from tactsim.estimators import Options
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify
from tactsim.estimators.likelihoods.scale import threshold_of
from tactsim.press.clip import covers


class Agreement(NamedTuple):
    """How many taxels eq. 3 decides, and how many of them rightly.

    share: of the decided taxels, those classified as the footprint says. decided: taxels that are not
    Unknown. taxels: all of them.
    """

    share: float
    decided: int
    taxels: int


def true_contact(scan: Scan, letters: dict[str, models.Letter]) -> NDArray[np.bool_]:
    """Tell which taxels lie on the letter: (n, taxels), True for a centre on the footprint.

    The centre is taken at the stated pose. So a placement error counts as the classifier's error, as it does
    when real readings are labelled by their stated poses.
    """
    truth = np.zeros(scan.readings.shape, dtype=bool)
    for label in scan.letters:
        rows = scan.labels == label
        points = transform(scan.poses[rows], scan.taxel_xy)
        truth[rows] = covers(letters[label].contours, points.reshape(-1, 2)).reshape(points.shape[:-1])
    return truth


def classifier_agreement(
    scan: Scan,
    in_contact: NDArray[np.bool_],
    no_contact: NDArray[np.bool_],
    letters: dict[str, models.Letter],
) -> Agreement:
    """Score a classification of every taxel against the letters' outlines.

    in_contact, no_contact: (n, taxels); a taxel in neither is Unknown and does not count as decided. The
    paper reports about 90 % right.
    """
    truth = true_contact(scan, letters)
    decided = in_contact | no_contact
    right = (in_contact & truth) | (no_contact & ~truth)
    count = int(decided.sum())
    return Agreement(float(right.sum() / count) if count else float("nan"), count, decided.size)


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
    agreement = classifier_agreement(train, kinds == CONTACT, kinds == NO_CONTACT, letters)
    return agreement.share if agreement.decided else None
