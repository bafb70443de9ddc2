"""The engine `bed`: springs with exact areas carry the letter, and MuJoCo solves the balance of what may move.

A rigid letter can move along the pad's normal, and where the wrist gives way it can tilt about two axes. Its pose at
rest is that of least energy, E = k/2 int d^2 + wrist/2 |tilt - nominal|^2 - F z, d being the depth where it is above 0.
E is convex, and a step of Newton's method towards its minimum is one long implicit time step of MuJoCo: it solves
(stiffness + m / h^2) dx = imbalance, and h is chosen so long that the inertia m / h^2 is negligible.

The springs of a step stand for the part of the face that touches when the step begins. After it the face is
clipped again where its depth is 0, so that the part is exact to within a cell. A press is at rest when the
exact force and moments balance. Where a step does not lower the energy it is halved.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.press.bed import MM, Bed, Level, Springs, lay_bed, levels, slopes
from tactsim.press.clip import EVEN_MOMENTS, MOMENTS
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import RADIUS, Setup, scene
from tactsim.press.spread import Patches
from tactsim.press.touches import MOST_TILT, TIPPED, Pressed, Touches, UnsettledError

MASS = 0.01  # kg; an equilibrium does not depend on it
_INERTIA = 1e-8  # m / h^2 as a share of the bed's stiffness
_BALANCE = 1e-6  # share of the force, and of force times _REACH, that a press at rest may miss
_REACH = 5.0  # mm, about half a pad
_MOST_STEPS = 60
_MOST_HALVINGS = 30
_DEPTH = 1e-5  # m into the bed, for a step that shows that a press without contact has no forces


@dataclass(frozen=True, eq=False)
class _Contact:
    """What touches in some presses where their letters are now, and how it balances there.

    depth: (n,) mm at the pad's middle. tilt: (n, 2) rad. bed: what touches there. foot: (contacts, 2) mm, the centre
    of pressure of each part. below: (contacts,) mm, the mean depth of each. bending: (n, 2) N mm/rad, by which the
    parts resist a tilt about x and y, each about its own centroid. unbent: (n, 2) rad, the tilt at which springs at
    the feet have all of the parts' moments. energy: (n,) N mm. missing: (n,) how far force and moments are from
    balance, as a share of the force, and of force times _REACH.
    """

    depth: FloatArray
    tilt: FloatArray
    bed: Bed
    foot: FloatArray
    below: FloatArray
    bending: FloatArray
    unbent: FloatArray
    energy: FloatArray
    missing: FloatArray


@dataclass(frozen=True, eq=False)
class _Problem:
    """The presses that are to be solved.

    tilted: whether any face may be other than level. force: (n,) N of each. stiffness: (n,) N/mm^3, of the layer under
    each.
    """

    touches: Touches
    face: Sequence[Level]
    options: ScanOptions
    tilted: bool
    force: FloatArray
    stiffness: FloatArray

    def lay(self, rows: NDArray[np.intp], tilt: FloatArray, depth: FloatArray | None = None) -> Bed:
        """Lay the bed under some presses: where the face is below the pad's surface, or all over the pad."""
        return lay_bed(
            self.face,
            self.touches.poses[rows],
            *self.options.cell_lines,
            tilts=tilt if self.tilted else None,
            depths=depth,
            moments=MOMENTS if self.tilted else EVEN_MOMENTS,
        )

    def begin(self, bed: Bed) -> _Contact:
        """Begin at the nominal tilts, and so deep that all of the face touches. bed: all of it, under every press."""
        tilt, area = self.touches.tilts, bed.area_of_presses
        touch = bed.gap - np.einsum("ci,ci->c", slopes(tilt)[bed.press], bed.centroid)
        depth = np.full(len(tilt), -np.inf)
        np.maximum.at(depth, bed.press, touch)
        depth += 1.05 * self.force / (self.stiffness * np.where(area > 0, area, 1))
        return _Contact(
            depth,
            tilt,
            bed,
            foot=bed.centroid,
            below=depth[bed.press] - touch,
            bending=self._bending(bed, np.arange(len(tilt))),
            # With their feet at the centroids springs have the moments of a level face
            unbent=np.zeros_like(tilt),
            energy=np.full(len(tilt), np.inf),
            missing=np.full(len(tilt), np.inf),
        )

    def at(self, rows: NDArray[np.intp], depth: FloatArray, tilt: FloatArray) -> _Contact:
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
        # Of all parts of a press together.
        twice_stored, carried, moment_x, moment_y = (
            self.stiffness[rows] * np.bincount(bed.press, of_parts, len(rows))
            for of_parts in (squared, force, *arm.T)
        )
        force_set = self.force[rows]
        energy = twice_stored / 2 - force_set * depth
        missing = np.abs(carried - force_set) / force_set
        if press.wrist_stiffness is not None:
            bend = tilt - self.touches.tilts[rows]
            energy += press.wrist_stiffness * (bend**2).sum(axis=1) / 2
            # How the depth at (x, y) changes with either tilt: the forces do work through it.
            (cos_x, cos_y), (sin_x, sin_y) = np.cos(tilt.T), np.sin(tilt.T)
            about_x = moment_y / cos_x**2 - moment_x * sin_x * sin_y / (cos_y * cos_x**2)
            about_y = -moment_x / (cos_y**2 * cos_x)
            for about, gave in zip((about_x, about_y), bend.T, strict=True):
                imbalance = np.abs(about + press.wrist_stiffness * gave)
                missing = np.maximum(missing, imbalance / (force_set * _REACH))
        carrying = force > 0
        foot = bed.centre + np.divide(
            leaning, force[:, None], out=np.zeros_like(leaning), where=carrying[:, None]
        )
        below = np.where(carrying, force / area, 0.0)
        return _Contact(depth, tilt, bed, foot, below, self._bending(bed, rows), tilt, energy, missing)

    def _bending(self, bed: Bed, rows: NDArray[np.intp]) -> FloatArray:
        area, first, second = bed.moments[0], bed.moments[1:3], bed.moments[[3, 5]]
        own = second - first**2 / area
        about_y, about_x = (np.bincount(bed.press, along, len(rows)) for along in own)
        return self.stiffness[rows, None] * np.stack([about_x, about_y], axis=1)


def press(touches: Touches, options: ScanOptions, face: Sequence[Level] | None = None) -> Pressed:
    """Press a letter until it rests. face: the levels that touch, if they are not those of the letter.

    A press that tips over or finds no balance is a blank, with its reason.
    """
    setup = options.press
    if face is None:
        face = levels(touches.letter, setup)
    force, stiffness = touches.forces(setup.force), np.ones(len(touches))
    tilted = setup.wrist_stiffness is not None or bool(touches.tilts.any())
    problem = _Problem(touches, face, options, tilted, force, stiffness)
    whole = problem.lay(np.arange(len(touches)), touches.tilts)
    area = whole.area_of_presses
    touching = np.flatnonzero(area)
    stiffness[touching] = [
        1e-3 * setup.stiffness_over(some, carried)
        for some, carried in zip(area[touching].tolist(), force[touching].tolist(), strict=True)
    ]
    stage = Setup(MASS, setup.wrist_stiffness)
    if not setup.skip.no_contact:
        for index in np.flatnonzero(area == 0).tolist():
            _fall(stage, whole.springs[index], touches, index, force[index])
    depth, tilt, blanks = _solve(problem, stage, problem.begin(whole), touching)
    resting = np.setdiff1d(touching, list(blanks))
    bed = problem.lay(resting, tilt[resting], depth[resting]).among(resting, len(touches))
    load = Patches.under(bed, depth, tilt, force, even=not tilted)
    untouched = len(touches) - len(touching)
    pressed = len(touching) + (0 if setup.skip.no_contact else untouched)
    work = Counter(presses=pressed, no_contact=len(touches) - pressed)
    return Pressed(touches, load, work, blanks)


def _solve(
    problem: _Problem, stage: Setup, contact: _Contact, trying: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray, dict[int, str]]:
    """Step the presses `trying` towards their rest, all of them in turn, until each is there or is given up.

    contact: where every press begins. Returns the depth (n,) mm and tilt (n, 2) rad of all presses at rest, and
    why a press finds none.
    """
    count = len(contact.depth)
    depth, tilt, energy, missing = contact.depth, contact.tilt.copy(), contact.energy, contact.missing
    # Where each press is tried next; by how much it was to tilt by its last step, and how often that was halved.
    proposed, turned, turning = depth.copy(), tilt.copy(), np.zeros(count)
    steps, halvings = np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    blanks: dict[int, str] = {}
    row, better = trying, np.ones(len(trying), dtype=bool)
    while len(trying):
        stepped, halved = trying[better], trying[~better]
        lost = _step(problem, stage, contact, row[better], stepped, proposed, turned)
        turning[stepped] = np.abs(turned[stepped]).max(axis=1)
        steps[stepped] += 1
        halvings[stepped] = 0
        proposed[halved] = (proposed[halved] + depth[halved]) / 2
        turned[halved] = (turned[halved] + tilt[halved]) / 2
        halvings[halved] += 1
        blanks |= lost
        trying = trying[~np.isin(trying, list(lost))]
        contact = problem.at(trying, proposed[trying], turned[trying])
        leaning = np.abs(contact.tilt).max(axis=1)
        better = (contact.energy <= energy[trying]) | (contact.missing <= missing[trying] / 2)
        better &= leaning <= 1
        better &= contact.bed.area_of_presses > 0  # else so far off that no spring is left to step with
        accepted = trying[better]
        depth[accepted], tilt[accepted] = contact.depth[better], contact.tilt[better]
        energy[accepted], missing[accepted] = contact.energy[better], contact.missing[better]
        resting = better & (contact.missing <= _BALANCE)
        blanks |= dict.fromkeys(trying[resting & (leaning > MOST_TILT)].tolist(), TIPPED)
        for index in trying[~better & (halvings[trying] == _MOST_HALVINGS)].tolist():
            blanks[index] = (
                TIPPED if turning[index] > MOST_TILT else "no step brings its forces nearer to balance"
            )
        for index in trying[better & ~resting & (steps[trying] == _MOST_STEPS)].tolist():
            blanks[index] = f"after {_MOST_STEPS} steps its forces do not balance"
        row = np.flatnonzero(~resting & ~np.isin(trying, list(blanks)))
        trying, better = trying[row], better[row]
    return depth, tilt, blanks


def _step(
    problem: _Problem,
    stage: Setup,
    contact: _Contact,
    rows: NDArray[np.intp],
    presses: NDArray[np.intp],
    proposed: FloatArray,
    turned: FloatArray,
) -> dict[int, str]:
    """Make one step of Newton's method in each press from its row of `contact`.

    Fills proposed (all presses,) mm and turned (all presses, 2) rad, where the letters are after it. Returns why a
    press finds no rest.
    """
    # Contacts push along the face's normal, which leans from the pad's by an angle whose cosine is `lean`. So stiff
    # and so placed, a sphere's foot on the face is where its part presses, and it answers to the depth there along
    # the pad's normal. The sphere stands above the face and feels it by its margin: one below the face could be
    # nearer to a part's side.
    bed, foot, above = contact.bed, contact.foot * MM, 2 * RADIUS
    lean = np.cos(contact.tilt).prod(axis=1)
    over, slope = above * lean[bed.press], slopes(contact.tilt)[bed.press]
    position = np.empty((len(foot), 3))
    position[:, :2] = foot - over[:, None] * slope
    position[:, 2] = contact.depth[bed.press] * MM + np.einsum("ci,ci->c", foot, slope) - RADIUS + over
    margin = above - RADIUS + lean[bed.press] * contact.below * MM
    wrist, lost = stage.wrist_stiffness, {}
    for row, index in zip(rows.tolist(), presses.tolist(), strict=True):
        springs, stiffness = bed.springs[row], 1e3 * float(problem.stiffness[index])
        placed = scene(stage, len(springs.share), problem.touches.tilts[index])
        bending = contact.bending[row]
        placed.set_springs(
            springs._replace(position=position[springs.rows]),
            stiffness / lean[row] ** 2,
            step=_time_step(stiffness * springs.area),
            margin=margin[springs.rows],
            bending=bending,
        )
        placed.reset(contact.depth[row] * MM, contact.tilt[row])
        if wrist is not None:
            target = wrist * placed.tilt + bending * contact.unbent[row]
            placed.model.eq_data[:, 0] = target / (wrist + bending)
        data = placed.data
        data.qfrc_applied[0] = problem.force[index]
        placed.model.opt.tolerance = 0.0  # the solver goes on as long as it improves
        try:
            placed.check_position()
            mujoco.mj_step(placed.model, data)
            placed.check_position()
        except UnsettledError as error:
            lost[index] = str(error)
            continue
        proposed[index] = data.qpos[0] / MM
        turned[index] = placed.tilt if wrist is None else data.qpos[1:]
    return lost


def _fall(stage: Setup, springs: Springs, touches: Touches, index: int, force: float) -> None:
    """Push a letter that touches nothing for one step, and check that MuJoCo finds no force.

    Done only where the skip of presses without contact is switched off, to show that it changes nothing.
    """
    placed = scene(stage, len(springs.share), touches.tilts[index])
    stiffness = force / _DEPTH  # as for a contact of 1 mm^2
    placed.set_springs(springs, stiffness, step=_time_step(stiffness))
    placed.reset(_DEPTH)
    placed.data.qfrc_applied[0] = force
    mujoco.mj_step(placed.model, placed.data)
    if placed.forces(len(springs.share)).any():
        raise AssertionError("a letter beside the pad was touched")


def _time_step(stiffness: float) -> float:
    return math.sqrt(MASS / (_INERTIA * stiffness))
