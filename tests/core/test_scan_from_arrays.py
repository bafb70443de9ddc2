import numpy as np
import pandas as pd
import pytest

from tactsim.core import InputError, Pad, Scan
from tactsim.core.scan import names_of, readings_a_press, splits_of

PAD = Pad(rows=2, columns=3, seam=None)
FLAT = np.arange(24.0).reshape(4, 6)


def test_a_scan_of_arrays_says_where_it_is_from():
    scan = Scan.from_arrays(FLAT, np.zeros((4, 3)), list("AABB"), pad=PAD, unit="count", licence="CC0-1.0")
    assert np.array_equal(scan.readings, FLAT)
    assert np.array_equal(scan.taxel_xy, PAD.taxel_xy)
    assert scan.split.tolist() == ["train"] * 4
    about = scan.about
    assert (about["source"], about["licence"], about["units"]["readings"]) == ("imported", "CC0-1.0", "count")
    assert Pad.model_validate(about["pad"]) == PAD
    assert Scan.from_arrays(np.zeros((1, 36)), np.zeros((1, 3)), ["A"]).about["licence"] is None


@pytest.mark.parametrize("shape", [(4, 6), (4, 2, 3)])
def test_pictures_of_the_pad_are_put_in_a_row(shape):
    assert np.array_equal(readings_a_press(FLAT.reshape(shape), PAD), FLAT)


@pytest.mark.parametrize("shape", [(4, 5, 6), (4, 5, 2, 3)])
def test_several_images_of_a_press_are_averaged_and_that_is_said(shape, caplog):
    images = FLAT[:, None] + np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[None, :, None]
    assert np.array_equal(readings_a_press(images.reshape(shape), PAD), FLAT)
    said = "each reading is the mean of 5 images of its press; of taxels with several axes give one"
    assert caplog.messages == [said]


@pytest.mark.parametrize("shape", [(4, 5), (24,), (4, 3, 2), (4, 0, 6)])
def test_readings_of_another_shape_are_one_line(shape):
    with pytest.raises(InputError, match=r"a pad of 2x3 taxels asks for \(presses, 6\)") as error:
        readings_a_press(np.zeros(shape), PAD)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "names"),
    [
        (["A", " B ", "Ü"], ["A", "B", "Ü"]),
        ([3, -1, 0], ["3", "-1", "0"]),
        ([[1.0], [2.0]], ["1", "2"]),
        ([], []),
        ([b"bolt", "Mutter größer".encode()], ["bolt", "Mutter größer"]),
        (np.array(["bolt", b"nut"], dtype=object), ["bolt", "nut"]),
    ],
)
def test_names_are_texts_or_whole_numbers(values, names):
    assert names_of(np.array(values), "labels").tolist() == names


@pytest.mark.parametrize("values", [[1.5], [np.nan], [1e300], [None], [b"\xff"], np.zeros((2, 2))])
def test_what_names_nothing_is_refused(values):
    with pytest.raises(InputError, match=r"labels (are|hold)"):
        names_of(values, "labels")


@pytest.mark.parametrize("values", [["train", "test"], [True, False], [1, 0], [[1.0], [0.0]]])
def test_a_split_is_named_or_says_whether_to_train(values):
    assert splits_of(values, 2).tolist() == ["train", "test"]


@pytest.mark.parametrize("values", [[0.5, 1], [None, None]])
def test_a_split_of_anything_else_is_refused(values):
    with pytest.raises(InputError, match=r"the split is neither|hold None, which is no text"):
        splits_of(values, 2)


def test_angles_in_degrees_are_refused_and_places_in_metres_are_said(caplog):
    poses = np.array([[0.01, 0.02, 0.5], [0.03, -0.01, 1.0], [0.0, 0.015, -3.0]])
    readings, labels = np.ones((3, PAD.taxels)), ["A", "B", "A"]
    with pytest.raises(InputError, match=r"poses turn by 180.*are these degrees"):
        Scan.from_arrays(readings, [[1, 2, 0], [3, 4, 90], [5, 6, 180]], labels, pad=PAD)
    for places, said in ((1, True), (1000, False), (0, False)):
        caplog.clear()
        Scan.from_arrays(readings, poses * [places, places, 1], labels, pad=PAD)
        assert ("in metres" in caplog.text) is said


def test_what_numpy_masks_is_left_out():
    readings = np.ma.masked_equal(np.where(FLAT == 8, -9999, FLAT).astype(int), -9999)
    scan = Scan.from_arrays(readings, np.zeros((4, 3)), list("AABB"), pad=PAD)
    assert list(scan.meta["left_out"]) == ["2"]
    assert np.array_equal(scan.readings, np.delete(FLAT, 2, axis=1))
    loads = np.ma.masked_equal([1, 2, -1, 4], -1)
    scan = Scan.from_arrays(FLAT, np.zeros((4, 3)), list("AABB"), pad=PAD, loads=loads)
    assert np.array_equal(scan.loads, [1, 2, np.nan, 4], equal_nan=True)


def test_masked_poses_and_names_are_one_line():
    poses = np.ma.masked_equal(np.where(np.arange(12).reshape(4, 3) == 5, -9999, 0), -9999)
    with pytest.raises(InputError, match=r"poses\[1, 2\] is nan"):
        Scan.from_arrays(FLAT, poses, list("AABB"), pad=PAD)
    with pytest.raises(InputError, match="labels are masked in 1 places"):
        Scan.from_arrays(FLAT, np.zeros((4, 3)), np.ma.array(list("AABB"), mask=[0, 0, 1, 0]), pad=PAD)


@pytest.mark.parametrize("names", [("t{}",), ("r{}c{}",), ("x{1}y{0}",)])
def test_columns_of_a_table_go_by_their_names(names):
    names = [names[0].format(row, column) for row in range(2) for column in range(3)]
    names = [f"t{at}" for at in range(6)] if names[0] == "t0" else names
    order = np.random.default_rng(0).permutation(6)
    table = pd.DataFrame(FLAT, columns=names).iloc[:, order]
    poses = pd.DataFrame({"theta_rad": np.ones(4), "y_mm": np.full(4, 2.0), "x_mm": np.full(4, 3.0)})
    scan = Scan.from_arrays(table, poses, pd.Series(list("AABB")), pad=PAD)
    assert np.array_equal(scan.readings, FLAT)
    assert np.array_equal(scan.poses, np.tile([3.0, 2.0, 1.0], (4, 1)))
    unnamed = Scan.from_arrays(pd.DataFrame(FLAT), pd.DataFrame(np.zeros((4, 3))), list("AABB"), pad=PAD)
    assert np.array_equal(unnamed.readings, FLAT)


def test_columns_that_are_no_taxels_or_poses_are_one_line():
    table, poses = pd.DataFrame(FLAT, columns=[f"t{at}" for at in range(6)]), np.zeros((4, 3))
    with pytest.raises(InputError, match="are no taxels in an order"):
        Scan.from_arrays(table.rename(columns={"t3": "force"}), poses, list("AABB"), pad=PAD)
    degrees = pd.DataFrame(poses, columns=["x_mm", "y_mm", "theta_deg"])
    with pytest.raises(InputError, match="poses are x_mm, y_mm and theta_rad"):
        Scan.from_arrays(table, degrees, list("AABB"), pad=PAD)
    with pytest.raises(InputError, match="other indices"):
        Scan.from_arrays(table, poses, pd.Series(list("AABB"), index=[3, 2, 1, 0]), pad=PAD)
