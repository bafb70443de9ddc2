"""What all filters over (letter, T_R^O) share: learning the maps, and the way of a reading.

    reading -> frames -> pad fit -> likelihood's evidence -> field -> motion -> measurement update

A filter has parts. Frames are identity where origins are near the object. The others are made only if its options ask
for them: a fit to the pad, a belief that moves, an open set. What proposes readings is made when it is first asked.
"""

from __future__ import annotations

import copy
import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import Scan, memory
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    PlaneBelief,
    check_candidates,
    check_order,
    check_reading,
)
from tactsim.estimators.field.field import IMPOSSIBLE, LikelihoodField, field_of
from tactsim.estimators.filters.grid import StateGrid, state_grid
from tactsim.estimators.filters.states import WeightedStates, likeliest_view, plane_cells, plane_histogram
from tactsim.estimators.frames import Frames, reach_on_object
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.likelihood import Likelihood, TaxelSum
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps_by
from tactsim.estimators.options import FilterOptions, OpenSetOptions, reach_of, wants_pad_fit

if TYPE_CHECKING:  # parts, and what they need, are imported by the filters that have them
    from tactsim.estimators.filters.active_touch import Planner
    from tactsim.estimators.filters.motion import Motion
    from tactsim.estimators.filters.moving import MovingBelief
    from tactsim.estimators.filters.open_set import OpenSet
    from tactsim.estimators.filters.trust import Trust
    from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
    from tactsim.estimators.pad_fit import PadFit

# Of an object that is watched: the prior probability that it lies still; and a motion is looked for once rest has less
# than the second of what regions allow for, after so many readings or more.
_LIES_STILL, _STIRRED, _FEWEST = 0.8, 0.02, 3
# A motion that is followed leaves at most that share unexplained of what is not explained at rest; one that leaves more
# than the second is none.
_LEFT, _MUCH_LEFT = 0.3, 0.5
# The next look is after so many times as many touches.
_AGAIN = 1.5
# An object is followed on while it moves with this probability, and as letters that are more probable than the second.
_AT_REST, _UNLIKELY = 0.04, 1e-4
# Bytes that a filter holds for a bin of a letter and for a particle: logs, indices, and room to list and sum them.
_OF_A_BIN, _OF_A_PARTICLE = 64, 200
# Bins of all letters, up to which they grow in number with the reach: of objects of 100 mm, 40 pictures.
_MOST_BINS = 16_000_000


class MapFilter(Estimator):
    """A filter on learned maps. A subclass implements `_fit`, `_reset`, `measure`, `own_estimate` and `own_states`.

    labels: the letters, in the order of the scan. maps: the occupancy map of each, mm. likelihood: the measurement
    model. field: the log-likelihood of the readings so far, which has a new reading before `measure` is called.
    taxel_xy: (taxels, 2) mm. reach: mm, of x and y of T_R^O. grid: the bins of a filter that has some.

    frames: where the origins of the filter's frames lie in those of its user, for the present sequence. All that the
    filter holds is in its own.
    pad_fit: units and options that were fitted to the scan's pad; None if that was not asked for. With it, all that
    the filter holds, but for `options` and `maps`, is in mm and kPa of the paper's pad, as `fitted_options` are.
    motion: how the object moves between touches; None if it lies still. moving: the belief that follows the motion,
    beside the filter's own; None without a motion.
    open_set: what says "none of these"; None if the options give that no probability.

    An object of several views has a map of each, which counts as a letter in all that the filter does. What it answers
    is of objects: a view's prior is its share of its object's presses, and the views' probabilities are summed.
    """

    options_type: type[Options] = FilterOptions
    options: FilterOptions
    # Whether a touch may have been made under any of the loads that were trained.
    mixes_loads = False
    # By what power the likelihood of so many readings counts in the belief; None for 1, however many there are.
    trust: Trust | None = None
    pad_fit: PadFit | None = None
    grid: StateGrid | None = None
    frames: Frames
    taxel_xy: FloatArray
    reach: float
    field: LikelihoodField
    moving: MovingBelief | None
    _train: Scan | None
    _planning: np.random.Generator

    def __init__(self, options: FilterOptions) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self.open_set: OpenSet | None = None
        self._maps: Mapping[str, OccupancyMap] = {}
        self._object_of: Mapping[str, str] = {}
        self._started = False
        self._evaluated = 0
        self._set_options(options)

    def _set_options(self, options: FilterOptions) -> None:
        """Take options, in the units that the filter works in, and make what follows from them alone."""
        self.fitted_options = options
        self.likelihood: Likelihood = likelihood.create(options)
        self.motion: Motion | None = None
        self._watched = False
        if options.motion != "off":
            from tactsim.estimators.filters.motion import parse_motion

            self._watched = options.motion == "seen"
            self.motion = parse_motion("auto" if self._watched else options.motion)
            if self._watched and self.motion is not None:
                self.motion = replace(self.motion, still=_LIES_STILL)
            self.draws = self.draws or self.motion is not None
        self.moving = None if self._watched else self._moving_belief()

    def _moving_belief(self) -> MovingBelief | None:
        if self.motion is None:
            return None
        from tactsim.estimators.filters.moving import MovingBelief

        return MovingBelief(self, self.motion)

    def fit(self, scan: Scan) -> None:
        """Learn the maps (eq. 2 to 6) and the measurement model from the training readings.

        Where it is asked for, units and options are fitted to the pad first. Raises InputError if a map or the
        belief would not fit in memory, or with an open set if a letter is called "none".
        """
        options, pad_fit = self.options, None
        frames = Frames.fitted(scan, reach_of(options.reach, scan.taxel_xy))
        scan, object_of = frames.scan(scan).by_view()
        if self.fits_pad(scan):
            from tactsim.estimators.pad_fit import fit_to_pad

            pad_fit = fit_to_pad(scan, options)
            scan, options = pad_fit.units.scan(scan.where("train")), pad_fit.inner(options)
        # A belief that would not fit in memory is refused before hours of work.
        particles = getattr(options, "particles", None)
        if self.grid is not None:
            count = len(scan.where("train").letters)
            what = f"{count} letters with {self.grid.bins:,} bins each"
            memory.require(count * self.grid.bins * _OF_A_BIN, what, "choose fewer bins")
        elif particles is not None:
            memory.require(particles * _OF_A_PARTICLE, f"{particles:,} particles", "choose fewer particles")
        maps = learn_maps_by(options, scan)
        open_set = None
        if isinstance(options, OpenSetOptions) and options.unknown:
            from tactsim.estimators.filters.open_set import OpenSet

            open_set = OpenSet(options, scan, maps)
        self.frames, self.pad_fit, self.open_set, self._object_of = frames, pad_fit, open_set, object_of
        self.fit_with(options, maps, scan)

    def fits_pad(self, scan: Scan) -> bool:
        """Tell whether units and options are fitted to a scan's pad."""
        return wants_pad_fit(self.options, scan)

    def without(self, letter: str, scan: Scan) -> Estimator:
        """Give a filter of the other letters, with the maps that are known and a measurement model of their own.

        What is fitted to the pad is fitted anew, for it saw the letter.
        """
        other = copy.copy(self)
        rest = scan.untrained([letter])
        if self.pad_fit is not None:
            MapFilter.fit(other, rest)
            return other
        maps = {label: chart for label, chart in self._maps.items() if self._object_of[label] != letter}
        other.fit_with(self.fitted_options, maps, self.frames.scan(rest).by_view()[0])
        if self.open_set is not None:
            other.open_set = copy.copy(self.open_set)
            other.open_set.reset()
        return other

    def fit_with(self, options: FilterOptions, maps: Mapping[str, OccupancyMap], scan: Scan) -> None:
        """Learn the measurement model from the training readings, given the maps of all letters in the scan.

        options, maps, scan: in the units and the frame that the filter works in.
        """
        self._started = False
        self._set_options(options)
        self._maps = maps
        self.labels = tuple(maps)
        objects = [self._object_of.get(label, label) for label in maps]
        of_view = np.array([np.count_nonzero(scan.where("train").labels == label) for label in maps])
        self.same_object = np.array(objects)[:, None] == np.array(objects)
        self._view_share = of_view / (self.same_object @ of_view)
        self.taxel_xy = scan.taxel_xy
        self._reach_near = reach_of(self.fitted_options.reach, scan.taxel_xy)
        self._reach_far = max(self._reach_near, reach_on_object(scan))
        if self.mixes_loads:
            self.likelihood = likelihood.create(options, scan.where("train"))
        self.likelihood.fit(scan, maps)
        self._planner: Planner | None = None
        # Proposals need a calibrated model; readings are kept to learn one if the filter's own is another.
        calibrated = self.fitted_options.likelihood == "calibrated" and self.likelihood.loads == 1
        self._train = None if calibrated else scan.where("train")
        self._lay_out(self._reach_near)

    def _lay_out(self, reach: float) -> None:
        """Build what every sequence needs, for x and y of T_R^O in [-reach, reach] mm."""
        self.reach = reach
        cell = self.fitted_options.cell
        # States that share a node's place lie so far apart in x and y (mm): bins, or a map cell for any states.
        spacing = (cell, cell) if self.grid is None else self.grid.spacing[:2]
        self.field = field_of(self.likelihood, self.labels, self.taxel_xy, spacing, cell)
        self._fit()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every state of every letter is equally probable again."""
        check_order(bool(self._maps), "fit", "reset")
        self._begins_with: np.random.Generator | None = copy.deepcopy(rng)
        self._begin(rng)
        self._started = True

    def _begin(self, rng: np.random.Generator) -> None:
        """Begin a sequence, for states within `reach`."""
        self.field.reset()
        self._reset(rng)
        if self.moving is not None or self._watched:
            self._stirring, self._kept = rng.spawn(1)[0], list[Callable[[], WeightedStates]]()
            self._next_look, self._none = 0.0, False
        if self._watched:
            self.moving = None
        elif self.moving is not None:
            self.moving.reset(self._stirring)
        if self.open_set is not None:
            self.open_set.reset()
        # Proposals have a random stream of their own. So the filter draws the same numbers whether proposals
        # are asked for or not, and proposals do not depend on how many numbers the filter draws.
        self._planning = rng.spawn(1)[0]

    def _bring_poses(self, poses: FloatArray) -> FloatArray:
        """Bring sensor_in_robot (..., 3), mm, into the filter's frame, which the first pose of a sequence decides.

        With it the sequence begins anew where states within another reach are asked for than the sequence before.
        """
        if self._begins_with is not None:
            rng, self._begins_with = self._begins_with, None
            self.frames = self.frames.begun(poses.reshape(-1, 3)[0])
            reach = self._reach_near if self.frames.first_touch is None else self._reach_far
            if reach != self.reach:
                self._lay_out(reach)
                self._begin(rng)
        return self.frames.poses(poses)

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,), in the scan's unit, at the pose sensor_in_robot [mm, mm, rad].

        Raises InputError, and leaves the belief as it was, for a wrong length or a NaN.
        """
        self._check_started("update")
        values, pose = check_reading(reading, sensor_in_robot, len(self.taxel_xy))
        pose = self._bring_poses(pose)
        if self.pad_fit is not None:
            units = self.pad_fit.units
            values, pose = check_reading(units.readings(values), units.poses(pose), len(self.taxel_xy))
        self.field.append(values, pose)
        if self.moving is not None:
            self.moving.update()  # it has the filter measure, too, where the object may lie still
        else:
            self.measure()
        if self._watched:
            self._watch()
        if self.open_set is not None:
            self.open_set.keep(values, pose)

    def _watch(self) -> None:
        """Notice whether the object moves, or lies still again."""
        if self._next_look == math.inf:
            return
        self._kept.append(self._keep())
        if self.moving is not None and self.moving.probability < _AT_REST:
            self.moving, self._none, self._next_look = None, True, _AGAIN * self.touches
        elif self.touches >= self._next_look and (self.moving is not None or self._stirred()):
            self._look()

    def _look(self) -> None:
        """Follow the object, or let it lie, by whether a motion explains the readings.

        To follow it is to take all touches in again by a belief that moves, as if it had been there from the first on,
        beside what the filter held at each, of the letters that are likely at rest. The next look is after half as many
        touches again; there is none if a motion explains next to nothing of what it did not before either, or if the
        filter cannot tell: then the object is followed on.
        """
        first, self._next_look = not self._next_look, _AGAIN * self.touches
        moving = self.moving or self._moving_belief()
        assert moving is not None
        if self.moving is None:
            said = self.own_estimate().probabilities
            likely = np.array([said[label] > _UNLIKELY for label in self.labels])
            self.moving = moving
            moving.reset(self._stirring, likely)
            moving.take_in(self._kept, self.log_p_in)
        left, still = self.left_along(moving), moving.probability < _AT_REST
        if left > _LEFT or still:
            self.moving = None
        self._none = left > _MUCH_LEFT or still
        if (left > _MUCH_LEFT and not first) or self.shares_of_walks() is None:
            self._next_look = math.inf
            self._kept.clear()

    def _stirred(self) -> bool:
        """Tell whether the readings disagree with an object at rest; of a filter that cannot tell they always do."""
        shares = self.shares_of_walks()
        return shares is None or (self.touches >= _FEWEST and shares[0] < _STIRRED)

    def shares_of_walks(self) -> FloatArray | None:
        """Weigh rest and the walks of `motion` by how much readings disagree; None of a filter that cannot tell.

        Too few readings say nothing: then there is but the share of rest, 1.
        """
        return None

    def left_along(self, moving: MovingBelief) -> float:
        """Tell what share of what is unexplained at rest is so by a motion, too; 0 of a filter that cannot tell."""
        return 0.0

    def estimate(self) -> Estimate:
        """Give the letter's probabilities, and the pose T_R^O of the most probable letter, mm and rad."""
        self._check_started("estimate")
        if self.moving is not None and not self._watched:
            known = self.moving.estimate()
        else:
            own = self._perhaps_moved(self.own_estimate())
            known = own if self.moving is None else self.moving.estimate(own)
        against = 0.0
        if self.open_set is not None:
            against = self.open_set.log_odds(known, self.path(known), self.weighted_states)
        if self.pad_fit is not None:
            known = known.moved(self.pad_fit.units.poses_back)
        if len(set(self._object_of.values())) < len(self._object_of):  # an object's views are summed
            summed: dict[str, float] = {}
            for label, p in known.probabilities.items():
                name = self._object_of.get(label, label)
                summed[name] = summed.get(name, 0.0) + p
            label = self._object_of.get(known.label, known.label)
            known = replace(known, label=label, probabilities=summed)
        if self.open_set is not None:
            known = self.open_set.estimate(known, against)
        return self.frames.estimate_back(known)

    def _perhaps_moved(self, known: Estimate) -> Estimate:
        """Let the samples of an object at rest tell where it is if it moved, too slowly as yet to be seen.

        Not from when a motion was looked for and is none until the next look.
        """
        if not self._watched or (self._none and self.touches < self._next_look):
            return known
        shares = self.shares_of_walks()
        if shares is None or len(shares) == 1 or known.samples is None:
            return known
        assert self.motion is not None
        return replace(known, samples=self.motion.walked(known.samples, shares, self.touches))

    def likeliest(self, mass: FloatArray) -> tuple[int, FloatArray]:
        """Find the likeliest map of the likeliest object, and what each map holds given its prior.

        mass: (maps,) what each would hold if all were as likely before.
        """
        mass = mass * self._view_share
        return likeliest_view(mass, self.same_object), mass

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the sensor_in_robot pose (n, 3) whose reading should say most about the state.

        Raises InputError for candidates that are no poses.
        """
        self._check_started("propose")
        poses = self._bring_poses(check_candidates(candidates))
        if self.pad_fit is not None:
            poses = self.pad_fit.units.poses(poses)
        from tactsim.estimators.filters.active_touch import STATES, Planner

        if self._planner is None:
            self._planner = Planner(self._calibrated(), self.taxel_xy)
        letter, state = self.weighted_states().draw(STATES, self._planning)
        return self._planner.choose(poses, letter, state, self._planning)

    def weighted_states(self) -> WeightedStates:
        """Give the belief as weighted states of all letters; those that are negligible may be left out."""
        return self.own_states() if self.moving is None else self.moving.weighted_states()

    def path(self, estimate: Estimate) -> FloatArray:
        """Give robot_in_object at each touch so far (n, 3), for the letter and the last pose of an estimate."""
        if self.moving is not None:
            return self.moving.path(estimate)
        return np.tile(estimate.robot_in_object, (len(self.field), 1))

    def belief_over_plane(self) -> PlaneBelief:
        """Show how the belief lies over the plane, mm, for a person to look at."""
        plane = self._own_plane()
        if self.moving is not None:  # in the same cells, as a sequence may be followed from some touch on
            plane = plane_histogram(self.labels, self.weighted_states(), plane.x, plane.y)
        if self.pad_fit is not None:
            plane = self.pad_fit.units.plane_back(plane)
        return self.frames.plane_back(plane)

    @property
    def maps(self) -> Mapping[str, OccupancyMap]:
        """Give the maps that were learned, in mm."""
        if not self._maps:
            return self._maps
        maps = self._maps if self.pad_fit is None else self.pad_fit.units.maps_back(self._maps)
        return self.frames.maps_back(maps, self._object_of)

    def describe(self) -> str:
        """Say in one line how the filter is set up, whether the object may move, and what is fitted to the pad."""
        parts = [self._own_setup()]
        if self.motion is not None:
            parts.append(f"motion {self.fitted_options.motion}")
        if self.pad_fit is not None:
            parts.append(self.pad_fit.describe())
        return "; ".join(parts)

    @property
    def work(self) -> dict[str, Any]:
        """Count what was done since the filter was made: what its own belief took, and the one that moves beside it."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {}, **self._ignored()}

    def _ignored(self) -> dict[str, int]:
        """Count the readings that a measurement model said are impossible everywhere, if it is one that may."""
        return {} if isinstance(self.likelihood, TaxelSum) else {"ignored_readings": self.field.ignored}

    # What a belief that moves beside the filter's own asks of it (`moving.MovingBelief`), as of `Synthesis` too.

    @abstractmethod
    def measure(self) -> None:
        """Update the filter's own belief with the last reading of `field`."""

    @abstractmethod
    def own_estimate(self) -> Estimate:
        """Make the estimate of the filter's own belief."""

    @abstractmethod
    def own_states(self) -> WeightedStates:
        """Give the filter's own belief as weighted states."""

    def _keep(self) -> Callable[[], WeightedStates]:
        """Give what the filter's own belief is now, to be asked for later."""
        held = self.own_states()
        return lambda: held

    @property
    def touches(self) -> int:
        """Count the readings so far."""
        return len(self.field)

    @property
    def located(self) -> bool:
        """Tell whether the belief can be followed from here on; that of a filter on maps always can."""
        return True

    def log_p(self, letter: int, state: FloatArray, touch: int) -> FloatArray:
        """Weigh states T_R^O (3, n) of a letter by one reading: (n,) nats. It counts as one of few readings."""
        self._evaluated += state.shape[1]
        log_p = np.maximum(self.field.log_p(letter, state, touch, touch + 1), IMPOSSIBLE)
        if self.trust is None:
            return log_p
        from tactsim.estimators.filters.trust import FEW

        return np.asarray(self.trust(FEW) * log_p, dtype=float)

    def foretold(self, belief: WeightedStates) -> float:
        """Update the filter's own belief; returns the log-likelihood of the last reading in its `belief` before."""
        self.measure()
        return self.log_p_in(belief, self.touches - 1)

    def log_p_in(self, belief: WeightedStates, touch: int) -> float:
        """Weigh a belief by one reading: its log-likelihood, nats."""
        with np.errstate(divide="ignore"):
            log_p = np.log(belief.weights.normalised)
        for letter in np.unique(belief.letter).tolist():
            chosen = np.flatnonzero(belief.letter == letter)
            log_p[chosen] += self.log_p(letter, belief.state.take(chosen, axis=1), touch)
        return float(np.logaddexp.reduce(log_p))

    # What else a subclass may say of itself.

    @abstractmethod
    def _fit(self) -> None:
        """Build from `labels` and `field` what every sequence needs."""

    @abstractmethod
    def _reset(self, rng: np.random.Generator) -> None:
        """Begin a new sequence; `field` has no reading."""

    def _own_plane(self) -> PlaneBelief:
        """Show how the filter's own belief lies over the plane, in cells of about 1 mm."""
        x = plane_cells(self.reach)
        return plane_histogram(self.labels, self.own_states(), x, x)

    def _own_setup(self) -> str:
        """Say in one line how the filter itself is set up."""
        return ", ".join(f"{name} {value}" for name, value in self.fitted_options if value is not None)

    def _calibrated(self) -> CalibratedLikelihood:
        """Give the calibrated model that the filter has learned, or learn it and let go of the readings."""
        from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood

        if isinstance(self.likelihood, CalibratedLikelihood):
            return self.likelihood
        assert self._train is not None
        model = CalibratedLikelihood(self.fitted_options)
        model.fit(self._train, self._maps)
        self._train = None
        return model

    def _check_started(self, call: str) -> None:
        check_order(self._started, "reset" if self._maps else "fit", call)


class GridFilter(MapFilter):
    """A filter on maps over the bins of `grid`, which options say by `bins`, or by `split`."""

    budget: str | None = "bins"
    draws = False
    grid: StateGrid

    def __init__(self, options: FilterOptions, bins: int, split: str | None) -> None:
        super().__init__(options)
        self.grid = self._as_asked = state_grid(bins, split, reach_of(options.reach))
        self._grows = split is None
        if split is not None:
            self.budget = "split"

    def _own_setup(self) -> str:
        """Say how the state space is split, in one line."""
        return self.grid.describe()

    def _lay_out(self, reach: float) -> None:
        """Let the bins reach as far, then build what every sequence needs."""
        if self._grows:
            self.grid = self._as_asked.reaching(reach, self._reach_near, _MOST_BINS // len(self.labels))
        else:
            self.grid = replace(self.grid, reach=reach)
        super()._lay_out(reach)
