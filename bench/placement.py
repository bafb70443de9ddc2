"""Where an object is placed: the error of a placement, and how sure a belief is of the place.

A region is all placements at most so far from the estimated one, in the metric of the placement error, that they
hold a share of the belief. So it respects a letter's symmetry and an O's free angle, and it takes any shape of
belief as it is, weighted poses, without a kernel. Its radius is the error that the estimator itself expects not to
exceed with that probability. An estimator is calibrated if regions of the share a hold the truth in the share a of
trials: the test of Lemos et al. 2023 (expected coverage, with distances to a point) with the estimate as the point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, Field

from tactsim.core import InputError, Scan, compose, transform, wrap_angle
from tactsim.core.checking import checked
from tactsim.core.compiling import GivenReals1D, GivenReals2D, Reals1D, compiled
from tactsim.core.errors import short
from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray, algebra
from tactsim.core.provenance import poses_unknown
from tactsim.estimators.estimator import Estimate, PoseSamples


@compiled(called_from_python=False)
def _placed(pose: GivenReals1D, centre_x: float, centre_y: float) -> tuple[float, float, float, float]:
    """Say where an object lies, T_O^R, for its pose T_R^O (3,): [x, y] of the centre, cosine and sine of the angle."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = centre_x - pose[0], centre_y - pose[1]
    return cos * x + sin * y, cos * y - sin * x, cos, -sin


@compiled()
def distances(
    estimated: GivenReals2D,
    true: GivenReals2D,
    symmetry: int,
    centre_x: float,
    centre_y: float,
    inertia_over_mass: float,
) -> Reals1D:
    """Measure the distance between placements, mm: see `placement_error`.

    estimated: (n, 3) T_R^O, mm, mm, rad. true: (n, 3), or (1, 3) for all. The rest is what `Properties` hold.
    """
    away = np.empty(len(estimated))
    true_x = true_y = true_cos = true_sin = 0.0
    for k in range(len(estimated)):
        if k < len(true):
            true_x, true_y, true_cos, true_sin = _placed(true[k], centre_x, centre_y)
        x, y, cos, sin = _placed(estimated[k], centre_x, centre_y)
        if symmetry == 0:
            chord = 0.0
        elif symmetry <= 2:
            # 2 (1 - cos dtheta) is the squared chord, which needs no angle to be folded.
            chord = (cos - true_cos) ** 2 + (sin - true_sin) ** 2
            if symmetry == 2:
                chord = min(chord, (cos + true_cos) ** 2 + (sin + true_sin) ** 2)
        else:
            turn = (true[min(k, len(true) - 1), 2] - estimated[k, 2]) * symmetry
            chord = 4 * math.sin((turn - 2 * math.pi * np.rint(turn / (2 * math.pi))) / (2 * symmetry)) ** 2
        away[k] = math.sqrt((x - true_x) ** 2 + (y - true_y) ** 2 + inertia_over_mass * chord)
    return away


@compiled()
def radius(away: Reals1D, weights: GivenReals1D, share: float) -> float:
    """Find the least distance within which samples, `away` (n,) mm with weights (n,), hold a share of the weight."""
    left, weight = away.copy(), weights.copy()
    target, farthest = share * weights.sum(), away.max()
    below, low, high = 0.0, 0, len(left)
    # Quickselect: what is nearer than a pivot goes before it, and the part goes on that holds the distance.
    while low < high:
        pivot = left[(low + high) // 2]
        nearer, same, first, here, last = 0.0, 0.0, low, low, high
        while here < last:
            if left[here] < pivot:
                nearer += weight[here]
                left[here], left[first] = left[first], left[here]
                weight[here], weight[first] = weight[first], weight[here]
                first, here = first + 1, here + 1
            elif left[here] > pivot:
                last -= 1
                left[here], left[last] = left[last], left[here]
                weight[here], weight[last] = weight[last], weight[here]
            else:
                same += weight[here]
                here += 1
        if below + nearer >= target and first > low:
            high = first
        elif below + nearer + same >= target:
            return float(pivot)
        else:
            below, low = below + nearer + same, last
    # Rounding may leave the sum of all just below the share asked for.
    return float(farthest)


# mm that a turn of 1 rad counts as, and the share of the widest variance below which a pose's number has no width.
_LEVER, _NO_WIDTH = 10.0, 1e-9
_ROUNDING = 1e-18  # mm^2: samples that differ by less than nm are one
_Length = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class Placement(Protocol):
    """What measures the placement of an object: `Properties` in the plane, `Surface` of a solid."""

    def alike(self, poses: FloatArray, near: FloatArray) -> FloatArray:
        """Give of poses (n, 3 or 7) each the nearest to `near` of those in which the object looks the same."""

    def error(self, estimated: ArrayLike, true: ArrayLike) -> FloatArray:
        """Measure how far estimated poses robot_in_object lie from true ones, (..., 3 or 7) each: (...,) mm."""

    def spread(
        self, samples: PoseSamples, estimated: FloatArray, true: FloatArray
    ) -> tuple[FloatArray, float, FloatArray]:
        """Measure how far a belief and the truth lie from an estimated pose.

        Returns distances (n,) mm of poses that stand for the belief, that of the truth, and the poses' weights (n,).
        """


@dataclass(frozen=True)
class Properties:
    """What the error metric needs of an object.

    symmetry: order of the rotational symmetry, 0 for a disc. centre: [x, y] mm, centre of mass in
    the object frame. inertia_over_mass: mm^2, polar second moment of mass about the centre / mass. placed: whether
    anybody knows where it truly lies; if not, its placement errors are NaN.
    """

    symmetry: int
    centre: tuple[float, float]
    inertia_over_mass: float
    placed: bool = True

    @classmethod
    def stated(cls, values: Any, where: str) -> Properties:
        """Take the properties from a file's JSON. Raises InputError that begins with `where`."""
        stated = checked(_Stated, values, where)
        return cls(stated.symmetry, stated.centre, stated.inertia_over_mass, stated.placed)

    def alike(self, poses: FloatArray, near: FloatArray) -> FloatArray:
        """Turn the object about its centre until it lies as `near`, as far as its symmetry lets it; see `Placement`."""
        if self.symmetry == 1:
            return poses
        turn = poses[:, 2] - near[2]
        turn = fold_angle(turn, self.symmetry) - turn
        about, centre = np.column_stack([np.zeros((len(turn), 2)), turn]), np.array([*self.centre, 0.0])
        return compose(compose(compose(centre, about), -centre), poses)

    def error(self, estimated: ArrayLike, true: ArrayLike) -> FloatArray:
        """Measure the placement error (...,) mm; see `placement_error`."""
        away = placement_error(estimated, true, self)
        return away if self.placed else np.full_like(away, np.nan)

    def spread(
        self, samples: PoseSamples, estimated: FloatArray, true: FloatArray
    ) -> tuple[FloatArray, float, FloatArray]:
        """Measure how far all samples and the truth lie from an estimated pose; see `Placement`."""
        return self.error(samples.poses, estimated), float(self.error(true, estimated)), samples.weights


class _Stated(BaseModel):
    symmetry: int = Field(ge=0, le=1000)
    centre: tuple[_Length, _Length] = (0.0, 0.0)
    inertia_over_mass: float = Field(gt=0, le=LARGEST)
    placed: bool = True


def properties(scan: Scan) -> dict[str, Properties]:
    """Take the objects' properties from the scan, or estimate them from its training readings.

    If the scan does not state them, the pressures of the training readings above the idle level, at the places where
    they were felt, stand for the mass, and no symmetry is assumed. The paper estimates the properties from its maps.
    Where the scan says that poses are unknown no object is `placed`.
    Raises InputError as `stated_properties` does.
    """
    known = stated_properties(scan)
    if len(known) < len(scan.letters):
        from tactsim.core.idle import find_idle

        train = scan.where("train")
        scan = replace(scan, readings=find_idle(train.readings, train.presses).rise(scan.readings))
    found = {
        label: known.get(label) or _felt(scan.where("train", label), scan.where(label=label))
        for label in scan.letters
    }
    if not poses_unknown(scan.meta):
        return found
    return {label: replace(of, placed=False) for label, of in found.items()}


def stated_properties(scan: Scan) -> dict[str, Properties]:
    """Take the properties of those objects of which the scan states them. Raises InputError if they make no sense."""
    known = scan.meta.get("objects", {})
    if not isinstance(known, dict):
        raise InputError(f"scan: meta.objects must be a table, got {short(known)}")
    return {
        label: Properties.stated(known[label], f"scan: meta.objects.{label}")
        for label in scan.letters
        if label in known
    }


def _felt(train: Scan, all_readings: Scan) -> Properties:
    felt = train if len(train) else all_readings
    points = transform(felt.poses, felt.taxel_xy).reshape(-1, 2)
    weights = np.clip(felt.readings, 0, None).reshape(-1)
    if weights.sum() <= 0:
        return Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=1.0)
    weights = weights / weights.sum()
    centre = weights @ points
    inertia = float(weights @ ((points - centre) ** 2).sum(axis=1))
    return Properties(1, (float(centre[0]), float(centre[1])), max(inertia, 1e-6))


def placement_error(estimated: ArrayLike, true: ArrayLike, of: Properties) -> FloatArray:
    """Measure the distance between an object's estimated and true placement, in mm.

    estimated, true: (..., 3) robot_in_object. The object's placement is the inverse, T_O^R.
    d^2 = |displacement of the centre of mass|^2 + (I/m) 2 (1 - cos dtheta): the rms displacement of
    the object's points (the paper's ref. [24], Eqn. 4, in mm); dtheta is folded by the object's
    rotational symmetry (eq. 17-20, with the wrap that the printed mod lacks).
    """
    one, other = np.asarray(estimated, dtype=float), np.asarray(true, dtype=float)
    if other.ndim > 1:
        one, other = np.broadcast_arrays(one, other)
    poses, others = (np.ascontiguousarray(rows.reshape(-1, 3)) for rows in (one, other))
    away = distances(poses, others, of.symmetry, *of.centre, of.inertia_over_mass)
    return away.reshape(one.shape[:-1])


def fold_angle(angle: ArrayLike, symmetry: int) -> FloatArray:
    """Return the smallest turn (rad, signed) that looks the same, for a symmetry order (0: a disc)."""
    if symmetry == 0:
        return np.zeros_like(np.asarray(angle, dtype=float))
    return wrap_angle(np.asarray(angle, dtype=float) * symmetry) / symmetry


@dataclass(frozen=True)
class Certainty:
    """How an estimator's belief of the place lies about its estimate.

    credibility: the share of the belief that is nearer to the estimate than the truth is: a region of a larger
    share holds the truth. radius: mm, of the region that holds 90 % of the belief. nees: see `normalised_error`. All
    are NaN if the estimator does not say how sure it is, or nobody knows where the object is.
    """

    credibility: float
    radius: float
    nees: float


def certainty(estimate: Estimate, true: ArrayLike, of: Placement) -> Certainty:
    """Compare an estimate's belief with the truth, T_R^O (3,) or (7,). of: what the metric needs of the true object."""
    if estimate.samples is None:
        return Certainty(np.nan, np.nan, np.nan)
    true = np.asarray(true, dtype=float)
    away, truth, weights = of.spread(estimate.samples, estimate.robot_in_object, true)
    if np.isnan(truth):
        return Certainty(np.nan, np.nan, np.nan)
    nearer = away < truth
    credibility = float(weights[nearer].sum() / weights.sum())
    return Certainty(
        credibility,
        radius(away, weights, 0.9),
        normalised_error(estimate.samples, estimate.robot_in_object, true, of),
    )


def normalised_error(samples: PoseSamples, near: FloatArray, true: FloatArray, of: Placement) -> float:
    """Give the squared error of a belief's mean in units of its covariance, a number of the pose at a time (NEES).

    In the mean it is 1 for every belief that is right, whatever its shape (Bar-Shalom et al. 2001, section 5.4). Poses
    (3,) or (7,) are those of the object's symmetry that lie nearest to `near`, and numbers that it leaves free do not
    count. NaN of a belief without a width but that of rounding; at most `LARGEST`, which a run's table may hold.
    """
    group = algebra(samples.poses.shape[1])
    folded = of.alike(np.concatenate([samples.poses, true[None]]), near)
    mean, covariance = PoseSamples(folded[:-1], samples.weights).moments(near)
    away = group.log(group.compose(folded[-1], group.invert(mean)))
    turns = len(away) // 2  # of the numbers, the last 1 of 3 or 3 of 6
    lever = np.repeat([1.0, _LEVER], [len(away) - turns, turns])
    squares, axes = np.linalg.eigh(covariance * lever[:, None] * lever)
    known = squares > _NO_WIDTH * squares[-1]
    if not squares[-1] > _ROUNDING:
        return np.nan
    return min(float(np.mean(((lever * away) @ axes[:, known]) ** 2 / squares[known])), LARGEST)
