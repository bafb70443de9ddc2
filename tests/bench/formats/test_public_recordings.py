"""Public recordings: what is listed, and files of the same layouts, small and made here, as scans."""

import bz2
import hashlib
import io
import itertools
import json
import zipfile

import numpy as np
import pytest
import tomli_w
from command_line import refused
from PIL import Image
from scipy.io import savemat

from tactsim.bench.formats import public_recordings as public
from tactsim.core import InputError, Scan

RISE = np.array([0, 0, 0.5, 1, 1, 1, 0.5, 0, 0, 0.95])  # the last frame is of the next press


def trials(name, rng):
    """Press a pad four times: its readout has some columns in reverse."""
    images = rng.uniform(10, 90, (4, 16, 16))
    readout = images.copy()
    readout[..., 5:14] = readout[..., 13:4:-1]
    frames = 7 + readout.reshape(4, 256, 1) * RISE
    return {f"{name}_raster.mat": mat({"all_trials": frames})}, images.reshape(4, 256)


def grasps(name, rng):
    arrays = [rng.uniform(10, 90, (14 - number % 2, 6)) for number in range(6)]
    cell = np.empty((1, 6), dtype=object)
    for number, image in enumerate(arrays):
        cell[0, number] = 30 + image[..., None] * RISE
    filled = [np.vstack([image, np.zeros((14 - len(image), 6))]).ravel() for image in arrays]
    return {f"{name}/grasp-1.mat": mat({"TS": cell, "seqLength": len(RISE)})}, np.array(filled)


def dsa(name, rng):
    """Hold an object between the tips, arrays 1 and 5 of six; runs of zeros are one negative number."""
    tips = rng.integers(1, 4000, (2, 13, 6)) * (rng.random((2, 13, 6)) < 0.5)
    tips[:, 6, 2] = 1
    shapes = 3 * [(14, 6), (13, 6)]
    cells = {1: tips[0], 5: tips[1]}
    still = np.concatenate([cells.get(k, np.zeros(shape)).ravel() for k, shape in enumerate(shapes)])
    matrices = "".join(f"<matrix><cells_x>{b}</cells_x><cells_y>{a}</cells_y></matrix>" for a, b in shapes)
    frames = "".join(
        f"<frame><frame_data>\n  {np.array(list(runs(still * rise)), '>f4').tobytes().hex()}\n</frame_data></frame>"
        for rise in RISE
    )
    text = f'<?xml version="1.0"?><root><sensor>{matrices}</sensor>{frames}<joint_angles/></root>'
    return {f"{name}/{name}_0001-0009.dsa": bz2.compress(text.encode())}, tips.reshape(2, 78)


BARE = (
    b"<root>"
    + 3 * b"".join(b"<matrix><cells_x>6</cells_x><cells_y>%d</cells_y></matrix>" % rows for rows in (14, 13))
    + b"<frame_data>c3f30000</frame_data><frame_data>c3f28000</frame_data></root>"
)  # of 486 and 485 zeros


def runs(cells):
    """Give the cells with each run of zeros as its negative length."""
    for nothing, group in itertools.groupby(cells, lambda cell: cell == 0):
        alike = list(group)
        yield from [-len(alike)] if nothing else alike


def fingers(name, rng):
    """Close a hand whose fingers read less under load; angles and the largest of each finger stand between frames."""
    image = rng.integers(0, 90, (5, 12))
    lines = ["-10000"]
    for frame in 245 - np.rint(image * RISE[:, None, None] * 2):
        lines += ["21 79.7 13.8 47.5 33.4 57 36.2 55.5 -0.5", " ".join(map(str, 255 - frame.min(axis=1)))]
        lines += [" ".join(map(str, row)) for row in frame]
    return {f"{name}_7.txt": ("\n".join(lines) + "\n").encode()}, 2 * image.reshape(1, 60)


def images(names, rng):
    content, kept = io.BytesIO(), {}
    with zipfile.ZipFile(content, "w") as archive:
        for name in names:
            for number in (10, 9, 1, 2, 3):
                level = float(rng.integers(20, 200))
                kept[name, number] = level
                image = io.BytesIO()
                Image.fromarray(np.full((28, 50), level, np.uint8)).save(image, "JPEG", quality=100)
                archive.writestr(f"Images/{name}/{name}{number}.jpg", image.getvalue())
    return {"images.zip": content.getvalue()}, kept


def mat(arrays):
    content = io.BytesIO()
    savemat(content, arrays)
    return content.getvalue()


def described(like, files, **changes):
    """Describe files as one of the known recordings describes its own."""
    known = public.recordings()[like].model_dump(mode="json", exclude_none=True)
    known["pad"] |= {"no_seam": True}
    return (
        known
        | {"files": {path: hashlib.sha256(content).hexdigest() for path, content in files.items()}}
        | changes
    )


def laid(folder, files):
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    return folder


def scanned(like, files, **changes):
    return public.scan_of(
        public.Recording.model_validate(described(like, files, **changes)), iter(files.items())
    )


def test_a_press_is_the_rise_of_its_longest_plateau():
    files, readings = trials("X", np.random.default_rng(1))
    more, others = trials("triangle", np.random.default_rng(2))
    scan = scanned("dtmf7", files | more)
    assert np.allclose(scan.readings, np.vstack([readings, others]))
    assert scan.letters == ("cross", "triangle")
    assert scan.split.tolist() == 2 * ["train", "train", "test", "test"]
    assert scan.presses.tolist() == list(range(8))
    assert scan.meta["poses"] == "one"
    assert scan.meta["unit"] == "count"


def test_arrays_of_a_hand_are_readings_of_one_press():
    files, readings = grasps("DUCK", np.random.default_rng(3))
    more, others = grasps("BALL", np.random.default_rng(4))
    scan = scanned("schunk5", files | more)
    assert np.allclose(scan.readings, np.vstack([readings, others]))
    assert scan.labels.tolist() == 6 * ["DUCK"] + 6 * ["BALL"]
    assert scan.presses.tolist() == 6 * [0] + 6 * [1]
    assert scan.about["licence"] == "LicenseRef-st-hmp"


@pytest.mark.parametrize(("like", "made"), [("kiechle36", dsa), ("icub10", fingers)])
def test_fingers_of_a_grasp_are_read_less_what_they_read_at_rest(like, made):
    rng = np.random.default_rng(6)
    (files, readings), (more, others) = made("none", rng), made("tea_pot", rng)
    scan = scanned(like, files | more)
    assert np.allclose(scan.readings, np.vstack([readings, others]))
    none = "nothing" if like == "icub10" else "none"
    assert scan.labels.tolist() == len(readings) * [none] + len(readings) * ["tea_pot"]
    assert scan.presses.tolist() == len(readings) * [0] + len(readings) * [1]


def test_images_are_presses_in_the_order_of_their_numbers():
    files, levels = images(["key", "arm"], np.random.default_rng(5))
    scan = scanned("tekscan22", files)
    expected = [levels[name, number] for name in ("arm", "key") for number in (1, 2, 3, 9, 10)]
    assert np.allclose(scan.readings, np.array(expected)[:, None], atol=1)
    assert scan.split.tolist() == 2 * (4 * ["train"] + ["test"])
    assert scan.about["licence"] is None


@pytest.mark.parametrize(
    ("like", "files", "says"),
    [
        ("dtmf7", {"a_raster.mat": mat({"all_trials": np.ones((2, 256, 5))})}, "no rise"),
        ("dtmf7", {"a_raster.mat": b"cut short"}, "no whole MAT file"),
        ("schunk5", {"A/g.mat": mat({"TS": np.ones((2, 2))})}, "no 'TS{1}'"),
        ("kiechle36", {"A/g.dsa": b"BZh91AY&SY"}, "no whole file"),
        ("kiechle36", {"A/g.dsa": bz2.compress(b"<root><matrix/></root>")}, "no whole file"),
        ("kiechle36", {"A/g.dsa": bz2.compress(b"<root/>")}, "its arrays are []"),
        ("kiechle36", {"A/g.dsa": bz2.compress(BARE)}, "not of 486 cells"),
        ("icub10", {"A_1.txt": b"1 2 3 4 5 6 7\n"}, "no frames of 60 taxels"),
        ("tekscan22", {"i.zip": images([], np.random.default_rng(0))[0]["images.zip"]}, "no images"),
    ],
)
def test_files_of_another_layout_are_refused(like, files, says):
    with pytest.raises(InputError, match=next(iter(files)).split("/")[0]) as error:
        scanned(like, files)
    assert says in str(error.value)


def test_a_recording_is_got_from_a_folder(here, tmp_path, monkeypatch):
    """As a user calls it, with a list of our own: whole, then with a file that is not the one that is known."""
    files, readings = trials("X", np.random.default_rng(1))
    (tmp_path / "known.toml").write_text(tomli_w.dumps({"mine": described("dtmf7", files)}))
    monkeypatch.setattr(public, "KNOWN", tmp_path / "known.toml")
    laid(tmp_path / "there", files)
    got = here("data", "get", "mine", "--from", "there", "--out", "s.npz")
    assert got.returncode == 0, got.stderr
    assert np.allclose(Scan.load(tmp_path / "s.npz").readings, readings)
    refused(here("data", "get", "mine", "--from", "there", "--out", "s.npz"), "s.npz exists")
    (tmp_path / "there" / "X_raster.mat").write_bytes(b"other")
    refused(
        here("data", "get", "mine", "--from", "there", "--out", "t.npz"),
        "X_raster.mat",
        "SHA-256",
        "at commit",
    )
    assert not (tmp_path / "t.npz").exists()


@pytest.mark.parametrize("whole", [True, False])
def test_many_files_come_in_one_archive_and_without_it_one_by_one(tmp_path, monkeypatch, whole):
    files = {f"bolt/{number:02}.txt": bytes([number]) for number in range(80)}
    commit = "0" * 40
    address = f"https://raw.githubusercontent.com/she/grasps/{commit}/all%20of%20them/"
    known = public.Recording.model_validate(described("icub10", files, address=address))
    content, asked = io.BytesIO(), []
    with zipfile.ZipFile(content, "w") as archive:
        for path, inside in files.items():
            archive.writestr(f"grasps-{commit}/all of them/{path}", inside)

    def download(address, place):
        asked.append(address)
        if "codeload" in address:
            return content.getvalue() if whole else b"no archive"
        return files[address.partition("%20them/")[2]]

    monkeypatch.setattr(public, "_download", download)
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(tmp_path))
    assert dict(public.files_of("mine", known)) == files
    assert asked[0] == f"https://codeload.github.com/she/grasps/zip/{commit}"
    assert len(asked) == (1 if whole else 81)


def test_without_a_network_it_is_said_where_a_file_is_to_be_put(here, tmp_path, monkeypatch):
    """A port on which nothing listens stands for no network; a file that is put there is taken."""
    files, _ = trials("X", np.random.default_rng(1))
    known = described("dtmf7", files, address="http://127.0.0.1:9/some%20folder/")
    (tmp_path / "known.toml").write_text(tomli_w.dumps({"mine": known}))
    monkeypatch.setattr(public, "KNOWN", tmp_path / "known.toml")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(tmp_path / "kept"))
    place = tmp_path / "kept" / "recordings" / "mine" / "X_raster.mat"
    refused(
        here("data", "get", "mine"),
        "http://127.0.0.1:9/some%20folder/X_raster.mat",
        f"put it at {place}",
        "--from",
    )
    laid(place.parent, files)
    assert here("data", "get", "mine").returncode == 0
    assert len(Scan.load(tmp_path / "mine.npz")) == 4


def test_what_is_known_is_listed_and_names_are_checked(here):
    known = json.loads(here("data", "--json").stdout)
    assert [len(one["files"]) for one in known.values()] == [7, 1, 51, 856, 200]
    assert all(one["commit"] in one["address"] for one in known.values())
    refused(here("data", "get", "dtmf8"), "dtmf8", "dtmf7")
    refused(here("data", "got", "dtmf7"), "bench data get NAME")


def prepared(monkeypatch, folder, like, files, **how):
    """Describe a recording with a scan for trials, mine-v1, whose files are kept here."""
    known = described(like, files, scans={"mine-v1": how})
    (folder / "known.toml").write_text(tomli_w.dumps({"mine": known}))
    monkeypatch.setattr(public, "KNOWN", folder / "known.toml")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(folder / "kept"))
    laid(folder / "kept" / "recordings" / "mine", files)


def test_moments_of_training_presses_and_light_test_presses(tmp_path, monkeypatch):
    files, images = trials("X", np.random.default_rng(1))
    prepared(monkeypatch, tmp_path, "dtmf7", files, shares=[0.5, 1.0], test_share=0.5)
    scan = public.prepared_scan("mine-v1", 0)
    assert scan.moments.tolist() == [0.5, 1, 0.5, 1, 0.5, 0.5]
    assert scan.split.tolist() == ["train"] * 4 + ["test"] * 2
    assert scan.presses.tolist() == [0, 0, 1, 1, 2, 3]
    assert np.allclose(scan.readings, scan.moments[:, None] * images[scan.presses])
    assert public.prepared_scan("mine-v1", 3).digest == scan.digest


def test_each_seed_leaves_out_another_grasp_of_each_object(tmp_path, monkeypatch):
    rng, files = np.random.default_rng(3), {}
    for name, count in (("BALL", 3), ("DUCK", 2)):
        for number in range(count):
            files[f"{name}/grasp-{number}.mat"] = grasps(name, rng)[0][f"{name}/grasp-1.mat"]
    prepared(monkeypatch, tmp_path, "schunk5", files, folds=3)
    left_out = [
        np.unique(public.prepared_scan("mine-v1", seed).where("test").presses).tolist() for seed in range(4)
    ]
    assert left_out == [[0, 3], [1, 4], [2, 3], [0, 4]]


def test_a_task_on_a_recording_says_how_to_get_it_and_is_run(here, tmp_path, monkeypatch):
    files, _ = trials("X", np.random.default_rng(1))
    more, _ = trials("triangle", np.random.default_rng(2))
    prepared(monkeypatch, tmp_path, "dtmf7", files | more, cut=[5, 5], stride=4)
    kept = tmp_path / "kept" / "recordings" / "mine"
    kept.rename(tmp_path / "there")
    (tmp_path / "mine-v1.toml").write_text(
        'line = "Two patterns."\nseeds = [0, 1, 2, 3, 4]\ntrials = 2\nreadings = 3\nscored = ["accuracy@3"]\n'
        '[words]\nscan = "recording:mine-v1"\n'
    )
    words = ("run", "--task", "mine-v1.toml", "--estimator", "nearest", "--json")
    refused(
        here(*words), "mine-v1 is made of the public recording mine", "`bench data get mine`", "--from FOLDER"
    )
    assert here("data", "get", "mine", "--from", "there", "--out", "whole.npz").returncode == 0
    done = here(*words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["letters"] == ["cross", "triangle"]
