from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import tactsim
from tactsim.bench.config import Slip, run_config
from tactsim.bench.experiment import gather, silent
from tactsim.bench.intervals import wilson
from tactsim.bench.placement import Properties
from tactsim.bench.sent_trials import run_part
from tactsim.bench.trials import (
    NOT_TAKEN,
    OneTrial,
    TrialPlan,
    TrialRules,
    Trials,
    check_readings,
    draw_true_pose,
    generator,
    run_trial,
    run_trials,
)
from tactsim.core import InputError, Scan, compose
from tactsim.core.workers import worker_processes
from tactsim.estimators import NONE, Estimate, Estimator, Options

LETTERS = "AEIOU"
PLAIN = Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=60.0)


def make_scan(readings=20, letters=LETTERS):
    """Make a scan whose readings name their letter and pose: taxel 0 the letter, taxel 1 the index."""
    rng = np.random.default_rng(0)
    labels = np.repeat(list(letters), 2 * readings)
    split = np.tile(["train"] * readings + ["test"] * readings, len(letters))
    values = np.stack(
        [np.repeat(np.arange(len(letters)), 2 * readings), np.tile(np.arange(2 * readings), len(letters))],
        axis=1,
    )
    return Scan(values, rng.normal(size=(len(labels), 3)) * 5, labels, split, np.zeros((2, 2)))


class Blind(Estimator):
    """Guess at random, whatever is felt: scores 1 / letters unless the harness leaks the answer."""

    def fit(self, scan):
        self.letters = scan.letters

    def reset(self, rng):
        self.rng = rng

    def update(self, reading, sensor_in_robot):
        self.guess = self.letters[self.rng.integers(len(self.letters))]

    def estimate(self):
        even = dict.fromkeys(self.letters, 1 / len(self.letters))
        return Estimate(self.guess, even, self.rng.uniform(-10, 10, 3))


class Witness(Estimator):
    """Note all that is shown, and answer from it."""

    evaluated = 0

    def fit(self, scan):
        self.scan = scan

    def reset(self, rng):
        self.seen = []

    def update(self, reading, sensor_in_robot):
        self.seen.append((np.array(reading), np.array(sensor_in_robot)))
        self.evaluated += 7

    def estimate(self):
        reading, sensor_in_robot = self.seen[-1]
        label = LETTERS[int(reading[0])]
        index = int(reading[1])
        sensor_in_object = self.scan.where(label=label).poses[index]
        x, y, angle = sensor_in_robot
        inverse = [-np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x - np.cos(angle) * y, -angle]
        return Estimate(label, {label: 1.0}, compose(sensor_in_object, inverse))

    def propose(self, candidates):
        return len(candidates) - 1

    @property
    def work(self):
        return {"likelihood_evaluations": self.evaluated, "skipped": {"nothing": 1}}


def trials_of(estimator, scan, count, readings=20, seed=0):
    estimator.fit(scan)
    tasks = [OneTrial(letter, trial) for letter in scan.letters for trial in range(count)]
    plan = TrialPlan("none", {}, scan, TrialRules(readings, seed))
    return run_trials(plan, estimator, tasks, progress=silent)[0]


@pytest.mark.long
@pytest.mark.parametrize("hold_out", ["", "each"])
def test_what_a_worker_gives_is_what_is_done_here_to_the_bit(hold_out):
    """A run of few trials may be over before its workers have begun, so they are waited for."""
    run = tactsim.run(
        letters="AEI", estimator="particle", particles=500, hold_out=hold_out, trials=2, readings=4
    )
    with worker_processes(1) as workers:
        tasks = [OneTrial(letter, trial) for letter in "AEI" for trial in range(2)]
        trials, work, _ = workers.submit(run_part, run.plan, tasks).result(timeout=120)
    for field in fields(Trials):
        if not field.name.endswith("_s"):
            assert np.array_equal(getattr(trials, field.name), getattr(run.trials, field.name)), field.name
    assert work["likelihood_evaluations"] == run.work["likelihood_evaluations"]


def test_an_estimator_that_ignores_its_input_scores_one_in_the_number_of_letters():
    trials = trials_of(Blind(Options()), make_scan(), count=100)
    for k in (0, 9, 19):
        low, high = wilson(trials.right[:, k].sum(), len(trials.truth))
        assert low - 0.03 < 1 / len(LETTERS) < high + 0.03
    # over all readings the guesses are independent, so the share is far tighter
    assert trials.right.mean() == pytest.approx(1 / len(LETTERS), abs=4 * np.sqrt(0.16 / trials.right.size))


def test_the_frames_compose_so_that_an_estimator_that_knows_the_reading_finds_the_pose():
    trials = trials_of(Witness(Options()), make_scan(), count=3)
    assert trials.right.all()
    assert np.allclose(trials.pose[..., :2], trials.true_pose[..., :2], atol=1e-9)
    turn = trials.pose[..., 2] - trials.true_pose[..., 2]
    assert np.allclose(np.cos(turn), 1)


def test_readings_are_the_letters_own_test_readings_without_replacement():
    scan = make_scan()
    witness = Witness(Options())
    witness.fit(scan)
    test = scan.where("test", "I")
    run_trial(witness, test, OneTrial("I", 4), TrialRules(20, 3), letters=scan.letters, of=PLAIN)
    letters, indices = np.array([reading for reading, _ in witness.seen]).T
    assert set(letters) == {2}
    assert sorted(indices) == list(range(20, 40))
    assert list(indices) != sorted(indices)


def test_true_poses_cover_the_stated_range():
    poses = np.array([draw_true_pose(np.random.default_rng(seed)) for seed in range(400)])
    assert np.all(np.abs(poses[:, :2]) <= 10)
    assert np.abs(poses[:, :2]).max() > 9.5
    assert np.abs(poses[:, 2]).max() > 3.0
    assert np.abs(poses.mean(axis=0)).max() < 4 * 10 / np.sqrt(3 * 400)


def test_a_trial_depends_on_seed_letter_and_number_alone():
    draws = {
        key: generator(*key).random()
        for key in [(0, OneTrial("A", 0), 0), (0, OneTrial("A", 0), 1), (1, OneTrial("A", 0), 0),
                    (0, OneTrial("A", 1), 0), (0, OneTrial("E", 0), 0)]
    }  # fmt: skip
    assert len(set(draws.values())) == len(draws)
    scan = make_scan()
    whole = trials_of(Witness(Options()), scan, count=2)
    alone = trials_of(Witness(Options()), scan.of_letters("U"), count=2)
    chosen = whole.truth == "U"
    assert np.array_equal(whole.true_pose[chosen], alone.true_pose)
    assert np.array_equal(whole.touch_index[chosen], alone.touch_index)


def test_a_proposing_estimator_chooses_among_the_readings_that_are_left():
    scan = make_scan()
    witness = Witness(Options())
    witness.fit(scan)
    of_a, task = scan.where("test", "A"), OneTrial("A", 0)
    rules = TrialRules(5, 0, "information")
    trial = run_trial(witness, of_a, task, rules, letters=scan.letters, of=PLAIN)
    assert trial.touch_index[0].tolist() == [19, 18, 17, 16, 15]
    assert (trial.evaluations == 7).all()


class Together(Blind):
    """Name the letter that the sum of all readings so far stands for, of one trial or of many at once."""

    draws = False

    def estimates(self, readings, sensor_in_robot):
        """Answer as one by one does."""
        self.calls = [*getattr(self, "calls", []), readings.shape]
        trials = zip(readings.sum(axis=-1).cumsum(axis=1), sensor_in_robot, strict=True)
        return [list(map(self.named, *of_trial)) for of_trial in trials]

    def named(self, total, pose):
        """Name a letter by a sum, and the place by a pose."""
        label = LETTERS[int(total) % len(LETTERS)]
        return Estimate(label, {label: 1.0}, pose)

    def reset(self, rng):
        """Forget the sum."""
        self.total = 0.0

    def update(self, reading, sensor_in_robot):
        """Add a reading."""
        self.total, self.pose = self.total + np.sum(reading), np.asarray(sensor_in_robot)

    def estimate(self):
        """Answer alone."""
        return self.named(self.total, self.pose)


class OneByOne(Together):
    """The same, asked for one reading at a time."""

    answers_together = False


@pytest.mark.parametrize("slip", [Slip(), Slip(walk_mm=0.5)])
def test_trials_done_at_once_are_those_done_one_by_one(slip):
    made = Together(Options()), OneByOne(Options())
    plan = TrialPlan("together", {}, make_scan(), TrialRules(7, 3, moving=slip))
    tasks = [OneTrial(letter, trial) for letter in "AE" for trial in range(3)]
    together, alone = (run_trials(plan, one, tasks, progress=silent)[0] for one in made)
    assert made[0].calls == [(3, 7, 2)] * 2
    assert not hasattr(made[1], "calls")
    assert not alone.propose_s.any()
    assert len(set(alone.label.ravel())) > 1
    for field in fields(Trials):
        if not field.name.endswith("_s"):
            np.testing.assert_array_equal(getattr(together, field.name), getattr(alone, field.name))


class Surer(Together):
    """The same, surer of its letter with each reading: 1/3, 2/4, 3/5 and so on."""

    def estimate(self):
        return self._surer(super().estimate(), self.heard)

    def reset(self, rng):
        super().reset(rng)
        self.heard = 0

    def update(self, reading, sensor_in_robot):
        super().update(reading, sensor_in_robot)
        self.heard += 1

    def estimates(self, readings, sensor_in_robot):
        answers = super().estimates(readings, sensor_in_robot)
        return [[self._surer(one, k + 1) for k, one in enumerate(of_trial)] for of_trial in answers]

    def _surer(self, estimate, touches):
        p = touches / (touches + 2)
        rest = dict.fromkeys(LETTERS, (1 - p) / (len(LETTERS) - 1))
        return replace(estimate, probabilities=rest | {estimate.label: p})


class SurerOneByOne(Surer):
    answers_together = False


@pytest.mark.parametrize("kind", [Surer, SurerOneByOne])
@pytest.mark.parametrize(("stop_at", "touches"), [(0.6, 3), (0.61, 4), (0.99, 7), (None, 7)])
def test_a_trial_ends_as_soon_as_it_is_sure(kind, stop_at, touches):
    """What it did until then is what it does without an end, and costs nothing after."""
    tasks = [OneTrial(letter, trial) for letter in "AE" for trial in range(2)]
    ended, whole = (
        run_trials(
            TrialPlan("surer", {}, make_scan(), TrialRules(7, 3, moving=Slip(walk_mm=0.5), stop_at=end)),
            kind(Options()), tasks, progress=silent,
        )[0]
        for end in (stop_at, None)
    )  # fmt: skip
    assert (ended.touches == touches).all()
    assert (ended.touch_index[:, touches:] == NOT_TAKEN).all()
    for name in ("touch_index", "label", "p_label", "p_truth", "pose", "true_pose"):
        column = getattr(ended, name)
        np.testing.assert_array_equal(column[:, :touches], getattr(whole, name)[:, :touches])
        if name != "touch_index":
            assert (column[:, touches:] == column[:, touches - 1 : touches]).all()
    assert not ended.seconds[:, touches:].any()


def test_an_estimator_that_leaves_out_answers_of_many_trials_is_named():
    class Short(Together):
        def estimates(self, readings, sensor_in_robot):
            return super().estimates(readings, sensor_in_robot)[1:]

    plan = TrialPlan("short", {}, make_scan(), TrialRules(7, 3))
    with pytest.raises(InputError, match=r"Short is broken.*7 readings of each of 2 trials"):
        run_trials(plan, Short(Options()), [OneTrial("A", 0), OneTrial("A", 1)], progress=silent)


@pytest.mark.parametrize(
    ("readings", "letters", "message"), [(21, "A", "at most 20"), (5, "X", "no train readings of letter 'X'")]
)
def test_readings_that_are_not_there_are_refused(readings, letters, message):
    with pytest.raises(InputError, match=message):
        check_readings(make_scan(), letters, readings)


class Broken(Blind):
    """Answer what a test says, whatever is felt."""

    answer = proposal = counts = None

    def estimate(self):
        return self.answer

    def propose(self, candidates):
        return self.proposal

    @property
    def work(self):
        return {"skipped": {}} if self.counts is None else self.counts


EVEN = dict.fromkeys(LETTERS, 0.2)
ANSWERS = {
    "none": (None, "no Estimate"),
    "nan": (Estimate("A", EVEN | {"A": np.nan}, np.zeros(3)), "do not sum to 1"),
    "wrong label": (Estimate("X", EVEN, np.zeros(3)), "names 'X'"),
    "nan pose": (Estimate("A", EVEN, np.array([0.0, np.nan, 0.0])), "no finite"),
    "far pose": (Estimate("A", EVEN, np.array([0.0, 1e300, 0.0])), "no finite [x, y, theta] up to 1e+09"),
    "short pose": (Estimate("A", EVEN, np.zeros(2)), "no finite"),
}


@pytest.mark.parametrize("kind", ANSWERS)
def test_an_answer_that_is_no_estimate_names_the_estimator(kind):
    broken = Broken(Options())
    broken.answer, said = ANSWERS[kind]
    with pytest.raises(InputError, match=r"estimator test_trials\.Broken is broken") as caught:
        trials_of(broken, make_scan(), count=1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("proposal", [None, -1, 20])
def test_a_proposal_that_is_none_names_the_estimator(proposal):
    scan, broken = make_scan(), Broken(Options())
    broken.fit(scan)
    broken.answer, broken.proposal = Estimate("A", EVEN, np.zeros(3)), proposal
    with pytest.raises(InputError, match="Broken is broken: it proposed"):
        run_trial(
            broken, scan.where("test", "A"), OneTrial("A", 0), TrialRules(2, 0, "information"),
            letters=scan.letters, of=PLAIN,
        )  # fmt: skip


@pytest.mark.parametrize("counts", [3, {"likelihood_evaluations": "many"}, {"skipped": 3}])
def test_counts_that_are_none_are_refused(counts):
    broken = Broken(Options())
    broken.answer, broken.counts = Estimate("A", EVEN, np.zeros(3)), counts
    with pytest.raises(InputError, match="an estimator's work is"):
        trials_of(broken, make_scan(), count=1)


@pytest.mark.parametrize(("estimator", "size"), [("particle", "particles"), ("histogram", "bins")])
def test_the_smallest_estimators_are_scored_too(estimator, size, tmp_path):
    # With few particles only one is left of a letter: arrays of one row.
    make_scan(letters="AO").save(tmp_path / "scan.npz")
    words = {"scan": tmp_path / "scan.npz", "trials": 1, "readings": 4, size: 1}
    run = tactsim.run(estimator=estimator, **words)
    assert np.isfinite(run.trials.pose).all()


class Refusing(Witness):
    """Says "none" to every third reading, and takes the letter that it was not fitted to for another."""

    def estimate(self):
        known = super().estimate()
        if known.label == LETTERS[0]:
            known = replace(known, label=LETTERS[1], probabilities={LETTERS[1]: 1.0})
        refused = len(self.seen) % 3 == 0
        return replace(known, label=NONE, probabilities={NONE: 1.0}) if refused else known


def test_a_letter_that_was_held_out_is_right_when_it_is_refused():
    scan = make_scan()
    refusing = Refusing(Options())
    refusing.fit(scan)
    tasks = [OneTrial(letter, trial) for letter in LETTERS for trial in range(2)]
    plan = TrialPlan("none", {}, scan.untrained(LETTERS[:1]), TrialRules(6, 0))
    trials = run_trials(plan, refusing, tasks, progress=silent)[0]
    held_out = trials.truth == LETTERS[0]
    assert np.array_equal(trials.known, ~held_out)
    assert (trials.right[held_out] == [False, False, True] * 2).all()
    assert (trials.p_truth[held_out] == [0, 0, 1, 0, 0, 1]).all()
    assert (trials.right[~held_out] == [True, True, False] * 2).all()


def test_a_letter_whose_name_means_no_known_letter_is_refused(tmp_path):
    scan = make_scan(letters="AE")
    labels = np.where(scan.labels == "E", NONE, scan.labels.astype("U4"))
    Scan(scan.readings, scan.poses, labels, scan.split, scan.taxel_xy).save(tmp_path / "scan.npz")
    how = {"jobs": 1, "cache": False, "progress": silent}
    with pytest.raises(InputError, match="called 'none'"):
        gather(run_config(scan=tmp_path / "scan.npz"), **how)
    assert gather(run_config(scan=tmp_path / "scan.npz", letters="A"), **how).letters == ("A",)


def test_each_letter_held_out_in_turn_is_what_holding_out_one_by_one_gives(tmp_path):
    words = {"letters": "EIL", "estimator": "histogram", "bins": 1000, "trials": 1, "readings": 4}
    run = tactsim.run(hold_out="each", **words)
    assert not run.trials.known.any()
    assert run.protocol.endswith("each letter held out in turn")
    for letter in "EIL":
        alone = tactsim.run(hold_out=letter, **words).trials
        ours, theirs = run.trials.truth == letter, alone.truth == letter
        assert (run.trials.touch_index[ours] == alone.touch_index[theirs]).all()
        assert (run.trials.label[ours] == alone.label[theirs]).all()
        assert run.trials.label[ours].tolist() != [[letter] * 4]
        assert run.trials.p_label[ours] == pytest.approx(alone.p_label[theirs], abs=1e-6)
    assert run.summary["refused_unknown"] == [0.0] * 4
    assert run.summary["refused_known"] == [None] * 4
    again = tactsim.Run.load(run.save(tmp_path / "run"))
    assert again.summary == run.summary
    assert (again.trials.label == run.trials.label).all()


def test_one_letter_cannot_be_held_out_in_turn(tmp_path):
    make_scan(letters="A").save(tmp_path / "scan.npz")
    with pytest.raises(InputError, match="leave one to train on"):
        gather(run_config(scan=tmp_path / "scan.npz", hold_out="each"), jobs=1, cache=False, progress=silent)


@pytest.mark.parametrize("name", ["nearest", pytest.param("refined", marks=pytest.mark.long)])
def test_the_frame_of_an_object_is_its_owners_choice(name):
    """Frames that lie apart give the same trials; one that is turned gives others, of which as many are right."""
    scan = tactsim.scan(letters="AEI")

    def run(motions):
        poses = scan.poses.copy()
        for letter, motion in motions.items():
            poses[scan.labels == letter] = compose(motion, poses[scan.labels == letter])
        moved = tactsim.Scan.from_arrays(scan.readings, poses, scan.labels, scan.split, tactsim.Pad())
        return tactsim.run(moved, estimator=name, trials=12, readings=3)

    one, apart = run({}), run({"E": [12.0, 0, 0], "I": [600.0, 35.5, 0]})
    assert_allclose(apart.accuracy, one.accuracy, atol=1e-12)
    assert_allclose(apart.error_mm, one.error_mm, atol=1e-4)
    turned = run({"E": [12.0, 0, 0.7], "I": [600.0, 35.5, -2.0]})
    assert_allclose(turned.accuracy, one.accuracy, atol=0.2)
    assert abs(turned.error_mm[-1] - one.error_mm[-1]) < 3.0
