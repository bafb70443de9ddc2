"""The coarse-to-fine search over SO(3) x R^3: cells of poses about the first contact, halved where they fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.solids.field import SpaceField, Surface
from tactsim.solids.screen_kernels import PadWay, Slack, TouchPoints, screen

CUBES = 4  # q and -q are one rotation, so four of a tesseract's eight cubes hold all
ACROSS = np.pi  # rad, how far a cube reaches along each of its axes through its middle


def middles(cube: NDArray[np.int64], place: NDArray[np.int64], side: int) -> FloatArray:
    """Give the rotations, unit quaternions (n, 4), in the middles of cells.

    cube: (n,) which part of the quaternion is the largest. place: (n, 3) from 0 to side - 1, the cell's number along
    each axis of its cube. The axes are angles: equal steps in them are equal turns, as on a cubed sphere (Ronchi et al.
    1996), here in four dimensions.
    """
    tangent = np.tan(((place + 0.5) * (2 / side) - 1) * (np.pi / 4))
    others = (cube[:, None] + np.arange(1, 4)) % 4
    rotation = np.empty((len(cube), 4))
    np.put_along_axis(rotation, cube[:, None], 1.0, axis=1)
    np.put_along_axis(rotation, others, tangent, axis=1)
    return rotation / np.sqrt(1 + (tangent**2).sum(axis=1, keepdims=True))


def volumes(place: NDArray[np.int64], side: int) -> FloatArray:
    """Give the share (n,) of all rotations that cells hold, by the middle's density: exact in the limit of small cells.

    The density of even rotations over the tangents is (1 + |t|^2)^-2; over the angles, each tangent's slope is added.
    The shares of all CUBES * side^3 cells sum to 1 to within 3 % at side 4, and the nearer the larger it is.
    """
    tangent = np.tan(((place + 0.5) * (2 / side) - 1) * (np.pi / 4))
    slope = np.prod(1 + tangent**2, axis=1)
    # Half of the unit sphere in four dimensions has the area pi^2.
    return slope / (1 + (tangent**2).sum(axis=1)) ** 2 * (np.pi / 2 / side) ** 3 / np.pi**2


def every_cell(side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List all CUBES * side^3 cells: cube (n,), place (n, 3)."""
    cube, *place = np.indices((CUBES, side, side, side)).reshape(4, -1)
    return cube, np.stack(place, axis=1)


_EVEN = 0.2  # the share of the cells that is divided evenly among objects
_EIGHT = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True)
class CellSizes:
    """How large cells are.

    side: cells along each side of a cube of rotations. voxel: mm. reach: mm; the voxels hold the object's places from
    -reach to reach. box: mm, half the side of the box that the object's origin lies in, about the robot's.
    """

    side: int
    voxel: float
    reach: float
    box: float

    @property
    def turn(self) -> float:
        """Give how far rotations of a cell are turned from its middle about any one axis, rms, rad."""
        return ACROSS / self.side / math.sqrt(12)

    @property
    def shift(self) -> float:
        """Give how far places in a voxel are from its middle along any one axis, rms, mm."""
        return self.voxel / math.sqrt(12)

    def turned(self) -> CellSizes:
        """Halve the turns."""
        return replace(self, side=2 * self.side)

    def shifted(self) -> CellSizes:
        """Halve the voxels."""
        return replace(self, voxel=self.voxel / 2)


@dataclass(frozen=True, eq=False)
class PoseCells:
    """n cells of poses. label: (n,) the object. cube (n,), place (n, 3): the rotations, see `middles`.

    voxel: (n, 3) from 0, where on the object the touched place lies.
    """

    label: NDArray[np.int64]
    cube: NDArray[np.int64]
    place: NDArray[np.int64]
    voxel: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.label)

    @classmethod
    def joined(cls, parts: Sequence[PoseCells]) -> PoseCells:
        """Put cells one after another."""
        columns = zip(*((one.label, one.cube, one.place, one.voxel) for one in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))

    def some(self, which: NDArray[np.intp]) -> PoseCells:
        """Take some of the cells."""
        return PoseCells(self.label[which], self.cube[which], self.place[which], self.voxel[which])

    def turned_halves(self) -> PoseCells:
        """Give the cells of half the turns, the eight of each one after another: (8 n,)."""
        place = (2 * self.place[:, None] + _EIGHT).reshape(-1, 3)
        return replace(self.some(np.repeat(np.arange(len(self)), 8)), place=place)

    def shifted_halves(self) -> PoseCells:
        """Give the cells of half the voxel, the eight of each one after another: (8 n,)."""
        voxel = (2 * self.voxel[:, None] + _EIGHT).reshape(-1, 3)
        return replace(self.some(np.repeat(np.arange(len(self)), 8)), voxel=voxel)

    def poses(self, sizes: CellSizes, anchor: FloatArray) -> FloatArray:
        """Give object_in_robot (n, 7) in the cells' middles: the voxel's middle lies at the anchor (3,) mm."""
        rotation = middles(self.cube, self.place, sizes.side)
        touched = (self.voxel + 0.5) * sizes.voxel - sizes.reach
        return np.concatenate([anchor - rigid.turned(rotation, touched), rotation], axis=1)

    def log_prior(self, poses: FloatArray, sizes: CellSizes, slack: float = 0.0) -> FloatArray:
        """Give the log of the prior probability (n,) of cells: even over rotations and over the box of origins.

        poses: (n, 7), as `poses` gives them; -inf where the origin is more than `slack` mm outside of the box.
        """
        held = np.log(volumes(self.place, sizes.side)) + 3 * math.log(sizes.voxel / (2 * sizes.box))
        inside = np.abs(poses[:, :3]).max(axis=1, initial=0.0) <= sizes.box + slack
        return np.where(inside, held, -np.inf)


def shared(log_mass: FloatArray, label: NDArray[np.int64]) -> FloatArray:
    """Give log-masses (n,) by which cells of objects (n,) are to be chosen, so that no object loses all of its cells.

    The masses come from a quick look, which may be wrong by several nats: a part of their sum is shared evenly among
    the objects that have any.
    """
    finite = log_mass > -np.inf
    if not finite.any():
        return log_mass
    mass = np.exp(log_mass - log_mass[finite].max())
    held = np.bincount(label, mass)
    there = np.count_nonzero(held)
    gain = 1 - _EVEN + _EVEN * held.sum() / there / np.where(held > 0, held, 1.0)
    return np.where(finite, log_mass + np.log(gain)[label], -np.inf)


def thinned(log_mass: FloatArray, count: int, offset: float = 0.5) -> tuple[NDArray[np.intp], FloatArray]:
    """Keep at most `count` of n masses, so that sums stay what they are: which, ascending, and the logs of factors.

    The larger ones stay as they are; of the others some stand for all (Fearnhead and Clifford 2003): chosen evenly
    along the sum in the given order from `offset` (of a step, 0 to 1) on, they all get the same mass.
    """
    there = np.flatnonzero(log_mass > -np.inf)
    if len(there) <= count:
        return there, np.zeros(len(there))
    mass = np.exp(log_mass[there] - log_mass[there].max())
    order = np.argsort(-mass, kind="stable")
    rest = np.cumsum(mass[order][::-1])[::-1]
    limit = rest[:count] / (count - np.arange(count))
    kept = int(np.argmax(mass[order[:count]] < limit)) if (mass[order[:count]] < limit).any() else count
    large = order[:kept]
    if kept == count:
        return there[np.sort(large)], np.zeros(count)
    small = np.sort(order[kept:])
    reached = np.cumsum(mass[small])
    step = reached[-1] / (count - kept)
    chosen = small[
        np.minimum(np.searchsorted(reached, (np.arange(count - kept) + offset) * step), len(small) - 1)
    ]
    which = np.concatenate([large, chosen])
    factor = np.concatenate([np.zeros(kept), np.log(step / mass[chosen])])
    order = np.argsort(which, kind="stable")
    return there[which[order]], factor[order]


_PRESSED, _FREE = 0.35, 0.08  # shares of the reading's largest pressure: from there on, and below
_POINTS, _PLACES = 6, 8  # taxels of either kind that are looked at: enough to tell where a pad can lie
_LOUD = 10.0  # by how much more than noise the sum of a reading must be for a contact
_SAYS = 3.0  # places that a touch is worth at most: how far it is, and how it is tilted
_BEHIND = 0.7  # mm behind the deepest contact, from where on back the pad's way was free


@dataclass(frozen=True, eq=False)
class PointReader:
    """Turns readings into points.

    taxel_points: (taxels, 3) mm. stiffness: kPa/mm. noise: kPa, a taxel's standard deviation.
    """

    taxel_points: FloatArray
    stiffness: float
    noise: float

    def met(self, readings: FloatArray) -> np.ndarray:
        """Tell which readings (m, taxels) show a contact: (m,)."""
        return np.asarray(readings.sum(axis=1) > _LOUD * self.noise * np.sqrt(readings.shape[1]))

    def read(self, readings: FloatArray, sensors_in_robot: FloatArray) -> TouchPoints:
        """Give the points of readings (m, taxels) kPa at poses (m, 7)."""
        count = len(readings)
        point, free = np.zeros((count, _POINTS, 4)), np.zeros((count, _PLACES, 3))
        points, frees = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        begin = np.zeros(count)
        for m in np.flatnonzero(self.met(readings)):
            most = readings[m].max()
            pressed = np.flatnonzero(readings[m] > _PRESSED * most)
            pressed = _some(pressed[np.argsort(-readings[m, pressed], kind="stable")], _POINTS)
            points[m] = len(pressed)
            point[m, : len(pressed), :3] = self.surface(readings[m], pressed)
            point[m, : len(pressed), 3] = _SAYS * readings[m, pressed] / readings[m, pressed].sum()
            empty = _some(np.flatnonzero(readings[m] < _FREE * most), _PLACES)
            frees[m] = len(empty)
            free[m, : len(empty)] = self.taxel_points[empty]
            begin[m] = most / self.stiffness + _BEHIND
        return TouchPoints(sensors_in_robot, point, points, free, frees, begin)

    def surface(self, reading: FloatArray, pressed: np.ndarray) -> FloatArray:
        """Give the places (n, 3) mm, in the sensor's frame, that pressed taxels say lie on a surface."""
        places = self.taxel_points[pressed].copy()
        places[:, 2] -= reading[pressed] / self.stiffness
        return places

    def anchor(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        """Give the place (3,) mm in the robot's frame that is touched the hardest: it lies on a surface."""
        strongest = np.array([int(reading.argmax())])
        return np.asarray(rigid.transform(sensor_in_robot, self.surface(reading, strongest))[0], dtype=float)


def _some(which: np.ndarray, count: int) -> np.ndarray:
    """Take `count` of `which` evenly, or all if there are fewer."""
    return which if len(which) <= count else which[np.arange(count) * len(which) // count]


def joined(first: TouchPoints, second: TouchPoints) -> TouchPoints:
    """Put the points of one touch after another."""
    return TouchPoints(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def since(touches: TouchPoints, first: int) -> TouchPoints:
    """Give the touches from number `first` on."""
    return TouchPoints(*(part[first:] for part in touches))  # type: ignore[arg-type]


_WIDTH = 0.4  # mm by which a touched point misses the map
_NEAR = 2.0  # times that: what is so near to the surface may be the touched point
# A coarse cell that is so many nats below the best is forgotten; what is so many below the best of the cells that it is
# compared with is not worked out to the end.
_FORGOTTEN, _NEGLIGIBLE = 15.0, 18.0
_LISTED, _KEPT = 50_000, 10_000  # coarse cells at the first contact, and after each later touch
_STEPS = 5  # in which the middle of a coarse cell is moved to where touches agree
_OBLIQUE = 0.25  # of the cosine between a pad's normal and a surface's that it can touch, at most


@dataclass(frozen=True, eq=False)
class Patches:
    """The coarse voxels that a surface crosses or comes near: voxels (v, 3), the mean places and normals (v, 3) of it.

    Where the surface only comes near, the places are those in the voxel that are near the surface.
    """

    voxels: NDArray[np.int64]
    points: FloatArray
    normals: FloatArray


def patches_of(surface: Surface, sizes: CellSizes, near: float) -> Patches:
    """Divide a surface, and what is `near` mm about it, among voxels."""
    steps = np.stack(np.meshgrid(*[[0.0, -near, near]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = (surface.points + steps[:, None]).reshape(-1, 3)
    normals = np.tile(surface.normals, (len(steps), 1))
    voxels, which = np.unique(
        np.floor((points + sizes.reach) / sizes.voxel).astype(np.int64), axis=0, return_inverse=True
    )
    which = which.ravel()
    own = len(surface.points)
    crossed = np.bincount(which[:own], minlength=len(voxels)) > 0
    counted = (np.arange(len(points)) < own) | ~crossed[which]
    count = np.bincount(which[counted], minlength=len(voxels))

    def mean(values: FloatArray) -> FloatArray:
        sums = [np.bincount(which[counted], values[counted, axis], len(voxels)) for axis in range(3)]
        return np.stack(sums, axis=1) / count[:, None]

    return Patches(voxels, mean(points), mean(normals))


class PoseSearch:
    """Which poses of which objects may agree with the touches so far, found by a quick look at distances.

    A pose is given by its rotation and by the point of the object that lies where the first contact was the hardest,
    the anchor: in these six numbers volumes are the same as in rotation and place, and only points on the surface
    matter.
    Cells of them, all objects' together, are screened (`screen_kernels`) for what may lie in them, the better ones are
    halved in turns, then in places, and so on. Of the cells that are not halved some stand for all: so what is found
    stands for the whole belief. screened: touches times cells that were looked at. coarse: the coarse cells' sizes.
    anchor: (3,) mm in the robot's frame, from the first contact on.
    """

    anchor: FloatArray
    # The coarse cells that can matter from the first contact on, their poses (n, 7), and logs (n,): what touches say of
    # them, the prior that they hold, and for how many others each stands.
    _cells: PoseCells
    _poses: FloatArray
    _scores: FloatArray
    _prior: FloatArray
    _held: FloatArray

    def __init__(
        self,
        field: SpaceField,
        labels: Sequence[int],
        reader: PointReader,
        side: int,
        voxel: float,
        box: float,
    ) -> None:
        """Take the objects `labels` of a field. side, voxel, box: of the coarse cells, see `CellSizes`."""
        self._reader, self._labels = reader, labels
        self._reach = {label: field.reach(label) for label in labels}
        self._charts = {label: field.maps[field.labels[label]] for label in labels}
        self.coarse = CellSizes(side, voxel, voxel * np.ceil(max(self._reach.values()) / voxel + 1), box)
        self._patches = {
            label: patches_of(field.surface(label), self.coarse, _NEAR * _WIDTH) for label in labels
        }
        xy = reader.taxel_points[:, :2]
        x, y = (np.linspace(xy[:, axis].min(), xy[:, axis].max(), 3) for axis in (0, 1))
        # The pad's middle and its corners.
        self._lattice = np.ascontiguousarray(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)[::2])
        self.screened = 0
        self.reset()

    def reset(self) -> None:
        """Forget all touches."""
        self._points = self._reader.read(np.empty((0, len(self._reader.taxel_points))), np.empty((0, 7)))
        self._begun = False

    def take_in(self, readings: FloatArray, sensors_in_robot: FloatArray) -> None:
        """Add touches: readings (m, taxels) kPa at poses (m, 7)."""
        first, new = len(self._points.sensor), self._reader.read(readings, sensors_in_robot)
        self._points = joined(self._points, new)
        if self._begun:
            self._screen_coarse(first)
        elif new.points.any():
            strongest = int(np.where(new.points > 0, readings.sum(axis=1), -np.inf).argmax())
            self.anchor, self._begun = (
                self._reader.anchor(readings[strongest], sensors_in_robot[strongest]),
                True,
            )
            self._list_coarse(sensors_in_robot[strongest])
            self._screen_coarse(0)

    def find(
        self, count: int, halvings: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Halve the better cells `halvings` times, and draw a pose in each of `count` of the smallest.

        Returns labels (n,), object_in_robot (n, 7), and the logs (n,) of how much of the prior each stands for. n is at
        most `count`: poses outside of the prior are left out. It is 0 where no object can be what was touched.
        """
        sizes, cells, scores = self.coarse, self._cells, self._scores
        log_held, log_mass = self._held, self._scores + self._prior + self._held
        for step in range(2 * halvings):
            chosen, more = thinned(shared(log_mass, cells.label), count, rng.random())
            if not len(chosen):  # the prior is nowhere near
                break
            least = float(scores[chosen].max()) - _NEGLIGIBLE
            if step % 2:
                cells, sizes = cells.some(chosen).shifted_halves(), sizes.shifted()
            else:
                cells, sizes = cells.some(chosen).turned_halves(), sizes.turned()
            poses = cells.poses(sizes, self.anchor)
            prior = cells.log_prior(poses, sizes, self._slack(poses, sizes))
            log_held = np.repeat(log_held[chosen] + more, 8)
            scores = self._screen(cells.label, poses, sizes, 0, np.zeros(len(cells)), least)
            log_mass = prior + log_held + scores
        chosen, more = thinned(shared(log_mass, cells.label), count, rng.random())
        cells = cells.some(chosen)
        poses = self._within(cells.poses(sizes, self.anchor), sizes, rng)
        log_held = log_held[chosen] + more + cells.log_prior(poses, sizes)
        inside = log_held > -np.inf
        return cells.label[inside], poses[inside], log_held[inside]

    def seeds(self, count: int, kept: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw `count` of the coarse cells, move the poses in their middles to where touches agree, and keep the best.

        Returns labels (n,) and object_in_robot (n, 7) of at most `kept` poses, the best first. They stand for no share
        of the belief; a search for its modes may begin at them.
        """
        mass = shared(self._scores + self._prior + self._held, self._cells.label)
        chosen, _ = thinned(mass, count, rng.random())
        label, poses, score = self._cells.label[chosen], self._poses[chosen], np.zeros(len(chosen))
        self._look(label, poses, self.coarse, 0, _STEPS, -np.inf, score)
        best = np.argsort(-score, kind="stable")[:kept]
        return label[best], poses[best]

    def _list_coarse(self, sensor_in_robot: FloatArray) -> None:
        """List the coarse cells in which the surface faces the pad: their middles lie on the surface."""
        cube, place = every_cell(self.coarse.side)
        turns = middles(cube, place, self.coarse.side)
        along = rigid.turned(sensor_in_robot[3:], np.array([0.0, 0.0, 1.0]))
        inward = rigid.turned(rigid.conjugate(turns), along)
        slant = np.sin(np.sqrt(3) * self.coarse.turn)  # other rotations in a cell face the pad more
        cells, poses = [], []
        for label in self._labels:
            patches = self._patches[label]
            # Where normals differ within a voxel, their mean is short, and the pad may look along it.
            least = _OBLIQUE + 1 - np.linalg.norm(patches.normals, axis=1) + slant
            which, turn = np.nonzero(patches.normals @ inward.T < least[:, None])
            cells.append(PoseCells(np.full(len(turn), label), cube[turn], place[turn], patches.voxels[which]))
            poses.append(
                np.concatenate(
                    [self.anchor - rigid.turned(turns[turn], patches.points[which]), turns[turn]], axis=1
                )
            )
        self._cells, self._poses = PoseCells.joined(cells), np.concatenate(poses)
        self._prior = self._cells.log_prior(self._poses, self.coarse, self._slack(self._poses, self.coarse))
        self._scores, self._held = np.zeros(len(self._cells)), np.zeros(len(self._cells))
        self._keep(self._prior, _LISTED)

    def _screen_coarse(self, first: int) -> None:
        """Take touches from `first` on into the coarse cells, and keep those that can matter."""
        if not len(self._cells):
            return
        least = float(self._scores.max()) - _NEGLIGIBLE
        self._scores = self._screen(self._cells.label, self._poses, self.coarse, first, self._scores, least)
        mass = self._scores + self._prior + self._held
        mass[mass < mass.max() - _FORGOTTEN] = -np.inf
        self._keep(mass, _LISTED if first == 0 else _KEPT)

    def _keep(self, log_mass: FloatArray, count: int) -> None:
        """Keep `count` of the coarse cells, chosen by their log-masses (n,)."""
        kept, more = thinned(shared(log_mass, self._cells.label), count)
        self._cells, self._poses, self._held = (
            self._cells.some(kept),
            self._poses[kept],
            self._held[kept] + more,
        )
        self._scores, self._prior = self._scores[kept], self._prior[kept]

    def _screen(
        self,
        label: NDArray[np.int64],
        poses: FloatArray,
        sizes: CellSizes,
        first: int,
        score: FloatArray,
        least: float,
    ) -> FloatArray:
        """Add the touches from `first` on to scores (n,); -inf for those that fall to `least`, unless all do."""
        for limit in (least, -np.inf):
            found = score.copy()
            self._look(label, poses, sizes, first, 0, limit, found)
            found = np.where(found > limit, found, -np.inf)
            if found.max() > -np.inf:
                break
        return found

    def _look(
        self,
        label: NDArray[np.int64],
        poses: FloatArray,
        sizes: CellSizes,
        first: int,
        steps: int,
        least: float,
        score: FloatArray,
    ) -> None:
        """Call `screen` for poses (n, 7) of objects (n,): moves the poses by so many steps and adds to score (n,)."""
        touches = since(self._points, first)
        slack = Slack(self.anchor, sizes.turn, sizes.shift, _WIDTH)
        for one in np.unique(label).tolist():
            mine = np.flatnonzero(label == one)
            moved, part = poses[mine], score[mine]
            way = PadWay(self._lattice, self._reach[one])
            screen(self._charts[one], touches, way, moved, slack, steps, least, part)
            score[mine] = part
            if steps:
                poses[mine] = moved
        self.screened += len(poses) * len(touches.sensor) * (steps + 1)

    def _slack(self, poses: FloatArray, sizes: CellSizes) -> float:
        """Give how far an object's origin may be from that of its cell's middle, mm."""
        lever = float(np.linalg.norm(poses[:, :3] - self.anchor, axis=1).max(initial=0.0))
        return 2 * (lever * sizes.turn + sizes.shift)

    def _within(self, poses: FloatArray, sizes: CellSizes, rng: np.random.Generator) -> FloatArray:
        """Move poses (n, 7) from the middles of their cells to anywhere within."""
        by = rigid.from_vector(rng.uniform(-0.5, 0.5, (len(poses), 3)) * (ACROSS / sizes.side))
        shift = rng.uniform(-0.5, 0.5, (len(poses), 3)) * sizes.voxel
        place = self.anchor + rigid.turned(by, poses[:, :3] - self.anchor) + shift
        rotation = rigid.multiply(by, poses[:, 3:])
        return np.concatenate([place, rotation / np.linalg.norm(rotation, axis=1, keepdims=True)], axis=1)
