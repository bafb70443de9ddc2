"""Poses in space: arrays [x, y, z, qw, qx, qy, qz], mm and a unit quaternion, that stand for rigid transforms, SE(3).

`a_in_b` maps points given in frame a to frame b, as in `poses`. q and -q are the same rotation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.errors import InputError, short
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_ROUND_OFF = 1e-6  # by which a given rotation may miss being one
_SMALL = 1e-8  # rad^2, below which a series is its first term


def checked_poses(given: ArrayLike, what: str) -> FloatArray:
    """Read poses (..., 7), their quaternions scaled to length 1 to within rounding.

    Raises InputError, naming `what`, if they are not finite numbers of that shape or a quaternion's length is not 1
    within 1e-6.
    """
    poses = finite(given, what)
    if poses.ndim < 1 or poses.shape[-1] != 7:
        raise InputError(f"{what} has shape {poses.shape}; a pose in space is [x, y, z, qw, qx, qy, qz]")
    length = np.linalg.norm(poses[..., 3:], axis=-1)
    wrong = np.abs(length - 1) > _ROUND_OFF
    if wrong.any():
        raise InputError(
            f"{what} holds the quaternion {short(poses[..., 3:][wrong][0].tolist())} of length "
            f"{length[wrong].flat[0]:.6g}; a rotation's has length 1"
        )
    # What has been scaled once stays as it is, to the bit.
    length = np.where(np.abs(length - 1) < 1e-15, 1.0, length)
    return np.concatenate([poses[..., :3], poses[..., 3:] / length[..., None]], axis=-1)


def multiply(left: ArrayLike, right: ArrayLike) -> FloatArray:
    """Multiply quaternions (..., 4), so that the product turns by `right` first."""
    a, b = np.asarray(left, dtype=float), np.asarray(right, dtype=float)
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(quaternion: ArrayLike) -> FloatArray:
    """Invert unit quaternions (..., 4)."""
    return np.asarray(quaternion, dtype=float) * (1.0, -1.0, -1.0, -1.0)


def turned(quaternion: ArrayLike, vectors: ArrayLike) -> FloatArray:
    """Turn vectors (..., 3) by unit quaternions (..., 4); both broadcast."""
    quaternion, vectors = np.asarray(quaternion, dtype=float), np.asarray(vectors, dtype=float)
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    twice = 2 * _cross(axis, vectors)
    return vectors + w * twice + _cross(axis, twice)


def _cross(left: FloatArray, right: FloatArray) -> FloatArray:
    """Multiply vectors (..., 3) crosswise, as `np.cross` to the bit; of few vectors in less than half its time."""
    product = np.empty(np.broadcast_shapes(left.shape, right.shape))
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., x] = left[..., y] * right[..., z]
        product[..., x] -= left[..., z] * right[..., y]
    return product


def compose(outer: ArrayLike, inner: ArrayLike) -> FloatArray:
    """Multiply transforms (..., 7), so that `compose(b_in_c, a_in_b)` gives a_in_c; both broadcast."""
    outer, inner = np.asarray(outer, dtype=float), np.asarray(inner, dtype=float)
    rotation = multiply(outer[..., 3:], inner[..., 3:])
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)  # so that long chains stay rotations
    place = outer[..., :3] + turned(outer[..., 3:], inner[..., :3])
    return np.concatenate([place, rotation], axis=-1)


def invert(pose: ArrayLike) -> FloatArray:
    """Invert transforms (..., 7), so that `invert(a_in_b)` gives b_in_a."""
    pose = np.asarray(pose, dtype=float)
    back = conjugate(pose[..., 3:])
    return np.concatenate([-turned(back, pose[..., :3]), back], axis=-1)


def transform(pose: ArrayLike, points: ArrayLike) -> FloatArray:
    """Map points (n, 3) mm by poses (..., 7): returns (..., n, 3) mm in the outer frame."""
    pose = np.asarray(pose, dtype=float)
    return turned(pose[..., None, 3:], points) + pose[..., None, :3]


def matrix(quaternion: ArrayLike) -> FloatArray:
    """Write unit quaternions (..., 4) as rotation matrices (..., 3, 3)."""
    quaternion = np.asarray(quaternion, dtype=float)
    return np.swapaxes(turned(quaternion[..., None, :], np.eye(3)), -1, -2)


def quaternion(rotation: ArrayLike) -> FloatArray:
    """Write rotation matrices (..., 3, 3) as unit quaternions (..., 4) with qw >= 0."""
    m = np.asarray(rotation, dtype=float)
    # Four times the products of the quaternion's parts; the row with the largest diagonal is the most exact.
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    products = np.empty((*m.shape[:-2], 4, 4))
    for row, one in enumerate((xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy)):
        products[..., row, row] = 1 + one
    pairs = {
        (0, 1): m[..., 2, 1] - m[..., 1, 2],
        (0, 2): m[..., 0, 2] - m[..., 2, 0],
        (0, 3): m[..., 1, 0] - m[..., 0, 1],
        (1, 2): m[..., 1, 0] + m[..., 0, 1],
        (1, 3): m[..., 0, 2] + m[..., 2, 0],
        (2, 3): m[..., 2, 1] + m[..., 1, 2],
    }
    for (row, column), product in pairs.items():
        products[..., row, column] = products[..., column, row] = product
    best = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    found = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    found /= np.linalg.norm(found, axis=-1, keepdims=True)
    return np.where(found[..., :1] < 0, -found, found)


def angle_between(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Give the angles (...) rad in [0, pi] between rotations given as unit quaternions (..., 4)."""
    between = multiply(conjugate(first), second)
    return 2 * np.arctan2(np.linalg.norm(between[..., 1:], axis=-1), np.abs(between[..., 0]))


def from_vector(vector: ArrayLike) -> FloatArray:
    """Make the unit quaternions (..., 4) of rotation vectors (..., 3): the axis times the angle in rad."""
    vector = np.asarray(vector, dtype=float)
    half = np.linalg.norm(vector, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), np.sinc(half / np.pi) / 2 * vector], axis=-1)


def to_vector(quaternion: ArrayLike) -> FloatArray:
    """Write unit quaternions (..., 4) as rotation vectors (..., 3) of at most pi rad."""
    quaternion = np.asarray(quaternion, dtype=float)
    quaternion = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, quaternion[..., :1])
    scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
    return quaternion[..., 1:] * scale


def log(pose: ArrayLike) -> FloatArray:
    """Write transforms (..., 7) in the Lie algebra se(3): (..., 6), a shift in mm and a rotation vector in rad.

    `exp` makes the transform of it (Sola et al. 2018, A micro Lie theory, eq. 173).
    """
    pose = np.asarray(pose, dtype=float)
    turn, shift = to_vector(pose[..., 3:]), pose[..., :3]
    square = (turn**2).sum(axis=-1, keepdims=True)
    half = np.sqrt(square) / 2
    left = 1 - np.cos(half) / np.sinc(half / np.pi)
    twice = np.divide(left, square, out=np.full_like(square, 1 / 12), where=square > _SMALL)
    across = np.cross(turn, shift)
    return np.concatenate([shift - across / 2 + twice * np.cross(turn, across), turn], axis=-1)


def exp(vector: ArrayLike) -> FloatArray:
    """Make transforms (..., 7) of vectors (..., 6) of the Lie algebra se(3); see `log`."""
    vector = np.asarray(vector, dtype=float)
    shift, turn = vector[..., :3], vector[..., 3:]
    square = (turn**2).sum(axis=-1, keepdims=True)
    angle = np.sqrt(square)
    once = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    rest = 1 - np.sinc(angle / np.pi)
    twice = np.divide(rest, square, out=np.full_like(square, 1 / 6), where=square > _SMALL)
    across = np.cross(turn, shift)
    return np.concatenate(
        [shift + once * across + twice * np.cross(turn, across), from_vector(turn)], axis=-1
    )


def turn_from_z(direction: ArrayLike) -> FloatArray:
    """Give the shortest turns, unit quaternions (..., 4), that bring +z onto unit vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(direction, dtype=float), -1, 0)
    opposite = z < -1 + 1e-12  # half a turn about x
    parts = np.stack([1 + z, -y, x, np.zeros_like(z)], axis=-1)
    parts[opposite] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(parts / np.linalg.norm(parts, axis=-1, keepdims=True), dtype=float)


def random_rotations(count: int, rng: np.random.Generator) -> FloatArray:
    """Draw unit quaternions (count, 4) evenly over all rotations."""
    parts = rng.standard_normal((count, 4))
    return np.asarray(parts / np.linalg.norm(parts, axis=-1, keepdims=True), dtype=float)


def nearest_rotation(rotation: ArrayLike, among: ArrayLike) -> tuple[FloatArray, NDArray[np.intp]]:
    """Find for rotations (..., 4) the nearest of `among` (k, 4): angle rad (...), and which (...)."""
    angles = angle_between(np.asarray(rotation, dtype=float)[..., None, :], among)
    nearest = angles.argmin(axis=-1)
    return np.take_along_axis(angles, nearest[..., None], axis=-1)[..., 0], nearest
