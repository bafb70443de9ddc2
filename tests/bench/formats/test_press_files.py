"""Folders of frames, a press in each file, in the forms in which people publish them."""

import json

import numpy as np
import pytest
from command_line import refused
from made_scans import as_matlab_saves
from scipy.io import savemat

from tactsim.bench.formats.press_files import read_press_folder
from tactsim.core import InputError, Pad, Scan

PAD = Pad(rows=4, columns=6, seam=None, unread_columns=0)
# Of a press: idle, two frames under load, idle again. Counts, so that texts say them whole.
LOADED = np.random.default_rng(0).permuted(np.tile(np.arange(24) * 4, (2, 1)), axis=1)
FRAMES = np.concatenate([np.zeros((3, 24), int), LOADED, np.ones((2, 24), int)])


def lines(rows, mark=","):
    return "".join(mark.join(map(str, row)) + "\n" for row in rows)


def several_lines(head=""):
    """Write frames of four lines, each below a line of other numbers, as a hand's joints."""
    return head + "".join("1.5 2.5 3.5 4.5 5.5\n" + lines(frame.reshape(4, 6), " ") for frame in FRAMES)


TEXTS = {
    "a line a frame, tabs, no title": lines(FRAMES, "\t"),
    "a shape above": "shape,4,6\n" + lines(FRAMES),
    "a clock before": lines(np.column_stack([np.arange(7) * 0.1 + 1.7e9, FRAMES]), ";"),
    "a title, and a comma behind": "".join(f"t{k}," for k in range(24)) + "\n" + lines(FRAMES).replace("\n", ",\n"),
    "four lines a frame": several_lines("-10000\n"),
    "four lines a frame, nothing between": lines(FRAMES.reshape(-1, 6)),
    "a time of day before": "".join(f"2026-11-28 12:00:0{at}.5," + lines([row]) for at, row in enumerate(FRAMES)),
    "as NumPy prints pictures": "".join(f"{frame.reshape(4, 6)}\n" for frame in FRAMES),
    "as NumPy parts long rows": "".join(f"{np.array2string(frame, 40)}\n" for frame in FRAMES),
    "bars": "| " + lines(FRAMES, " | ").replace("\n", " |\n| "),
    "lists over many lines": json.dumps(FRAMES.tolist(), indent=1),
    "nested lists": "".join(f"{frame.reshape(4, 6).tolist()}\n" for frame in FRAMES),
    "a line a taxel, named": "taxel,f0\n" + "".join(f"t{at}," + lines([row]) for at, row in enumerate(FRAMES.T)),
    "a line a taxel": "node_id," + ",".join(f"frame{k}" for k in range(7)) + "\n"
    + lines(np.column_stack([np.arange(24), FRAMES.T])),
}  # fmt: skip


@pytest.mark.parametrize("form", TEXTS)
def test_a_press_reads_its_loaded_frames_in_whatever_form_they_stand(tmp_path, form):
    (tmp_path / "nut07.txt").write_text(TEXTS[form])
    scan = read_press_folder(tmp_path, PAD, "count")
    assert scan.readings == pytest.approx(LOADED.mean(axis=0)[None])
    assert (scan.labels.tolist(), scan.meta["poses"]) == (["nut"], "unknown")


def test_arrays_are_read_one_a_file_or_one_a_press(tmp_path):
    np.save(tmp_path / "bolt_1.npy", FRAMES.reshape(7, 4, 6))
    np.savez(tmp_path / "bolt_2.npz", frames=FRAMES)
    savemat(tmp_path / "more.mat", {"Nut_1_1": FRAMES, "Nut_1_2": 2 * FRAMES, "other": np.ones((3, 5))})
    scan = read_press_folder(tmp_path, PAD, "count")
    assert scan.labels.tolist() == ["bolt", "bolt", "Nut", "Nut"]
    assert scan.readings == pytest.approx(np.outer([1, 1, 1, 2], LOADED.mean(axis=0)))


def test_long_lines_of_a_mat_in_folders_become_a_scan(here, tmp_path):
    """Lines of 2,048 numbers, a folder a person, mmHg: what is to test with is said by its folder."""
    rng = np.random.default_rng(1)
    for person in ("S1", "S2"):
        (tmp_path / "data" / person).mkdir(parents=True)
        for posture in (1, 2, 10):
            image = 100 * (np.arange(2048) % 32 // 11 == posture % 3) + rng.integers(1000, 1010, (5, 2048))
            (tmp_path / "data" / person / f"{posture}.txt").write_text(lines(image, "\t"))
        (tmp_path / "data" / "about.csv").write_text("person,kg\nS1,70\n")
    (tmp_path / "mat.toml").write_text(
        "rows = 64\ncolumns = 32\nno_seam = true\npitch_x = 25.0\npitch_y = 25.0\n"
    )
    words = (
        "import",
        "data",
        "--pad",
        "mat.toml",
        "--unit",
        "mmHg",
        "--labels",
        "name",
        "--files",
        "*/*.txt",
    )
    assert here(*words, "--test", "S2/*", "--zero", "off", "--out", "scan.npz").returncode == 0
    scan = Scan.load(tmp_path / "scan.npz")
    assert scan.labels.tolist() == ["1", "2", "10"] * 2
    assert scan.split.tolist() == ["train"] * 3 + ["test"] * 3
    assert scan.readings.min() == pytest.approx(1000 * 0.13332, rel=0.01)
    refused(here(*words, "--test", "S9/*", "--out", "no.npz"), "--test S9/*")
    refused(here(*words, "--test", "50%", "--test", "S2/*", "--out", "no.npz"), "give one share")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.txt", lines(FRAMES.reshape(-1, 6)[:-1]), "27 lines of 6 numbers follow each other"),
        ("a.txt", "1 2 3 4 5 6 7\n" * 4, "lines have 7 numbers, no frames of 24 taxels"),
        ("a.txt", "nothing\n", "lines such as 'nothing' have no numbers"),
        ("a.npy", "text", "whole .npz file|no header"),
    ],
)
def test_frames_that_do_not_fit_are_refused_with_their_file(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_press_folder(tmp_path, PAD, "count")
    assert name in str(error.value)


def test_the_last_presses_of_each_object_are_left_to_test(here, tmp_path):
    for label in ("nut", "bolt"):
        for number in range(1, 5):
            (tmp_path / "all").mkdir(exist_ok=True)
            (tmp_path / "all" / f"{label}{number}.csv").write_text(lines(number * FRAMES))
    (tmp_path / "pad.toml").write_text("rows = 4\ncolumns = 6\nno_seam = true\nunread_columns = 0\n")
    words = ("import", "all", "--pad", "pad.toml", "--unit", "count", "--zero", "off", "--out", "scan.npz")
    assert here(*words, "--test", "25%").returncode == 0
    scan = Scan.load(tmp_path / "scan.npz")
    assert scan.where("test").readings.sum() == pytest.approx(8 * LOADED.mean(axis=0).sum())
    (tmp_path / "scan.npz").unlink()
    refused(here(*words, "--labels", "colour"), "say folder or name")
    refused(here(*words, "--test", "100%"), "too few presses")


HALVES = np.arange(24) * 3.5 + 0.5  # of a press's plateau
PRESS = np.outer([0, 0, 1, 1, 1, 0, 0], HALVES)


def decimal_commas(mark, clock=False, lines_a_frame=1):
    rows = PRESS.reshape(7 * lines_a_frame, -1)
    rows = np.column_stack([np.arange(7) * 0.04, PRESS]) if clock else rows
    return lines(rows, mark).replace(".", ",")


@pytest.mark.parametrize(
    "text",
    [
        decimal_commas(";"),
        decimal_commas("\t"),
        decimal_commas(" "),
        decimal_commas(";", clock=True),
        decimal_commas(";", lines_a_frame=4),
        lines(PRESS.astype(str), '","').replace("\n", '"\n"')[:-1],
        lines(PRESS).replace("28.5", "nan", 1),
        lines(PRESS).replace("28.5", "inf", 1),
        lines(PRESS).replace("28.5", "", 1),
        *(lines(PRESS).replace("28.5", word, 1) for word in ("n/a", "#DIV/0!", "-", "null", "B")),
        "".join(",".join(f"{number:.3E}".replace("E", "D") for number in row) + "\n" for row in PRESS),
    ],
)
def test_decimal_commas_quotes_and_words_for_no_number_make_no_other_numbers(tmp_path, text):
    (tmp_path / "nut1.csv").write_text('"' * text.startswith('0.0"') + text)
    assert read_press_folder(tmp_path, PAD, "count").readings == pytest.approx(HALVES[None])


def test_thousands_in_frames_are_whole_and_what_reads_both_ways_is_refused(tmp_path):
    whole = np.outer([0, 1, 1, 0], np.arange(24) * 137)
    (tmp_path / "nut1.csv").write_text("".join(";".join(f"{n:,}" for n in row) + "\n" for row in whole))
    assert read_press_folder(tmp_path, PAD, "count").readings == pytest.approx(whole[1:2])
    for marks in ({}, {44: ".", 46: ","}):  # 1,234.5 and 1.234,5
        rows = ("\t".join(f"{n + 0.5:,}".translate(marks) for n in row) + "\n" for row in whole)
        (tmp_path / "nut1.csv").write_text("".join(rows))
        assert read_press_folder(tmp_path, PAD, "count").readings == pytest.approx(whole[1:2] + 0.5)
    (tmp_path / "nut1.csv").write_text("".join(";".join(["0", "5,166", *"0" * 22]) + "\n" for _ in range(3)))
    with pytest.raises(InputError, match="5,166 may be 5166 or"):
        read_press_folder(tmp_path, PAD, "count")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            lines(np.column_stack([PRESS, PRESS.sum(axis=1)])),
            "25 numbers for 24 taxels, and the first is no clock",
        ),
        (lines(np.column_stack([np.arange(24), np.ones((24, 24))])), "may be frames or taxels"),
        (lines(np.column_stack([np.arange(24), np.ones((24, 25))])), "may be frames or taxels"),
        (
            "".join(" ".join(f"{int(n):04x}" for n in row) + "\n" for row in 9 * PRESS),
            "its numbers are hexadecimal",
        ),
        (f"{np.tile(PRESS, (99, 1))}", "what a program shows of an array"),
        ("X =\n\n   1.0e+03 *\n\n" + lines(PRESS, "  "), "what a program shows of an array"),
        ("  Columns 1 through 6\n\n" + lines(PRESS[:, :6], "  "), "what a program shows of an array"),
        (lines(np.where(np.eye(7, 24), np.nan, PRESS)), "every frame has a cell that failed or is no number"),
    ],
)
def test_frames_that_may_be_something_else_are_refused(tmp_path, text, says):
    (tmp_path / "nut1.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_press_folder(tmp_path, PAD, "count")


@pytest.mark.parametrize("mark", [65535, -9999])
def test_frames_with_failed_cells_are_left_out_and_counted(tmp_path, caplog, mark):
    rng = np.random.default_rng(3)
    for press in range(5):
        frames = np.repeat(PRESS, 6, axis=0).astype(float)
        frames[rng.integers(len(frames)), rng.integers(24)] = mark
        (tmp_path / f"nut{press}.csv").write_text(lines(frames))
    assert read_press_folder(tmp_path, PAD, "count").readings == pytest.approx(np.tile(HALVES, (5, 1)))
    assert "5 of 210 frames have a failed cell" in caplog.text


def test_a_taxel_that_fails_in_many_frames_is_left_out(tmp_path, caplog):
    frames = np.repeat(PRESS, 6, axis=0)
    frames[::5, 7] = 9999
    (tmp_path / "nut1.csv").write_text(lines(frames))
    assert read_press_folder(tmp_path, PAD, "count").readings == pytest.approx(np.delete(HALVES, 7)[None])
    assert "taxel 7 is left out" in caplog.text


def test_frames_that_read_less_under_load_are_found_and_said(tmp_path, caplog):
    for press in range(4):
        (tmp_path / f"nut{press}.csv").write_text(lines(900 - (1 + press) * PRESS))
    readings = read_press_folder(tmp_path, PAD, "count").readings
    assert readings == pytest.approx(900 - np.outer([1, 2, 3, 4], HALVES))
    assert "read less under load" in caplog.text


@pytest.mark.parametrize("save", ["npy", "mat"])
def test_frames_may_come_last_in_an_array(tmp_path, save):
    last = np.moveaxis(FRAMES.reshape(7, 4, 6), 0, -1)
    (np.save if save == "npy" else lambda path, array: savemat(path, {"x": array}))(
        tmp_path / f"nut1.{save}", last
    )
    assert read_press_folder(tmp_path, PAD, "count").readings == pytest.approx(LOADED.mean(axis=0)[None])


def test_a_mat_file_of_version_73_is_read_as_one_of_version_7(tmp_path):
    as_matlab_saves(
        tmp_path / "more.mat", Nut_1_1=FRAMES, Nut_1_2=2 * FRAMES.reshape(7, 4, 6), other=np.ones((3, 5))
    )
    scan = read_press_folder(tmp_path, PAD, "count")
    assert scan.labels.tolist() == ["Nut", "Nut"]
    assert scan.readings == pytest.approx(np.outer([1, 2], LOADED.mean(axis=0)))
