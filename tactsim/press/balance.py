"""The engine `bed`: springs with exact areas carry the letter, and MuJoCo solves the balance of what may move.

A rigid letter can move along the pad's normal, and where the wrist gives way it can tilt about two axes. Its
pose at rest is that of least energy, E = k/2 int d^2 + wrist/2 |tilt - nominal|^2 - F z, d being the depth
where it is above 0. E is convex, and a step of Newton's method towards its minimum is one long implicit time
step of MuJoCo: it solves (stiffness + m / h^2) dx = imbalance, and h is chosen so long that the inertia
m / h^2 is negligible.

The springs of a step stand for the part of the face that touches when the step begins. After it the face is
clipped again where its depth is 0, so that the part is exact to within a cell. A press is at rest when the
exact force and moments balance. Where a step does not lower the energy it is halved.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.press.bed import MM, Bed, Level, Springs, join, lay_bed, levels, slopes
from tactsim.press.clip import EVEN_MOMENTS, MOMENTS
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import RADIUS, UNREAD_STAGES, Scene, Setup, scene
from tactsim.press.spread import Patches
from tactsim.press.touches import Pressed, Touches, UnsettledError

MASS = 0.01  # kg; an equilibrium does not depend on it
_INERTIA = 1e-8  # m / h^2 as a share of the bed's stiffness
_BALANCE = 1e-6  # share of the force, and of force times _REACH, that a press at rest may miss
_BALANCE_OF_PARTS = (
    1e-4  # the same where the letter's parts are touched: MuJoCo keeps meshes in single precision
)
_REACH = 5.0  # mm, about half a pad
_MOST_ROUNDS = 60
_MOST_HALVINGS = 30
_DEPTH = 1e-5  # m into the bed, for a step that shows that a press without contact has no forces
MOST_TILT = 0.35  # rad, 20 degrees: a letter that tilts further has tipped over
TIPPED = "the wrist gives way until it tips over; press with less force or a stiffer wrist"


@dataclass(frozen=True, eq=False)
class _State:
    """Where the letters of some presses are, and how they balance there.

    depth: (n,) mm at the pad's middle. tilt: (n, 2) rad. bed: what touches there. pressure, gradient: there,
    as in Patches. foot: (contacts, 2) mm, the centre of pressure of each part. below: (contacts,) mm, the mean
    depth of each. bending: (n, 2) N mm/rad, by which the parts resist a tilt about x and y, each about its own
    centroid. energy: (n,) N mm. missing: (n,) how far force and moments are from balance, as a share of
    the force, and of force times _REACH.
    """

    depth: FloatArray
    tilt: FloatArray
    bed: Bed
    pressure: FloatArray
    gradient: FloatArray
    foot: FloatArray
    below: FloatArray
    bending: FloatArray
    energy: FloatArray
    missing: FloatArray

    def start(self, row: int) -> _Start:
        """Describe where the next step of one press begins."""
        springs = self.bed.springs[row]
        rows = springs.rows
        return _Start(
            springs,
            depth=self.depth[row] * MM,
            tilt=self.tilt[row],
            foot=self.foot[rows] * MM,
            below=self.below[rows] * MM,
            bending=self.bending[row],
            unbent=self.tilt[row],
        )


class _Start(NamedTuple):
    """Where a step begins: springs, depth (m) and tilt (2,); each spring's foot (n, 2) m and depth (n,) m.

    bending: (2,) N mm/rad, as in _State. unbent: (2,) rad, the tilt at which the springs at their feet have all
    of the parts' moments.
    """

    springs: Springs
    depth: float
    tilt: FloatArray
    foot: FloatArray
    below: FloatArray
    bending: FloatArray
    unbent: FloatArray


@dataclass(frozen=True, eq=False)
class _Problem:
    """The presses that are to be solved. force: (n,) N of each. stiffness: (n,) N/mm^3, of the layer under each."""

    touches: Touches
    face: Sequence[Level]
    options: ScanOptions
    force: FloatArray
    stiffness: FloatArray

    @property
    def tilted(self) -> bool:
        """Tell whether any face may be other than level."""
        return self.options.press.wrist_stiffness is not None or bool(self.touches.tilts.any())

    def lay(self, rows: NDArray[np.intp], tilt: FloatArray, depth: FloatArray | None = None) -> Bed:
        """Lay the bed under some presses: where the face is below the pad's surface, or all over the pad."""
        return lay_bed(
            self.face,
            self.touches.poses[rows],
            *self.options.cell_lines,
            tilts=tilt if self.tilted else None,
            depths=depth,
            moments=MOMENTS if self.tilted else EVEN_MOMENTS,
            skip_empty=self.options.press.skip.cells,
        )

    def at(self, rows: NDArray[np.intp], depth: FloatArray, tilt: FloatArray) -> _State:
        """Clip the face where it touches, and integrate force, moments and energy there exactly."""
        press = self.options.press
        bed = self.lay(rows, tilt, depth)
        slope = slopes(tilt)[bed.press]
        area, first, second = bed.moments[0], bed.moments[1:3].T, bed.moments[3:6]
        at_centre = depth[bed.press] - bed.gap + np.einsum("ci,ci->c", slope, bed.centre)
        along = np.einsum("ci,ci->c", slope, first)
        force = at_centre * area + along
        slope_x, slope_y = slope.T
        bent = np.stack(
            [slope_x * second[0] + slope_y * second[1], slope_x * second[1] + slope_y * second[2]], axis=1
        )
        leaning = at_centre[:, None] * first + bent
        arm = bed.centre * force[:, None] + leaning
        squared = at_centre * (force + along) + np.einsum("ci,ci->c", slope, bent)
        stiffness, force_set = self.stiffness[rows], self.force[rows]

        def over_press(values: FloatArray) -> FloatArray:
            return stiffness * np.bincount(bed.press, values, len(rows))

        energy = over_press(squared) / 2 - force_set * depth
        carried = over_press(force)
        missing = np.abs(carried - force_set) / force_set
        if press.wrist_stiffness is not None:
            bend = tilt - self.touches.tilts[rows]
            energy += press.wrist_stiffness * (bend**2).sum(axis=1) / 2
            # How the depth at (x, y) changes with either tilt: the forces do work through it.
            (cos_x, cos_y), (sin_x, sin_y) = np.cos(tilt.T), np.sin(tilt.T)
            moment_x, moment_y = over_press(arm[:, 0]), over_press(arm[:, 1])
            about_x = moment_y / cos_x**2 - moment_x * sin_x * sin_y / (cos_y * cos_x**2)
            about_y = -moment_x / (cos_y**2 * cos_x)
            for about, gave in zip((about_x, about_y), bend.T, strict=True):
                imbalance = np.abs(about + press.wrist_stiffness * gave)
                missing = np.maximum(missing, imbalance / (force_set * _REACH))
        # What is missing in the balance is made up for, so that every reading is one of exactly the press's force.
        here = (stiffness * force_set / np.where(carried > 0, carried, np.inf))[bed.press]
        carrying = force > 0
        return _State(
            depth=depth,
            tilt=tilt,
            bed=bed,
            pressure=here * at_centre,
            gradient=here[:, None] * slope,
            foot=bed.centre
            + np.divide(leaning, force[:, None], out=np.zeros_like(leaning), where=carrying[:, None]),
            below=np.divide(force, area, out=np.zeros_like(force), where=carrying),
            bending=self.bending(bed, rows),
            energy=energy,
            missing=missing,
        )

    def bending(self, bed: Bed, rows: NDArray[np.intp]) -> FloatArray:
        """Sum what the parts of each press add to the wrist's stiffness about x and y: (n, 2) N mm/rad."""
        area, first, second = bed.moments[0], bed.moments[1:3], bed.moments[[3, 5]]
        own = second - np.divide(first**2, area, out=np.zeros_like(first), where=area > 0)
        about_y, about_x = (np.bincount(bed.press, along, len(rows)) for along in own)
        return self.stiffness[rows, None] * np.stack([about_x, about_y], axis=1)

    @property
    def allowed(self) -> float:
        """How far from balance a press at rest may be."""
        return _BALANCE if self.options.press.skip.parts else _BALANCE_OF_PARTS


def press(touches: Touches, options: ScanOptions) -> Pressed:
    """Press a letter until it rests.

    A press that tips over or finds no balance is a blank, with its reason.
    Raises InputError if a letter with rounded edges is to be pressed by its parts.
    """
    return press_face(levels(touches.letter, options.press), touches, options)


def press_face(face: Sequence[Level], touches: Touches, options: ScanOptions) -> Pressed:
    """Press a face that is given by its levels, as `press` does."""
    setup = options.press
    force, stiffness = touches.forces(setup.force), np.ones(len(touches))
    problem = _Problem(touches, face, options, force, stiffness)
    whole = problem.lay(np.arange(len(touches)), touches.tilts)
    area = whole.area_of_presses
    touching = np.flatnonzero(area)
    stiffness[touching] = [
        1e-3 * setup.stiffness_over(some, carried)
        for some, carried in zip(area[touching].tolist(), force[touching].tolist(), strict=True)
    ]
    stage = Setup(
        mass=MASS,
        wrist_stiffness=setup.wrist_stiffness,
        letter=None if setup.skip.parts else touches.letter,
        skip_stages=setup.skip.stages,
    )
    if not setup.skip.no_contact:
        for index in np.flatnonzero(area == 0).tolist():
            _fall(stage, whole.springs[index], touches, index, force[index])
    load, blanks = _solve(problem, stage, whole, touching)
    return Pressed(touches, load, _work(whole, face, touches, options), blanks)


def _solve(
    problem: _Problem, stage: Setup, whole: Bed, touching: NDArray[np.intp]
) -> tuple[Patches, dict[int, str]]:
    """Step the presses `touching` towards their rest, all of them in turn, until every one is there or is given up.

    whole: the springs under all of the face, which the first step begins with.
    """
    count = len(problem.touches)
    depth, tilt = np.zeros(count), problem.touches.tilts.copy()
    energy, missing = np.full(count, np.inf), np.full(count, np.inf)
    done: list[tuple[NDArray[np.intp], _State]] = []
    blanks: dict[int, str] = {}
    starts: dict[int, _Start] = {}
    bending = problem.bending(whole, np.arange(count))
    left = touching
    for _ in range(_MOST_ROUNDS):
        proposed, turned = np.empty(len(left)), np.empty((len(left), 2))
        lost = np.zeros(len(left), dtype=bool)
        for row, index in enumerate(left.tolist()):
            force = float(problem.force[index])
            springs = starts[index].springs if index in starts else whole.springs[index]
            placed = _placed(stage, springs, problem.touches, index)
            stiffness = 1e3 * problem.stiffness[index]
            start = starts.get(index)
            if start is None:
                start = _all_touch(placed, springs, force / stiffness, bending[index])
                depth[index] = start.depth / MM
            try:
                proposed[row], turned[row] = _step(placed, start, stiffness, force)
            except UnsettledError as error:
                blanks[index], lost[row] = str(error), True
        trying, proposed, turned = left[~lost], proposed[~lost], turned[~lost]
        turning = dict(zip(trying.tolist(), np.abs(turned).max(axis=1).tolist(), strict=True))
        starts = {}
        for _ in range(_MOST_HALVINGS):
            state = problem.at(trying, proposed, turned)
            worse = (state.energy > energy[trying]) & (state.missing > missing[trying] / 2)
            worse |= (np.abs(turned) > 1).any(axis=1)
            worse |= state.bed.area_of_presses == 0  # so far off that no spring is left to step with
            balanced = state.missing <= problem.allowed
            resting = ~worse & balanced
            tipped = resting & (np.abs(turned) > MOST_TILT).any(axis=1)
            blanks |= dict.fromkeys(trying[tipped].tolist(), TIPPED)
            done.append((np.where(resting & ~tipped, trying, -1), state))
            for row in np.flatnonzero(~worse & ~balanced).tolist():
                starts[int(trying[row])] = state.start(row)
            accepted = trying[~worse]
            depth[accepted], tilt[accepted] = proposed[~worse], turned[~worse]
            energy[accepted], missing[accepted] = state.energy[~worse], state.missing[~worse]
            trying = trying[worse]
            if not len(trying):
                break
            proposed = (proposed[worse] + depth[trying]) / 2
            turned = (turned[worse] + tilt[trying]) / 2
        for index in trying.tolist():
            blanks[index] = (
                TIPPED if turning[index] > MOST_TILT else "no step brings its forces nearer to balance"
            )
        left = np.array(sorted(starts), dtype=np.intp)
        if not len(left):
            break
    blanks |= dict.fromkeys(left.tolist(), f"after {_MOST_ROUNDS} steps its forces do not balance")
    return _gathered(done, problem), blanks


def _gathered(done: list[tuple[NDArray[np.intp], _State]], problem: _Problem) -> Patches:
    """Put together what rests. done: states, and which press each of their presses is, -1 if not at rest."""
    beds, presses, pressure, gradient = [], [], [], []
    for own, state in done:
        rows = np.flatnonzero(own[state.bed.press] >= 0)
        beds.append(state.bed.of(rows, state.bed.press[rows], len(own)))
        presses.append(own)
        pressure.append(state.pressure[rows])
        gradient.append(state.gradient[rows])
    bed, order = join(beds, presses, len(problem.touches))
    return Patches(
        bed,
        np.concatenate(pressure)[order],
        np.concatenate(gradient)[order] if problem.tilted else None,
    )


def _placed(stage: Setup, springs: Springs, touches: Touches, index: int) -> Scene:
    """Give the scene of one press, with the letter at its pose and its nominal tilt."""
    placed = scene(stage, len(springs.share))
    placed.place_letter(touches.poses[index], touches.tilts[index])
    return placed


def _all_touch(stage: Scene, springs: Springs, give: float, bending: FloatArray) -> _Start:
    """Begin at the nominal tilt and so deep that all springs touch. give: F / stiffness, mm^2 m."""
    touch = stage.depth_of_touch(springs)
    depth = touch.max() + 1.05 * give / springs.area
    below = depth - touch
    # With their feet at the centroids the springs have the moments of a level face.
    return _Start(
        springs, depth, stage.tilt.copy(), springs.position[:, :2], below, bending, unbent=np.zeros(2)
    )


def _step(stage: Scene, start: _Start, stiffness: float, force: float) -> tuple[float, FloatArray]:
    """Make one step of Newton's method with springs of `stiffness` (kPa/mm): depth (mm) and tilt (2,) after it.

    Raises UnsettledError if the letter leaves the stage.
    """
    # Contacts push along the face's normal, which leans from the pad's by an angle whose cosine is `lean`. So stiff
    # and so placed, a sphere's foot on the face is where its part presses, and it answers to the depth there along
    # the pad's normal. The sphere stands above the face and feels it by its margin: one below the face could be
    # nearer to a part's side.
    springs, depth, tilt, foot, below, bending, unbent = start
    lean = math.cos(tilt[0]) * math.cos(tilt[1])
    slope = np.array([-math.tan(tilt[1]) / math.cos(tilt[0]), math.tan(tilt[0])])
    above = 2 * RADIUS
    position = np.empty_like(springs.position)
    position[:, :2] = foot - above * lean * slope
    position[:, 2] = depth + foot @ slope - RADIUS + above * lean
    stage.set_springs(
        springs._replace(position=position),
        stiffness / lean**2,
        step=_time_step(stiffness * springs.area),
        margin=above - RADIUS + lean * below,
        bending=bending,
    )
    stage.reset(depth, tilt)
    wrist = stage.setup.wrist_stiffness
    if wrist is not None:
        stage.model.eq_data[:, 0] = (wrist * stage.tilt + bending * unbent) / (wrist + bending)
    data = stage.data
    data.qfrc_applied[0] = force
    stage.model.opt.tolerance = 0.0  # the solver goes on as long as it improves
    stage.check_position()
    mujoco.mj_step(stage.model, data)
    stage.check_position()
    hinged = stage.setup.wrist_stiffness is not None
    return data.qpos[0] / MM, data.qpos[1:].copy() if hinged else stage.tilt.copy()


def _fall(stage: Setup, springs: Springs, touches: Touches, index: int, force: float) -> None:
    """Push a letter that touches nothing for one step, and check that MuJoCo finds no force.

    Done only where the skip of presses without contact is switched off, to show that it changes nothing.
    """
    placed = _placed(stage, springs, touches, index)
    stiffness = force / _DEPTH  # as for a contact of 1 mm^2
    placed.set_springs(springs, stiffness, step=_time_step(stiffness))
    placed.reset(_DEPTH)
    placed.data.qfrc_applied[0] = force
    mujoco.mj_step(placed.model, placed.data)
    if placed.forces(len(springs.share)).any():
        raise AssertionError("a letter beside the pad was touched")


def _time_step(stiffness: float) -> float:
    return float(np.sqrt(MASS / (_INERTIA * stiffness)))


def _work(bed: Bed, face: Sequence[Level], touches: Touches, options: ScanOptions) -> Counter[str]:
    """Count presses and what each skip left out of them."""
    skip = options.press.skip
    touching = int(np.count_nonzero(bed.area_of_presses))
    untouched = len(touches) - touching
    pressed = touching + (0 if skip.no_contact else untouched)
    x_lines, y_lines = options.cell_lines
    cells = (len(x_lines) - 1) * (len(y_lines) - 1) * len(face)
    return Counter(
        presses=pressed,
        no_contact=untouched if skip.no_contact else 0,
        cells=touching * cells - len(bed.area) if skip.cells else 0,
        parts=pressed * len(touches.letter.parts) if skip.parts else 0,
        stages=pressed * len(UNREAD_STAGES) if skip.stages else 0,
    )
