"""The verbs of the real pad as a user calls them, on an emulated pad behind a real pty or TCP port."""

import json
import re
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from command_line import emulated, refused, wait_until

from tactsim.bench.runs.saved import load
from tactsim.core import Scan
from tactsim.hardware.scans import scan_of_sessions


def right(result):
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_devices_are_listed(here):
    out = right(here("devices"))
    for word in ("recording", "simulated", "singletact-5x5"):
        assert word in out
    found = json.loads(right(here("devices", "--json")))
    assert {"ports", "sources", "codecs", "device_files"} == set(found)


@pytest.mark.parametrize("on", ["pty:pad", "tcp"])
def test_a_pad_is_probed(bench, here, on):
    with emulated(bench, "--port", on, "--letter", "A", "--hold", "1000", "--lift", "0.1") as name:
        found = json.loads(right(here("probe", "--port", name, "--seconds", "0.5", "--json")))
        shown = right(here("probe", "--port", name, "--seconds", "0.3"))
    assert found["taxels"] == 36
    assert 50 < found["readings_per_s"] < 150
    assert found["counters"]["garbage_bytes"] == 0
    assert 0.2 < found["force_n"] < 2.0
    assert "36 taxels" in shown


def test_a_probe_of_something_else_shows_its_bytes(bench, here):
    with emulated(bench, "--port", "pty:pad") as name:
        result = here("probe", "--port", name, "--device", "singletact-5x5")
    refused(result, "no whole frame of 'SingleTact 5x5 array'", "baud rate")
    assert "aa 55" in result.stderr


@pytest.mark.long
def test_an_emulated_pad_that_is_ended_leaves_no_link(bench, tmp_path):
    process = bench.start("emulate", "--port", "pty:pad")
    assert process.stdout.readline().strip() == "pad"
    assert (tmp_path / "pad").is_symlink()
    process.terminate()
    process.wait(30)
    assert not (tmp_path / "pad").is_symlink()


@pytest.mark.long
def test_a_letter_is_recorded_from_tare_to_scan(bench, here, tmp_path):
    with emulated(bench, "--port", "pty:pad", "--follow", "A.tactrec", "--rate", "200", "--lift", "0.2",
                  "--scan-set", "placement_tilt=0"):  # fmt: skip
        assert "zero of 36 taxels" in right(here("tare", "--port", "pad", "--out", "cal.toml"))
        refused(here("tare", "--port", "pad", "--out", "cal.toml"), "cal.toml")
        right(here("tare", "--port", "pad", "--out", "cal.toml", "--force"))
        words = [
            "record", "--port", "pad", "--letter", "A", "--calibration", "cal.toml", "--out", "A.npz",
            "--poses", "spread:5", "--frames", "10",
        ]  # fmt: skip
        session = bench.start(*words)
        wait_until(session, lambda: _marks(tmp_path))
        session.send_signal(signal.SIGKILL)
        session.communicate(timeout=10)
        assert not (tmp_path / "A.npz").exists()
        refused(here(*words), "A.tactrec exists", "--resume")
        other = ["B" if word == "A" else word for word in words]
        refused(here(*other, "--resume"), "is a session of 'A'")
        out = right(here(*words, "--resume"))
    assert "5 readings of A in A.npz" in out
    scan = Scan.load(tmp_path / "A.npz")
    assert scan.readings.shape == (5, 36)
    assert scan.meta["objects"]["A"]["symmetry"] == 1
    pressed = _pressed(scan.poses)
    assert np.sqrt(((scan.readings - pressed) ** 2).mean()) < 2.0
    assert pressed.max() > 20
    again = right(here("replay", "A.tactrec", "--scan", "again.npz", "--csv", "readings.csv"))
    assert "finished" in again
    assert "2 segments" in again
    assert "readings are as they were tared" in again
    right(here("replay", "A.tactrec", "--calibration", "cal.toml"))  # the recorded one
    (tmp_path / "other.toml").write_text(
        (tmp_path / "cal.toml").read_text().replace("frames = 100", "frames = 99")
    )
    refused(here("replay", "A.tactrec", "--calibration", "other.toml"), "give none")
    refused(
        here("replay", "A.tactrec", "--device", "arduino-csv"), "another [codec], [part], [pad]: leave it out"
    )
    (tmp_path / "wired.toml").write_text(
        re.sub('read_by = "..', 'read_by = "xx', (tmp_path / "cal.toml").read_text())
    )
    refused(here("replay", "A.tactrec", "--calibration", "wired.toml"), "holds for another device file")
    (tmp_path / "copy.tactrec").write_bytes((tmp_path / "A.tactrec").read_bytes())
    for twin in ("A.tactrec", "./A.tactrec", "copy.tactrec"):
        refused(here("replay", "A.tactrec", twin, "--scan", "twice.npz"), "same recording as A.tactrec")
    assert not (tmp_path / "twice.npz").exists()
    assert Scan.load(tmp_path / "again.npz").digest == scan.digest
    assert (tmp_path / "readings.csv").read_text().startswith("s,host_s,device_s,index,taxel_0")


@pytest.mark.long
def test_an_object_of_ones_own_is_drawn_and_pressed_where_it_is(here, tmp_path):
    (tmp_path / "bar.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="30mm" height="6mm" viewBox="0 0 30 6">'
        '<rect width="30" height="6"/></svg>'
    )
    words = ["record", "--port", "simulated:hand", "--poses", "spread:12", "--frames", "5"]
    out = right(here(*words, "--shape", "bar.svg", "--out", "bar.npz"))
    assert "12 readings of bar in bar.npz" in out
    scan = Scan.load(tmp_path / "bar.npz")
    assert scan.readings.max(axis=1).min() > 5
    assert scan.meta["objects"]["bar"]["symmetry"] == 2
    refused(here(*words, "--shape", "bar.svg", "--letter", "A", "--out", "A.npz"), "leave --letter out")
    right(here("replay", "bar.tactrec", "--scan", "again.npz", "--shape", "bar.svg"))
    assert Scan.load(tmp_path / "again.npz").digest == scan.digest
    right(here("record", *words[1:], "--letter", "I", "--out", "I.npz"))
    right(here("replay", "bar.tactrec", "I.tactrec", "--scan", "both.npz", "--shape", "bar.svg"))
    measure = [
        "run", "--port", "simulated:hand", "--train-scan", "both.npz", "--trials", "1", "--readings", "3",
    ]  # fmt: skip
    measure += ["--frames", "5", "--estimator", "histogram", "--bins", "200"]
    right(here(*measure, "--shape", "bar.svg", "--out", "own"))
    run = load(tmp_path / "own")
    assert set(run.trials.truth) == {"bar", "I"}
    assert scan_of_sessions([tmp_path / "own.presses" / "bar-1.tactrec"]).readings.max(axis=1).min() > 5
    (tmp_path / "mug.svg").write_text((tmp_path / "bar.svg").read_text())
    refused(here(*measure, "--shape", "mug.svg", "--out", "no"), "mug", "bar")


@pytest.mark.long
def test_without_a_terminal_a_session_says_so_at_once(bench, tmp_path):
    with emulated(bench, "--port", "pty:pad"):
        session = bench.start("record", "--port", "pad", "--letter", "mug", "--out", "mug.npz")
        assert "'mug' is no letter of the catalogue" in session.stdout.readline()
        assert "no terminal" in session.stdout.readline()
        session.send_signal(signal.SIGINT)
        session.communicate(timeout=30)


def _marks(folder):
    """Tell whether two presses are in the recording that is being written."""
    from tactsim.hardware.recording import Kind, Tail

    records = Tail(folder / "A.tactrec").poll()
    return sum(record.kind is Kind.MARK for record in records) >= 2


def _pressed(poses):
    from tactsim import models
    from tactsim.press import press_letter

    return np.array([press_letter(models.letter("A"), pose).ideal for pose in poses])


def test_a_large_array_is_cut_into_touches(here, tmp_path):
    rng = np.random.default_rng(0)
    (tmp_path / "array.toml").write_text(
        'name = "16x16"\n[codec]\nkind = "pps-csv"\ntaxels = 256\n'
        "[pad]\nrows = 16\ncolumns = 16\nno_seam = true\nunread_columns = 0\n"
    )
    rows = [", ".join(["Time [ms]", *(f"Elem{k}" for k in range(256))])]
    rows += [", ".join(map(str, [100 * k, *rng.uniform(0, 50, 256).round(2)])) for k in range(4)]
    (tmp_path / "array.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "marks.csv").write_text(
        "label,split,x_mm,y_mm,theta_rad,first_s,last_s\nA,train,0,0,0,0,0.1\nA,test,1,0,0.5,0.2,0.3\n"
    )
    words = ["replay", "array.csv", "--device", "array.toml", "--marks", "marks.csv", "--cut", "5x5"]
    refused(here(*words), "name it with --scan")
    refused(here(*words, "--scan", "m.npz", "--moments", "4"), "no press of the recording shows a plateau")
    narrow = right(here(*words[:-1], "16x16", "--scan", "narrow.npz"))
    assert "too small for test touches at places of their own" in narrow
    assert "144 readings of A, 25 taxels" in right(here(*words, "--scan", "touches.npz"))
    made = Scan.load(tmp_path / "touches.npz")
    assert made.readings.shape == (144, 25)
    assert made.meta["objects"] == {}  # a label may be an object of one's own, whatever it is called
    right(here(*words, "--letters", "A", "--scan", "letters.npz"))
    assert Scan.load(tmp_path / "letters.npz").meta["objects"]["A"]["symmetry"] == 1
    refused(here(*words, "--letters", "Q", "--scan", "q.npz"), "no reading is of the letter 'Q'", "are A")


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["probe", "--port", "/dev/nothing"], ["there is no such port", "bench devices"]),
        (["probe", "--port", "x", "--device", "emulatd"], ["unknown device 'emulatd'", "'emulated'"]),
        (["tare", "--port", "simulated:A", "--out", "t.toml"], ["something touches the pad"]),
        (["record", "--port", "simulated:A", "--out", "a.npz", "--letter", "A"], ["never lifted", ":hand"]),
        (["record", "--port", "x", "--out", "a.npz", "--letter", "A", "--force", "3"], ["LEAST:MOST"]),
        (["record", "--port", "x", "--out", "a.csv"], ["FILE.tactrec", "bench replay FILE.tactrec --csv"]),
        (["replay", "nothing.tactrec"], ["cannot read recording nothing.tactrec"]),
        (["emulate", "--port", "tcp:x"], ["tcp:[HOST:]PORT"]),
        (["emulate", "--hold", "3"], ["--hold times presses, and nothing is pressed", "--letter"]),
    ],
)
def test_mistakes_end_in_one_line(here, words, parts):
    refused(here(*words), *parts)


MARKED = ["replay", "r.tactrec", "--marks", "m.csv"]


@pytest.mark.parametrize(("codec", "part"), [('unit = "psi"', ""), ("", '[[part]]\nfirst_row = "top"\n')])
def test_idle_readings_of_the_pad_are_read_as_its_recordings_are(here, tmp_path, codec, part):
    (tmp_path / "pad.toml").write_text(
        f'name = "2x2"\n[codec]\nkind = "pps-csv"\ntaxels = 4\n{codec}\n{part}'
        "[pad]\nrows = 2\ncolumns = 2\nno_seam = true\nunread_columns = 0\n"
    )
    title, rest, pressed = "Time [ms],a,b,c,d\n", ",10,20,30,40\n", ",10,20,30,50\n"
    (tmp_path / "idle.csv").write_text(title + "".join(f"{10 * k}{rest}" for k in range(9)))
    (tmp_path / "r.csv").write_text(
        title + "".join(f"{10 * k}{pressed if k > 3 else rest}" for k in range(9))
    )
    (tmp_path / "m.csv").write_text("label,x_mm,y_mm,theta_rad,first_s,last_s\nA,0,0,0,0.04,0.08\n")
    words = ["replay", "r.csv", "--device", "pad.toml", "--marks", "m.csv", "--idle", "idle.csv"]
    right(here(*words, "--scan", "new.npz"))
    read = Scan.load(tmp_path / "new.npz").readings
    assert read == pytest.approx(np.array([[0, 10, 0, 0]] if part else [[0, 0, 0, 68.94757]]))


@pytest.mark.parametrize(
    ("words", "option"),
    [(["replay", "r.tactrec", "--csv", "r.tactrec"], "--csv"), ([*MARKED, "--scan", "r.tactrec"], "--scan"),
     ([*MARKED, "--scan", "new.npz", "--csv", "new.npz"], "--scan"),
     (["emulate", "--plan", "m.csv", "--out", "m.csv"], "--out"),
     (["emulate", "--plan", "m.csv", "--out", "n.tactrec", "--marks", "m.csv"], "--marks"),
     (["submit", "letters-v1", "--estimator", "nearest", "--out", "held.npz"], "--out"),
     (["tare", "--port", "x", "--out", "tare.toml"], "--out"),
     (["fit", "held.npz", "--out", "tare.toml"], "--out"),
     (["scan", "--letters", "A", "--out", "held.npz"], "--out"),
     (["import", "x.h5", "--out", "held.npz"], "--out"),
     (["export", "x.npz", "--to", "hdf5", "--out", "held.npz"], "--out"),
     (["replay", "r.tactrec", "--scan", "held.npz"], "--scan"),
     (["record", "--port", "x", "--letter", "A", "--out", "held.npz"], "--out")],
)  # fmt: skip
def test_what_is_there_already_is_never_replaced(here, tmp_path, words, option):
    held = {name: name.encode() for name in ("r.tactrec", "m.csv", "held.npz", "tare.toml")}
    for name, content in held.items():
        (tmp_path / name).write_bytes(content)
    refused(here(*words), option, "name another")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == held


def test_a_mark_may_not_be_called_none(here, tmp_path):
    right(here("record", "--port", "simulated:A", "--out", "r.tactrec", "--seconds", "1"))
    (tmp_path / "m.csv").write_text(
        "label,split,x_mm,y_mm,theta_rad,first_s,last_s\nnone,train,0,0,0,0.1,0.5\n"
    )
    refused(here(*MARKED, "--scan", "new.npz"), "'none'", "rename it")
    assert not (tmp_path / "new.npz").exists()


@pytest.mark.long
def test_a_simulation_is_validated_and_brought_nearer(here, tmp_path, monkeypatch):
    """The recording is another simulation, whose parameters are known and have to be found.

    A sixth of a scan's presses finds the point spread to 0.03 mm times the root of six.
    """
    monkeypatch.setattr("tactsim.press.scan_poses.ANGLES", 4)
    right(here("scan", "--letters", "E", "--out", "simulated.npz"))
    truth = {"sensor.psf_sigma": 1.4, "sensor.noise": 3, "press.force": 2.5, "placement_mm": 0.5}
    changes = [word for name, value in truth.items() for word in ("--scan-set", f"{name}={value}")]
    right(here("scan", "--letters", "E", "--seed", "5", "--out", "whole.npz", *changes))
    whole = Scan.load(tmp_path / "whole.npz")
    few = slice(None, None, 2)
    Scan(  # as a recording with a dead taxel would be
        np.delete(whole.readings[few], 17, axis=1), whole.poses[few], whole.labels[few], whole.split[few],
        np.delete(whole.taxel_xy, 17, axis=0), {"source": "recorded"},
    ).save(tmp_path / "recorded.npz")  # fmt: skip
    words = ["validate", "--recorded", "recorded.npz", "--trials", "1", "--set", "bins=1000"]
    words += ["--estimator", "histogram"]
    said = right(here(*words, "--simulated", "simulated.npz", "--out", "result")).splitlines()
    assert [line.split()[0] for line in said[:3]] == ["near", "worth", "doubt"]
    before = json.loads((tmp_path / "result" / "validation.json").read_text())
    assert before["fit"]["psf_sigma"] == pytest.approx(1.4, abs=0.03 * np.sqrt(6))
    assert before["fit"]["noise"] == pytest.approx(3.0, abs=0.3)
    assert before["parameters"]["press"]["force"] == pytest.approx(2.5, rel=0.02)
    assert before["fit"]["placement_mm"] == pytest.approx(0.5, rel=0.15)
    assert before["errors"]["fitted"]["rms"] < before["errors"]["as_it_is"]["rms"]
    near = [100 * before["errors"][name]["relative"] for name in ("held_out_placed", "as_it_is")]
    assert [float(word) for word in re.findall(r"(\d+) %", said[0])] == [round(value) for value in near]
    right(here("scan", "--letters", "E", "--world", "result/world.toml", "--out", "nearer.npz"))
    after = json.loads(right(here(*words, "--simulated", "nearer.npz", "--json")))
    assert after["errors"]["as_it_is"]["rms"] < before["errors"]["as_it_is"]["rms"]
    assert after["fit"]["gain"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.long
def test_a_pad_of_odd_columns_without_a_seam_is_validated_in_counts(here, tmp_path):
    """Its world is written with `no_seam`, read again and pressed; twenty copies of a press count as one."""
    (tmp_path / "pad.toml").write_text(
        "rows = 4\ncolumns = 5\npitch_x = 3\npitch_y = 2.5\ntaxel_width = 2.8\ntaxel_height = 2.5\n"
        "no_seam = true\nunread_columns = 0\n"
    )
    rigid = ["--scan-set", "press.wrist_stiffness=rigid"]
    of_pad = ["scan", "--letters", "E,U", "--scan-set", "pad=pad.toml", *rigid]
    right(here(*of_pad, "--out", "simulated.npz"))
    right(here(*of_pad, "--scan-set", "sensor.noise=0.02", "--scan-set", "sensor.resolution=0", "--seed", "3",
               "--out", "other.npz"))  # fmt: skip
    other = Scan.load(tmp_path / "other.npz")
    few = np.flatnonzero((other.split == "test") & (np.linalg.norm(other.poses[:, :2], axis=1) < 8))[::9]
    rows = np.repeat(few, 20)
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 0.5, (len(rows), 20))
    split = np.where(np.arange(len(rows)) % 20 < 10, "train", "test")
    meta = {"source": "recorded", "unit": "count"}
    moments = np.where(np.arange(len(rows)) % 20 == 3, 0.7, 1.0)  # the fit takes none of .7
    readings = 40 * moments[:, None] * other.readings[rows] + noise
    Scan(readings, other.poses[rows], other.labels[rows], split, other.taxel_xy, meta, moments=moments).save(
        tmp_path / "recorded.npz"
    )
    words = ["--estimator", "histogram", "--set", "bins=200", "--trials", "1", "--out", "result"]
    pair = ["--simulated", "simulated.npz", "--recorded", "recorded.npz"]
    said = right(here("validate", *pair, *words))
    assert f"fitted to {9 * len(few)} training ones, near copies averaged to {len(few)}" in said
    assert (tmp_path / "result" / "presses.png").is_file()
    found = json.loads((tmp_path / "result" / "validation.json").read_text())
    assert found["fit"]["noise"] > 0.4  # of single presses; that of the means is 0.16
    assert found["parameters"]["sensor"]["noise"] == pytest.approx(found["fit"]["noise"], rel=1e-4)
    right(here("scan", "--world", "result/world.toml", "--out", "fitted.npz"))
    fitted = Scan.load(tmp_path / "fitted.npz")
    assert fitted.meta["options"]["pad"] == other.meta["options"]["pad"]
    assert fitted.about["units"]["readings"] == "count"
    assert np.array_equal(fitted.taxel_xy, other.taxel_xy)


def test_scans_that_cannot_be_compared_are_refused(here, tmp_path):
    right(here("scan", "--letters", "A", "--out", "a.npz"))
    scan = Scan.load(tmp_path / "a.npz")
    Scan(scan.readings, scan.poses, np.full(len(scan), "Z"), scan.split, scan.taxel_xy).save(
        tmp_path / "z.npz"
    )
    Scan(scan.readings, scan.poses, scan.labels, scan.split, scan.taxel_xy + 1).save(tmp_path / "moved.npz")
    words = ["validate", "--simulated"]
    refused(here(*words, "a.npz", "--recorded", "z.npz"), "'Z' was recorded but not simulated")
    refused(here(*words, "a.npz", "--recorded", "moved.npz"), "the pads differ")
    refused(here(*words, "z.npz", "--recorded", "a.npz"), "does not say how it was made")
    # Before anything is compared, which takes long.
    refused(here(*words, "a.npz", "--recorded", "moved.npz", "--estimator", "nix"), "unknown estimator 'nix'")
    refused(here("scan", "--out", "b.npz", "--world", "nothing.toml"), "cannot read world nothing.toml")


def test_presses_that_cannot_be_what_was_simulated_are_refused(here, tmp_path):
    """Each is named, before anything is fitted: idle frames, another place, one object under two labels."""
    right(here("scan", "--letters", "AE", "--out", "ae.npz"))
    scan = Scan.load(tmp_path / "ae.npz").where("train")
    near = np.flatnonzero((scan.labels == "A") & (np.linalg.norm(scan.poses[:, :2], axis=1) < 5))[:2]
    numbers = ", ".join(str(row + 1) for row in near)  # A comes first

    def refused_for(why, readings):
        replace(scan, readings=readings).save(tmp_path / "wrong.npz")
        refused(here("validate", "--simulated", "ae.npz", "--recorded", "wrong.npz"), why)

    few = np.arange(len(scan)) % 12 == 0
    replace(scan.chosen(few), readings=400 - scan.readings[few]).save(tmp_path / "few.npz")
    refused(
        here("validate", "--simulated", "ae.npz", "--recorded", "few.npz"), "nothing touches", "--zero 400"
    )
    idle = scan.readings.copy()
    idle[near] = 0.0
    refused_for("of the 192 presses of 'A' these are idle frames", idle)
    turned = scan.readings.copy()
    turned[near] = 0.0
    turned[near, scan.readings[near].argmin(axis=1)] = 50.0
    refused_for(
        f"of the 192 presses of 'A' these fit nowhere on what is pressed at their poses: {numbers};", turned
    )
    twice = scan.readings.copy()
    twice[np.flatnonzero(scan.labels == "E")[near]] = twice[near]
    refused_for(f"press {near[0] + 1} of 'E' is press {near[0] + 1} of 'A', to the last bit", twice)


def test_a_recording_that_failed_does_not_stand_in_its_own_way(bench, here, tmp_path):
    for words in (["--out", "a.tactrec"], ["--letter", "A", "--out", "A.npz"]):
        for _ in range(2):
            refused(here("record", "--port", "pad", *words), "there is no such port")
    with emulated(bench, "--port", "pty:pad") as name:
        words = ["record", "--port", name, "--out", "a.tactrec", "--seconds", "0.3"]
        refused(here(*words, "--device", "singletact-5x5"), "no whole frame")
        assert "readings in a.tactrec" in right(here(*words))
        refused(here(*words), "a.tactrec exists")


@pytest.mark.long
def test_a_recording_goes_on_when_the_pad_comes_back(bench, here, tmp_path):
    """The pad is away for longer than the deadline of 1 s."""
    with emulated(bench, "--port", "pty:pad"):
        process = bench.start("record", "--port", "pad", "--out", "a.tactrec", "--seconds", "6")
        wait_until(process, lambda: _size(tmp_path) >= 5000)
    time.sleep(1.5)
    before = _size(tmp_path)
    with emulated(bench, "--port", "pty:pad"):
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert "waiting for it" in output
    assert "reconnects 1" in output
    assert _size(tmp_path) > before + 5000
    right(here("replay", "a.tactrec", "--csv", "a.csv"))


def _size(folder):
    path = folder / "a.tactrec"
    return path.stat().st_size if path.exists() else 0


@pytest.mark.long
def test_without_a_terminal_a_session_says_each_trouble_once(bench, tmp_path):
    """Nobody lifts the letter, so it still touches: every reading of it is another number, and the same trouble."""
    bench.environment["PYTHONUNBUFFERED"] = "1"
    with emulated(bench, "--port", "tcp", "--letter", "A", "--hold", "600", "--lift", "0.01") as name:
        process = bench.start(
            "record", "--port", name, "--letter", "A", "--out", "A.npz", "--poses", "random:2"
        )
        said = [process.stdout.readline()]
        while "still reads" not in said[-1]:
            assert said[-1], "it has ended"
            said.append(process.stdout.readline())
        time.sleep(2.0)  # a hundred readings more
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=30)
    assert len(said) + len(rest.splitlines()) < 8
    assert (tmp_path / "A.tactrec").stat().st_size < 2_000_000


def test_a_scan_of_one_split_is_refused_with_the_way_out(here, tmp_path):
    right(here("scan", "--letters", "A", "--out", "a.npz"))
    scan = Scan.load(tmp_path / "a.npz")
    chosen = scan.where("train")
    chosen.save(tmp_path / "train.npz")
    refused(
        here("run", "--scan", "train.npz", "--trials", "1"), "no test readings", "--split", "--train-scan"
    )


SIX = """name = "six"
[codec]
kind = "csv"
taxels = 6
kpa_per_count = 1.0
[pad]
rows = 2
columns = 3
no_seam = true
unread_columns = 0
"""


def test_a_recording_without_a_clock_is_cut_into_presses_at_a_rate(here, tmp_path):
    """Six presses: every second one rises at once, and so has no half of its load on the way."""
    frames, marks = [np.zeros(6)] * 50, ["label,split,x_mm,y_mm,theta_rad,first_s,last_s"]
    for number in range(6):
        label = "AB"[number // 3]
        rise = [0.25, 0.5, 0.75] if number % 2 == 0 else []
        frames += [share * np.arange(40, 100, 10) for share in [*rise, *[1.0] * 20, *[0.0] * 27]]
        held = len(frames) - 47
        split = "train" if number % 3 == 0 else "test"
        marks.append(f"{label},{split},{number},0,0,{held / 25},{(held + 19) / 25}")
    (tmp_path / "a.txt").write_text("".join("\t".join(f"{x:g}" for x in frame) + "\n" for frame in frames))
    (tmp_path / "six.toml").write_text(SIX)
    (tmp_path / "marks.csv").write_text("\n".join(marks) + "\n")
    words = ("replay", "a.txt", "--device", "six.toml", "--marks", "marks.csv", "--scan")
    assert "--rate HZ" in here(*words, "none.npz").stderr
    done = here(*words, "half.npz", "--rate", "25", "--at-load", "50%")
    assert done.returncode == 0, done.stderr
    assert "2 test presses have no such moment and are left out: A 1 of 2, B 1 of 2" in done.stdout
    test = Scan.load(tmp_path / "half.npz").where("test")
    assert test.readings == pytest.approx(np.tile(np.arange(20, 50, 5), (2, 1)))
    refused(here(*words, "no.npz", "--rate", "0"), "--rate 0", "above 0")
    (tmp_path / "timed.txt").write_text("".join(f"{40 * k},1,2,3,4,5,6\n" for k in range(5)))
    (tmp_path / "six.toml").write_text(SIX.replace("taxels", 'before = ["clock"]\ntaxels'))
    refused(here("replay", "timed.txt", "--device", "six.toml", "--rate", "25"), "states its times itself")


def test_long_lines_are_probed_and_the_pad_that_they_are_of_is_asked_for(here, tmp_path):
    (tmp_path / "k.txt").write_text("\n".join("\t".join(["1000"] * 2048) for _ in range(20)))
    done = here("probe", "--port", "recording:k.txt")
    refused(done, "no device file says of which pad it is", "--device FILE.toml")
    assert "taxels = 2048" in done.stdout


def test_a_text_that_no_device_file_reads_is_refused_for_that_and_no_other_pad_is_named(here, tmp_path):
    (tmp_path / "k.txt").write_text("ovf,1,2,3\n" * 20)
    done = here("probe", "--port", "recording:k.txt")
    refused(done, "recording:k.txt", "no device file reads what came as it is")
    assert "'ovf' is no number" in done.stderr
    assert "emulated" not in done.stderr


def test_what_probe_prints_is_the_device_file_that_reads_the_port(bench, here, tmp_path):
    """Standard output is the file; the error names what to do with it, and not the command that was typed."""
    (tmp_path / "sketch.toml").write_text(
        'name = "sketch"\n[codec]\nkind = "csv"\ntaxels = 36\nzero = 820\nkpa_per_count = -0.1\n'
    )
    with emulated(bench, "--port", "pty:pad", "--device", "sketch.toml") as name:
        asked = here("probe", "--port", name)
        refused(asked, "--device FILE.toml", "keep the one above")
        assert "bench probe" not in asked.stderr
        (tmp_path / "mine.toml").write_text(asked.stdout)
        found = json.loads(right(here("probe", "--port", name, "--device", "mine.toml", "--json")))
        assert found["taxels"] == 36
        assert abs(np.array(found["mean_kpa"])).max() < 15  # its zero is what the pad sends
        right(here("tare", "--port", name, "--device", "mine.toml", "--out", "tare.toml"))
        refused(here("tare", "--port", name, "--device", "mine.toml", "--out", "tare.toml"), "--force")


def test_a_tare_names_taxels_under_a_load_that_the_device_file_allows(bench, here, tmp_path):
    (tmp_path / "loose.toml").write_text(
        'name = "loose"\nlargest_offset_kpa = 500\n[codec]\nkind = "csv"\ntaxels = 36\nkpa_per_count = 0.1\n'
    )
    loaded = ("--letter", "I", "--pose", "6,8,0", "--hold", "1000", "--lift", "0.1")  # its edge, on a column
    for more, named in ((loaded, True), ((), False)):
        with emulated(bench, "--port", "pty:pad", "--device", "loose.toml", *more) as name:
            right(here("probe", "--port", name, "--device", "loose.toml"))  # until it lies at rest
            said = right(here("tare", "--port", name, "--device", "loose.toml", "--out", f"{named}.toml"))
        assert ("far above the others" in said) == named
        assert "on the line" not in said  # the first line after opening may be torn, and is no fault
