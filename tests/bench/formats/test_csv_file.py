"""A table of presses, one a row, as a lab's script or a spreadsheet writes it."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import refused

from tactsim.bench.cli.pad_options import idle_frames
from tactsim.bench.formats.csv_file import columns_of, read_press_table
from tactsim.core import InputError, Pad, Scan

PAD = Pad(rows=2, columns=3, seam=None, unread_columns=0)
TITLE = "label,split,x_mm,y_mm,theta_rad,load_N,press,t0,t1,t2,t3,t4,t5"
ROWS = (
    "A,train,1.5,-2,0.5,10,1,1,2,3,4,5,6.25",
    "A,train,1.5,-2,0.5,5,1,0,1,1,2,2,3",
    "B,test,0,0,-3,,2,9,8,7,6,5,4",
)
WANTED = Scan.from_arrays(
    [[1, 2, 3, 4, 5, 6.25], [0, 1, 1, 2, 2, 3], [9, 8, 7, 6, 5, 4]],
    [[1.5, -2, 0.5], [1.5, -2, 0.5], [0, 0, -3]],
    ["A", "A", "B"], ["train", "train", "test"], PAD,
    unit="N", loads=[10, 5, np.nan], presses=[1, 1, 2],
)  # fmt: skip


@pytest.fixture
def read(tmp_path):
    def read(*lines):
        (tmp_path / "lab.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return read_press_table(tmp_path / "lab.csv", PAD, "N")

    return read


def test_a_table_is_the_scan_of_the_same_arrays(read):
    assert read(TITLE, *ROWS).digest == WANTED.digest


def test_what_a_spreadsheet_saved_again_is_the_same(read):
    saved = [line.replace(",", ";").replace(".", ",").replace("A;", '"A";') for line in ROWS]
    assert read("\ufeff" + TITLE.replace(",", ";"), *saved).digest == WANTED.digest
    assert read("\ufeffsep=;", TITLE.replace(",", ";"), *saved).digest == WANTED.digest
    assert (
        read(
            "# each label is an object", f"# {TITLE}", "# in mm", *ROWS[:1], "% pause", "// pause", *ROWS[1:]
        ).digest
        == WANTED.digest
    )
    assert read(TITLE.upper(), *ROWS, ",,,,,,,,,,,,").digest == WANTED.digest


def test_tabs_and_a_separator_behind_the_last_cell_are_read(read):
    assert read(*(line.replace(",", "\t") for line in (TITLE, *ROWS))).digest == WANTED.digest
    assert read(TITLE, *(f"{row},," for row in ROWS)).digest == WANTED.digest
    assert read(*(line.replace(",", "|") for line in (TITLE, *ROWS))).digest == WANTED.digest
    assert read(TITLE.replace("_mm", " [mm]").replace("_N", " (N)"), *ROWS).digest == WANTED.digest
    assert read(TITLE, *ROWS[:2], ROWS[2].replace(",9,", ",0.9D+01,")).digest == WANTED.digest
    assert (
        read(*(line.replace(",", " ").replace("  ", ' "" ') for line in (TITLE, *ROWS))).digest
        == WANTED.digest
    )


def test_a_point_among_decimal_commas_is_refused_with_its_cell(read):
    rows = [
        row.replace(",", ";").replace(".", ",")
        for row in ("A,train,1.5,0,0,,1,1,2,3,4,5,6", "A,train,1,0,0,,2,1,2,3,4,5,6")
    ]
    rows[1] = rows[1].replace(";3;", ";1.234;")
    with pytest.raises(InputError, match=r"line 3: t2: .*'1\.234 among decimal commas'"):
        read(TITLE.replace(",", ";"), *rows)


def test_columns_stand_in_any_order_and_others_are_left_alone(read):
    cells = [line.split(",") for line in (TITLE, *ROWS)]
    turned = [",".join(reversed(line)) for line in cells]
    notes = [f"{note},{line}" for note, line in zip(("when", "1", "2", "3"), turned, strict=True)]
    assert read(*notes).digest == WANTED.digest


def test_without_t0_all_other_columns_of_numbers_are_the_taxels_in_their_order(read):
    names = TITLE.replace("t0,t1,t2,t3,t4,t5", "up,down,note,left,right,front,back")
    rows = [",".join([*(cells := row.split(","))[:9], "by hand", *cells[9:]]) for row in ROWS]
    assert read(names, *rows).digest == WANTED.digest
    for named in ("R1C1,R1C2,R1C3,R2C1,R2C2,R2C3", "x0y0,x1y0,x2y0,x0y1,x1y1,x2y1", "a1,a2,a3,b1,b2,b3"):
        assert read(TITLE.replace("t0,t1,t2,t3,t4,t5", named), *ROWS).digest == WANTED.digest


def test_an_angle_may_be_in_degrees_and_the_rest_may_be_left_out(read):
    scan = read("label,x_mm,y_mm,theta_deg,t0,t1,t2,t3,t4,t5", "A,1,2,90,1,2,3,4,5,6")
    assert np.allclose(scan.poses, [[1, 2, np.pi / 2]], atol=1e-15)
    assert (scan.split.tolist(), scan.loads, scan.presses) == (["train"], None, None)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([TITLE], "holds no presses"),
        ([*ROWS], "no line names its columns, which are label"),
        ([TITLE.replace("theta_rad", "angle"), *ROWS], r"line 2: missing is theta_rad \(or theta_deg\)"),
        ([TITLE, *ROWS, "", "B,dev,0,0,-3,,2,9,8,7,6,5,4"], "line 6: split: give 'train' or 'test'"),
        ([TITLE, *ROWS, "B,test,0,0,-3,,2,9,8,7,6,5,4,3"], "line 5: .*more columns than the title"),
        ([TITLE.replace("t1", "t0"), *ROWS], "two columns are called 't0'"),
        ([TITLE, *ROWS, "B,test,0,0,-180,,2,9,8,7,6,5,4"], "line 5: theta_rad: -180 rad are .* theta_deg"),
        ([TITLE, *ROWS, "B,test,0,0,-3,,2,9,1e300,7,6,5,4"], "line 5: t1: give a number up to 1e9, got '1e300'"),
        ([TITLE, *ROWS, 'B,test,0,0,-3,,2,9,"1,234",7,6,5,4'], "line 5: t1: give a number up to 1e9, got '1,234'"),
        ([TITLE, *ROWS, "B,test,0,0,-3,,,9,8,7,6,5,4"], "line 5: either all rows have a number in the column press"),
        ([TITLE.replace("t0,t1,t2,t3,t4,t5", "p1,p10,p2,p3,p4,p5"), *ROWS], "line 2: columns p1, p10, p2, .* no order"),
        ([TITLE.replace("t0,t1,t2,t3,t4,t5", "r0c0,r1c0,r0c1,r1c1,r0c2,r1c2"), *ROWS], "r0c0, r1c0, .* no order"),
        ([TITLE.replace("t0,t1,t2,t3,t4,t5", "x0y0,x0y1,x1y0,x1y1,x2y0,x2y1"), *ROWS], "x0y0, x0y1, .* no order"),
        ([TITLE.replace("t0,t1,t2,t3,t4,t5", "p0,p1,p2,p3,p4,celsius"), *ROWS], "'celsius' has no number as others"),
        ([TITLE.replace("t0,t1,t2,t3,t4,t5", "p0 (V),p1 (V),p2 (V),p3 (V),p4 (V),p5 (V)"), *ROWS], "not in N; count"),
        ([TITLE, *ROWS, "B,test,0,0,-3,,2,9,8,,6,5,4"], "line 5: t2: give a number up to 1e9, got ''"),
        ([TITLE.replace("x_mm,y_mm,theta_rad", "X,Y,heading"), *ROWS], "X, Y, heading may be poses"),
        ([TITLE, *ROWS, "Mean,test,1,1,1,,2,3,3,3,3,3,3"], "line 5: 'Mean' begins no press"),
        ([TITLE, ROWS[0] + "\0"], "it holds bytes of 0"),
        ([TITLE + ",t6", ROWS[0] + ",1"], "line 2: 7 columns of taxels, t0, t1, t2 ..., and the pad has 6"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_with_its_line(read, lines, says):
    with pytest.raises(InputError, match=says):
        read(*lines)


def test_a_table_is_imported_from_the_command_line(tmp_path, here):
    (tmp_path / "lab.csv").write_text("\n".join([TITLE, *ROWS]) + "\n")
    (tmp_path / "pad.toml").write_text("rows = 2\ncolumns = 3\nno_seam = true\nunread_columns = 0\n")
    done = here("import", "lab.csv", "--pad", "pad.toml", "--unit", "N", "--out", "scan.npz")
    assert done.returncode == 0, done.stderr
    assert Scan.load(tmp_path / "scan.npz").digest == WANTED.digest
    assert "were not zeroed; --zero N sets it" in done.stdout
    trained, tested = (len(WANTED.where(split)) for split in ("train", "test"))
    assert f"{trained} to train on and {tested} to test with" in done.stdout
    refused(here("run", "--scan", "lab.csv"), "not a whole .npz file", "`bench import`")


@pytest.mark.parametrize(
    "text", ["0.5,1\n0.5,1\n", "0,5;1\n", "0,5\t1\n", "t0,t1\n0.5,1,\n", "# idle\n0.5 1\n", "sep=;\n0,5;1\n",
             "Time [ms], a, b\n0, .5, 1\n"],
)  # fmt: skip
def test_idle_readings_are_read_from_any_table(tmp_path, text):
    (tmp_path / "idle.csv").write_text(text, encoding="utf-16")
    assert np.atleast_2d(idle_frames(tmp_path / "idle.csv"))[-1].tolist() == [0.5, 1]


def test_a_scan_is_written_as_the_table_that_is_read(tmp_path, here):
    WANTED.save(tmp_path / "scan.npz")
    done = here("export", "scan.npz", "--to", "csv", "--out", "scan.csv")
    assert done.returncode == 0, done.stderr
    assert read_press_table(tmp_path / "scan.csv", PAD, "N").digest == WANTED.digest
    refused(here("export", "scan.npz", "--to", "csv", "--out", "scan.txt"), ".csv")


@pytest.mark.parametrize("turned", [0.0, 0.25])
def test_poses_that_nobody_noted_come_back_from_a_table_as_such(tmp_path, here, turned):
    """Windows of a press lie to each other as their poses say, whose they are not."""
    poses = np.outer([0, turned, 0], [4, 0, 1.0])
    scan = replace(WANTED, poses=poses, meta={**WANTED.meta, "poses": "unknown"})
    scan.save(tmp_path / "scan.npz")
    done = here("export", "scan.npz", "--to", "csv", "--out", "scan.csv")
    assert done.returncode == 0, done.stderr
    first = (tmp_path / "scan.csv").read_text().partition("\n")[0]
    assert ("x_mm" in first, "poses" in first) == (turned > 0, turned > 0)
    assert read_press_table(tmp_path / "scan.csv", PAD, "N").digest == scan.digest
    text = (tmp_path / "scan.csv").read_text()
    if turned:
        (tmp_path / "scan.csv").write_text(text.replace("unknown", "", 1))
        with pytest.raises(
            InputError, match="line 3: either all rows say unknown in the column poses, or none"
        ):
            read_press_table(tmp_path / "scan.csv", PAD, "N")
        (tmp_path / "scan.csv").write_text(text.replace("unknown", "none"))
        with pytest.raises(InputError, match="line 2: poses: give 'unknown', got 'none'"):
            read_press_table(tmp_path / "scan.csv", PAD, "N")


@pytest.mark.parametrize("told", [["--poses", "none"], ["--columns", "poses=:unknown"]])
def test_a_table_is_said_to_be_of_poses_that_nobody_noted(tmp_path, here, told):
    """Rows of one press keep how they lie to each other."""
    (tmp_path / "lab.csv").write_text("\n".join((TITLE, *ROWS, "B,test,0,2,-3,,2,9,8,7,6,5,4")) + "\n")
    (tmp_path / "pad.toml").write_text("rows = 2\ncolumns = 3\nno_seam = true\n")
    words = ["lab.csv", "--pad", "pad.toml", "--unit", "N", "--out", "scan.npz"]
    done = here("import", *words, *told)
    assert done.returncode == 0, done.stderr
    scan = Scan.load(tmp_path / "scan.npz")
    assert scan.meta["poses"] == "unknown"
    assert not scan.poses[:3].any()
    assert scan.poses[3] == pytest.approx([-2 * np.sin(3), 2 * np.cos(3), 0])
    says = "--poses is of .npz, .mat and .h5 files; of a table --columns says it, as in x_mm=position"
    refused(here("import", *words[:-1], "other.npz", "--poses", "T"), says)


def test_columns_that_may_be_poses_are_none_where_nobody_noted_them(tmp_path):
    (tmp_path / "lab.csv").write_text("label,x,angle,a,b,c,d,e,f\nA,1,90,1,2,3,4,5,6\n")
    with pytest.raises(InputError, match=r"x, angle may be poses; .*--poses none"):
        read_press_table(tmp_path / "lab.csv", PAD, "N")
    scan = read_press_table(tmp_path / "lab.csv", PAD, "N", noted=False)
    assert (scan.meta["poses"], scan.readings.tolist()) == ("unknown", [[1, 2, 3, 4, 5, 6]])
    assert not scan.poses.any()


@pytest.mark.parametrize(
    ("names", "cells"),
    [
        ("x_mm,y_mm", "1,2"),
        ("x_mm,y_mm,theta_rad", ",,"),
        ("x_mm,y_mm,theta_rad", "left,?,n.a."),
        ("x_mm,y_mm,theta_rad", "1,2,90"),
        ("x_mm,y_mm,heading", "1,2,90"),
        ("theta_deg,theta_rad", "90,90"),
    ],
)
@pytest.mark.parametrize("told", ["noted", "columns", "column"])
def test_columns_of_poses_that_nobody_noted_are_not_read_but_of_rows_of_one_press(
    tmp_path, names, cells, told
):
    said = ",unknown" if told == "column" else ""
    title = f"label,press,{names}{',poses' if said else ''},a,b,c,d,e,f"
    called = columns_of("poses=:unknown") if told == "columns" else None
    for other in (2, 1):
        rows = (f"A,1,{cells}{said},1,2,3,4,5,6", f"A,{other},{cells}{said},1,1,2,2,3,3")
        (tmp_path / "lab.csv").write_text("\n".join((title, *rows)) + "\n")
        if other == 1:
            with pytest.raises(InputError, match=r"line 2: .*(x_mm|theta_rad)"):
                read_press_table(tmp_path / "lab.csv", PAD, "N", called, noted=told != "noted")
        else:
            scan = read_press_table(tmp_path / "lab.csv", PAD, "N", called, noted=told != "noted")
            assert (scan.meta["poses"], scan.readings[0].tolist()) == ("unknown", [1, 2, 3, 4, 5, 6])
            assert not scan.poses.any()


OTHERS = "kind,position,angle,p0_fx,p0_fz,p1_fz,p2_fz,p3_fz,p4_fz,p5_fz\n"


def test_columns_of_other_names_are_told(tmp_path):
    (tmp_path / "lab.csv").write_text(OTHERS + "7,1.5,90,9,1,2,3,4,5,6\n7,2.5,0,9,0,1,1,2,2,3\n")
    told = columns_of("x_mm=position, y_mm=:0,theta_deg=angle,label=kind,split=:test,taxels=*_fz")
    scan = read_press_table(tmp_path / "lab.csv", PAD, "N", told)
    assert scan.readings.tolist() == [[1, 2, 3, 4, 5, 6], [0, 1, 1, 2, 2, 3]]
    assert scan.poses == pytest.approx(np.array([[1.5, 0, np.pi / 2], [2.5, 0, 0]]))
    assert (scan.labels.tolist(), scan.split.tolist()) == (["7", "7"], ["test", "test"])
    assert "poses" not in scan.meta


def test_a_table_without_poses_says_that_nobody_knows_them(tmp_path):
    (tmp_path / "lab.csv").write_text("Fruit,a 1,a 2,a 3,b 1,b 2,b 3\n0,1,2,3,4,5,6\n")
    scan = read_press_table(tmp_path / "lab.csv", PAD, "mmHg", columns_of("label=Fruit"))
    assert (scan.meta["poses"], scan.meta["unit"], scan.poses.tolist()) == ("unknown", "kPa", [[0, 0, 0]])
    assert scan.readings == pytest.approx(101.325 / 760 * np.arange(1, 7)[None], rel=1e-6)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ("x_mm", "'x_mm': give NAME=COLUMN"),
        ("colour=kind", "names are label, .* and taxels"),
        ("label=kind,label=angle", "label is named twice"),
        ("x_mm=angle,theta_deg=angle", "angle is named twice"),
        ("label=what", "no line names a column 'what'"),
        ("x_mm=position,label=what", "no column is called 'what'; there are"),
        ("label=kind,taxels=*_fy", "0 columns of taxels"),
    ],
)
def test_columns_that_are_not_there_or_named_twice_are_refused(tmp_path, told, message):
    (tmp_path / "lab.csv").write_text(OTHERS + "7,1.5,90,9,1,2,3,4,5,6\n")
    with pytest.raises(InputError, match=message):
        read_press_table(tmp_path / "lab.csv", PAD, "N", columns_of(told))
