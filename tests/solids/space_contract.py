"""The contract of an estimator of objects in space: `SpaceCase(make, scan)`, and those of its checks that it keeps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.estimators.contract import checks
from tactsim.estimators.contract.checks import Case
from tactsim.estimators.estimator import Estimator
from tactsim.solids.scan import SpaceScan


class SpaceCase(Case):
    """An estimator in space to check. Touches of its scan's test split are what it is tried on."""

    def __init__(self, make: Callable[[], Estimator], scan: SpaceScan) -> None:
        """Take a function that makes a new estimator each time, and a scan of at least two objects."""
        self.make = make
        self.scan: SpaceScan = scan

    @property
    def labels(self) -> tuple[str, ...]:
        """List the objects that were learned."""
        return self.scan.objects

    def trial(self, label: str | None = None, count: int = 4, seed: int = 5) -> tuple[FloatArray, FloatArray]:
        """Draw a hidden object: readings (count, taxels) and sensor_in_robot (count, 7)."""
        rng = np.random.default_rng(seed)
        mine = self.scan.where("test", label or self.labels[0])
        object_in_robot = np.concatenate([rng.uniform(-10, 10, 3), rigid.random_rotations(1, rng)[0]])
        chosen = rng.permutation(len(mine))[:count]
        return mine.readings[chosen], rigid.compose(object_in_robot, mine.poses[chosen])

    def still(self, count: int, far: float = 0.0) -> FloatArray:
        """Give poses sensor_in_robot (count, 7), all the same one, `far` mm away along x and y."""
        return np.tile([far, -far, 0.0, 1.0, 0.0, 0.0, 0.0], (count, 1))


# Of these, the ones that an estimator in space keeps too; the others are about pads and letters in the plane.
SPACE_CHECKS: tuple[Callable[[SpaceCase], Any], ...] = (
    checks.calls_out_of_order_are_refused,
    checks.a_scan_without_training_readings_is_refused,
    checks.options_are_described,
    checks.estimates_are_probabilities_and_poses,
    checks.a_bad_reading_is_refused_and_leaves_no_trace,
    checks.the_same_seed_gives_the_same_answer,
    checks.an_estimator_that_says_it_draws_nothing_draws_nothing,
    checks.reset_forgets_the_sequence_and_keeps_the_maps,
    checks.looking_changes_nothing,
    checks.inputs_are_not_written_to,
    checks.readings_may_come_as_lists_and_as_whole_numbers,
    checks.readings_without_contrast_are_taken,
    checks.a_pose_far_away_is_taken,
    checks.work_is_counted,
    checks.a_proposal_is_a_candidate,
    checks.objects_are_recognised,
)
