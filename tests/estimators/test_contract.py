"""What every registered estimator, built in or plugged in, must keep."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from plugging import install_plug_in
from synthetic import draw_trial, fit, fitted, make_scan, paper_poses, square_pad

from tactsim import estimators
from tactsim.core import InputError, Scan
from tactsim.estimators import Estimator
from tactsim.estimators.registry import load

NAMES = (*estimators.names(), "sorted")  # the last from docs/estimators.md, as a stranger would install it
COARSE = {
    "synthesis": {"spacing": 2.5, "angles": 8, "modes": 100}
}  # options that make an estimator cheaper to fit
POSES = paper_poses(positions=4, angles=6)


@pytest.fixture(scope="module", autouse=True)
def plug_in(tmp_path_factory):
    """Install the worked example of the documentation as a package of its own, for these tests."""
    text = (Path(__file__).parents[2] / "docs" / "estimators.md").read_text()
    code = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[-1]
    assert len(code.splitlines()) < 40
    place = tmp_path_factory.mktemp("site")
    (place / "sorted.py").write_text(code)
    with pytest.MonkeyPatch.context() as patch:
        install_plug_in(place, patch, sorted="sorted:Sorted")
        yield


@pytest.fixture(scope="module")
def small_scan() -> Scan:
    return make_scan("EIL", poses=POSES)


@pytest.fixture(scope="module", params=NAMES)
def learned(request, small_scan):
    return fitted(request.param, small_scan, **COARSE.get(request.param, {}))


def create(name):
    return estimators.create(name, **COARSE.get(name, {}))


def run(estimator, readings, poses, seed=0):
    """Run a sequence from a reset; the estimates after each reading, as comparable tuples."""
    estimator.reset(np.random.default_rng(seed))
    answers = []
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
        answers.append(frozen(estimator.estimate()))
    return answers


def frozen(estimate):
    return estimate.label, dict(estimate.probabilities), np.asarray(estimate.robot_in_object).tolist()


def trial(scan, label="E", count=4, seed=5):
    return draw_trial(scan, label, count, np.random.default_rng(seed))[:2]


@pytest.mark.parametrize("name", NAMES)
def test_calls_out_of_order_are_refused(name, small_scan):
    readings, poses = trial(small_scan)
    estimator = create(name)
    with pytest.raises(InputError, match="fit"):
        estimator.reset(np.random.default_rng(0))
    with pytest.raises(InputError, match="fit"):
        estimator.update(readings[0], poses[0])
    with pytest.raises(InputError, match="fit"):
        estimator.estimate()
    fit(estimator, small_scan.where(label="E"))
    with pytest.raises(InputError, match="reset"):
        estimator.update(readings[0], poses[0])
    with pytest.raises(InputError, match="reset"):
        estimator.estimate()


@pytest.mark.parametrize("name", NAMES)
def test_a_scan_without_training_readings_is_refused(name, small_scan):
    with pytest.raises(InputError, match="train"):
        fit(create(name), small_scan.where("test"))


@pytest.mark.parametrize("name", NAMES)
def test_options_are_described_and_unknown_ones_refused(name):
    for option, field in load(name).options_type.model_fields.items():
        assert field.description, option
    with pytest.raises(InputError, match="no_such_option"):
        estimators.create(name, no_such_option=1)


def test_estimates_are_probabilities_and_poses(learned, small_scan):
    learned.reset(np.random.default_rng(0))
    for reading, pose in zip(*trial(small_scan), strict=True):
        estimate = learned.estimate()  # before the first reading as well
        assert set(small_scan.letters) <= set(estimate.probabilities)
        assert estimate.label in estimate.probabilities
        assert sum(estimate.probabilities.values()) == pytest.approx(1)
        assert all(0 <= p <= 1 for p in estimate.probabilities.values())
        assert np.asarray(estimate.robot_in_object).shape == (3,)
        assert np.isfinite(estimate.robot_in_object).all()
        learned.update(reading, pose)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda z, p: (np.where(np.arange(len(z)) == 3, np.nan, z), p), r"reading\[3\]"),
        (lambda z, p: (np.where(np.arange(len(z)) == 0, np.inf, z), p), r"reading\[0\]"),
        (lambda z, p: (z[:-1], p), "36 taxels"),
        (lambda z, p: (z.reshape(6, 6), p), "36 taxels"),
        (lambda z, p: (z, p[:2]), "sensor_in_robot"),
        (lambda z, p: (z, [p[0], np.nan, p[2]]), "sensor_in_robot"),
    ],
)
def test_a_bad_reading_is_refused_and_leaves_no_trace(learned, small_scan, spoil, message):
    readings, poses = trial(small_scan)
    clean = run(learned, readings, poses)
    learned.reset(np.random.default_rng(0))
    spoilt = []
    for reading, pose in zip(readings, poses, strict=True):
        with pytest.raises(InputError, match=message):
            learned.update(*spoil(reading, pose))
        learned.update(reading, pose)
        spoilt.append(frozen(learned.estimate()))
    assert spoilt == clean


def test_same_seed_same_answer(learned, small_scan):
    readings, poses = trial(small_scan)
    assert run(learned, readings, poses, seed=3) == run(learned, readings, poses, seed=3)


def test_reset_forgets_and_keeps_the_maps(learned, small_scan):
    readings, poses = trial(small_scan, "E")
    others, other_poses = trial(small_scan, "L", count=7, seed=6)
    first = run(learned, readings, poses)
    run(learned, others, other_poses, seed=8)
    assert run(learned, readings, poses) == first


def test_looking_changes_nothing(learned, small_scan):
    readings, poses = trial(small_scan)
    plain = run(learned, readings, poses)
    learned.reset(np.random.default_rng(0))
    looked = []
    for reading, pose in zip(readings, poses, strict=True):
        learned.update(reading, pose)
        plane = learned.belief_over_plane()
        if plane is not None:
            assert plane.probability.shape == (len(plane.labels), len(plane.y), len(plane.x))
            assert plane.probability.sum() == pytest.approx(1)
        learned.estimate()
        looked.append(frozen(learned.estimate()))
    assert looked == plain


def test_inputs_are_not_written_to(learned, small_scan):
    readings, poses = (np.array(a) for a in trial(small_scan))
    kept = readings.copy(), poses.copy()
    readings.setflags(write=False)
    poses.setflags(write=False)
    run(learned, readings, poses)
    assert (readings == kept[0]).all()
    assert (poses == kept[1]).all()


def test_readings_may_come_as_lists_and_as_other_numbers(learned, small_scan):
    readings, poses = trial(small_scan)
    readings = np.round(readings).astype(int)
    assert run(learned, readings.tolist(), poses.tolist()) == run(learned, readings.astype(np.int32), poses)


@pytest.mark.parametrize("reading", [0.0, -3.0, 1e6], ids=["zeros", "below zero", "saturated"])
def test_readings_without_contrast_are_taken(learned, small_scan, reading):
    for estimate in run(learned, np.full((3, 36), reading), np.zeros((3, 3))):
        assert sum(estimate[1].values()) == pytest.approx(1)


def test_a_pose_far_away_is_taken(learned, small_scan):
    readings, poses = trial(small_scan)
    for far in (1e2, 1e5, 9e8):
        for estimate in run(learned, readings, poses + [far, -far, 0]):
            assert sum(estimate[1].values()) == pytest.approx(1)


def test_work_is_counted(learned, small_scan):
    before = learned.work["likelihood_evaluations"]
    run(learned, *trial(small_scan))
    assert json.loads(json.dumps(learned.work)) == learned.work
    if type(learned).work is not Estimator.work:  # a plug-in need not count
        assert learned.work["likelihood_evaluations"] > before
    assert all(count >= 0 for count in learned.work["skipped"].values())


def test_a_proposal_is_a_candidate(learned, small_scan):
    readings, poses = trial(small_scan)
    run(learned, readings, poses)
    candidates = poses[:3]
    try:
        index = learned.propose(candidates)
    except InputError:
        return  # it explores at random
    assert index in range(len(candidates))


def test_test_readings_teach_nothing(learned, small_scan, request):
    other = make_scan("EIL", poses=POSES, seed=1)
    test = small_scan.split == "test"
    swapped = Scan(
        np.where(test[:, None], other.readings, small_scan.readings), small_scan.poses, small_scan.labels,
        small_scan.split, small_scan.taxel_xy,
    )  # fmt: skip
    readings, poses = trial(small_scan)
    theirs = create(request.node.callspec.params["learned"])
    fit(theirs, swapped)
    assert run(learned, readings, poses) == run(theirs, readings, poses)


@pytest.mark.parametrize("name", NAMES)
def test_any_pad_will_do_and_a_new_fit_replaces_the_old(name):
    estimator, old = create(name), "E"
    pads = square_pad(9, 8, 1.2), square_pad(5, 5, 2.3), square_pad(1, 1), square_pad(3, 7) * [1, -1]
    for pad, new in zip(pads, "TITI", strict=True):
        scan = make_scan("L" + new, pad, paper_poses(positions=3, angles=4))
        fit(estimator, scan)
        for estimate in run(estimator, *trial(scan, new)):
            assert set(estimate[1]) >= {"L", new}
            assert old not in estimate[1]
            assert sum(estimate[1].values()) == pytest.approx(1)
        old = new


@pytest.mark.parametrize("name", NAMES)
def test_a_single_object_can_be_localised(name, small_scan):
    estimator = create(name)
    fit(estimator, small_scan.where(label="E"))
    assert run(estimator, *trial(small_scan))[-1][0] == "E"


def test_objects_are_recognised(learned, small_scan):
    right = 0
    for seed in range(6):
        label = small_scan.letters[seed % 3]
        right += run(learned, *trial(small_scan, label, count=12, seed=seed), seed=seed)[-1][0] == label
    assert right >= 4  # guessing gets there once in ten


def test_a_letter_can_be_left_out_of_what_was_learned(learned, small_scan, request):
    readings, poses = trial(small_scan)
    anew = create(request.node.callspec.params["learned"])
    before = run(learned, readings, poses)
    fit(anew, small_scan.untrained("E"))
    for one, two in zip(
        run(learned.without("E", small_scan), readings, poses), run(anew, readings, poses), strict=True
    ):
        assert one[0] == two[0]
        assert one[1] == pytest.approx(two[1], abs=1e-6)
    assert run(learned, readings, poses) == before


LEARNING = [name for name in NAMES if name == "sorted" or not load(name).uses_forward_model]


@pytest.mark.parametrize("name", LEARNING)
def test_letters_that_are_one_share_its_probability(name, small_scan):
    """Training readings under three labels say nothing of which label it is, whatever is felt and drawn."""
    one = small_scan.where("train", "E")
    three = Scan(
        np.tile(one.readings, (3, 1)), np.tile(one.poses, (3, 1)), np.repeat(list("ABC"), len(one)),
        np.full(3 * len(one), "train"), one.taxel_xy,
    )  # fmt: skip
    estimator = estimators.create(name)
    estimator.fit(three)
    readings, poses = trial(small_scan, count=6)
    for seed in (0, 1):
        for _, probabilities, _ in run(estimator, readings, poses, seed):
            assert probabilities == pytest.approx(dict.fromkeys("ABC", 1 / 3), abs=1e-9)
