"""Touches pressed on demand: their poses say nothing of the object, and their readings are those of the press."""

import numpy as np
import pytest
from test_trials import PLAIN, Witness

from tactsim import models
from tactsim.bench.config import run_config
from tactsim.bench.experiment import perform
from tactsim.bench.on_demand import OnDemand
from tactsim.bench.trials import OneTrial, TrialRules, run_trial
from tactsim.core import InputError, Scan, compose
from tactsim.estimators import Estimate, Options
from tactsim.press import WORLDS, PressOptions, ScanOptions, press_letter

IDEAL = ScanOptions(**WORLDS["ideal"])
TRUTH = np.array([4.0, -7.0, 2.0])


class Last(Witness):
    """Propose the last candidate, and keep what is shown."""

    def __init__(self):
        super().__init__(Options())
        self.shown = []

    def estimate(self):
        return Estimate("O", {"O": 1.0}, np.zeros(3))

    def propose(self, candidates):
        self.shown.append(candidates)
        return super().propose(candidates)


def trial_of(estimator, press, *, truth="O", trial=0, seed=0, readings=3, explore="information"):
    nothing = Scan(
        np.empty((0, 36)), np.empty((0, 3)), np.array([]), np.array([]), press.options.pad.taxel_xy
    )
    return run_trial(
        estimator, nothing, OneTrial(truth, trial), TrialRules(readings, seed, explore, press=press),
        letters=("O",), of=PLAIN,
    )  # fmt: skip


def test_candidates_say_nothing_of_the_object():
    """They are the same bits for every letter, and so for every place, since each letter's trial draws its own."""
    shown = {}
    for truth, trial, seed in [("O", 0, 0), ("I", 0, 0), ("O", 1, 0), ("O", 0, 1)]:
        last = Last()
        found = trial_of(last, OnDemand(IDEAL), truth=truth, trial=trial, seed=seed, readings=1)
        shown[truth, trial, seed] = last.shown[0], found.true_pose[0, 0]
    first, place = shown["O", 0, 0]
    other, elsewhere = shown["I", 0, 0]
    assert np.array_equal(first, other)
    assert not np.allclose(place, elsewhere)
    assert first.shape == (192, 3)
    assert 11 < np.abs(first[:, :2]).max() <= 12
    for key in [("O", 1, 0), ("O", 0, 1)]:
        assert not np.isin(shown[key][0], first).any()


def test_a_touch_is_what_a_press_there_reads():
    touches = OnDemand(IDEAL).touches("A", 3, 0)
    poses = touches.sensor_in_robot(TRUTH)
    felt = 0
    for index in (0, 50, 191, 7):
        want = press_letter(models.letter("A"), compose(TRUTH, poses[index]), IDEAL).ideal
        assert touches.reading(index, TRUTH) == pytest.approx(want, abs=1e-9)
        felt += want.max() > 1
    assert felt > 1


def test_touches_have_the_errors_and_noise_of_the_scan():
    def readings(**options):
        touches = OnDemand(IDEAL.model_copy(update=options)).touches("A", 0, 0)
        return np.array([touches.reading(index, np.zeros(3)) for index in range(40)])

    exact = readings()
    noisy = readings(sensor=IDEAL.sensor.model_copy(update={"noise": 2.0})) - exact
    assert noisy.std() == pytest.approx(2.0, rel=0.1)
    assert np.abs(noisy.mean()) < 0.3
    for option in (
        {"placement_mm": 0.5},
        {"placement_rad": 0.05},
        {"placement_tilt": 0.01},
        {"test_load": 0.5},
    ):
        assert np.abs(readings(**option) - exact).max() > 5, option
    assert readings(test_load=0.5) == pytest.approx(exact / 2, abs=1e-6)  # level and rigid: pressures halve


def test_a_reading_depends_on_the_touch_and_on_how_many_came_before_but_not_on_which():
    one, other, fresh = (OnDemand(ScanOptions()).touches("E", 0, 0) for _ in range(3))
    late = [one.reading(index, TRUTH) for index in (4, 9, 30)][-1]
    assert np.array_equal([other.reading(index, TRUTH) for index in (100, 5, 30)][-1], late)
    assert not np.array_equal(fresh.reading(30, TRUTH), late)


def test_lag_and_drift_know_the_touches_before():
    def felt(**sensor):
        options = IDEAL.model_copy(update={"sensor": IDEAL.sensor.model_copy(update=sensor)})
        touches = OnDemand(options).touches("E", 0, 0)
        return np.array([touches.reading(index, np.zeros(3)) for index in range(5)])

    exact = felt()
    assert felt(drift=1.0) - exact == pytest.approx(np.tile([[1], [2], [3], [4], [5]], 36))
    lagged = exact.copy()
    for row in range(1, 5):
        lagged[row] += 0.3 * (lagged[row - 1] - lagged[row])
    assert felt(lag=0.3) == pytest.approx(lagged)


def test_a_press_that_does_not_come_to_rest_is_no_reading():
    press = OnDemand(ScanOptions(placement_tilt=0.0, press=PressOptions(wrist_stiffness=16.0)))
    touches = press.touches("O", 0, 0)
    assert any(touches.reading(index, TRUTH) is None for index in range(20))
    last = Last()
    found = trial_of(last, press, readings=10)
    assert len(last.seen) == 10 < len(last.shown)
    assert len(set(found.touch_index[0].tolist())) == 10


@pytest.mark.long
def test_a_trial_that_runs_out_of_presses_that_rest_is_refused():
    press = OnDemand(ScanOptions(placement_tilt=0.0, press=PressOptions(wrist_stiffness=16.0)))
    with pytest.raises(InputError, match="192 readings a trial: no other press of 'O' comes to rest"):
        trial_of(Last(), press, readings=192)


@pytest.mark.long
def test_blind_touches_are_the_same_for_every_estimator_and_any_number_of_processes():
    words = {"letters": "IL", "trials": 2, "readings": 4, "explore": "blind", "bins": 100}
    one = perform(run_config(estimator="histogram", **words))
    two = perform(run_config(estimator="refined", **words), jobs=2)
    assert np.array_equal(one.trials.touch_index, two.trials.touch_index)
    assert one.protocol == two.protocol == "touches in the robot's frame, random order"


def test_blind_touches_of_recorded_readings_are_refused():
    with pytest.raises(
        InputError, match=r"explore=blind presses on demand, but the readings come from s\.npz"
    ):
        run_config(scan="s.npz", explore="blind")
