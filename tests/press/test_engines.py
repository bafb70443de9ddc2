"""All engines press the same letters and must agree, each with its own error."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from exact_readings import expected_reading
from hypothesis import given, settings
from hypothesis import strategies as st
from level_world import level_press, level_scan
from test_accuracy import LEAST_AREA

from tactsim import models
from tactsim.core import Pad, transform
from tactsim.press import ScanOptions, bed, facet_kernels, press_letter, scan_letters
from tactsim.press.clip import covers
from tactsim.press.collide import lattice
from tactsim.press.engine import ideal_readings, press_at
from tactsim.press.scan_options import Skips
from tactsim.press.scan_poses import REACH, grid_poses, random_poses
from tactsim.press.touches import MOST_TILT, Touches

POSES = np.concatenate([grid_poses()[7::61], random_poses(np.random.default_rng(3), 2)])
EVERY_POSE = np.concatenate([grid_poses(), random_poses(np.random.default_rng(4))])
TILT, WRIST = 0.0044, 300.0  # rad, N mm/rad


def options(engine, **press):
    return level_scan(press=level_press(engine=engine, **({"wrist_stiffness": None} | press)))


def read(engine, touches, **press):
    chosen = options(engine, **press)
    pressed = press_at(touches, chosen)
    assert not pressed.blanks
    return pressed.readings(chosen)


def against_each_other(name, poses, tilt, wrist, **press):
    """Press by every engine: worst taxel's difference over the peak, where the letter touches enough."""
    letter = models.letter(name)
    tilts = tilt * np.random.default_rng(len(name)).standard_normal((len(poses), 2))
    touches = Touches(letter, poses, tilts)
    readings = {
        engine: read(engine, touches, wrist_stiffness=wrist, **press)
        for engine in ("exact", "bed", "collide")
    }
    area = np.array([expected_reading(letter.footprint, pose, Pad())[1] for pose in poses])
    enough = area >= LEAST_AREA
    peak = readings["bed"][enough].max(axis=1)
    return {
        engine: np.abs(readings[engine] - readings["bed"])[enough].max(axis=1) / peak
        for engine in ("exact", "collide")
    }


@pytest.mark.parametrize("name", ["A", "Q", "8"])
def test_a_glyph_reads_the_same_by_every_engine(name):
    for tilt, wrist in ((0.0, None), (TILT, WRIST)):
        apart = against_each_other(name, POSES, tilt, wrist)
        assert apart["exact"].max() < 1e-5
        assert apart["collide"].max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", models.names())
def test_every_glyph_reads_the_same_at_every_pose(name):
    level = against_each_other(name, EVERY_POSE, 0.0, None)
    assert level["exact"].max() < 1e-5
    assert np.percentile(level["collide"], 95) < 0.03
    tilted = against_each_other(name, EVERY_POSE, TILT, WRIST)
    assert tilted["exact"].max() < 1e-5
    assert np.percentile(tilted["collide"], 95) < 0.05


@pytest.mark.long
def test_collide_keeps_to_the_figure_that_the_page_states():
    """95 % of the worst taxels of the vowels are within 0.9 kPa, on the paper's poses and on any in their range."""
    within = random_poses(np.random.default_rng(4)) * (10.2 / REACH, 10.2 / REACH, 1)
    for poses in (grid_poses()[::2], within[::2]):
        worst = []
        for name in "AEIOU":
            letter = models.letter(name)
            readings = read("collide", Touches.of(letter, poses))
            for pose, reading in zip(poses, readings, strict=True):
                expected, area = expected_reading(letter.footprint, pose, Pad())
                if area >= LEAST_AREA:
                    worst.append(np.abs(reading - expected).max())
        assert np.percentile(worst, 95) < 0.9


@pytest.mark.parametrize("name", ["A", "O"])
def test_mujoco_touches_the_points_that_the_letter_covers(name):
    """No contact is lost to a mesh and none doubled, but at seams of parts and on the outline itself."""
    letter, pad = models.letter(name), Pad()
    chosen = options("collide")
    touches = Touches.of(letter, random_poses(np.random.default_rng(5), 24))
    load = press_at(touches, chosen).load
    points = lattice(pad, chosen.press.points_per_taxel)
    lost = twice = found = 0
    for index, pose in enumerate(touches.poses):
        inside = covers(letter.contours, transform(pose[None], points).reshape(-1, 2))
        times = np.bincount(load.point[load.press == index], minlength=len(points))
        assert times.max(initial=0) <= 2
        lost += np.count_nonzero(inside & (times == 0))
        twice += np.count_nonzero(times == 2)
        found += np.count_nonzero((times > 0) & ~inside)
    assert lost == 0
    assert twice < 2e-3 * len(load.point)
    assert found < 2e-3 * len(load.point)


def test_collide_presses_rounded_edges_as_the_bed_does():
    letter = models.letter("U", rounding=0.25)
    touches = Touches(letter, POSES, np.full((len(POSES), 2), 0.003))
    want, got = read("bed", touches), read("collide", touches, points_per_taxel=150)
    touched = want.any(axis=1)
    assert (np.abs(got - want)[touched].max(axis=1) / want[touched].max(axis=1)).max() < 0.03


@settings(max_examples=20, deadline=None)
@given(
    st.floats(1e-3, 30.0), st.floats(10.0, 1e4), st.floats(-0.03, 0.03), st.floats(-0.03, 0.03),
    st.one_of(st.none(), st.floats(200.0, 1e5)),
)  # fmt: skip
def test_tilted_presses_agree_over_forces_and_stiffnesses(force, stiffness, tilt_x, tilt_y, wrist):
    touches = Touches.of(models.letter("E"), np.array([[0.5, -1.0, 0.3]]), (tilt_x, tilt_y))
    chosen = {"force": force, "stiffness": stiffness, "wrist_stiffness": wrist, "points_per_taxel": 150}
    beds, exact, collided = (
        press_at(touches, options(engine, **chosen)) for engine in ("bed", "exact", "collide")
    )
    assert beds.blanks or not exact.blanks  # at some mN the bed may give up where the closed form does not
    if beds.blanks:
        return
    want = beds.readings(options("bed", **chosen))
    assert exact.readings(options("exact", **chosen)) == pytest.approx(want, abs=1e-5 * want.max())
    if collided.blanks or beds.load.bed.area.sum() < LEAST_AREA:  # of what still touches
        return
    got = collided.readings(options("collide", **chosen))
    assert np.abs(got - want).max() < 0.06 * want.max()


def test_presses_do_not_depend_on_those_before():
    touches = Touches(models.letter("A"), POSES, np.linspace(-0.01, 0.01, 2 * len(POSES)).reshape(-1, 2))
    chosen = options("collide", wrist_stiffness=WRIST)
    together = press_at(touches, chosen).readings(chosen)
    backwards = Touches(touches.letter, touches.poses[::-1], touches.tilts[::-1])
    assert np.array_equal(press_at(backwards, chosen).readings(chosen)[::-1], together)


def test_a_letter_that_tips_over_is_a_blank_with_its_reason():
    touches = Touches.of(models.letter("I"), np.array([[9.0, 0.0, 0.0]]))
    for engine in ("exact", "bed", "collide"):
        chosen = options(engine, wrist_stiffness=2.0, force=20.0)
        pressed = press_at(touches, chosen)
        assert pressed.blanks[0]
        assert not pressed.readings(chosen).any()
    assert "tips over" in pressed.blanks[0]


def test_a_press_has_tipped_over_at_the_same_tilt_whoever_presses():
    """Kernels take their constants from files of kernels, and those without kernels cannot import these."""
    assert MOST_TILT == facet_kernels.STEEPEST


@pytest.mark.parametrize(
    ("engine", "rounding", "off"),
    [("auto", 0.0, 2e-3), ("auto", 0.3, 1e-2), pytest.param("bed", 0.0, 2e-3, marks=pytest.mark.slow)],
)
def test_a_fine_pad_reads_in_the_mean_what_a_coarse_one_does(engine, rounding, off):
    """Of 120x120 taxels, whose springs do not fit into the memory that MuJoCo takes by itself."""

    def pad(count, cells, **press):
        side = 18.0 / count
        taxels = Pad(
            rows=count, columns=count, pitch_x=side, pitch_y=side, taxel_width=side, taxel_height=side, seam=None,
            unread_columns=0,
        )  # fmt: skip
        options = ScanOptions(pad=taxels, press={"cells_per_taxel": cells, **press})
        return press_letter(models.letter("H", rounding=rounding), [1.0, 2.0, 0.3], options).ideal.reshape(
            count, count
        )

    means = pad(120, 2, engine=engine).reshape(6, 20, 6, 20).mean(axis=(1, 3))
    coarse = pad(6, 8)
    assert means == pytest.approx(coarse, abs=off * coarse.max())


FAR = np.array([[40.0, 0.0, 0.0], [0.0, -30.0, 1.0]])
GRID_POSES = np.concatenate([grid_poses()[::9], FAR])


@cache
def ideal(name, engine="bed", **skips):
    options = level_scan(press=level_press(engine=engine, skip=Skips(**skips)))
    return ideal_readings(Touches.of(models.letter(name), GRID_POSES), options)


@pytest.mark.parametrize("name", ["A", "O"])
def test_a_level_flat_face_needs_no_solver(name):
    usual, work = ideal(name, "auto")
    solved, more = ideal(name)
    assert solved == pytest.approx(usual, abs=1e-8 * usual.max())
    assert (work["no_contact"], work["presses"]) == (len(FAR), len(GRID_POSES) - len(FAR))
    assert (work["engine_exact"], work["engine_bed"]) == (work["presses"], 0)
    assert (more["engine_exact"], more["engine_bed"]) == (0, work["presses"])


def test_a_press_beside_the_pad_reads_nothing_with_and_without_physics():
    usual, work = ideal("A")
    without, more = ideal("A", no_contact=False)
    assert np.array_equal(usual, without)
    assert (work["no_contact"], more["no_contact"]) == (len(FAR), 0)


@pytest.mark.parametrize("engine", ["bed", "collide"])
def test_stages_of_mujoco_that_are_left_out_change_no_bit(engine, monkeypatch):
    touches = Touches(models.letter("O"), GRID_POSES, np.full((len(GRID_POSES), 2), 0.01))
    options = level_scan(press=level_press(engine=engine, wrist_stiffness=300.0))
    usual, _ = ideal_readings(touches, options)
    monkeypatch.setattr(f"tactsim.press.{'scene' if engine == 'bed' else engine}.UNREAD_STAGES", ())
    with ThreadPoolExecutor(1) as other:  # another thread compiles scenes of its own
        whole, _ = other.submit(ideal_readings, touches, options).result()
    assert np.array_equal(usual, whole)


def test_poses_in_blocks_do_not_change_a_bit(monkeypatch):
    options = level_scan(press=level_press(engine="bed", wrist_stiffness=300.0))
    touches = Touches(
        models.letter("A"), GRID_POSES, np.random.default_rng(0).normal(scale=0.01, size=(len(GRID_POSES), 2))
    )
    once, _ = ideal_readings(touches, options)
    for poses in (1, 7):
        cells = np.prod([len(lines) - 1 for lines in options.cell_lines])
        monkeypatch.setattr(bed, "_BLOCK", poses * cells)
        in_blocks, _ = ideal_readings(touches, options)
        assert np.array_equal(once, in_blocks)
    assert once.any()


def test_a_known_pose_is_not_pressed_again():
    exact = {"letters": ("U",), "test_poses": "same", "placement_mm": 0.0, "placement_rad": 0.0}
    scan, work = scan_letters(level_scan(**exact), cache=False)
    other, more = scan_letters(level_scan(**exact, press=level_press(skip=Skips(known=False))), cache=False)
    assert (work["presses"], work["skipped"]["known"]) == (192, 192)
    assert (more["presses"], more["skipped"]["known"]) == (384, 0)
    assert np.array_equal(scan.readings, other.readings)


def test_all_switches_leave_a_scan_as_it_is():
    usual, _ = scan_letters(level_scan(letters=("E",)), cache=False)
    off = level_press(skip=Skips(no_contact=False, known=False), engine="bed")
    other, work = scan_letters(level_scan(letters=("E",), press=off), cache=False)
    assert np.array_equal(usual.readings, other.readings)  # the resolution swallows the rounding
    assert work["presses"] == 384
    assert not any(work["skipped"].values())


@pytest.mark.long
def test_any_number_of_processes_gives_the_same_bits(monkeypatch):
    monkeypatch.setattr("tactsim.press.scanning.WORTH_A_WORKER", 1e-3)
    options = level_scan(letters=("I", "O"), test_poses="random")
    done = []
    alone, work = scan_letters(options, cache=False)
    many, same = scan_letters(options, jobs=2, cache=False, progress=lambda n, total: done.append((n, total)))
    assert np.array_equal(alone.readings, many.readings)
    assert np.array_equal(alone.poses, many.poses)
    assert alone.meta == many.meta
    assert work == same
    assert done[-1] == (768, 768)
    assert [n for n, _ in done] == sorted(n for n, _ in done)
