"""Whose a scan is, what it says of itself, and what the hash of a result's source depends on."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tactsim
from tactsim.bench import formats
from tactsim.core import InputError, Scan
from tactsim.core.making import train_on
from tactsim.core.provenance import OWN_LICENCE
from tactsim.core.source_digest import git_commit, source_digest
from tactsim.press import ScanOptions, scan_letters


def scan_with(meta, split=("train", "test")):
    return Scan(
        np.ones((2, 4)), np.zeros((2, 3)), np.array(["A", "B"]), np.array(split), np.zeros((4, 2)), meta
    )


def test_a_scan_that_says_nothing_is_in_kpa_and_has_no_licence():
    about = scan_with({}).about
    assert about["units"]["readings"] == "kPa"
    assert (about["licence"], about["pad"], about["source"], about["seed"], about["train"]) == (None,) * 5
    assert about["frames"]["poses"].startswith("sensor_in_object")


def test_of_poses_that_nobody_noted_it_is_said_what_they_are():
    frames = scan_with({"poses": "unknown"}).about["frames"]
    assert frames["poses"].startswith("how readings of a press lie to each other")


@pytest.mark.parametrize("unit", ["kpa", None, ["kPa"], "x" * 1000])
def test_an_unknown_unit_is_one_line(unit):
    with pytest.raises(
        InputError, match=r"the unit of the readings is .* known are kPa, N, V, count"
    ) as refused:
        scan_with({"unit": unit})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("poses", ["unkown", "none", "", True, ["unknown"], "x" * 1000])
def test_poses_that_are_called_otherwise_than_unknown_are_one_line(poses):
    with pytest.raises(InputError, match=r"meta\['poses'\] is .*; say 'unknown'") as refused:
        scan_with({"poses": poses})
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300
    with pytest.raises(InputError, match="say 'unknown'"):
        scan_with({"train": {"poses": poses}})
    for known in ("unknown", "one"):
        assert scan_with({"poses": known}).meta["poses"] == known


@pytest.mark.parametrize("licence", ["", "CC-BY", "x" * 101, "MIT\n", 3, "MIT and more"])
def test_a_licence_that_is_stated_is_on_the_list_of_spdx(licence):
    with pytest.raises(InputError, match="is no SPDX name; give one of") as caught:
        scan_with({}).licensed(licence)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="is no SPDX name"):
        Scan.from_arrays(np.zeros((1, 36)), np.zeros((1, 3)), ["A"], licence=licence)


@pytest.mark.parametrize(
    ("stated", "written"),
    [
        ("cc0-1.0", "CC0-1.0"),
        ("MIT OR apache-2.0", "MIT OR Apache-2.0"),
        ("LicenseRef-ours", "LicenseRef-ours"),
    ],
)
def test_a_licence_is_written_as_spdx_writes_it(stated, written):
    scan = scan_with({}).licensed(stated)
    assert scan.about["licence"] == written
    assert scan.licensed(stated).about["licence"] == written


def test_a_scan_under_an_odd_licence_is_still_read(tmp_path):
    scan_with({"licence": "as is"}).save(tmp_path / "scan.npz")
    assert Scan.load(tmp_path / "scan.npz").about["licence"] == "as is"


def test_readings_of_two_units_are_not_joined():
    with pytest.raises(InputError, match=r"different units .*: kPa and N"):
        scan_with({}).joined(scan_with({"unit": "N"}), {})


def test_a_pressed_scan_says_how_it_was_made_and_whose_it_is(tmp_path):
    size = 'xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8" width="8mm" height="8mm"'
    drawing = f'<svg {size}><path d="M0 0h8v8h-8z"/></svg>'
    (tmp_path / "own.svg").write_text(drawing)
    options = ScanOptions(letters=("I",), seed=7)
    about = scan_letters(options)[0].about
    assert (about["source"], about["licence"], about["seed"]) == ("simulated", OWN_LICENCE, 7)
    assert {"tactsim", "mujoco", "numpy"} <= about["versions"].keys()
    assert about["pad"] == options.pad.model_dump(mode="json")
    own = options.model_copy(update={"letters": (), "shapes": (str(tmp_path / "own.svg"),)})
    assert scan_letters(own)[0].about["licence"] is None


@pytest.mark.long
@pytest.mark.parametrize("value", ["lost", {"a": [1]}])
def test_what_a_stranger_wrote_there_is_left_out_and_breaks_no_card(value, tmp_path):
    names = ("versions", "options", "train", "recordings", "source", "pad")
    for name in names:
        json.dumps(scan_with({name: value}).about)
    scan = scan_with(dict.fromkeys(names, value))
    formats.write(scan, tmp_path / "parquet", "parquet")
    assert formats.read(tmp_path / "parquet").digest == scan.digest


def test_training_readings_of_another_scan_speak_for_themselves():
    recorded = scan_with({"source": "recorded", "licence": "CC0-1.0"}, ("test", "test"))
    pressed = scan_with({"source": "simulated", "licence": "CC-BY-4.0"}, ("train", "train"))
    about = train_on(pressed, recorded).about
    assert (about["source"], about["train"]["source"]) == ("recorded", "simulated")
    assert (about["licence"], about["train"]["licence"]) == ("CC0-1.0", "CC-BY-4.0")


@pytest.fixture
def digest_of(tmp_path):
    """Hash the source of a module in a process that sees a copy of tactsim and, before it, a plug-in's package."""
    rooms = Path(tactsim.__file__).parent
    copy = tmp_path / "tactsim"
    copy.mkdir()
    for name in ("core", "models"):
        (copy / name).symlink_to((rooms / name).resolve())
    (copy / "__init__.py").write_text("")
    plug_in = tmp_path / "my_touch"
    (plug_in / "inner").mkdir(parents=True)
    for name in ("__init__", "main", "inner/__init__", "inner/deep"):
        (plug_in / f"{name}.py").write_text("VALUE = 1\n")
    code = "import sys; from tactsim.core.source_digest import source_digest; print(source_digest(*sys.argv[1:]))"

    def digest(*modules):
        words = [sys.executable, "-c", code, *modules]
        environment = {"PYTHONPATH": str(tmp_path)}
        done = subprocess.run(
            words, capture_output=True, text=True, check=True, env=environment, cwd=tmp_path
        )
        return done.stdout

    return digest


def test_any_edit_of_the_package_counts_and_undoing_it_too(digest_of, tmp_path):
    before = digest_of()
    assert digest_of() == before
    path = tmp_path / "tactsim" / "__init__.py"
    path.write_text("# a comment\n")
    after = digest_of()
    assert after != before
    path.rename(path.with_name("other.py"))  # the same bytes under another name
    path.write_text("")
    assert digest_of() not in (before, after)
    path.with_name("other.py").unlink()
    assert digest_of() == before


def test_files_of_a_linked_room_count(digest_of, tmp_path):
    before = digest_of()
    (tmp_path / "tactsim" / "models").unlink()
    assert digest_of() != before


def test_a_plug_ins_whole_package_counts_for_what_it_makes(digest_of, tmp_path):
    before, others = digest_of("my_touch.main"), digest_of()
    (tmp_path / "my_touch" / "inner" / "deep.py").write_text("VALUE = 10\n")
    assert digest_of("my_touch.main") != before
    assert digest_of() == others


def test_the_commit_is_that_of_the_checkout():
    def git(*words):
        return subprocess.run(["git", *words], cwd=Path(__file__).parent, capture_output=True, text=True)

    head = git("rev-parse", "HEAD")
    wanted = head.stdout.strip() if head.returncode == 0 else None
    commit = git_commit()
    assert (commit and commit.removesuffix("-changed")) == wanted


def test_a_module_without_a_file_counts_by_its_name():
    assert source_digest("no_such_module_anywhere") != source_digest("nor_this_one")
