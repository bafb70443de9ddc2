from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.core import InputError, Pad, Scan, transform
from tactsim.hardware.cutting import cut


def array_scan(rows=16, columns=16, missing=(), **pad):
    """A large even array that feels a smooth field of the object's frame, twice at two poses; taxels may be missing."""
    pad = Pad(rows=rows, columns=columns, seam=None, unread_columns=0, **pad)
    poses = np.array([[0.0, 0.0, 0.0], [3.0, -2.0, 0.7]] * 2)
    xy = np.delete(pad.taxel_xy, list(missing), axis=0)
    points = transform(poses, xy)
    split = np.array(["train", "train", "test", "test"])
    return Scan(field(points), poses, np.array(["A", "B"] * 2), split, xy, loads=[1.0, np.nan, 3.0, 4.0])


def field(points):
    return 50 + 3 * points[..., 0] + 20 * np.sin(points[..., 1] / 5)


@pytest.mark.parametrize(
    ("window", "stride", "train", "test"),
    [((5, 5), 1, 72, 72), ((5, 5), 4, 9, 9), ((3, 16), 2, 7, 7), ((1, 2), 8, 4, 4)],
)
def test_each_cut_feels_the_same_place_of_the_object(window, stride, train, test):
    touches = cut(array_scan(), *window, stride)
    assert touches.readings.shape == (2 * (train + test), window[0] * window[1])
    assert np.allclose(touches.taxel_xy.mean(axis=0), 0)
    assert np.allclose(touches.readings, field(transform(touches.poses, touches.taxel_xy)))
    assert (touches.labels == "A").sum() == train + test
    assert [np.count_nonzero(touches.presses == press) for press in range(4)] == [train] * 2 + [test] * 2
    for press in range(4):  # its windows are of its angle
        angles = touches.poses[touches.presses == press, 2]
        assert angles == pytest.approx(array_scan().poses[press, 2])
    assert touches.meta["cut"]["windows"] == {"train": train, "test": test}
    assert np.array_equal(np.isnan(touches.loads), (touches.labels == "B") & (touches.split == "train"))


@given(
    rows=st.integers(1, 7), columns=st.integers(1, 7), stride=st.integers(1, 5),
    window=st.tuples(st.integers(1, 7), st.integers(1, 7)),
)  # fmt: skip
def test_no_test_touch_is_taken_where_a_training_touch_was(rows, columns, stride, window):
    if window[0] > rows or window[1] > columns:
        return
    touches = cut(array_scan(rows, columns), *window, stride)
    train, test = (
        {tuple(np.round(pose, 6)) for pose in touches.where(split).poses} for split in ("train", "test")
    )
    if touches.meta["cut"]["apart"]:
        assert not train & test
    else:  # there is room for one lattice only
        assert train == test
        assert all(
            room == 1 or (stride > 1 and room <= stride // 2)
            for room in (rows - window[0] + 1, columns - window[1] + 1)
        )


def test_what_is_cut_is_described_by_its_own_pad():
    whole = Pad(rows=16, columns=16, seam=None)
    scan = replace(array_scan(), meta={"pad": whole.model_dump(mode="json")})
    assert Pad.model_validate(cut(scan, 5, 4).about["pad"]) == Pad(
        rows=5, columns=4, seam=None, unread_columns=0
    )
    assert cut(array_scan(), 5, 4).about["pad"] is None


@pytest.mark.parametrize("window", [(17, 5), (0, 5), (5, -1)])
def test_a_window_that_does_not_fit_is_refused(window):
    with pytest.raises(InputError, match="cannot be cut from 16x16"):
        cut(array_scan(), *window)


@pytest.mark.parametrize("pitch", [1.9, 3.8])
def test_windows_with_a_missing_taxel_are_left_out(pitch):
    masked = (7, 100, *range(15, 256, 16))  # two taxels, and the last column whole
    size = {"pitch_x": pitch, "pitch_y": pitch}
    touches = cut(array_scan(missing=masked, **size), 5, 5, 1)
    whole = cut(array_scan(**size), 5, 5, 1)
    assert touches.meta["cut"]["missing"] == 2
    assert np.allclose(touches.taxel_xy, whole.taxel_xy)
    assert np.allclose(touches.readings, field(transform(touches.poses, touches.taxel_xy)))
    assert len(touches) < len(whole)


def test_an_array_without_a_whole_window_is_refused():
    with pytest.raises(InputError, match=r"no window of 5x5 taxels is whole.*8 of 64 taxels are missing"):
        cut(array_scan(8, 8, missing=range(3, 64, 8)), 5, 5)


def test_a_pad_with_a_seam_is_not_cut():
    one = np.array(["A"]), np.array(["train"])
    with pytest.raises(InputError, match="not evenly spaced"):
        cut(Scan(np.zeros((1, 36)), np.zeros((1, 3)), *one, Pad().taxel_xy), 3, 3)
