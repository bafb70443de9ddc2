"""Scans: what they hold, what is refused, and those that are made from arrays."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from scipy import stats

from tactsim.bench import formats
from tactsim.core import InputError, Pad, Scan, compose
from tactsim.core.making import names_of, readings_a_press, splits_of, train_on, without_poses
from tactsim.core.pad import offsets
from tactsim.core.poses import wrap_angle


@pytest.fixture
def scan():
    rng = np.random.default_rng(0)
    return Scan(
        readings=rng.normal(size=(6, 4)),
        poses=rng.normal(size=(6, 3)),
        labels=np.array(["A", "A", "E", "E", "A", "E"]),
        split=np.array(["train", "test"] * 3),
        taxel_xy=rng.normal(size=(4, 2)),
        meta={"seed": 3, "objects": {"A": {"symmetry": 1}}},
    )


def test_what_is_saved_is_loaded(scan, tmp_path):
    scan.save(tmp_path / "scan.npz")
    again = Scan.load(tmp_path / "scan.npz")
    for name in ("readings", "poses", "labels", "split", "taxel_xy"):
        assert np.array_equal(getattr(again, name), getattr(scan, name))
    assert again.meta == scan.meta


def test_the_file_holds_exactly_the_named_arrays_and_loads_without_pickle(scan, tmp_path):
    scan.save(tmp_path / "scan.npz")
    with np.load(tmp_path / "scan.npz", allow_pickle=False) as arrays:
        assert set(arrays) == {"readings", "poses", "labels", "split", "taxel_xy", "meta"}
        assert arrays["meta"].dtype.kind == "U"


def test_the_same_scan_gives_the_same_bytes(scan, tmp_path):
    scan.save(tmp_path / "a.npz")
    scan.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_the_digest_names_the_content(scan, tmp_path):
    scan.save(tmp_path / "scan.npz")
    assert Scan.load(tmp_path / "scan.npz").digest == scan.digest
    assert replace(scan).digest == scan.digest
    assert replace(scan, readings=scan.readings + 1e-12).digest != scan.digest
    assert replace(scan, labels=scan.labels[::-1].copy()).digest != scan.digest
    assert replace(scan, meta={}).digest != scan.digest


def test_equal_scans_have_equal_digests_however_wide_their_names_were_stored(scan):
    wide = replace(scan, labels=scan.labels.astype("U40"), split=scan.split.astype("U40"))
    assert wide.digest == scan.digest
    test = scan.where("test")
    alone = Scan(
        test.readings, test.poses, np.array(["A", "E", "E"]), np.array(["test"] * 3), scan.taxel_xy, scan.meta
    )
    assert test.digest == alone.digest


def test_selection_by_split_and_label_keeps_the_order(scan):
    chosen = scan.where(split="train", label="A")
    assert np.array_equal(chosen.readings, scan.readings[[0, 4]])
    assert chosen.letters == ("A",)
    assert scan.letters == ("A", "E")


def test_a_split_that_no_scan_has_is_refused(scan):
    with pytest.raises(InputError, match="unknown split 'tran': did you mean 'train'"):
        scan.where("tran")
    assert not len(scan.where("train", "Z"))


def test_letters_are_selected_in_the_order_of_the_readings(scan):
    assert np.array_equal(scan.of_letters(["E"]).readings, scan.readings[[2, 3, 5]])
    assert np.array_equal(scan.of_letters(["E", "A"]).readings, scan.readings)


def test_untrained_letters_keep_their_test_readings_only(scan):
    assert np.array_equal(scan.untrained(["A"]).readings, scan.readings[[1, 2, 3, 5]])
    assert np.array_equal(scan.untrained([]).readings, scan.readings)


def test_training_and_test_readings_of_two_scans_become_one(scan):
    both = scan.where("train").joined(scan.where("test"), meta={"from": "two"})
    assert np.array_equal(both.readings, np.concatenate([scan.readings[::2], scan.readings[1::2]]))
    assert both.meta == {"from": "two"}


def test_scans_of_different_pads_are_not_joined(scan):
    moved = replace(scan, taxel_xy=scan.taxel_xy + 0.1)
    with pytest.raises(InputError, match="different pads"):
        scan.joined(moved, meta={})


def test_the_arrays_cannot_be_changed_by_accident(scan):
    for name in ("readings", "poses", "labels", "split", "taxel_xy"):
        array = getattr(scan, name)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": np.zeros((5, 3))}, "poses has shape"),
        ({"readings": np.full((6, 4), np.nan)}, r"readings\[0, 0\] is nan"),
        ({"split": np.array(["train"] * 5 + ["dev"])}, "'dev'"),
        ({"labels": np.arange(6)}, "must be names"),
        ({"readings": np.zeros((6, 0)), "taxel_xy": np.zeros((0, 2))}, "no taxels"),
        ({"labels": np.array(["A"] * 5 + ["A\nB"])}, r"label 'A\\nB' is .* not printable"),
        ({"labels": np.array(["A"] * 5 + ["A" * 101])}, "too long"),
        ({"labels": np.full(6, 0x110000, "<u4").view("<U1")}, "labels are no text"),
        ({"meta": {"x": float("nan")}}, "meta is no JSON"),
    ],
)
def test_a_scan_that_does_not_fit_together_is_refused(scan, change, message):
    with pytest.raises(InputError, match=message):
        replace(scan, **change)


def test_training_on_one_scan_and_testing_on_another_uses_what_both_have(scan):
    # A recording of one split, with a taxel masked.
    masked = replace(
        scan, readings=scan.readings[:, [0, 2, 3]] + 1, split=["train"] * 6, taxel_xy=scan.taxel_xy[[0, 2, 3]]
    )
    both = train_on(scan, masked)
    assert both.readings.shape == (3 + 6, 3)
    assert np.array_equal(both.where("train").readings, scan.where("train").readings[:, [0, 2, 3]])
    assert np.array_equal(both.where("test").readings, masked.readings)
    assert np.array_equal(
        train_on(masked, scan).where("test").readings, scan.where("test").readings[:, [0, 2, 3]]
    )
    far = replace(scan, taxel_xy=scan.taxel_xy + 100)
    with pytest.raises(InputError, match="no taxel at the same place"):
        train_on(scan, far)


def test_what_the_training_scan_says_of_objects_holds_for_the_test_readings(scan):
    pressed = replace(scan, meta={"objects": {"A": {"symmetry": 2}}})
    recorded = replace(scan, meta={"objects": {"A": {"symmetry": 1}, "E": {"symmetry": 3}}})
    assert train_on(pressed, recorded).meta["objects"] == {"A": {"symmetry": 2}, "E": {"symmetry": 3}}
    assert train_on(recorded, replace(scan, meta={})).meta["objects"] == recorded.meta["objects"]


@pytest.fixture
def moving(scan):
    rng = np.random.default_rng(1)
    return replace(
        scan,
        sequence=rng.normal(size=(6, 5, 4)),
        sequence_times=np.arange(1, 6) / 200,
        sequence_force=rng.normal(size=(6, 5)),
    )


def test_a_sequence_is_saved_and_loaded(moving, tmp_path):
    moving.save(tmp_path / "scan.npz")
    again = Scan.load(tmp_path / "scan.npz")
    assert again.sequence.dtype == again.sequence_force.dtype == np.float32
    for name in ("readings", "sequence", "sequence_times", "sequence_force"):
        assert np.array_equal(getattr(again, name), getattr(moving, name))
    assert again.digest == moving.digest


def test_a_sequence_goes_with_its_readings(moving):
    rows = [0, 4]
    chosen = moving.where(split="train", label="A")
    assert np.array_equal(chosen.sequence, moving.sequence[rows])
    assert np.array_equal(chosen.sequence_force, moving.sequence_force[rows])
    assert np.array_equal(chosen.sequence_times, moving.sequence_times)
    assert np.array_equal(moving.of_letters(["E"]).sequence, moving.sequence[[2, 3, 5]])
    assert np.array_equal(moving.untrained(["A"]).sequence, moving.sequence[[1, 2, 3, 5]])
    fewer = replace(
        moving,
        readings=moving.readings[:, 1:],
        taxel_xy=moving.taxel_xy[1:],
        sequence=moving.sequence[:, :, 1:],
    )
    assert np.array_equal(moving.on_taxels_of(fewer).sequence, fewer.sequence)


def test_joined_sequences_hold_the_last_image_of_the_shorter(moving):
    short = replace(
        moving,
        sequence=moving.sequence[:, :3],
        sequence_times=moving.sequence_times[:3],
        sequence_force=moving.sequence_force[:, :3],
    )
    for one, other in ((moving, short), (short, moving)):
        both = one.joined(other, {})
        assert np.array_equal(both.sequence_times, moving.sequence_times)
        held = both.sequence[6:] if other is short else both.sequence[:6]
        assert np.array_equal(held[:, :3], short.sequence)
        assert np.array_equal(held[:, 3:], np.repeat(short.sequence[:, 2:], 2, axis=1))
        held = both.sequence_force[6:] if other is short else both.sequence_force[:6]
        assert np.array_equal(held[:, 4], short.sequence_force[:, 2])


def test_sequences_at_other_times_or_of_one_scan_alone_are_not_joined(scan, moving):
    assert moving.joined(scan, {}).sequence is None
    late = replace(moving, sequence_times=moving.sequence_times + 0.001)
    assert moving.joined(late, {}).sequence is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sequence_force": None}, "sequence without sequence_force"),
        ({"sequence": np.zeros((5, 5, 4))}, r"sequence has shape \(5, 5, 4\), not \(6, 5, 4\)"),
        ({"sequence_force": np.zeros((6, 4))}, "sequence_force has shape"),
        ({"sequence_times": np.zeros(5)}, "do not rise"),
    ],
)
def test_a_sequence_that_does_not_fit_is_refused(moving, change, said):
    with pytest.raises(InputError, match=said):
        replace(moving, **change)


@pytest.mark.parametrize(
    ("name", "values", "unsaid"),
    [
        ("loads", [1.0, 2.0, np.nan, 4.0, 5.0, 0.0], [np.nan] * 6),
        ("moments", [0.25, 1, 0.5, 1, 1, 0.75], [1] * 6),
        ("views", [0, 1, 1, 0, 2, 0], [0] * 6),
    ],
)
def test_what_is_said_of_each_reading_goes_with_it(scan, tmp_path, name, values, unsaid):
    known = replace(scan, **{name: values})
    known.save(tmp_path / "scan.npz")
    again = Scan.load(tmp_path / "scan.npz")
    np.testing.assert_array_equal(getattr(again, name), values)
    assert again.digest == known.digest != scan.digest
    np.testing.assert_array_equal(getattr(known.where("test"), name), values[1::2])
    np.testing.assert_array_equal(getattr(scan.joined(known, {}), name), unsaid + values)
    assert getattr(scan.joined(scan, {}), name) is None


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("loads", [1.0] * 5, "6 numbers, one a reading"),
        ("loads", [1.0, -2.0, np.nan, 1, 1, 1], "-2.0 N"),
        ("loads", [np.inf] * 6, "finite"),
        ("presses", [0.5] * 6, "6 whole numbers from 0 on"),
        ("presses", [-1] * 6, "6 whole numbers from 0 on"),
        ("presses", [2**64 - 1] * 6, "6 whole numbers from 0 on"),
        ("moments", [0.0] * 6, "moment"),
        ("moments", [1.1] * 6, "moment"),
        ("moments", [np.nan] * 6, "moment"),
    ],
)
def test_what_makes_no_sense_of_a_reading_is_refused(scan, name, values, said):
    with pytest.raises(InputError, match=said):
        replace(scan, **{name: values})


def test_readings_keep_the_number_of_their_press(scan, tmp_path):
    known = replace(scan, presses=[0, 0, 1, 1, 2, 9])
    known.save(tmp_path / "scan.npz")
    again = Scan.load(tmp_path / "scan.npz")
    assert again.presses.tolist() == [0, 0, 1, 1, 2, 9]
    assert again.digest == known.digest != scan.digest
    assert known.where(split="test").presses.tolist() == [0, 1, 9]
    # Presses of two scans are not taken for the same, and those of a scan that says nothing are each their own.
    assert known.joined(known, {}).presses.tolist() == [0, 0, 1, 1, 2, 9, 10, 10, 11, 11, 12, 19]
    assert scan.joined(known, {}).presses.tolist() == [0, 1, 2, 3, 4, 5, 6, 6, 7, 7, 8, 15]
    assert scan.joined(scan, {}).presses is None
    made = Scan.from_arrays(np.ones((2, 36)), np.zeros((2, 3)), ["A", "A"], presses=[3, 3], moments=[0.5, 1])
    assert (made.presses.tolist(), made.moments.tolist()) == ([3, 3], [0.5, 1.0])


def test_each_view_of_training_readings_gets_a_label_and_test_readings_keep_theirs(scan):
    assert scan.by_view() == (scan, {letter: letter for letter in scan.letters})
    readings, split = np.ones((5, 36)), ["train"] * 4 + ["test"]
    made = replace(
        Scan.from_arrays(readings, np.zeros((5, 3)), ["key", "key", "key", "pen", "key"], split),
        views=[4, 1, 4, 0, 3],
    )
    apart, object_of = made.by_view()
    assert apart.labels.tolist() == ["key, view 2", "key", "key, view 2", "pen", "key"]
    assert object_of == {"key": "key", "key, view 2": "key", "pen": "pen"}
    clash = replace(made, labels=np.array(["key", "key", "key", "key, view 2", "key"]))
    with pytest.raises(InputError, match="'key, view 2'"):
        clash.by_view()


def test_fewer_training_presses_are_whole_presses_and_among_those_of_a_larger_count():
    count = 40
    scan = Scan(
        readings=np.zeros((count, 4)), poses=np.zeros((count, 3)), labels=np.repeat(["A", "E"], count // 2),
        split=np.tile(["train"] * 3 + ["test"], count // 4), taxel_xy=np.zeros((4, 2)),
        meta={}, presses=np.arange(count) // 4,
    )  # fmt: skip
    before: set[int] = set()
    for presses in range(1, 6):
        fewer = scan.with_train_presses(presses, np.random.default_rng(7))
        train = fewer.where("train")
        kept = set(train.presses.tolist())
        assert before < kept
        assert [len(np.unique(train.where(label=label).presses)) for label in "AE"] == [presses] * 2
        assert len(train) == 3 * 2 * presses
        assert np.array_equal(fewer.where("test").presses, scan.where("test").presses)
        before = kept
    assert (
        replace(scan, presses=None)
        .with_train_presses(5, np.random.default_rng(7))
        .split.tolist()
        .count("train")
        == 10
    )
    with pytest.raises(InputError, match="A has 5 training presses; 6 are asked for"):
        scan.with_train_presses(6, np.random.default_rng(7))


def test_a_batch_holds_trials_as_a_run_draws_them():
    rng = np.random.default_rng(5)
    labels = np.array(["B", "A", "B", "C"] * 9)
    split = np.where(np.arange(36) % 3 == 0, "test", "train")
    poses = rng.uniform(-12, 12, (36, 3))
    scan = Scan(np.arange(36.0)[:, None] * np.ones(4), poses, labels, split, Pad(rows=2, columns=2).taxel_xy)
    (batch,) = islice(scan.batches(500, 3, np.random.default_rng(1)), 1)
    assert batch.readings.shape == (500, 3, 4)
    rows = batch.readings[..., 0].astype(int)
    assert (split[rows] == "train").all()
    assert (labels[rows] == np.array(scan.letters)[batch.letter][:, None]).all()
    assert all(len(set(trial)) == 3 for trial in rows.tolist()), "without replacement"
    back = compose(batch.robot_in_object[:, None], batch.sensor_in_robot)
    np.testing.assert_allclose(back[..., :2], poses[rows][..., :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angle(back[..., 2] - poses[rows][..., 2]), 0, atol=1e-9)
    reach = [offsets(scan.taxel_xy)] * 2 + [np.pi]
    for axis, most in enumerate(reach):
        uniform = stats.uniform(-most, 2 * most)
        assert stats.kstest(batch.robot_in_object[:, axis], uniform.cdf).pvalue > 1e-3
    assert stats.chisquare(np.bincount(batch.letter)).pvalue > 1e-3
    taken = np.bincount(rows.ravel(), minlength=36)[(split == "train") & (labels == "A")]
    assert stats.chisquare(taken).pvalue > 1e-3, "every reading of an object is as likely"
    (again,) = islice(scan.batches(500, 3, np.random.default_rng(1)), 1)
    assert (again.readings == batch.readings).all()


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


def test_a_scan_of_arrays_without_poses_says_that_nobody_noted_them():
    scan = Scan.from_arrays(FLAT, labels=list("AABB"), pad=PAD, presses=[0, 0, 1, 1])
    assert (scan.meta["poses"], scan.poses.tolist()) == ("unknown", np.zeros((4, 3)).tolist())
    assert Scan.from_arrays(FLAT, None, list("AABB"), pad=PAD, presses=[0, 0, 1, 1]).digest == scan.digest
    assert "poses" not in Scan.from_arrays(FLAT, np.zeros((4, 3)), list("AABB"), pad=PAD).meta
    with pytest.raises(InputError, match="labels are missing"):
        Scan.from_arrays(FLAT, pad=PAD)


@pytest.mark.parametrize("noted", [("train", "test"), ("train",), ("test",)])
def test_that_nobody_noted_poses_is_said_of_training_readings_of_another_scan_too(noted):
    poses = np.arange(12.0).reshape(4, 3) / 10
    halves = [
        Scan.from_arrays(FLAT, poses if split in noted else None, list("AABB"), [split] * 4, PAD)
        for split in ("train", "test")
    ]
    unposed = without_poses(train_on(*halves))
    assert unposed.meta["poses"] == unposed.meta["train"]["poses"] == "unknown"
    assert not unposed.poses.any()
    assert without_poses(unposed) is unposed
    assert unposed.about["train"]["frames"] == unposed.about["frames"]


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
    again = Scan.from_arrays(list(readings), np.zeros((4, 3)), list("AABB"), pad=PAD)  # a list of masked rows
    assert again.digest == scan.digest
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
    places = [(row, column) for row in range(2) for column in range(3)]
    for turn, levels in ((1, ["row", "col"]), (-1, ["col", "row"])):
        columns = pd.MultiIndex.from_tuples([place[::turn] for place in places], names=levels)
        levelled = pd.DataFrame(FLAT, columns=columns).iloc[:, order]
        assert Scan.from_arrays(levelled, poses, list("AABB"), pad=PAD).digest == scan.digest
    assert Scan.from_arrays(pa.Table.from_pandas(table), poses, list("AABB"), pad=PAD).digest == scan.digest
    unnamed = Scan.from_arrays(pd.DataFrame(FLAT), pd.DataFrame(np.zeros((4, 3))), list("AABB"), pad=PAD)
    assert np.array_equal(unnamed.readings, FLAT)
    numbered = pd.DataFrame(np.arange(24).reshape(4, 6)).astype("Int64").iloc[:, order]
    scan = Scan.from_arrays(numbered, poses, list("AABB"), pad=PAD)
    assert np.array_equal(scan.readings, np.arange(24).reshape(4, 6))


def test_columns_that_are_no_taxels_or_poses_are_one_line():
    table, poses = pd.DataFrame(FLAT, columns=[f"t{at}" for at in range(6)]), np.zeros((4, 3))
    with pytest.raises(InputError, match="are no taxels in an order"):
        Scan.from_arrays(table.rename(columns={"t3": "force"}), poses, list("AABB"), pad=PAD)
    degrees = pd.DataFrame(poses, columns=["x_mm", "y_mm", "theta_deg"])
    with pytest.raises(InputError, match="poses are x_mm, y_mm and theta_rad"):
        Scan.from_arrays(table, degrees, list("AABB"), pad=PAD)
    with pytest.raises(InputError, match="other indices"):
        Scan.from_arrays(table, poses, pd.Series(list("AABB"), index=[3, 2, 1, 0]), pad=PAD)


@pytest.mark.parametrize(
    ("read", "where"), [(Scan.load, "make one with"), (formats.read, "make a scan of it with")]
)
def test_a_recording_that_is_given_as_a_scan_is_told_what_makes_one_of_it(tmp_path, read, where):
    (tmp_path / "a.tactrec").write_bytes(b"\x89TACTREC\r\n\x1a\n\1\0")
    with pytest.raises(InputError, match=rf"{where} `bench replay {tmp_path}/a.tactrec --scan FILE`"):
        read(tmp_path / "a.tactrec")
