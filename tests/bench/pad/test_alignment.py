"""Presses whose poses nobody noted: what lies where is found again, up to a frame, and what cannot be is refused."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import refused
from hypothesis import given, settings
from hypothesis import strategies as st

import tactsim
from tactsim.bench.pad.alignment import Alignment, _in_frame_of, align
from tactsim.bench.placement import Properties, placement_error
from tactsim.core import InputError, Pad, Scan, compose, invert, wrap_angle

PAD = Pad(
    rows=24, columns=30, pitch_x=2, pitch_y=2, taxel_width=1, taxel_height=1, no_seam=True, unread_columns=0
)
BOXES = {  # middle x and y, width, height, mm
    "tee": [(0, 4, 20, 4), (2, -3, 4, 14)],
    "ell": [(0, 0, 4, 22), (5, -9, 12, 4)],
    "two": [(-6, 0, 4, 16), (6, 3, 8, 4)],
}


def pressed(name, pose):
    """Press boxes with soft edges, the sensor at `pose` on the object: (taxels,)."""
    x, y = compose(pose, np.column_stack([PAD.taxel_xy, np.zeros(PAD.taxels)]))[:, :2].T
    soft = [
        np.clip(w / 2 - np.abs(x - mx) + 1, 0, 1) * np.clip(h / 2 - np.abs(y - my) + 1, 0, 1)
        for mx, my, w, h in BOXES[name]
    ]
    return 100 * np.max(soft, axis=0)


def scan_of(labels, shapes=None, presses=8, seed=0, **meta):
    """Press each label's shape at random poses, the first half to train on."""
    rng = np.random.default_rng(seed)
    rows, poses, names = [], [], []
    for label in labels:
        for press in range(2 * presses):
            pose = np.array([*rng.uniform(-7, 7, 2), rng.uniform(-np.pi, np.pi)])
            shape = (shapes or {}).get(label, label)
            shape = shape if isinstance(shape, str) else shape[press % len(shape)]
            rows.append(pressed(shape, pose) * rng.uniform(0.7, 1.3) + rng.normal(0, 1, PAD.taxels))
            poses.append(pose)
            names.append(label)
    split = np.tile(["train"] * presses + ["test"] * presses, len(labels))
    made = Scan.from_arrays(np.array(rows), np.array(poses), names, split, PAD, unit="count")
    return replace(made, meta={**made.meta, **meta})


def lost(scan):
    """Forget the poses."""
    return replace(scan, poses=np.zeros((len(scan), 3)), meta={**scan.meta, "poses": "unknown"})


def test_presses_are_laid_over_each_other_as_they_truly_lay():
    scan = scan_of(list(BOXES))
    made, found = align(lost(scan))
    for label in BOXES:
        true, own = scan.where("train", label).poses, found[label]
        assert own.views.tolist() == [0] * len(true)
        between = compose(compose(invert(own.poses[0]), own.poses), invert(compose(invert(true[0]), true)))
        assert np.hypot(*between[:, :2].T).max() < 4  # mm: two taxels, and 10 degrees far from the middle
        assert np.abs(wrap_angle(between[:, 2])).max() < np.radians(11)
    assert made.views is None
    assert made.meta["poses"] == "unknown"
    assert np.array_equal(made.where("test").poses, np.zeros((24, 3)))


@pytest.mark.long
def test_an_object_that_lies_on_two_sides_gets_two_views_and_is_named_as_one():
    scan = lost(scan_of(["key", "tee"], {"key": ("ell", "two")}, presses=10))
    made, found = align(scan)
    views = found["key"].views
    assert len(set(views[::2])) == len(set(views[1::2])) == 1
    assert views[0] != views[1]
    estimator = tactsim.create("refined", bins=2000)
    estimator.fit(made)
    assert set(estimator.maps) == {"key", "key, view 2", "tee"}
    estimator.reset(np.random.default_rng(0))
    estimate = estimator.estimate()
    # Each object is as likely as another before the first reading, however many views it has.
    assert estimate.probabilities == pytest.approx({"key": 0.5, "tee": 0.5})
    for letter in ("key", "tee"):
        sure = 0
        for reading in made.where("test", letter).readings:
            estimator.reset(np.random.default_rng(0))
            estimator.update(reading, [0, 0, 0])
            estimate = estimator.estimate()
            # A touch of what both have in common tells nothing; one that tells something is right.
            if estimate.probabilities[estimate.label] > 0.6:
                sure += 1
                assert estimate.label == letter
        assert sure >= 6  # of 10
    assert set(estimator.without("key", made).maps) == {"tee"}


def test_withheld_poses_are_found_and_stay_in_the_frame_of_the_true_ones():
    scan = scan_of(list(BOXES))
    made, _ = align(scan, withheld=True)
    train = scan.split == "train"
    assert np.hypot(*(made.poses - scan.poses)[train, :2].T).max() < 4
    assert np.array_equal(made.poses[~train], scan.poses[~train])
    assert made.meta.get("poses") != "unknown"


@settings(max_examples=50)
@given(st.sampled_from([0, 1, 2, 5]), st.integers(0, 2**32 - 1))
def test_what_a_rigid_motion_and_the_symmetry_leave_open_is_found_and_presses_that_lie_elsewhere_have_no_say(
    symmetry, seed
):
    rng = np.random.default_rng(seed)
    of = Properties(symmetry, tuple(rng.uniform(-5, 5, 2)), 80.0)

    def drawn(count):
        return np.column_stack([rng.uniform(-15, 15, (count, 2)), rng.uniform(-np.pi, np.pi, count)])

    def spun(poses, turns):
        """Turn poses on the object about its centre by `turns` (n,) rad."""
        about = np.column_stack([np.tile(of.centre, (len(poses), 1)), turns])
        return compose(about, compose(invert([*of.centre, 0.0]), poses))

    true, views = drawn(20), np.arange(20) % 2
    turns = rng.uniform(-np.pi, np.pi, 20) if symmetry == 0 else 2 * np.pi / symmetry * rng.integers(0, 9, 20)
    lies, motions = spun(true, turns), drawn(2)
    wrong = np.arange(20) < 6  # three of each view
    lies[wrong] = drawn(6)
    found = _in_frame_of(Alignment(compose(motions[views], lies), views, np.ones(20)), true, of)
    assert placement_error(found.poses, true, of)[~wrong] == pytest.approx(0, abs=1e-5)
    between = compose(invert(found.poses[views == 0][0]), found.poses[views == 0])
    assert between == pytest.approx(compose(invert(lies[0]), lies[views == 0]), abs=1e-9)  # moved as one


def changed(row, reading):
    scan = lost(scan_of(["tee", "ell"]))
    readings = scan.readings.copy()
    readings[row] = readings[reading] if isinstance(reading, int) else reading(np.random.default_rng(0))
    return replace(scan, readings=readings)


def counts(of):
    """Give presses whose readings are `of` those above rest."""
    scan = lost(scan_of(["tee", "ell"]))
    return replace(scan, readings=of(scan.readings))


@pytest.mark.parametrize(
    ("scan", "words"),
    [
        (lambda: scan_of(["tee"]), "--poses unknown"),
        (lambda: lost(scan_of(["tee"], presses=1)), "'tee' has one training press"),
        (lambda: counts(lambda readings: readings + 400), "16 training presses are too few to find it"),
        (lambda: counts(lambda readings: 1023 - readings), "at rest is not 0"),
        (lambda: changed(2, lambda rng: rng.normal(0, 1, PAD.taxels)),
         "'tee' these are idle frames.*: 3; leave"),
        (lambda: changed(18, 1), "press 3 of 'ell' is press 2 of 'tee'"),
        (lambda: changed(4, lambda rng: 100.0 * (rng.random(PAD.taxels) < 0.03)),
         "press 5 of the 8 training presses of 'tee' fits nowhere"),
    ],
)  # fmt: skip
def test_what_cannot_be_aligned_is_refused(scan, words):
    with pytest.raises(InputError, match=words):
        align(scan())


def test_poses_that_are_not_there_are_not_withheld():
    marked, at_one = lost(scan_of(["tee"])), scan_of(["tee"])
    at_one = replace(at_one, poses=np.zeros((len(at_one), 3)))
    for scan, said in ((marked, "says that nobody noted poses"), (at_one, "has all presses at one pose")):
        with pytest.raises(InputError, match=f"the scan {said}, so there are none to withhold: leave out"):
            align(scan, withheld=True)
    assert align(at_one)[0].meta["poses"] == "unknown"


def test_the_verb_aligns_and_cuts_and_its_scan_is_run(here, tmp_path):
    lost(scan_of(list(BOXES), presses=6)).save(tmp_path / "presses.npz")
    cut = ["--cut", "8x8", "--stride", "4", "--touching", "3:20"]
    result = here("align", "presses.npz", "--out", "aligned.npz", *cut)
    assert result.returncode == 0, result.stderr
    assert "tee: 6 presses, which resemble" in result.stdout
    made = Scan.load(tmp_path / "aligned.npz")
    assert made.meta["poses"] == "unknown"
    assert ((made.readings > 20).sum(axis=1) >= 3).all()
    run = tactsim.run(scan=made, estimator="nearest", trials=6, readings=3)
    assert run.about["protocol"].startswith("one press a trial")
    words = ["align", "presses.npz", "--out", "b.npz"]
    refused(here(*words, *cut[4:]), "say how large they are with --cut")
