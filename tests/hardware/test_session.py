import re
import time
from dataclasses import replace

import numpy as np
import pytest
from made_pads import calibration, serving, small_device

from tactsim.core import InputError
from tactsim.core.reading import Reading
from tactsim.hardware.calibration import force
from tactsim.hardware.emulator import Faults, emulate
from tactsim.hardware.emulator.hand import SHARES, Pressing, Timing
from tactsim.hardware.live import LiveSource
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Recorder
from tactsim.hardware.scans import read_session, scan_of_sessions
from tactsim.hardware.session import Phase, Plan, Press, Session, Tare, count_taken

POSES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.5), (0.0, 2.0, 1.0), (1.0, 1.0, 0.0))


@pytest.fixture
def pad():
    return small_device(pad={"rows": 2, "columns": 3, "no_seam": True}).pad


def plan(**changes):
    return Plan.model_validate({"label": "A", "poses": POSES, "frames": 6, "window": 4} | changes)


def table(count=4):
    """Presses of 100 to 400 kPa, each on other taxels: 1 to 5 N."""
    return np.array([np.roll([100.0 * (k + 1), 150, 200, 0, 0, 50], k) for k in range(count)])


class Hand:
    """Presses what the session asks for, and reads it at 100 Hz with noise."""

    def __init__(self, session, rows, seed=0, noise=0.1):
        self.session, self.rows, self.noise = session, list(rows), noise
        self.rng = np.random.default_rng(seed)
        self.number, self.now = 0, 0.0
        self.pressing = Pressing(6, self.wanted, ramp=0.05)
        self.lifted_until = 0.0

    def wanted(self, now):
        if self.session.phase is Phase.LIFT or self.session.current >= len(self.rows):
            return None
        return self.rows[self.session.current]

    def reading(self):
        self.now += 0.01
        values = self.pressing(self.now) + self.noise * self.rng.standard_normal(6)
        return Reading(values, self.now)

    def steps(self, count):
        taken = []
        for _ in range(count):
            reading = self.reading()
            press = self.session.take(reading, self.number)
            self.number += 1
            taken += [press] if press else []
        return taken


def sliding(speed, rate=100.0):
    """An edge that slides over six taxels in a row, 2 mm apart, at constant force: 30 kPa a taxel in the mean."""
    at = 2.0 * np.arange(6)

    def image(now):
        values = 100 / (1 + np.exp(-(at - 5 - speed * now)))
        return 180 * values / values.sum()

    return image


@pytest.mark.parametrize(("speed", "taken"), [(0.0, 1), (20.0, 0)])
def test_a_slide_at_constant_force_is_no_press(pad, speed, taken):
    """20 mm/s is 2 mm within a press of ten readings; back and forth, so that it never leaves the pad."""
    image = sliding(speed)
    session = Session(plan(frames=10, window=10, patience=5.0), pad)
    hand = Hand(session, table(), noise=0.3)
    hand.pressing = lambda now: image(abs((now + 0.05) % 0.2 - 0.1)) if now > 0.1 else np.zeros(6)
    forces = [float(force(hand.pressing(now), pad)) for now in np.arange(0.2, 1.0, 0.01)]
    assert np.ptp(forces) < 1e-9
    assert len(hand.steps(150)) == taken


def test_a_slide_while_a_press_is_read_is_noticed(pad):
    image = sliding(10.0)
    session = Session(plan(frames=20), pad)
    hand = Hand(session, table())
    hand.pressing = lambda now: image(0.0) if now > 0.1 else np.zeros(6)
    while session.phase is not Phase.TAKING:
        hand.steps(1)
    start = hand.now
    hand.pressing = lambda now: image(now - start)
    assert hand.steps(22) == []
    assert session.message == "it moved; hold it still"


@pytest.mark.parametrize("noise", [0.1, 6.0])
def test_a_still_press_is_steady_whatever_its_noise(pad, noise):
    """Of 40 still presses nearly all are taken at the first go."""
    first = 0
    for seed in range(40):
        session = Session(plan(frames=20, window=10, touch_kpa=5 * noise), pad)
        hand = Hand(session, table(), seed=seed, noise=noise)
        still = table()[0]
        hand.pressing = lambda now, still=still: still if now > 0.1 else np.zeros(6)
        first += len(hand.steps(10 + 1 + 10 + 20))
    assert first >= 38


def test_a_loss_voids_the_open_press(pad):
    """The readings from before an unplugged cable are not averaged with those from behind it."""
    session = Session(plan(frames=20), pad)
    hand = Hand(session, table())
    while session.phase is not Phase.TAKING:
        hand.steps(1)
    assert hand.steps(15) == []
    again = hand.number
    lost = replace(hand.reading(), after_loss=True)
    assert session.take(lost, hand.number) is None
    hand.number += 1
    assert "lost for a moment" in session.message
    assert session.progress == 0
    while not (taken := hand.steps(1)):
        pass
    assert taken[0].first > again


def test_a_loss_is_no_touch_that_was_lifted(pad):
    """The letter still lies there from the press before: a lost cable must not make a second press of it."""
    session = Session(plan(), pad)
    hand = Hand(session, table())
    row = table()[0]
    hand.pressing = lambda now: row if now > 0.1 else np.zeros(6)
    while not hand.steps(1):
        pass
    session.take(replace(hand.reading(), after_loss=True), hand.number)
    hand.number += 1
    assert hand.steps(100) == []
    assert session.phase is Phase.LIFT


@pytest.mark.parametrize(
    ("pressing", "message"),
    [
        (lambda now: table()[0], "press 1 was given up after 3. s: the pad is never free"),
        (
            lambda now: table()[int(20 * now) % 4] if now > 0.1 else np.zeros(6),
            "press 1 was given up after.*does not come to rest",
        ),
    ],
)
def test_a_machine_that_gets_nowhere_ends(pad, pressing, message):
    """Without anybody who watches, the recording would grow for ever."""
    session = Session(plan(patience=1.0, frames=20, window=10), pad)
    hand = Hand(session, table())
    hand.pressing = pressing
    with pytest.raises(InputError, match=message):
        hand.steps(4000)


@pytest.mark.parametrize(
    ("scale", "message"), [(0.01, "too little; press with 0.3 N"), (50, "too much; press with 20 N")]
)
def test_a_press_with_the_wrong_force_is_not_taken(pad, scale, message):
    session = Session(plan(touch_kpa=0.5), pad)
    hand = Hand(session, scale * table(), noise=0.01)
    assert hand.steps(100) == []
    assert message in session.message


def test_a_press_on_nothing_can_be_taken_as_it_is(pad):
    """A hole of the letter can lie over the pad: nothing touches, and that is the reading."""
    session = Session(plan(), pad)
    hand = Hand(session, [np.zeros(6), *table()[1:]])
    assert hand.steps(100) == []
    session.take_anyway()
    (press,) = hand.steps(6)
    assert (press.number, press.what) == (0, "taken")
    assert np.abs(session.image).max() < 0.5


def test_a_machine_that_presses_needs_no_key(pad):
    session = Session(plan(patience=0.3), pad)
    hand = Hand(session, [np.zeros(6), table()[1], 0.02 * table()[2], table()[3]])
    assert [press.number for press in hand.steps(800)] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("level", "says"),
    [(-5.0, "untouched, the pad reads -0.10 N, taxel . -5.0 kPa: its zero has moved; take a tare"),
     (np.array([0, 0, 0, 0, -9.0, 0]), "taxel 4 -9"), (5.0, "taxel . still reads 5.* take a tare")],
)  # fmt: skip
def test_a_zero_that_has_moved_is_said_and_tared_away(pad, level, says):
    session = Session(plan(least_force=0.05), pad)
    hand = Hand(session, table(), noise=0.01)
    hand.pressing = lambda now: np.zeros(6) + level
    hand.steps(400)
    assert re.search(says, session.message)
    session.tared()
    hand.pressing = lambda now: np.zeros(6)
    hand.steps(20)
    assert (session.phase, session.message) == (Phase.TOUCH, "")


def test_a_press_from_a_fallen_zero_waits_for_a_tare_of_a_person(pad):
    """A machine's press is taken as it is once its patience is over."""
    for patience, taken in ((0.3, 1), (None, 0)):
        session = Session(plan(patience=patience), pad)
        hand = Hand(session, table())
        hand.pressing = lambda now: np.full(6, -5.0) if now < 0.2 else table()[0] - 5.0
        assert len(hand.steps(60)) == taken
    assert "its zero has moved; take a tare" in session.message
    session.tared()
    hand.pressing = Pressing(6, hand.wanted, ramp=0.05)
    assert hand.steps(100)


def test_presses_before_and_after_a_tare_have_each_their_zero(tmp_path):
    device, noise = small_device(), 0.1
    with Recorder(tmp_path / "a.tactrec") as recorder:
        recorder.segment({"device": device.as_json(), "plan": plan().model_dump(mode="json")}, 0.0)
        for number in range(20):
            values = np.arange(6.0) + noise * (-1) ** number + (30 if number >= 10 else 0)
            recorder.reading(Reading(values, 0.01 * number))
        for number in (0, 1):
            press = Press(number=number, what="taken", first=10 * number, count=10)
            recorder.mark(press.model_dump(), 1.0)
        tare = calibration(tare=(30.0,) * 6)
        recorder.mark(Tare(first=10, calibration=tare).model_dump(mode="json"), 1.0)
    scan = scan_of_sessions([tmp_path / "a.tactrec"])
    assert scan.readings == pytest.approx(np.tile(np.arange(6.0), (2, 1)))
    assert sum(1 for _ in Replay(tmp_path / "a.tactrec")) == 20


def test_the_same_press_is_never_taken_for_two_poses(pad):
    session = Session(plan(), pad)
    hand = Hand(session, table())
    row = table()[0]
    hand.pressing = Pressing(6, lambda now: row if now > 0.2 else None)
    assert [press.number for press in hand.steps(600)] == [0]
    assert "still reads" in session.message


def test_skip_and_redo(pad):
    session = Session(plan(), pad)
    hand = Hand(session, table())
    while not (taken := hand.steps(1)):
        pass
    assert session.skip() == Press(number=1, what="skipped")
    assert session.current == 2
    assert session.redo() == Press(number=1, what="redo")
    assert session.current == 1
    assert session.redo() == Press(number=0, what="redo")
    assert session.current == 0
    assert session.redo() is None
    assert [press.number for press in hand.steps(500)] == [0, 1, 2, 3]
    assert taken[0].number == 0


def record(path, pad, script, calibrations=(None,)):
    """Record a session in as many sittings as `calibrations`, stopping each after `script` steps."""
    device = small_device(pad=pad.model_dump())
    for sitting, known in enumerate(calibrations):
        presses, first = {}, 0
        if sitting:
            before = read_session(path)
            presses, first = before.presses, before.readings
        session = Session(plan(), pad, presses)
        hand = Hand(session, table(), seed=sitting)
        hand.number = first
        with Recorder(path, append=sitting > 0) as recorder:
            written = None if known is None else known.model_dump(mode="json")
            recorder.segment(
                {"device": device.as_json(), "calibration": written, "plan": plan().model_dump(mode="json")},
                0.0,
            )
            for _ in range(script[sitting]):
                reading = hand.reading()
                recorder.reading(reading)
                press = session.take(reading, hand.number)
                hand.number += 1
                if press:
                    recorder.mark(press.model_dump(), hand.now)
            recorder.end({}, hand.now)


@pytest.mark.parametrize("stop", [1, 50, 120])
def test_a_stopped_and_resumed_session_makes_the_whole_scan(tmp_path, pad, stop):
    record(tmp_path / "a", pad, [stop, 400], [None, None])
    scan = scan_of_sessions([tmp_path / "a"])
    assert len(scan) == 4
    assert np.abs(scan.readings - table()).max() < 0.5
    assert np.array_equal(scan.poses, POSES)
    assert set(scan.split) == {"train"}
    assert scan.meta["recordings"][0]["finished"]
    assert scan.meta["frame_noise_kpa"] == pytest.approx(0.1, rel=0.4)


def test_each_sittings_calibration_holds_for_its_own_presses(tmp_path, pad):
    sittings = [calibration(tare=(0.0,) * 6), calibration(tare=(7.0,) * 6, stuck=(3,))]
    record(tmp_path / "a", pad, [80, 400], sittings)
    scan = scan_of_sessions([tmp_path / "a"])
    kept = [0, 1, 2, 4, 5]
    assert np.array_equal(scan.taxel_xy, pad.taxel_xy[kept])
    offsets = np.median(table()[:, kept] - scan.readings, axis=1)
    first = [press.number for press in read_session(tmp_path / "a").presses.values() if press.first < 80]
    assert 0 < len(first) < 4
    assert np.allclose(offsets, [0.0 if number in first else 7.0 for number in range(4)], atol=0.2)


def test_a_session_cut_off_in_a_press_loses_that_press_only(tmp_path, pad):
    path = tmp_path / "a"
    record(path, pad, [100])
    assert len(read_session(path).presses) == 4
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * 0.6)])
    done = read_session(path)
    assert 0 < len(done.presses) < 4
    assert not done.whole.finished
    assert np.abs(scan_of_sessions([path]).readings - table()[: len(done.presses)]).max() < 0.5


@pytest.mark.parametrize(
    ("mark", "message"),
    [
        ({"number": 4, "what": "taken"}, "press 4 of a session with 4"),
        ({"number": 0, "what": "taken", "first": 5, "count": 6}, "come after it"),
        ({"first": 0, "calibration": {}}, "calibration.device"),
    ],
)
def test_marks_that_make_no_sense_are_refused(tmp_path, mark, message):
    with Recorder(tmp_path / "a") as recorder:
        recorder.segment({"device": small_device().as_json(), "plan": plan().model_dump(mode="json")}, 0.0)
        recorder.mark(mark, 0.0)
    with pytest.raises(InputError, match=message):
        read_session(tmp_path / "a")


@pytest.mark.long
def test_no_press_is_averaged_across_a_cable_that_is_cut_again_and_again(tmp_path):
    """A real pty that is cut every 0.7 s, a hand that holds each press for 1 s: what is taken lies between two cuts."""
    device = small_device()
    rising = table(2)[:, None] * np.array(SHARES)[:, None]
    hand = Timing(hold=0.9, lift=0.2, ramp=0.05).pressing(rising, again=True)
    session, readings, taken = Session(plan(frames=20), device.pad), [], []
    with (
        serving(emulate(device, hand, 100.0), faults=Faults(disconnect=0.7), link=tmp_path / "pad") as url,
        LiveSource([url], device) as source,
    ):
        until = time.monotonic() + 30
        while (source.counters.reconnects < 4 or not taken) and time.monotonic() < until:
            readings.append(source.read(5.0))
            press = session.take(readings[-1], len(readings) - 1)
            taken += [press] if press else []
    assert taken
    assert sum(reading.after_loss for reading in readings) >= 3
    for press in taken:
        held = readings[press.first : press.first + press.count]
        assert not any(reading.after_loss for reading in held[1:])
        assert np.diff([reading.device_time for reading in held]).max() < 0.25


def test_a_session_may_have_enough_before_its_last_pose(pad):
    session = Session(plan(enough=2), pad)
    hand = Hand(session, table())
    assert session.skip().number == 0
    while session.phase is not Phase.DONE:
        hand.steps(1)
    assert sorted(session.presses) == [0, 1, 2]
    assert count_taken(session.presses) == 2
    again = session.redo()
    assert again.number == 2
    assert session.current == 2
    assert session.phase is not Phase.DONE


def test_more_than_all_cannot_be_enough():
    with pytest.raises(ValueError, match="5 presses of 4"):
        plan(enough=5)
