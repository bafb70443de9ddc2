"""Which labels a run tries: letters, shapes beside them or alone, and what a file calls its objects."""

from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

import tactsim
from tactsim import models
from tactsim.core import Pad
from tactsim.core.pad import offsets

WORDS = {"estimator": "histogram", "bins": 100, "trials": 1, "readings": 3}


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    """Write a bar and a plate as files."""
    folder = tmp_path_factory.mktemp("shapes")
    for name, size in (("bar", (22, 7, 4)), ("plate", (15, 12, 4))):
        models.export(models.relief(name, Manifold.cube(size, True)), folder / f"{name}.stl")
    return [folder / "bar.stl", folder / "plate.stl"]


def test_shapes_beside_letters_that_are_named_are_tried(shapes):
    assert tactsim.run(letters="A", shapes=shapes, **WORDS).letters == ["A", "bar", "plate"]


def test_shapes_are_pressed_without_a_letter_and_known_when_recorded(shapes, tmp_path):
    scan = tactsim.scan(letters="none", shapes=shapes)
    assert scan.letters == ("bar", "plate")
    scan.save(tmp_path / "pressed.npz")
    replace(scan, meta={}).where("test").save(tmp_path / "recorded.npz")
    files = {"scan": tmp_path / "recorded.npz", "train_scan": tmp_path / "pressed.npz"}
    run = tactsim.run(**files, **WORDS)
    assert run.letters == ["bar", "plate"]
    assert run.objects["bar"].symmetry == 2
    assert tactsim.run(**files, letters="plate", **WORDS).letters == ["plate"]
    with pytest.raises(tactsim.InputError, match="unknown letter of the scan 'bolt'"):
        tactsim.run(**files, letters="plate,bolt", **WORDS)


def test_a_file_s_label_goes_before_the_letters_that_it_spells(shapes, tmp_path):
    scan = tactsim.scan("AT")
    labels = np.array([{"A": "A", "T": "AT"}[label] for label in scan.labels.tolist()])
    path = tmp_path / "labels.npz"
    replace(scan, labels=labels, meta={}).save(path)
    assert tactsim.run(scan=path, letters="AT", **WORDS).letters == ["AT"]
    assert tactsim.run(scan=path, letters="AT,A", **WORDS).letters == ["AT", "A"]
    scan.save(tmp_path / "letters.npz")
    assert tactsim.run(scan=tmp_path / "letters.npz", letters="TA", **WORDS).letters == ["T", "A"]


def test_a_pad_and_shapes_twice_as_large_are_pressed_and_hidden_twice_as_far(shapes, tmp_path):
    pad = Pad(pitch_x=3.8, pitch_y=3.8, taxel_width=3.6, taxel_height=3.6, seam=0.8)
    models.export(models.relief("bar", Manifold.cube((44, 14, 8), True)), tmp_path / "bar.stl")
    firm = {"press.force": 8.0, "press.wrist_stiffness": 2400.0}
    large = tactsim.scan(
        letters="none", shapes=tmp_path / "bar.stl", scan_set={"pad": pad.model_dump(), **firm}
    )
    small = tactsim.scan(letters="none", shapes=shapes[0])
    assert large.where("train").poses[:, :2] == pytest.approx(2 * small.where("train").poses[:, :2])
    assert large.where("test").poses[:, :2] == pytest.approx(2 * small.where("test").poses[:, :2])
    assert offsets(pad.taxel_xy) == pytest.approx(20.0)
    hidden = [tactsim.run(scan, **WORDS).trials.true_pose[..., :2] for scan in (small, large)]
    assert hidden[1] == pytest.approx(2 * hidden[0])
