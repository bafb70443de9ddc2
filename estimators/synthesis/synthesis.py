"""Analysis by synthesis: the estimator `synthesis` presses the known letters itself, and compares."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tactsim.core import Scan, compose
from tactsim.core.forward import Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    PlaneBelief,
    PoseSamples,
    check_order,
    check_reading,
    probabilities,
)
from tactsim.estimators.filters.motion import parse_motion
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.states import WeightedStates, Weights, plane_cells, plane_histogram
from tactsim.estimators.frames import Frames, reach_on_object
from tactsim.estimators.options import REACH, Reach, reach_of
from tactsim.estimators.synthesis.learned_pad import LearnedPad
from tactsim.estimators.synthesis.modes import GYRATION, Modes, expand, pressed
from tactsim.estimators.synthesis.pose_bank import PoseBank

if TYPE_CHECKING:
    from tactsim.estimators.filters.moving import MovingBelief

_SCOUTS = 1500  # states a letter that wait for the first reading which says where
# Squared pressures over the noise's variance. From the first on a reading says where it was taken; a fainter one
# does, as well as it can, when few scouts are left. For a taxel the latter; noise alone has 1.
_CONTACT, _FAINT = 1000.0, 3.0
_NEGLIGIBLE = 30.0  # nats below the heaviest mode at which one is given up
_APART = 0.7  # standard deviations; modes that are nearer to each other are one
_LOST = 1e-6  # probability that the true mode was given up
_OUTLIER = 1e-3  # probability of a reading that no mode explains
_SAMPLES, _STATES = 256, 4096  # drawn from the modes for an estimate, and to stand for the belief
_ROUNDS = 4  # of Gauss and Newton after a reading, at most
_CANDIDATES = 10  # places of the bank that are looked at closely for each mode that is begun
_CELL = 0.6  # standard deviation of a cell's prior over its size; a sum of such Gaussians is nearly even
# Times the noise: what a bank's linear predictions are off by, within a cell and for presses that err. With less, the
# true place may be given up before it is pressed.
_ROUGH = 3.0
_ROUGH_LEAST = 0.2  # of a typical pressure, however little noise there is
_FEW = 200  # modes; more are not compared with each other
# The search begins anew, so often at most, where readings are less probable than training presses at their known poses:
# that much less, in standard deviations of all of them together. A search that was not needed costs time alone.
_RESTARTS, _SURPRISE = 4, 1.0
# A reading is expanded again where its mode has moved by this share of its standard deviation, within limits in mm.
_STALE, _STALE_MM = 0.25, (0.02, 0.25)


class SynthesisOptions(Options):
    """Options of analysis by synthesis."""

    modes: int = Field(500, ge=1, le=100_000, description="how many places of the first contact are followed")
    spacing: float = Field(1.5, ge=0.2, le=10, description="mm between the poses pressed beforehand")
    angles: int = Field(12, ge=2, le=360, description="angles to half a turn pressed beforehand")
    motion: str = Field(
        "off",
        description="how the object moves between touches: off, auto (learned) or MM,RAD of a random walk",
    )
    reach: Reach = Field("auto", description=REACH)


class Synthesis(Estimator):
    """Follow the modes of the belief with predictions of a forward model, by Gauss and Newton's method.

    What the model is not told of the pad is learned from the training presses (`LearnedPad`), and how hard each touch
    is, is no matter.

    The first reading with contact is compared with a bank of readings that were pressed beforehand, and the `modes`
    best places begin as Gaussians of a grid cell's size. Every reading is expanded about each mode's mean, what a
    press is off by marginalised, and expanded again where the mean moves.

    moving: a belief that moves, beside the modes of an object that lies still, from the reading on that says where the
    object is; None unless the options say that it may move. Its states are weighed with presses at each of them, so
    that the forward model need not be linear as far as the object may have moved.

    frames: where the origins of the estimator's frames lie in those of its user, for the present sequence.
    """

    options_type: type[Options] = SynthesisOptions
    budget = "modes"
    draws = False
    uses_forward_model = True
    options: SynthesisOptions
    frames: Frames

    def __init__(self, options: SynthesisOptions) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self._started = False
        self._compared = 0
        self.moving: MovingBelief | None = None
        motion = parse_motion(options.motion)
        if motion is not None:
            from tactsim.estimators.filters.moving import MovingBelief

            self.moving, self.draws = MovingBelief(self, motion), True

    def fit(self, scan: Scan) -> None:
        """Press the bank of the letters that the training readings name."""
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self._started = False
        self.labels = train.letters
        self.same_object = np.eye(len(self.labels), dtype=bool)  # it knows no views
        rng = np.random.default_rng(0)
        reach = self._reach = self._reach_near = reach_of(self.options.reach, scan.taxel_xy)
        self.frames = Frames.fitted(scan, reach)
        seen = self.frames.scan(scan)
        self.pad = pad = LearnedPad.learned(self.forward, seen.where("train"))
        self.noise = pad.noise
        self.banks = [
            PoseBank.pressed(pad, label, self.options.spacing, self.options.angles) for label in self.labels
        ]
        self._typical = float(
            np.sqrt(np.mean([(bank.mean[bank.mean.any(axis=1)] ** 2).mean() for bank in self.banks]))
        )
        self._reach_far = max(reach, reach_on_object(seen))
        self._near_scouts = rng.uniform([-reach, -reach, -math.pi], [reach, reach, math.pi], (_SCOUTS, 3))
        self._normal = rng.standard_normal((_STATES, 3))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        check_order(bool(self.labels), "fit", "reset")
        self._started = True
        self._readings: list[FloatArray] = []
        self._poses: list[FloatArray] = []
        self._floor = np.empty(0)
        self._reach, self._scout_states = self._reach_near, self._near_scouts
        self._scouts = np.zeros((len(self.labels), _SCOUTS))
        self._modes: Modes | None = None
        self._restarts = 0
        if self.moving is not None:
            self.moving.reset(rng.spawn(1)[0])

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad]."""
        self.take(reading, sensor_in_robot)
        if self.moving is not None:
            self.moving.update()  # it has the modes measure, too, where the object may lie still
        else:
            self.measure()

    def take(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Add a reading and leave the belief alone. Raises InputError as `update`."""
        check_order(self._started, "reset" if self.labels else "fit", "update")
        values, pose = check_reading(reading, sensor_in_robot, self.forward.taxels)
        values = self.pad.response.pressures(values)
        if not self._poses:
            self.frames = self.frames.begun(pose)
            if self.frames.first_touch is not None:
                wider = self._reach_far / self._reach_near
                self._reach, self._scout_states = self._reach_far, self._near_scouts * [wider, wider, 1.0]
        self._readings.append(values)
        self._poses.append(self.frames.poses(pose))
        broad = max(float((values**2).mean()), self._typical**2) + self.noise**2
        self._floor = np.append(
            self._floor, math.log(_OUTLIER) - len(values) / 2 * (math.log(2 * math.pi * broad) + 1)
        )

    def measure(self) -> None:
        """Update the modes with the last reading, as of an object that lies still."""
        values, pose = self._readings[-1], self._poses[-1]
        energy = (np.array(self._readings) ** 2).sum(axis=1) / self.noise**2
        number = len(energy) - 1
        if self._modes is None:
            self._scout(values, pose)
            strongest = int(energy.argmax())
            if energy[strongest] > _CONTACT or (
                energy[strongest] > _FAINT * len(values) and Weights(self._scouts.ravel()).ess < _SCOUTS / 4
            ):
                begun = self._begun(strongest)
                self._modes = None if begun is None else self._settled(begun)
            return
        modes = self._settled(self._taken_in(self._modes, number))
        log_p = modes.log_p_of_readings()[int(modes.log_weight.argmax())]
        usual, spread = self.pad.usual
        less = usual - float(np.maximum(log_p, self._floor[modes.number]).mean())
        unexplained = log_p[-1] < self._floor[number] or less * math.sqrt(len(log_p)) > _SURPRISE * spread
        if unexplained and energy[number] > _CONTACT and self._restarts < _RESTARTS:
            self._restarts += 1
            begun = self._begun(number)
            if begun is not None:
                modes = self._settled(modes.joined(begun))
        self._modes = modes

    def _scout(self, reading: FloatArray, pose: FloatArray) -> None:
        """Weigh states all over the prior, for as long as no reading says where the letter is."""
        poses = compose(self._scout_states, pose)
        for log_p, bank in zip(self._scouts, self.banks, strict=True):
            log_p += bank.log_p_at(reading, poses)
        self._compared += self._scouts.size

    def _begun(self, first: int) -> Modes | None:
        """Begin with the best places of reading `first`, and take in all others so far.

        None if no state within `reach` lets the pad touch at all.
        """
        places = [bank.places(self._readings[first], self._poses[first], self._reach) for bank in self.banks]
        letter = np.repeat(np.arange(len(places)), [len(one.score) for one in places])
        entry, turned, state, score, factor = (np.concatenate(column) for column in zip(*places, strict=True))
        if not len(score):
            return None
        copies = np.log([bank.copies for bank in self.banks])[letter]
        best = _highest(score + copies, _CANDIDATES * self.options.modes)
        letter, entry, turned = letter[best], entry[best], turned[best]
        state, factor = state[best], factor[best]

        def from_bank(one: int, which: NDArray[np.intp]) -> Linearised:
            return self.banks[one].predicted(entry[which], turned[which], factor[which])

        modes = Modes.begun(letter, state, np.diag((_CELL * self.banks[0].spacing) ** 2), copies[best])
        readings, which = np.array(self._readings), np.full(len(letter), first)
        poses = np.array(self._poses)[which]
        expanded = expand(
            letter,
            state,
            poses,
            readings,
            which,
            from_bank,
            max(_ROUGH * self.noise, _ROUGH_LEAST * self._typical),
            self.pad.failing,
        )
        self._compared += len(letter)
        modes = modes.with_reading(first, state, *expanded)
        modes = self._refreshed(modes.posterior(self._floor).heaviest(self.options.modes, math.inf))
        for number in range(len(self._readings)):
            if number != first:
                modes = self._heaviest(self._taken_in(modes, number))
        return modes

    def _taken_in(self, modes: Modes, number: int) -> Modes:
        """Take in a reading, expanded at the modes' means."""
        expanded = self._expanded(modes.letter, modes.mean, np.full(len(modes), number))
        return modes.with_reading(number, modes.mean, *expanded).posterior(self._floor)

    def _heaviest(self, modes: Modes) -> Modes:
        return modes.heaviest(self.options.modes, _NEGLIGIBLE)

    def _settled(self, modes: Modes) -> Modes:
        """Merge, give up, and expand again until no mode moves."""
        for _ in range(_ROUNDS):
            modes = self._heaviest(modes)
            if len(modes) <= _FEW:
                modes = modes.together(_APART)
            refreshed = self._refreshed(modes)
            if refreshed is modes:
                break
            modes = refreshed
        return modes

    def _refreshed(self, modes: Modes) -> Modes:
        """Expand readings again that were expanded too far from where their mode is now."""
        variance = np.einsum("nii,i->n", modes.cov, [1.0, 1.0, GYRATION**2])
        allowed = np.clip(_STALE * np.sqrt(variance), *_STALE_MM)
        mode, column = np.nonzero(modes.moved() > allowed[:, None])
        if not len(mode):
            return modes
        found = self._expanded(modes.letter[mode], modes.mean[mode], modes.number[column])
        return modes.expanded_again(mode, column, *found).posterior(self._floor)

    def _expanded(
        self, letter: NDArray[np.int64], state: FloatArray, number: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Expand readings `number` (n,) at states (n, 3) with presses there, as `expand`."""
        readings, poses = np.array(self._readings), np.array(self._poses)[number]
        presses = pressed(self.pad, self.labels, compose(state, poses), readings, number)
        self._compared += len(letter)
        return expand(letter, state, poses, readings, number, presses, self.noise, self.pad.failing)

    def estimate(self) -> Estimate:
        """Say which letter it is and where, after the readings so far."""
        check_order(self._started, "reset" if self.labels else "fit", "estimate")
        known = self.own_estimate() if self.moving is None else self.moving.estimate()
        return self.frames.estimate_back(known)

    def own_estimate(self) -> Estimate:
        """Make the estimate of the modes, of an object that lies still."""
        count = len(self.labels)
        if self._modes is None:
            mass = np.exp(self._scouts - self._scouts.max()).sum(axis=1)
            best = int(mass.argmax())
            weights = Weights(self._scouts[best])
            state = self._scout_states[int(self._scouts[best].argmax())]
            samples = PoseSamples(self._scout_states.copy(), weights.normalised)
        else:
            modes = self._modes
            relative = np.exp(modes.log_weight - modes.log_weight.max())
            mass = np.bincount(modes.letter, relative, count)
            best = int(mass.argmax())
            mine = modes.some(np.flatnonzero(modes.letter == best))
            weights = Weights(mine.log_weight)
            states = np.ascontiguousarray(mine.mean.T)
            state = mean_around(states, weights.relative, int(mine.log_weight.argmax()))
            samples = self._drawn(mine)
        p = (1 - _LOST) * mass / mass.sum() + _LOST / count
        return Estimate(self.labels[best], probabilities(self.labels, p), state, samples)

    def _drawn(self, modes: Modes) -> PoseSamples:
        """Draw poses from the modes, evenly, the same every time, as wide as presses at known poses ask for."""
        reached = np.cumsum(Weights(modes.log_weight / self.pad.too_sure).normalised)
        which = np.searchsorted(reached, (np.arange(_SAMPLES) + 0.5) / _SAMPLES).clip(max=len(modes) - 1)
        factor = np.linalg.cholesky(self.pad.too_sure * modes.cov)[which]
        poses = modes.mean[which] + np.einsum("nij,nj->ni", factor, self._normal[:_SAMPLES])
        return PoseSamples(poses, np.full(_SAMPLES, 1 / _SAMPLES))

    @property
    def located(self) -> bool:
        """Tell whether some reading said where the object is, so that there are modes to follow."""
        return self._modes is not None

    @property
    def touches(self) -> int:
        """Count the readings."""
        return len(self._readings)

    def log_p(self, letter: int, state: FloatArray, touch: int) -> FloatArray:
        """Weigh states T_R^O (3, n) of a letter by one reading, with presses there: (n,).

        A reading that is less likely than that counts as an outlier, which says nothing of the pose.
        """
        count = state.shape[1]
        which = np.full(count, letter), state.T, np.full(count, touch)
        return np.maximum(self._expanded(*which)[0], self._floor[touch])

    def foretold(self, belief: WeightedStates) -> float:
        """Update the modes; returns how much their evidence grew, which they know without presses for `belief`."""
        before = self._log_evidence()
        self.measure()
        return self._log_evidence() - before

    def _log_evidence(self) -> float:
        """Give log p(readings) of an object that lies still, up to what no reading changes, once it is located."""
        assert self._modes is not None
        return float(np.logaddexp.reduce(self._modes.log_weight))

    def own_states(self) -> WeightedStates:
        """Give the belief as states that are drawn from the modes, the same every time, equally many of each."""
        if self._modes is None:
            states = np.tile(self._scout_states.T, len(self.labels))
            letter = np.repeat(np.arange(len(self.labels)), _SCOUTS)
            return WeightedStates(letter, states, Weights(self._scouts.ravel()))
        modes = self._modes
        each = max(1, _STATES // len(modes))
        which = np.repeat(np.arange(len(modes)), each)
        normal = self._normal[np.arange(len(which)) % _STATES]
        states = modes.mean[which] + np.einsum("nij,nj->ni", np.linalg.cholesky(modes.cov)[which], normal)
        return WeightedStates(modes.letter[which], states.T, Weights(modes.log_weight[which]))

    def belief_over_plane(self) -> PlaneBelief | None:
        """Count the states of an object that may move in cells of about 1 mm; None for one that lies still."""
        if self.moving is None:
            return None
        x = plane_cells(self._reach)
        return self.frames.plane_back(plane_histogram(self.labels, self.moving.weighted_states(), x, x))

    @property
    def work(self) -> dict[str, Any]:
        """Count the readings that were compared with predictions: with the bank's and with presses, one a mode."""
        return {"likelihood_evaluations": self._compared, "skipped": {}}


def _highest(values: FloatArray, count: int) -> NDArray[np.intp]:
    """Choose the `count` highest of n values, and what is as high as the last of them."""
    if count >= len(values):
        return np.arange(len(values))
    return np.flatnonzero(values >= np.partition(values, -count)[-count])
