from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import InputError, Scan
from tactsim.core.moments import at_load, moments_of, plateau, shares_of, with_moments

PATTERN = np.array([0.0, 10.0, 30.0, 60.0])


def course(idle=5, rise=20, hold=30, fall=0):
    """What a press does over its images, as a share of its load."""
    up, down = np.arange(1, rise + 1) / (rise + 1), np.arange(fall, 0, -1) / (fall + 1)
    return np.concatenate([np.zeros(idle), up, np.ones(hold), down, np.zeros(idle if fall else 0)])


def pressed(shape, spread=0.5):
    """Images of a press whose taxels do not answer alike: some feel a light press more than others."""
    powers = 1 + spread * np.array([0.0, 1.0, 0.5, 0.0])
    return PATTERN * shape[:, None] ** powers


def scan_of(shapes, force=True, **changes):
    images = np.array([pressed(shape) for shape in shapes], dtype=np.float32)
    count, frames = images.shape[:2]
    made = Scan(
        images[:, -1], np.arange(3.0 * count).reshape(count, 3), np.array(["A", "E"] * count)[:count],
        np.array(["train"] * (count - 1) + ["test"]), np.eye(4)[:, :2], {"unit": "kPa"},
        sequence=images, sequence_times=np.arange(1, frames + 1) / 200,
        sequence_force=2 * np.array(shapes) if force else np.zeros((count, frames)),
    )  # fmt: skip
    return replace(made, **changes)


@given(
    idle=st.integers(0, 10), rise=st.integers(3, 30), hold=st.integers(12, 60), fall=st.integers(0, 8),
    scale=st.floats(1e-3, 1e3), seed=st.integers(0, 99),
)  # fmt: skip
def test_a_plateau_is_found_where_it_is_held(idle, rise, hold, fall, scale, seed):
    shape = course(idle, rise, hold, fall)
    noisy = shape + 0.01 * np.random.default_rng(seed).standard_normal(len(shape))
    found = plateau(scale * noisy)
    # The last images of the rise, within a tenth of the level, count too: no more than they are.
    near = int(np.ceil(0.15 * (rise + 1))) + 1
    after = min(near, fall + 1)
    assert found is not None
    assert idle + rise - near <= found.start <= idle + rise + 1
    assert idle + rise + hold - 1 <= found.stop <= idle + rise + hold + after


def test_a_press_that_never_holds_still_has_no_plateau():
    tap = np.concatenate([np.arange(30.0), np.arange(30.0, 0, -1)])
    for felt in (tap, np.zeros(20), np.ones(2), np.zeros(0)):
        assert plateau(felt) is None


@pytest.mark.parametrize("gauged", [True, False])
def test_moments_are_the_images_at_shares_of_the_load(gauged):
    shape = course(rise=40)
    images = pressed(shape)
    shares = np.array([0.25, 0.5, 0.75, 1.0])
    found, taken = moments_of(images, shares, 2 * shape if gauged else images.sum(axis=1))
    assert found.all()
    if gauged:
        assert taken == pytest.approx(pressed(shares), abs=0.3)  # a plateau begins within a tenth
    else:
        assert taken.sum(axis=1) == pytest.approx(shares * PATTERN.sum(), rel=0.01)


def test_a_press_too_quick_for_its_images_has_no_moment_between_them():
    found, _ = moments_of(pressed(course(rise=1)), np.array([0.25, 0.5, 1.0]), course(rise=1))
    assert found.tolist() == [False, False, True]


def test_what_is_hardly_felt_above_the_noise_has_no_moments():
    noise = np.random.default_rng(0).normal(size=(60, 4))
    images = noise + 0.5 * course(idle=5, rise=5, hold=50)[:, None]
    found, _ = moments_of(images, np.array([0.5, 1.0]), images.sum(axis=1))
    assert not found.any()


def test_presses_get_their_moments_at_their_pose_and_test_presses_none():
    scan = scan_of([course(), course(rise=24, hold=26), course()])
    several = with_moments(scan, 4)
    assert len(several) == 4 + 4 + 1
    assert np.array_equal(several.poses[:4], np.tile(scan.poses[0], (4, 1)))
    assert np.array_equal(several.readings[[3, 7, 8]], scan.readings)
    assert several.labels.tolist() == ["A"] * 4 + ["E"] * 4 + ["A"]
    assert several.split.tolist() == ["train"] * 8 + ["test"]
    assert several.loads.tolist() == [0.5, 1, 1.5, 2, 0.5, 1, 1.5, 2, 2]
    assert several.presses.tolist() == [0] * 4 + [1] * 4 + [2]
    assert several.sequence is None
    assert several.meta["moments"] == {
        "shares": [0.25, 0.5, 0.75, 1.0], "of": "force", "split": "train", "presses": 2
    }  # fmt: skip


def test_without_a_gauge_the_load_is_what_is_felt_and_its_newtons_are_not_known():
    scan = scan_of([course(), course()], force=False)
    several = with_moments(scan, 2)
    assert several.meta["moments"]["of"] == "felt"
    assert several.loads is None
    assert several.readings[0].sum() == pytest.approx(PATTERN.sum() / 2, rel=0.01)
    known = with_moments(replace(scan, loads=[3.0, np.nan], moments=[0.8, 1.0]), 2)
    assert known.moments[:2].tolist() == [0.4, 0.8]
    assert known.loads[:2].tolist() == [1.5, 3.0]
    assert np.isnan(known.loads[2])


def test_auto_leaves_out_the_shares_that_few_presses_show():
    quick, slow = course(rise=1, hold=49), course()
    mostly_quick = with_moments(scan_of([quick, quick, quick, slow, slow]), "auto")
    assert 0.25 not in mostly_quick.meta["moments"]["shares"]
    assert with_moments(scan_of([slow, slow, quick]), "auto").meta["moments"]["shares"] == [
        0.25, 0.5, 0.75, 1,
    ]  # fmt: skip


def test_lighter_presses_are_what_was_felt_on_the_rise():
    scan = scan_of([course(rise=40), course(rise=40)])
    lighter = at_load(replace(scan, loads=[2.0, 2.0], moments=[0.5, 0.5]), 0.5)
    assert np.array_equal(lighter.readings[0], scan.readings[0])
    assert lighter.readings[1] == pytest.approx(pressed(np.array([0.5]))[0], abs=0.15)
    assert lighter.loads.tolist() == [2, 1]
    assert lighter.moments.tolist() == [0.5, 0.25]
    assert lighter.sequence is None


@pytest.mark.parametrize("moments", [0, 21, 1.5, True])
def test_an_odd_number_of_moments_is_refused(moments):
    with pytest.raises(InputError, match="whole number from 1 to 20"):
        shares_of(moments)


def test_scans_without_moments_are_refused_in_one_line():
    scan = scan_of([course(), course()])
    tap = np.concatenate([np.arange(30), np.arange(25, 0, -1)]) / 30
    still = replace(scan, sequence=None, sequence_times=None, sequence_force=None)
    for made, said in (
        (still, "holds one image of each press"),
        (scan.where("test"), "no press of the split 'train'"),
        (scan_of([tap, tap]), "no plateau"),
    ):
        with pytest.raises(InputError, match=said):
            with_moments(made)
    with pytest.raises(InputError, match="share of the load above 0"):
        at_load(scan, 0)
    with pytest.raises(InputError, match="one image of each press"):
        at_load(still, 0.5)
