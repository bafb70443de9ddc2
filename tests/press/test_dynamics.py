from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from level_world import at_few_angles, level_press, level_scan
from pydantic import ValidationError
from scipy.optimize import brentq

from tactsim import models
from tactsim.core import InputError, Pad
from tactsim.press import SensorOptions, press_letter, scan_letters
from tactsim.press.bed import lay_bed, levels
from tactsim.press.dynamics import ForceControl, contact_history
from tactsim.press.scene import Setup, UnsettledError, scene
from tactsim.press.touches import Touches


def both(name, pose, **press):
    letter = models.letter(name)
    still = press_letter(letter, pose, level_scan(press=level_press(**press)))
    moving = press_letter(letter, pose, level_scan(press=level_press(dynamics="full", **press)))
    return still, moving


@pytest.mark.parametrize(
    "press",
    [{}, {"tilt_x": 0.01, "tilt_y": -0.005}, {"tilt_x": 0.01, "wrist_stiffness": 2000.0},
     {"ramp": 0.0, "approach_speed": 50.0}, {"force": 1000.0, "thickness": 0.2}],
)  # fmt: skip
def test_it_ends_where_the_equilibrium_is(press):
    still, moving = both("E", [-3.4, 3.4, 0.5], **press)
    assert moving.ideal == pytest.approx(still.ideal, abs=5e-3 * still.ideal.max())


def test_the_image_sequence_runs_from_nothing_to_the_reading():
    _, press = both("A", [0.0, 0.0, 0.3], frame_rate=500.0)
    assert press.sequence.shape == (len(press.times), 36)
    assert not press.sequence[0].any()
    assert np.array_equal(press.sequence[-1], press.ideal)
    assert np.diff(press.times[:-1]) == pytest.approx(0.002)
    total = press.sequence.sum(axis=1)
    touched = np.argmax(total > 0)
    assert 0 < touched < len(total) - 10
    # 0.2 mm at 10 mm/s or less, then a ramp of 50 ms
    assert press.times[touched] == pytest.approx(press.trace.touch_time, abs=0.002)
    assert press.trace.touch_time == pytest.approx(0.023, abs=0.004)
    assert press.times[np.argmax(total > 0.9 * total[-1])] == pytest.approx(0.06, abs=0.01)


TOO_SHORT = level_scan(letters=("E",), press=level_press(dynamics="full", ramp=0.01, time_limit=0.035))


def test_a_press_that_does_not_settle_is_reported(few_angles):
    with pytest.raises(UnsettledError, match=r"'E'.*time_limit"):
        press_letter(models.letter("E"), [0.0, 0.0, 0.0], TOO_SHORT)
    with pytest.raises(InputError, match=r"16 of 16 presses of 'E' do not come to rest.*time_limit"):
        scan_letters(TOO_SHORT, cache=False)


@pytest.mark.long
def test_a_worker_s_unsettled_press_is_reported_too(monkeypatch, few_angles):
    monkeypatch.setattr("tactsim.press.scanning.WORTH_A_WORKER", 1e-3)
    with pytest.raises(InputError, match=r"'E'.*time_limit"):
        scan_letters(TOO_SHORT, jobs=2, cache=False)


def test_a_press_that_failed_leaves_nothing_behind():
    """The same scene serves the next press: it must be as if compiled anew, bit for bit."""
    letter, pose = models.letter("E"), [0.0, 3.4, 0.2]
    tilted = {"dynamics": "full", "tilt_x": 0.01, "wrist_stiffness": 3000.0}
    with pytest.raises(UnsettledError):
        press_letter(letter, pose, level_scan(press=level_press(time_limit=0.08, **tilted)))
    used = press_letter(letter, pose, level_scan(press=level_press(**tilted)))
    with ThreadPoolExecutor(1) as other:  # another thread has scenes of its own
        fresh = other.submit(press_letter, letter, pose, level_scan(press=level_press(**tilted))).result()
    assert np.array_equal(used.sequence, fresh.sequence)


def history(*, name="E", pose=(1.0, 2.0, 0.3), step_share=1.0, **press):
    """Press through time without the sensor: the history and the springs' areas."""
    options = level_scan(press=level_press(dynamics="full", **press))
    touches = Touches.of(models.letter(name), np.array([pose]), (options.press.tilt_x, options.press.tilt_y))
    bed = lay_bed(levels(touches.letter, options.press), touches.poses, *options.cell_lines)
    return contact_history(bed, touches, 0, options, step_share=step_share), bed.area


@pytest.mark.parametrize(
    "press",
    [
        {"moving_mass": 0.01, "stiffness": 1e5, "force": 0.05},
        {"moving_mass": 10.0, "stiffness": 10.0, "force": 100.0},
    ],
)
def test_the_force_is_reached_without_overshoot_whatever_is_moved_against_what(press):
    force = press["force"]
    peaks = []
    for step_share in (1.0, 0.25):
        done, area = history(**press, step_share=step_share)
        peaks.append(done.trace.force.max())
        assert peaks[-1] <= 1.001 * force
        assert done.forces[-1] == pytest.approx(force * area / area.sum(), rel=1e-3)
        assert done.trace.settle_time < 0.6
        after = done.trace.times > done.trace.touch_time + done.trace.settle_time + 1e-9
        assert np.abs(done.trace.force[after] - force).max() <= 0.02 * force
    assert peaks[0] == pytest.approx(peaks[1], rel=0.05)


def test_shorter_steps_converge_to_one_history():
    """First order: half the step, half the error."""
    runs = [history(step_share=share)[0] for share in (1.0, 0.5, 0.25, 0.02)]
    until = min(len(run.times) for run in runs) - 1
    totals = [run.forces[:until].sum(axis=1) for run in runs]
    errors = [np.abs(total - totals[-1]).max() for total in totals[:-1]]
    assert errors[0] < 0.05 * 2.0
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_without_a_ramp_a_flat_face_answers_as_two_equal_poles(monkeypatch):
    """The closed form of the module for a step of the set point, from rest at the surface."""
    monkeypatch.setattr("tactsim.press.dynamics._DISSIPATION", 0.0)
    monkeypatch.setattr("tactsim.press.dynamics.CLEARANCE", 0.0)
    done, area = history(ramp=0.0, step_share=0.02, approach_speed=1000.0)
    times, force = done.trace.times - done.trace.touch_time, done.trace.force
    rate = np.sqrt(2 * 1000.0 * area.sum() / 0.1)
    assert force / 2.0 == pytest.approx(1 - (1 + rate * times) * np.exp(-rate * times), abs=0.005)


@pytest.mark.parametrize("softer", [0.03, 0.3])
def test_a_softer_contact_than_assumed_does_not_overshoot(softer):
    """A tilted letter meets only a part of the layer at first."""
    mass, stiffness, force, step = 0.1, 6e4, 2.0, 1e-5
    control = ForceControl.designed(
        mass, stiffness, force=force, approach_speed=1.0, ramp=0.0, dissipation=0.0
    )
    depth = velocity = peak = 0.0
    for _ in range(60_000):
        measured = max(softer * stiffness * depth, 0.0)
        push = control.motor_force(control.contact(force, measured), velocity, measured, step)
        velocity += step * (push - measured) / mass
        depth += step * velocity
        peak = max(peak, measured)
    assert measured == pytest.approx(force, rel=1e-3)
    assert peak <= 1.0005 * force


def test_the_servo_is_exact_without_contact_at_any_step():
    control = ForceControl.designed(0.1, 6e4, force=2.0, approach_speed=0.01, ramp=0.05, dissipation=0.0)
    for step in (1e-6, 1e-3, 1.0):
        push = control.motor_force(0.02, 0.005, 0.0, step)
        left = 0.02 - (0.005 + push / 0.1 * step)
        assert left == pytest.approx(0.015 * np.exp(-control.servo / 0.1 * step), abs=1e-12)


@pytest.mark.parametrize(("dissipation", "most"), [(0.0, 1.0), (0.5, 1.0), (4.0, 0.25)])
def test_damping_at_most_doubles_the_layers_force_at_the_speed_in_contact(dissipation, most):
    """The layer's force is k x (1 + c v): the carriage is driven at c v = 1 at most, s/m times m/s."""
    control = ForceControl.designed(
        0.1, 6e4, force=2000.0, approach_speed=1.0, ramp=0.0, dissipation=dissipation
    )
    assert control.touch_speed == control.contact(1e9, 0.0) == -control.contact(0.0, 1e9) == most


# m/s and s/m, whose product is all that a bounce depends on.
@pytest.mark.parametrize(("speed", "dissipation"), [(0.01, 0.0), (0.1, 30.0)])
def test_a_free_letter_bounces_as_hunt_and_crossley_say(speed, dissipation):
    """m v dv = -k x (1 + c v) dx gives c u + log(1 - c u) = -(c v - log(1 + c v)) for leaving at speed u."""
    letter, options = models.letter("I"), level_press(dynamics="full")
    bed = lay_bed(levels(letter, options), np.zeros((1, 3)), *Pad().grid_lines(2))
    (springs,) = bed.springs
    stage = scene(Setup(mass=0.1), len(springs.share), np.zeros(2))
    rate = np.sqrt(1000.0 * springs.area / 0.1)
    step = 4e-4 / rate
    stage.set_springs(springs, 1000.0, step=step)
    stage.reset(0.0)
    data = stage.data
    data.qvel[0] = speed
    data.qfrc_applied[0] = 0.0
    energies = []
    while data.qpos[0] >= 0:
        depth = np.maximum(stage.depths(springs) + step * data.qvel[0], 0)
        stage.set_step(springs, 1000.0, step=step, bed_relaxation=dissipation * depth, hinge_relaxation=0.0)
        mujoco.mj_step(stage.model, data)
        forces = stage.forces(len(springs.share))
        assert (forces >= 0).all()
        energies.append(0.05 * data.qvel[0] ** 2 + 500.0 * springs.area * max(data.qpos[0], 0.0) ** 2)
    assert np.diff(energies).max() <= 1e-9 * energies[0]  # never gained
    left = -data.qvel[0]
    if dissipation:
        came = dissipation * speed - np.log1p(dissipation * speed)
        speed = brentq(
            lambda u: -dissipation * u - np.log1p(-dissipation * u) - came, 0, (1 - 1e-12) / dissipation
        )
    assert left == pytest.approx(speed, rel=2e-3)


def test_a_tilted_letter_changes_its_picture_on_the_way():
    """One picture times a scalar no longer: the side that touches first carries all at first."""
    _, press = both("E", [0.0, 0.0, 0.3], tilt_x=0.01, wrist_stiffness=300.0, force=5.0, frame_rate=1000.0)
    total = press.sequence.sum(axis=1)
    early = press.sequence[np.argmax(total > 0.05 * total[-1])]
    assert np.corrcoef(early, press.ideal)[0, 1] < 0.9


@pytest.mark.parametrize("press", [{"ramp": 5.0}, {"approach_speed": 0.04}])
def test_a_time_limit_that_cannot_do_is_refused(press):
    with pytest.raises(ValidationError, match="time_limit"):
        level_press(dynamics="full", **press)
    level_press(**press)


FULL = level_scan(
    letters=("I",), press=level_press(dynamics="full", frame_rate=100.0),
    sensor=SensorOptions(noise=0, resolution=0), placement_mm=0, placement_rad=0, test_poses="same",
)  # fmt: skip


@pytest.fixture(scope="module")
def taken():
    with at_few_angles():
        return scan_letters(FULL, cache=False, sequence=True)


def test_a_scan_holds_the_images_of_each_press(taken, few_angles):
    scan, work = taken
    assert scan.sequence.shape == (96, len(scan.sequence_times), 36)
    assert scan.sequence_times == pytest.approx(np.arange(1, len(scan.sequence_times) + 1) / 100)
    for row in np.flatnonzero(scan.readings.any(axis=1))[[3, 25, -1]]:
        press = press_letter(models.letter("I"), scan.poses[row], FULL)
        before = len(press.times) - 1
        assert scan.sequence[row, :before] == pytest.approx(press.sequence[:-1], abs=1e-4)
        assert scan.sequence[row, before:] == pytest.approx(
            np.tile(press.ideal, (len(scan.sequence_times) - before, 1)), abs=1e-4
        )
    assert np.array_equal(scan.sequence[:, -1], scan.readings.astype(np.float32))
    assert scan.sequence_times[-1] >= work["settle_time"]["longest"]


def test_the_force_of_each_press_ends_at_the_set_force_or_is_none(taken, few_angles):
    scan, work = taken
    touching = scan.readings.any(axis=1)
    assert scan.sequence_force[touching, -1] == pytest.approx(2.0, rel=1e-3)
    assert not scan.sequence_force[~touching].any()
    assert (~touching).any()
    assert np.count_nonzero(touching) == 2 * work["presses"]  # the test readings are the same presses


def test_how_presses_settle_is_summed_up(taken, few_angles):
    _, work = taken
    assert 0.03 < work["settle_time"]["median"] <= work["settle_time"]["longest"] < 1
    assert 0 <= work["overshoot"] < 0.01


def test_images_have_the_sensor_s_imperfections_with_random_numbers_of_their_own(taken, few_angles):
    sensor = SensorOptions(noise=3.0, resolution=0.5, gain_spread=0.3, drift=5.0, dead_taxels=(7,))
    options = FULL.model_copy(update={"sensor": sensor})
    scan, _ = scan_letters(options, cache=False, sequence=True)
    usual, work = scan_letters(options, cache=False)
    assert np.array_equal(scan.readings, usual.readings)
    assert usual.sequence is None
    assert work["settle_time"]["median"] > 0
    untouched = ~taken[0].readings.any(axis=1)
    images = scan.sequence[untouched]
    assert np.delete(images, 7, axis=2).std() == pytest.approx(3.0, rel=0.02)
    assert not images[:, :, 7].any()
    assert np.abs(images.mean()) < 0.1  # the zero drifts from press to press, not from image to image
    assert np.array_equal(scan.sequence, np.round(scan.sequence / 0.5) * 0.5)
    assert np.corrcoef(images[:, 0, 0], images[:, 1, 0])[0, 1] < 0.3


def test_sequences_that_no_file_would_hold_are_refused(monkeypatch, few_angles):
    monkeypatch.setattr("tactsim.press.dynamics.LARGEST", 25_000)
    with pytest.raises(InputError, match=r"press\.frame_rate"):
        scan_letters(FULL, cache=False, sequence=True)
