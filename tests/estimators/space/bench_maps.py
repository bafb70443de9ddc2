"""What maps in space are worth at known poses: the paper's log-odds and learned distances, voxels and points.

Run it by `python tests/estimators/space/bench_maps.py`; docs/objects-in-space.md has its figures.
"""

from __future__ import annotations

from time import process_time

import numpy as np
from scipy.spatial import cKDTree

from tactsim.core import rigid
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, classify
from tactsim.estimators.likelihoods.occupancy import sigmoid
from tactsim.estimators.space.space_field import SpaceField, SpaceMapOptions
from tactsim.estimators.space.space_occupancy import SpaceOccupancy, learn_occupancy
from tactsim.press.space import SpaceOptions, scan_solids

GAMMA, PRIOR, LEAST = 0.1, 0.2, 8.0  # of eq. 7; kPa from which a touch met something
DISPLACED = ((0.5, 0.025), (1.0, 0.05), (2.0, 0.1))  # mm, rad


def paper(chart: SpaceOccupancy, test: SpaceScan, poses: np.ndarray) -> np.ndarray:
    """Give log p (n,) of readings at poses (n, 7) by eq. 7, looked up where the taxels are."""
    kinds = classify(test.readings)
    odds = chart.log_odds_at(rigid.transform(poses, test.taxel_points))
    contact = np.log(GAMMA * PRIOR + (1 - GAMMA) * sigmoid(odds))
    without = np.log(GAMMA * (1 - PRIOR) + (1 - GAMMA) * sigmoid(-odds))
    return np.where(kinds == CONTACT, contact, np.where(kinds == NO_CONTACT, without, 0.0)).sum(axis=1)


def learned(field: SpaceField, number: int, test: SpaceScan, poses: np.ndarray) -> np.ndarray:
    """Give log p (n,) of readings at poses (n, 7) by the learned distances."""
    result = np.empty(len(poses))
    for n in range(len(poses)):
        field.reset()
        field.append(test.readings[n : n + 1], poses[n : n + 1])
        result[n] = field.log_p(number, rigid.IDENTITY[None])[0]
    return result


def compare(
    name: str, log_p: list[np.ndarray], moved: list[np.ndarray], truth: np.ndarray, seconds: float
) -> None:
    """Print how often a touch, and two, name the object, and how often the true pose beats a displaced one."""
    table, rng = np.array(log_p), np.random.default_rng(0)
    two = [
        table[:, rng.choice(np.flatnonzero(truth == label), 2, replace=False)].sum(axis=1).argmax() == label
        for label in range(len(table))
        for _ in range(50)
    ]
    own = table[truth, np.arange(len(truth))]
    better = "  ".join(
        f"{mm} mm {np.mean(own > off):.0%}" for (mm, _), off in zip(DISPLACED, moved, strict=True)
    )
    right = np.mean(table.argmax(axis=0) == truth)
    print(
        f"{name:28} one touch {right:.0%}  two {np.mean(two):.0%}  truth before {better}  learned in {seconds:.1f} s"
    )


def main() -> None:
    """Touch the twelve solids, learn both maps, and compare them by the test touches that met something."""
    scan, _ = scan_solids(SpaceOptions())
    test = scan.where("test")
    met = test.readings.max(axis=1) > LEAST
    labels = scan.objects
    truth = np.array([labels.index(label) for label in test.labels])[met]
    test = test.chosen(met)
    rng, count = np.random.default_rng(0), len(test)
    displaced = []
    for mm, rad in DISPLACED:
        turn = rigid.from_vector(rad * rng.standard_normal((count, 3)))
        displaced.append(
            rigid.compose(np.column_stack([mm * rng.standard_normal((count, 3)), turn]), test.poses)
        )

    def own(log_p: object, poses: np.ndarray) -> np.ndarray:
        return np.array(log_p(poses))[truth, np.arange(count)]  # type: ignore[operator]

    begin = process_time()
    field = SpaceField.learn(scan, SpaceMapOptions())
    spent = process_time() - begin
    by_distance = lambda poses: [learned(field, n, test, poses) for n in range(len(labels))]  # noqa: E731
    compare(
        "signed distances",
        by_distance(test.poses),
        [own(by_distance, off) for off in displaced],
        truth,
        spent,
    )
    begin = process_time()
    maps = learn_occupancy(scan, stiffness=field.touching.stiffness)
    spent = process_time() - begin
    by_paper = lambda poses: [paper(maps[label], test, poses) for label in labels]  # noqa: E731
    compare(
        "the paper's log-odds, eq. 7",
        by_paper(test.poses),
        [own(by_paper, off) for off in displaced],
        truth,
        spent,
    )

    # The same question to points of the surface instead of voxels: how far is the surface from where a ray begins?
    tree = cKDTree(field.surface(0).points)
    rays = rigid.transform(test.poses, field.touching.ray).reshape(-1, 3)
    begin = process_time()
    tree.query(rays)
    by_points = (process_time() - begin) / len(rays)
    field.reset()
    field.append(test.readings[:20], test.poses[:20])
    states = rigid.compose(rigid.IDENTITY, np.repeat(rigid.IDENTITY[None], 2000, axis=0))
    begin = process_time()
    field.log_p(0, states)
    whole = (process_time() - begin) / (20 * len(states))
    print(
        f"nearest of {tree.n} points: {by_points * 1e6:.2f} us a ray, "
        f"{by_points * len(field.touching.ray) * 1e6:.0f} us a touch; "
        f"voxels: {whole * 1e6:.1f} us a touch, its likelihood included"
    )


if __name__ == "__main__":
    main()
