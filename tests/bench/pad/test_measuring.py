"""`bench run --port`: trials measured press by press, on a simulated hand and on an emulated pad behind a pty."""

import signal

import numpy as np
import pytest
from command_line import refused, wait_until

import tactsim
from tactsim.bench.pad import measured_scan, poses_to_press, recording_of
from tactsim.bench.runs.saved import load
from tactsim.bench.trials import OneTrial, TrialPlan, TrialRules
from tactsim.core.poses import invert
from tactsim.hardware.recording import Kind, Tail
from tactsim.hardware.scans import read_session, scan_of_sessions

HAND = [
    "--port", "simulated:hand", "--seed", "0", "--frames", "3", "--estimator", "histogram", "--bins", "1000",
]  # fmt: skip


def marks(path):
    return sum(record.kind is Kind.MARK for record in Tail(path).poll())


@pytest.mark.long
def test_trials_are_measured_stopped_gone_on_with_and_scored(bench, here, scan_file, tmp_path):
    words = ["run", *HAND, "--train-scan", scan_file, "--trials", "2", "--readings", "3", "--out", "friday"]
    session = bench.start(*words)
    wait_until(session, lambda: marks(tmp_path / "friday.presses" / "I-2.tactrec") >= 1)
    session.send_signal(signal.SIGINT)
    output, errors = session.communicate(timeout=30)
    assert session.returncode == 0, errors
    assert "of 12 presses are measured; the same command" in output
    assert not (tmp_path / "friday").exists()
    kept = scan_of_sessions([tmp_path / "friday.presses" / "I-1.tactrec"])

    done = here(*words)
    assert done.returncode == 0, done.stderr
    assert "trial 2 of 4: press 3 of 3: taken" in done.stdout
    assert "trial 1 of 4" not in done.stdout
    run = load(tmp_path / "friday")
    assert run.trials.label.shape == (4, 3)

    folder = tmp_path / "friday.presses"
    scan = measured_scan(folder, ("I", "O"), trials=2, readings=3)
    assert np.array_equal(scan.readings[:3], kept.readings)
    for number, (letter, trial) in enumerate((letter, trial) for letter in "IO" for trial in range(2)):
        own = scan_of_sessions([recording_of(folder, letter, trial)])
        plan = TrialPlan("refined", {}, scan, TrialRules(3, 0, measured=True))
        test = plan.test_readings(OneTrial(letter, trial))
        assert np.array_equal(test.readings, own.readings)
        assert np.array_equal(test.poses, own.poses)
        assert sorted(run.trials.touch_index[number]) == [0, 1, 2]

    # What is measured once serves every estimator, without a pad; and a run can be done again from its own settings.
    config = {**run.config, "presses": folder}
    again = tactsim.run(**config)
    assert np.array_equal(again.trials.label, run.trials.label)
    assert np.array_equal(again.trials.pose, run.trials.pose)
    with pytest.raises(tactsim.InputError, match=r"I-3.tactrec was not measured yet.*--port"):
        tactsim.run(**{**config, "trials": 3})
    refused(here(*words[:4], "1", *words[5:-1], "other", "--presses", folder), "another seed")


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--port", "pad"], ["--train-scan", "bench record"]),
        (["--port", "pad", "--train-scan", "two.npz"], ["cannot open pad", "no such port"]),
        (["--port", "pad", "--train-scan", "two.npz", "--device", "singletact-5x5"], ["another pad"]),
        (["--port", "simulated:A@0,0,0.3", "--train-scan", "two.npz"], ["never lifted", "simulated:hand"]),
    ],
)
def test_mistakes_end_in_one_line(here, scan_file, tmp_path, words, parts):
    (tmp_path / "two.npz").write_bytes(scan_file.read_bytes())
    done = here("run", *words, "--out", "r")
    refused(done, *parts)
    assert "kept" not in done.stdout
    assert not (tmp_path / "r").exists()
    assert not list(tmp_path.glob("r.presses/*"))


def test_the_poses_of_a_trial_lie_on_the_marks_of_the_template():
    poses = poses_to_press("A", 0, 10, seed=0, pad=tactsim.Pad())
    assert len(poses) > 10
    assert np.array_equal(poses[:, :2], np.round(poses[:, :2]))
    assert np.allclose(np.rad2deg(poses[:, 2]) % 5, 0, atol=1e-9) or np.allclose(
        np.abs(np.rad2deg(poses[:, 2]) % 5 - 2.5), 2.5, atol=1e-9
    )
    assert (poses[:, 2] < 2 * np.pi).all()
    assert not np.array_equal(poses, poses_to_press("A", 1, 10, seed=0, pad=tactsim.Pad()))
    assert not np.array_equal(poses, poses_to_press("B", 0, 10, seed=0, pad=tactsim.Pad()))


def test_what_nobody_drew_is_pressed_with_its_origin_on_the_pad():
    pad = tactsim.Pad(rows=10, columns=10, pitch_x=2.5, pitch_y=2.5, no_seam=True, unread_columns=0)
    poses = poses_to_press("stone", 0, 10, seed=0, pad=pad)
    assert len(poses) == 30
    assert np.abs(invert(poses)[:, :2]).max() < 12.5


def test_a_letters_name_is_no_path(tmp_path):
    path = recording_of(tmp_path, "../A/B", 0)
    assert path.parent == tmp_path


def test_too_few_presses_are_named(tmp_path, made_session):
    made_session(tmp_path / "A-1.tactrec", taken=2)
    assert read_session(tmp_path / "A-1.tactrec").plan.label == "A"
    with pytest.raises(tactsim.InputError, match="has 2 presses of 3; the same command with --port"):
        measured_scan(tmp_path, "A", trials=1, readings=3)
    assert len(measured_scan(tmp_path, "A", trials=1, readings=1)) == 1


@pytest.fixture
def made_session():
    """Write a session's recording: presses of three readings each."""
    from tactsim.core.reading import Reading
    from tactsim.hardware.device import load_device
    from tactsim.hardware.recording import Recorder
    from tactsim.hardware.session import Plan, Press

    def make(path, taken):
        plan = Plan(label="A", split="test", poses=((0, 0, 0), (1, 0, 0), (0, 1, 0)), enough=3)
        with Recorder(path) as recorder:
            recorder.segment(
                {"device": load_device("emulated").as_json(), "plan": plan.model_dump(mode="json")},
                0.0,
            )  # fmt: skip
            for number in range(taken):
                for k in range(3):
                    recorder.reading(Reading(np.full(36, 10.0 * number), 3.0 * number + k))
                recorder.mark(Press(number=number, what="taken", first=3 * number, count=3).model_dump(), 0.0)

    return make
