"""The paper's equations as printed, where taken literally they fail: maps of a scan, cell by cell."""

import numpy as np
from reference import CONTACT, NO_CONTACT, classify, place

from tactsim.estimators.likelihoods.occupancy import OccupancyMap


def maps(
    scan, cell=1.0, sigma=1.0, peak=0.9, prior=0.2, spread="corrected", unknown="corrected", last="corrected"
):
    """Eq. 4 to 6 for every letter, each of them "corrected" or "printed"."""
    edge = np.arange(-20, 20 + cell / 2, cell)
    cells = np.stack(np.meshgrid(edge, edge), axis=-1)
    charts = {}
    train = scan.where("train")
    for label in train.letters:
        mine = train.where(label=label)
        log_odds = np.full(cells.shape[:2], np.log(prior / (1 - prior)))
        for reading, pose in zip(mine.readings, mine.poses, strict=True):
            classes = classify(reading)
            for kind, centre in zip(classes, place(pose, scan.taxel_xy), strict=True):
                square = ((cells - centre) ** 2).sum(axis=-1)
                if spread == "printed":
                    g = np.exp(-square / (8 * sigma**2)) / np.sqrt(np.pi * sigma**2 / 4)
                else:
                    g = peak * np.exp(-2 * square / sigma**2)
                if kind == CONTACT:
                    p = prior + (1 - prior) * g
                elif kind == NO_CONTACT:
                    p = prior - prior * g
                else:
                    p = np.full_like(g, prior + prior if unknown == "printed" else prior)
                with np.errstate(invalid="ignore", divide="ignore"):
                    log_odds += np.log(p / (1 - p))
            n = len(classes)
            odds = prior / (1 - prior)
            log_odds -= np.log(n * odds) if last == "printed" else n * np.log(odds)
        charts[label] = OccupancyMap(edge[[0, 0]], cell, log_odds, prior)
    return charts
