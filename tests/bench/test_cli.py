"""The command line as a user calls it: the installed script, in a folder of its own."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import BENCH, Bench, refused, wait_until
from rich.table import Table

from tactsim.bench import experiment, terminal
from tactsim.bench.cli import main
from tactsim.bench.cli.app import load, said_of
from tactsim.bench.console import plain_console
from tactsim.bench.experiment import perform
from tactsim.bench.leaderboard import best_known
from tactsim.bench.results import Run
from tactsim.core import InputError, Scan

SMALL = ["--estimator", "histogram", "--trials", "1", "--readings", "4", "--bins", "1000"]


def test_a_run_prints_its_table_and_leaves_its_files(bench, tmp_path):
    result = bench("run", *SMALL, "--letters", "AE", "--verbose", "--out", "here")
    assert result.returncode == 0, result.stderr
    shown = Run.load(tmp_path / "here")
    assert f"right after 4 readings: {shown.accuracy[3]:.2f} (95 % interval " in result.stdout
    assert f"error {shown.error_mm[3]:.2f} mm" in result.stdout
    names = {path.name for path in (tmp_path / "here").iterdir()}
    tables = {"trials.csv", "times.csv"}
    assert names == tables | {"run.json", "summary.json", "times.json", "readings.png", "maps.png"}
    assert (tmp_path / "here" / "readings.png").read_bytes().startswith(b"\x89PNG")


def test_an_option_that_is_no_list_is_given_once(here):
    refused(here("run", "--letters", "A", "--letters", "E"), "--letters is given twice; give it once")
    refused(here("table", "--to", "csv", "x", "--to", "latex"), "--to is given twice; give it once")
    refused(here("compare", "x"), "Missing argument 'NEW...'. `bench compare --help` says what it takes")


def test_a_count_has_no_point(here):
    """Ten thousand, as half of the world writes it, would be ten."""
    refused(here("run", "--bins", "10.000"), "--bins: give a whole number without a point, got '10.000'")
    refused(here("run", "--set", "bins=10.000"), "bins: give a whole number without a point, got '10.000'")
    refused(here("run", "--set", "a=1", "--set", "b=2", "--estimator", "histgram"), "histgram")


def test_the_help_of_a_run_fits_a_screen_and_the_rest_is_a_word_away(here, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    short, whole = (here("run", word).stdout for word in ("--help", "--help-all"))
    assert len(short.splitlines()) <= 60
    options = {one.opts[0] for one in load("run").params if one.opts[0].startswith("--")}
    assert {word for word in options if word not in short} == set()
    assert "spread over it" in " ".join(whole.split())


def test_one_known_letter_alone_is_no_recognition(here):
    said = here("run", *SMALL, "--letters", "A", "--out", "alone").stdout
    assert "nothing to tell apart: A is the only letter that is known\n" in said
    assert "right after" not in said


def test_beside_a_run_stand_the_paper_with_its_poses_and_the_default_estimator(here):
    said = " ".join(here("run", *SMALL, "--out", "off").stdout.split())
    assert "the paper, on a real pad and in its training's poses: 100 % from" in said
    default = best_known()["letters-offgrid-v1"].default
    assert (
        f"bench run --estimator stacked # the default: {default:.2f} mm after 20 readings on task letters"
        in said
    )
    alone = here("run", *SMALL, "--letters", "AE", "--out", "two").stdout
    assert "the paper" not in alone
    assert "the same data with --estimator stacked  # the default\n" in alone


def test_a_shape_of_ones_own_has_a_row_and_is_kept_with_the_run(here, tmp_path, drawn):
    (tmp_path / "bar.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="5mm" viewBox="0 0 20 5"><path d="M0 0H20V5H0Z"/>'
        "</svg>"
    )
    words = [*SMALL, "--letters", "E", "--shape", "bar.svg", "--out", "own"]
    ran = here("run", *words)
    assert "bar as read: 20.0 x 5.0 mm, 100 mm^2, 1 outline" in ran.stderr.splitlines()
    assert "bar: " in ran.stdout
    assert (tmp_path / "own" / "shapes.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "bar.svg").rename(tmp_path / "gone.svg")
    assert here("report", "own").returncode == 0
    page = (tmp_path / "own" / "report.html").read_text()
    assert '"same":true' in page
    assert '"remarks":[]' in page


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("--particles 100", "stacked has none; leave it out, or add --estimator particle"),
        ("--estimator nearest --bins 100", "nearest has none; leave it out, or add --estimator histogram"),
    ],
)
def test_a_budget_that_an_estimator_does_not_have_is_refused_with_one_that_has_it(here, words, says):
    refused(here("run", *words.split()), says)


def test_the_shell_completes_options_of_a_verb(bench):
    bench.environment |= {
        "_BENCH_COMPLETE": "complete_bash", "COMP_WORDS": "bench run --verb", "COMP_CWORD": "2",
    }  # fmt: skip
    assert bench().stdout.split() == ["--verbose"]


def test_without_a_terminal_progress_is_a_plain_line_now_and_then(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "LINE_EVERY", 0.02)
    with terminal.progress_bars() as progress:
        progress("press", 0, 2000)
        progress("press", 1, 2000)
        time.sleep(0.2)  # nothing is reported meanwhile
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) > 2
    assert all(line.startswith("pressing: 1 of 2,000 done, about ") for line in lines)
    left = [int(line.split()[6]) for line in lines]
    assert left[-1] > left[0] + 30  # so much later, and no more is done


def test_a_run_that_is_asked_for_the_bound_shows_and_keeps_it(here, tmp_path):
    words = ["run", "--estimator", "nearest", "--letters", "AE", "--trials", "2", "--readings", "12"]
    plain, bounded = here(*words, "--out", "plain"), here(*words, "--bound", "--out", "bounded")
    assert "bound" not in plain.stdout
    assert "error / bound" in " ".join(bounded.stdout.split())
    assert (tmp_path / "bounded" / "bounds.csv").is_file()
    same = [(tmp_path / folder / "trials.csv").read_bytes() for folder in ("plain", "bounded")]
    assert same[0] == same[1]
    assert "--bound" in json.loads((tmp_path / "plain" / "run.json").read_text())["no_bound"]


def test_json_is_one_object_and_nothing_else_on_standard_output(here):
    result = here("run", *SMALL, "--json", "--letters", "AE", "--seed", "7")
    answer = json.loads(result.stdout)
    wanted = "estimator options letters trials readings accuracy accuracy_low accuracy_high error_mm "
    wanted += "all_right_from settled_95 seconds work"
    assert set(wanted.split(" ")) <= set(answer)
    assert (answer["letters"], answer["seed"]) == (["A", "E"], 7)
    assert {"python", "tactsim", "numpy", "mujoco", "numba"} <= answer["versions"].keys()
    assert {"processor", "cores", "system"} <= answer["machine"].keys()
    assert len(answer["accuracy"]) == len(answer["error_mm"]) == 4
    assert {"scan", "fit", "update_per_reading", "update_p99", "total"} <= set(answer["seconds"])
    assert {"likelihood_evaluations", "presses", "skipped"} <= set(answer["work"])


def test_a_letter_held_out_is_tried_as_none_and_marks_the_protocol(here, tmp_path):
    words = ["--letters", "AEO", "--hold-out", "O", "--estimator", "refined", "--bins", "600"]
    words += ["--set", "unknown=0.2", "--set", "cell=0.8", "--trials", "2", "--readings", "8"]
    words += ["--out", "here"]
    run = here("run", *words, "--json")
    answer = json.loads(run.stdout)
    assert answer["hold_out"] == ["O"]
    assert "O held out" in answer["protocol"]
    assert len(answer["refused_unknown"]) == len(answer["refused_known"]) == 8
    assert set(answer["confusion"]) == {"A", "E", "O"}
    assert "O" not in {label for row in answer["confusion"].values() for label in row}
    shutil.copytree("here", "again")
    assert here("compare", "here", "again").returncode == 0
    refused(here("compare", "here", "here"), "here is given twice")


def test_a_chosen_order_marks_the_protocol_and_is_timed(here):
    run = here("run", *SMALL, "--letters", "AE", "--explore", "information", "--json")
    answer = json.loads(run.stdout)
    assert "chosen by information" in answer["protocol"]
    assert answer["seconds"]["propose_per_reading"] > 0


def test_what_is_tested_may_be_fewer_letters_than_are_known(here, tmp_path):
    here("scan", "--letters", "IO", "--out", "known.npz")
    here("scan", "--letters", "O", "--seed", "3", "--out", "tested.npz")
    words = ["--train-scan", "known.npz", "--scan", "tested.npz", *SMALL]
    assert "O (among I O): 1 trial, " in here("run", *words, "--out", "few").stdout
    answer = json.loads(here("run", *words, "--json").stdout)
    assert answer["letters"] == ["O"]
    assert set(Run.load(tmp_path / "few").trials.truth) == {"O"}
    refused(here("run", *words, "--letters", "I"), "no test readings of letter 'I'")
    known = Scan.load(tmp_path / "known.npz")
    replace(known, taxel_xy=known.taxel_xy + 100).save(tmp_path / "another.npz")
    refused(
        here("run", "--train-scan", "another.npz", *SMALL), "pads differ", "without --scan the test readings"
    )


def test_noise_off_makes_readings_without_chance(here, tmp_path):
    same = ("--test-poses", "same")
    for seed in (0, 1):
        here("scan", "--out", f"{seed}.npz", "--letters", "I", "--noise", "off", "--seed", seed, *same)
    first, second = (Scan.load(tmp_path / f"{seed}.npz") for seed in (0, 1))
    assert np.array_equal(first.readings, second.readings)
    train, test = first.where("train"), first.where("test")
    assert np.array_equal(train.readings, test.readings)


def test_a_scan_keeps_the_images_of_each_press_if_asked_to(scan_through_time):
    path, result = scan_through_time
    assert result.exit_code == 0, result.output
    assert "ms after touch" in result.stdout
    scan = Scan.load(path)
    assert f"{len(scan.sequence_times)} images of each press" in result.stdout
    assert scan.sequence.shape == (2 * 16, len(scan.sequence_times), 36)
    touching = scan.sequence_force[:, -1] > 0
    both_noisy = scan.sequence[touching, -1] - scan.readings[touching]  # each with noise of 2 kPa
    assert both_noisy.std() < 2 * 2.0


BAD = {
    "letter": (["run", "--letters", "A?"], ["letter", "?"]),
    "estimator": (["run", "--estimator", "histogramm"], ["histogramm", "did you mean 'histogram'"]),
    "option": (["run", "--binz", "3"], ["--binz"]),
    "an estimator's option": (["run", "--halvings", "3"], ["--halvings", "--set NAME=VALUE"]),
    "set": (["run", "--set", "bin=3"], ["bin", "did you mean 'bins'"]),
    "set without =": (["run", "--set", "bins"], ["key=value"]),
    "scan-set": (["run", "--scan-set", "press.forse=1"], ["press.forse", "did you mean 'press.force'"]),
    "a scan-set by its last word": (["run", "--scan-set", "noise_kPa=1"], ["did you mean 'sensor.noise'"]),
    "a value for a group": (["run", "--scan-set", "press=5"], ["press is a group", "'5'", "press.force"]),
    "a report of a file": (["report", "file"], ["file: it is no folder"]),
    "a file of another kind": (["scan", "--out", "s.npy"], ["--out s.npy", "FILE.npz"]),
    "readings": (["run", "--readings", "193"], ["193", "192"]),
    "world": (["run", "--world", "mars"], ["mars", "paper-like"]),
    "out is a file": (["run", "--out", "file"], ["file"]),
    "out is full": (["run", "--out", "full"], ["full", "holds something"]),
    "a run into no disk": (["run", "--out", "/proc/x"], ["--out /proc/x", "cannot be written"]),
    "verb": (["rum"], ["rum"]),
    "bytes for a text": (["sweep", "bytes.toml"], ["bytes.toml is not text in UTF-8, from byte 3 on"]),
    "a sweep into a file": (["sweep", "quick", "--out", "file"], ["--out file", "is a file", "new folder"]),
    "no letters of a scan": (["run", "--scan", "io.npz", "--letters", ","], ["letters names none", "I, O"]),
    "held out": (["run", "--letters", "AE", "--hold-out", "Q"], ["hold out", "'Q'", "A, E"]),
    "all held out": (["run", "--letters", "AE", "--hold-out", "A,E"], ["--hold-out", "train"]),
    "explore": (
        ["run", "--estimator", "nearest", "--explore", "information"],
        ["nearest", "explore at random"],
    ),
    "world for a file": (["run", "--scan", "some.npz", "--world", "paper-like"], ["world", "some.npz"]),
}


@pytest.mark.parametrize("case", BAD)
def test_wrong_input_is_one_line_and_exit_status_2(here, tmp_path, scan_file, case):
    (tmp_path / "file").write_text("")
    (tmp_path / "bytes.toml").write_bytes(b"abc\xff")
    (tmp_path / "io.npz").write_bytes(scan_file.read_bytes())
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "something").write_text("")
    before = sorted(tmp_path.rglob("*"))
    words, parts = BAD[case]
    refused(here(*words), *parts)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("words", [["run"], ["run", "--explore", "blind"], ["bound"]])
def test_more_readings_than_are_pressed_are_refused_before_the_press(here, own_cache, words):
    refused(here(*words, "--readings", "500", "--letters", "IO"), "500 readings", "'I' has", "at most")
    assert not list(own_cache.iterdir())


@pytest.mark.parametrize(
    "words",
    [["run", "--scan", "bad.npz"], ["live", "--port", "simulated:I@0,0,0", "--train-scan", "bad.npz"],
     ["validate", "--simulated", "two.npz", "--recorded", "bad.npz"]],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_scan_whose_objects_make_no_sense_is_refused_by_its_name_before_the_work(
    here, tmp_path, scan_file, words
):
    scan = Scan.load(scan_file)
    scan.save(tmp_path / "two.npz")
    objects = {**scan.meta["objects"], "O": {"symmetry": 0, "centre": [0, 0], "inertia_over_mass": -1}}
    replace(scan, meta={**scan.meta, "objects": objects}).save(tmp_path / "bad.npz")
    result = here(*words)
    refused(result, "bad.npz: scan: meta.objects.O: inertia_over_mass: give a number above 0, got -1")
    assert "mapping" not in result.stderr


@pytest.mark.long
@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_an_interrupt_ends_with_130_one_line_and_no_results(tmp_path, ended_by, jobs):
    words = ("run", "--trials", "1000", "--letters", "I", "--out", "here", "--jobs", jobs)
    process = Bench(tmp_path).start(*words)
    # All is pressed: it is at its trials.
    wait_until(process, lambda: any((tmp_path / "cache").rglob("*.readings")))
    process.send_signal(ended_by)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert "leaked" not in errors
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]


@pytest.mark.parametrize("verb", ["run", "list", "emulate"])
def test_the_help_says_of_a_verb_what_its_docstring_does(verb):
    assert load(verb).help.partition("\n")[0] == said_of(verb)


def full_disk():
    return os.open("/dev/full", os.O_WRONLY)


def reader_that_is_gone():
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize(
    ("output", "words", "status", "said"),
    [(full_disk, ["list", "letters"], 2, "bench: cannot write to standard output: the disk is full\n"),
     (reader_that_is_gone, ["list", "letters"], 141, ""), (reader_that_is_gone, ["run", "--help"], 141, "")],
)  # fmt: skip
def test_a_full_disk_is_one_line_and_a_reader_that_is_gone_none(bench, output, words, status, said):
    taken = output()
    process = subprocess.run(
        [BENCH, *words], stdout=taken, stderr=subprocess.PIPE, text=True, env=bench.environment, timeout=120
    )
    os.close(taken)
    assert (process.returncode, process.stderr) == (status, said)


IN_SPACE = ["--task", "solids", "--objects", "bolt,nut", "--touches", "2", "--scan-set", "points=12"]
IN_PLANE = ["--letters", "IO", "--readings", "3", "--estimator", "nearest"]


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize(
    ("output", "status", "words"),
    [(reader_that_is_gone, 141, IN_PLANE), (full_disk, 2, [*IN_PLANE, "--json"]), (full_disk, 2, IN_SPACE)],
    ids=["gone", "full", "solids"],
)
def test_a_run_whose_output_nobody_takes_is_saved_all_the_same(bench, tmp_path, output, status, words):
    taken = output()
    process = subprocess.Popen(
        [BENCH, "run", *words, "--trials", "1", "--out", "here"],
        cwd=tmp_path, stdout=taken, stderr=subprocess.PIPE, text=True, env=bench.environment,
    )  # fmt: skip
    os.close(taken)
    _, errors = process.communicate(timeout=240)
    assert process.returncode == status, errors
    assert "Traceback" not in errors
    assert (tmp_path / "here" / "run.json").is_file()


def test_a_run_whose_folder_another_one_took_is_saved_beside_it(here, monkeypatch, tmp_path):
    def perform_and_be_late(*words, **more):
        other = tmp_path / "same"
        other.mkdir()
        (other / "run.json").write_text("another run")
        return perform(*words, **more)

    monkeypatch.setattr(experiment, "perform", perform_and_be_late)
    result = here("run", *SMALL, "--letters", "IO", "--out", "same", "--json")
    assert result.returncode == 0, result.stderr
    assert "same was taken meanwhile; the results are in same-2" in result.stderr
    assert json.loads(result.stdout)["results"] == "same-2"
    assert (tmp_path / "same" / "run.json").read_text() == "another run"
    assert (tmp_path / "same-2" / "trials.csv").is_file()


@pytest.mark.parametrize("more", [[], ["--json"]], ids=["words", "json"])
def test_a_run_that_cannot_be_saved_is_printed(here, monkeypatch, tmp_path, more):
    def refuse(*words):
        raise InputError("cannot write here: No space left on device")

    monkeypatch.setattr(Run, "save", refuse)
    result = here("run", *SMALL, "--letters", "IO", "--out", "here", *more)
    refused(result, "No space left on device; the results are in no file, only in what was printed")
    if more:
        assert json.loads(result.stdout)["results"] is None
    else:
        assert "95 % interval" in result.stdout
        assert "results  " not in result.stdout


LOSES_IT = """\
import os, signal, sys, time, weakref
from tactsim.bench.cli import app, main

def lose_an_interrupt():
    thing = type("Thing", (), {})()
    kept = weakref.ref(thing, lambda gone: os.kill(os.getpid(), int(sys.argv[1])))
    del thing  # calls that function: an error that is raised there is lost
    time.sleep(60)

app.run_app = lose_an_interrupt
main()
"""


SWALLOWS_IT = """\
import os, signal
from contextlib import suppress
from tactsim.bench.cli import app, main
from tactsim.bench.watching.watch_screen import check_interrupted

def swallow_an_interrupt():
    check_interrupted()
    with suppress(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    check_interrupted()
    raise AssertionError

app.run_app = swallow_an_interrupt
main()
"""


def test_an_interrupt_that_was_swallowed_ends_what_watches_a_pad(tmp_path):
    words = [sys.executable, "-c", SWALLOWS_IT]
    ended = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=30)
    assert ended.stderr == "bench: interrupted; nothing half-written was kept\n"
    assert ended.returncode == 130


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_where_python_can_raise_nothing_comes_again(tmp_path, ended_by):
    words = [sys.executable, "-c", LOSES_IT, str(int(ended_by))]
    ended = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=30)
    assert ended.stderr == "bench: interrupted; nothing half-written was kept\n"
    assert ended.returncode == 130


def test_an_interrupt_while_modules_are_imported_ends_alike(monkeypatch, capsys):
    class Interrupts:
        def find_spec(self, name, path, target=None):
            if name == "tactsim.bench.cli.app":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "tactsim.bench.cli.app")
    monkeypatch.setattr(sys, "meta_path", [Interrupts(), *sys.meta_path])
    with pytest.raises(SystemExit, match="130"):
        main()
    assert capsys.readouterr().err == "bench: interrupted; nothing half-written was kept\n"


def test_a_users_own_folders_hide_nothing(bench, tmp_path):
    for name in ("models", "bench", "estimators", "hardware"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(
            "raise SystemExit('a folder of the user was imported')\n"
        )
    bench.environment["PYTHONPATH"] = str(tmp_path)
    result = bench("list", "letters")
    assert result.returncode == 0, result.stderr


@pytest.mark.long
@pytest.mark.parametrize(
    ("setting", "words", "said"),
    [
        ("COLUMNS=0", "list estimators", None),
        ("COLUMNS=0", "--help", None),
        ("MPLBACKEND=no_such", "run --letters IL --trials 1 --estimator histogram --out run", None),
        ("MUJOCO_GL=no_such", "run --letters IL --trials 1 --estimator histogram --out run", None),
        ("NUMBA_DISABLE_JIT=1", "list estimators", None),
        ("NUMBA_DISABLE_JIT=1", "run --letters IL --trials 1", "NUMBA_DISABLE_JIT is set"),
        ("NUMBA_NUM_THREADS=0", "run --letters IL --trials 1",
         "numba, which compiles the inner loops, does not start"),
        ("NUMBA_NUM_THREADS=0", "list estimators", "NUMBA_NUM_THREADS=0"),
    ],
)  # fmt: skip
def test_odd_settings_of_a_machine_are_answered_or_refused_in_one_line(bench, setting, words, said):
    name, _, value = setting.partition("=")
    bench.environment |= {name: value}
    ended = bench(*words.split())
    if said is None:
        assert ended.returncode == 0, ended.stderr
        assert len(ended.stdout.splitlines()) > 10
    else:
        refused(ended, said)


@pytest.mark.long
def test_nothing_is_compiled_to_list_estimators_or_before_the_words_are_checked(bench, tmp_path):
    bench.environment |= {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    assert bench("list", "estimators", "refined").returncode == 0
    refused(bench("run", "--estimator", "refined", "--set", "no_such=1"), "no_such")
    assert not list(tmp_path.glob("kernels/**/*.nbi"))


@pytest.mark.slow
def test_set_up_leaves_nothing_of_a_run_and_its_report_to_compile(bench, tmp_path):
    kept = tmp_path / "bytecode"
    bench.environment |= {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPYCACHEPREFIX": str(kept)}
    # That of `bench`: what is kept has its name by its folder
    python = Path(sys.prefix).resolve() / "bin" / "python"
    words = [python, "-m", "tactsim.bench.compile_kernels"]
    without = bench.environment | {"PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run(words, env=without, cwd=tmp_path, check=True)
    loops, before = set(tmp_path.glob("kernels/**/*.nbc")), set(kept.rglob("*.pyc"))
    bench.environment |= {"PYTHONDONTWRITEBYTECODE": ""}
    assert bench("run", "--letters", "IL", "--trials", "1", "--out", "run").returncode == 0
    assert bench("report", "run").returncode == 0
    assert set(tmp_path.glob("kernels/**/*.nbc")) == loops
    assert set(kept.rglob("*.pyc")) == before


EVIL = "[bold red]x[/] [/nothing] \x1b]0;title\x07 \x1b[2J :smile: \u202e"


def test_text_from_a_file_is_shown_as_it_is_written():
    console = plain_console()
    console.file = io.StringIO()
    table = Table(box=None)
    table.add_column(EVIL, overflow="fold")
    table.add_row(EVIL)
    console.print(table)
    console.print(EVIL)
    console.print(EVIL, style="bold")
    shown = console.file.getvalue()
    assert "\x1b" not in shown
    assert "\x07" not in shown
    assert "\u202e" not in shown
    assert shown.replace("\n", "").count("[bold red]x[/] [/nothing]") == 4
    assert ":smile:" in shown


@pytest.mark.parametrize("width", [20, 40, 60, 80])
def test_no_figure_and_no_word_of_a_table_is_cut(width):
    console = plain_console()
    console.file, console.width = io.StringIO(), width
    table = Table(box=None, pad_edge=False)
    table.add_column("what", overflow="fold")
    for heading in ("readings", "95 % interval", "90 % in mm", "held"):
        table.add_column(heading, justify="right")
    table.add_row("sensor_noise=0.5, and the rest of it", "1", "0.301 - 0.954", "7.36", "1.00")
    console.print(table)
    shown = console.file.getvalue()
    for words in ("sensor_noise=0.5,", "readings", "interval", "0.301 - 0.954", "7.36", "1.00"):
        assert words in shown
    assert width < 60 or max(map(len, shown.splitlines())) <= width
