"""Each check notices an estimator that breaks what it is about, and a sound one passes them all."""

import numpy as np
import pytest
from pydantic import Field

from tactsim.core import InputError, compose, invert
from tactsim.estimators import Estimate, Estimator, Options, check_order, check_reading
from tactsim.estimators.contract import CHECKS, Case
from tactsim.estimators.contract import checks as contract


class SoundOptions(Options):
    width: float = Field(6.0, gt=0, description="kernel width of a taxel, kPa")


class Sound(Estimator):
    """Which training readings are alike, in the fewest lines that keep the contract."""

    options_type = SoundOptions
    draws = False
    train = log_p = None
    compared = 0

    def fit(self, scan):
        self.train, self.log_p = scan.where("train"), None
        check_order(len(self.train) > 0, "a train reading", "fit")

    def reset(self, rng):
        check_order(self.train is not None, "fit", "reset")
        self.log_p, self.place = np.zeros(len(self.train.letters)), np.zeros(3)

    def update(self, reading, sensor_in_robot):
        check_order(self.log_p is not None, "reset" if self.train else "fit", "update")
        values, pose = check_reading(reading, sensor_in_robot, len(self.train.taxel_xy))
        self.take(values, pose)

    def take(self, values, pose):
        log_p = -((self.train.readings - values) ** 2).sum(axis=1) / (2 * self.options.width**2)
        self.compared += len(log_p)
        for k, label in enumerate(self.train.letters):
            self.log_p[k] += np.logaddexp.reduce(log_p[self.train.labels == label])
        self.place = compose(self.train.poses[log_p.argmax()], invert(pose))

    def estimate(self):
        check_order(self.log_p is not None, "reset" if self.train else "fit", "estimate")
        p = np.exp(self.log_p - np.logaddexp.reduce(self.log_p))
        letters = dict(zip(self.train.letters, p.tolist(), strict=True))
        return Estimate(max(letters, key=letters.get), letters, self.place)

    @property
    def work(self):
        return {"likelihood_evaluations": self.compared, "skipped": {}}


class FitsNothing(Sound):
    def fit(self, scan):
        self.train, self.log_p = scan.where("train"), None


class UpdatesBeforeReset(Sound):
    def update(self, reading, sensor_in_robot):
        if self.log_p is not None:
            super().update(reading, sensor_in_robot)


class UndescribedOptions(Options):
    width: float = 6.0


class Undescribed(Sound):
    options_type = UndescribedOptions


class Unnormalised(Sound):
    def estimate(self):
        one = super().estimate()
        return Estimate(one.label, {k: p / 2 for k, p in one.probabilities.items()}, one.robot_in_object)


class ChecksTooLate(Sound):
    def update(self, reading, sensor_in_robot):
        if self.log_p is not None:
            self.log_p[0] += 1e-3
        super().update(reading, sensor_in_robot)
        self.log_p[0] -= 1e-3 * 0.5


class Secretive(Sound):
    """Draws from a generator of its own."""

    own = np.random.default_rng(0)

    def take(self, values, pose):
        super().take(values + self.own.normal(size=values.shape), pose)


class Draws(Sound):
    """Says that it draws nothing, and draws."""

    def reset(self, rng):
        super().reset(rng)
        self.log_p = self.log_p + rng.normal(size=len(self.log_p))


class Remembers(Sound):
    def reset(self, rng):
        before = self.log_p
        super().reset(rng)
        if before is not None and len(before) == len(self.log_p):
            self.log_p = 1e-3 * before


class Watched(Sound):
    def estimate(self):
        if self.log_p is not None:
            self.log_p[0] += 1e-3
        return super().estimate()


class Writes(Sound):
    def update(self, reading, sensor_in_robot):
        super().update(reading, sensor_in_robot)
        if isinstance(reading, np.ndarray):
            reading *= 1.0


class Typed(Sound):
    def update(self, reading, sensor_in_robot):
        super().update(reading, sensor_in_robot)
        self.log_p[0] += 1e-3 * isinstance(reading, list)


class Underflows(Sound):
    """Multiplies probabilities that become 0 where nothing is alike."""

    def estimate(self):
        one, p = super().estimate(), np.exp(self.log_p)
        letters = dict(zip(one.probabilities, (p / max(p.sum(), 1e-300)).tolist(), strict=True))
        return Estimate(one.label, letters, one.robot_in_object)


class Reaches(Sound):
    """Gives up where no object can be."""

    lost = False

    def reset(self, rng):
        super().reset(rng)
        self.lost = False

    def take(self, values, pose):
        super().take(values, pose)
        self.lost = self.lost or abs(pose[0]) > 1e4

    def estimate(self):
        one = super().estimate()
        if self.lost:
            return Estimate(one.label, dict.fromkeys(one.probabilities, 0.0), one.robot_in_object)
        return one


class CountsNothing(Sound):
    @property
    def work(self):
        return {"likelihood_evaluations": 0, "skipped": {}}


class ProposesAnything(Sound):
    def propose(self, candidates):
        return len(candidates)


class ForgetsTogether(Sound):
    """Answers many trials at once, each reading as if it were the first."""

    draws = False

    def estimates(self, readings, sensor_in_robot):
        def alone(reading, pose):
            self.reset(np.random.default_rng(0))
            self.update(reading, pose)
            return self.estimate()

        trials = zip(readings, sensor_in_robot, strict=True)
        return [[alone(*touch) for touch in zip(*trial, strict=True)] for trial in trials]


class Peeks(Sound):
    def fit(self, scan):
        super().fit(scan)
        self.train = scan if len(scan.where("test")) else self.train


class Adds(Sound):
    """Keeps what an earlier fit learned."""

    seen = ()

    def fit(self, scan):
        super().fit(scan)
        self.seen = tuple(dict.fromkeys((*self.seen, *self.train.letters)))

    def estimate(self):
        one = super().estimate()
        return Estimate(
            one.label, dict.fromkeys(self.seen, 0.0) | dict(one.probabilities), one.robot_in_object
        )


class Doubts(Sound):
    """Never says what it learned when that is one letter."""

    def estimate(self):
        one = super().estimate()
        return Estimate("none", {**one.probabilities, "none": 0.0}, one.robot_in_object)


class Guesses(Sound):
    def take(self, values, pose):
        self.compared += 1


class LeavesNothingOut(Sound):
    def without(self, letter, scan):
        return self


class Prefers(Sound):
    """Thinks the first letter a little more probable than the others."""

    def reset(self, rng):
        super().reset(rng)
        self.log_p[0] += 1e-6


BROKEN = [
    (FitsNothing, contract.a_scan_without_training_readings_is_refused),
    (UpdatesBeforeReset, contract.calls_out_of_order_are_refused),
    (Undescribed, contract.options_are_described),
    (Unnormalised, contract.estimates_are_probabilities_and_poses),
    (ChecksTooLate, contract.a_bad_reading_is_refused_and_leaves_no_trace),
    (Secretive, contract.the_same_seed_gives_the_same_answer),
    (Draws, contract.an_estimator_that_says_it_draws_nothing_draws_nothing),
    (Remembers, contract.reset_forgets_the_sequence_and_keeps_the_maps),
    (Watched, contract.looking_changes_nothing),
    (Writes, contract.inputs_are_not_written_to),
    (Typed, contract.readings_may_come_as_lists_and_as_whole_numbers),
    (Underflows, contract.readings_without_contrast_are_taken),
    (Reaches, contract.a_pose_far_away_is_taken),
    (CountsNothing, contract.work_is_counted),
    (ProposesAnything, contract.a_proposal_is_a_candidate),
    (ForgetsTogether, contract.many_trials_at_once_are_as_one_by_one),
    (Peeks, contract.readings_to_test_with_teach_nothing),
    (Adds, contract.any_pad_will_do_and_a_new_fit_replaces_the_old),
    (Doubts, contract.a_single_object_can_be_localised),
    (Guesses, contract.objects_are_recognised),
    (LeavesNothingOut, contract.a_letter_can_be_left_out_of_what_was_learned),
    (Prefers, contract.letters_that_are_one_share_its_probability),
]


def case_of(kind):
    return Case(lambda: kind(kind.options_type()))


@pytest.mark.parametrize("check", CHECKS)
def test_a_sound_estimator_passes(check):
    check(case_of(Sound))


@pytest.mark.parametrize(("kind", "check"), BROKEN)
def test_a_broken_estimator_is_noticed(kind, check):
    with pytest.raises((AssertionError, InputError, ValueError)) as noticed:
        check(case_of(kind))
    assert str(noticed.value), "it should say what it saw"


def test_every_check_has_an_estimator_that_breaks_it():
    assert {check for _, check in BROKEN} == set(CHECKS)
