"""The idle level and the sign of each taxel, found from the readings of presses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactsim.core import InputError, Pad, Scan
from tactsim.core.idle import failed_cells, find_idle, flickering, settled, unwrapped

TAXELS = 36


def pressed(seed=0, presses=120, noise=0.5, step=0.0):
    """Make readings of a pad of which every press covers some third; at rest they are 0 but for noise."""
    rng = np.random.default_rng(seed)
    covered = rng.random((presses, TAXELS)) < rng.uniform(0.1, 0.5, TAXELS)
    readings = covered * rng.uniform(5, 60, (presses, TAXELS)) + rng.normal(
        scale=noise, size=(presses, TAXELS)
    )
    return np.round(readings / step) * step if step else readings


def scan_of(readings):
    count = len(readings)
    return Scan.from_arrays(readings, np.zeros((count, 3)), ["A"] * count, unit="count")


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 5),
    st.sampled_from([0.0, 0.7]),
    st.floats(0.01, 100),
    st.lists(st.floats(-1e4, 1e4), min_size=TAXELS, max_size=TAXELS),
    st.sampled_from(["rising", "falling", "some fall"]),
)
def test_a_scale_offsets_and_a_sign_change_no_rise(seed, step, scale, offsets, way):
    readings = pressed(seed, step=step)
    sign = {"rising": 1.0, "falling": -1.0, "some fall": np.where(np.arange(TAXELS) % 3 == 0, -1.0, 1.0)}[way]
    given_readings = scale * readings * sign + np.array(offsets)
    rise = find_idle(given_readings).rise(given_readings)
    wanted = scale * find_idle(readings).rise(readings)
    assert np.abs(rise - wanted).max() < 1e-9 * (scale * 60 + 1e4)
    assert find_idle(given_readings).off_zero or np.array_equal(sign, 1.0)


def test_a_taxel_that_is_nearly_always_pressed_goes_with_the_others():
    readings = pressed()
    held = 30 + 30 * np.random.default_rng(1).random(len(readings))
    readings[:, 7] = np.where(np.arange(len(readings)) % 20 == 0, 0.0, held)
    idle = find_idle(readings + 400)
    assert (idle.sign == 1).all()
    assert not idle.known[7]
    assert "of 1 taxels it cannot be told" in idle.describe()


@pytest.mark.parametrize(("share", "failed"), [(0.15, 0.0), (0.05, 65535.0), (0.1, "the one before")])
@pytest.mark.parametrize("sign", [1, -1])
def test_frames_that_failed_have_no_say(share, failed, sign):
    readings = sign * pressed(presses=600) + np.random.default_rng(1).integers(300, 500, TAXELS)
    bad = np.random.default_rng(2).random(len(readings)) < share
    bad[0] = True
    among = readings.copy()
    among[bad] = readings[0] if isinstance(failed, str) else failed
    idle, alone = find_idle(among), find_idle(readings[~bad])
    assert np.array_equal(idle.sign, alone.sign)
    assert np.abs(idle.level - alone.level).max() < 0.1
    assert idle.off_zero
    assert f"; {bad.sum()} readings that come again to the digit" in idle.describe()
    assert "again" not in alone.describe()


def test_moments_of_a_press_that_are_one_frame_and_a_press_that_was_kept_twice_have_a_say():
    readings = pressed(presses=150) + np.random.default_rng(1).integers(300, 500, TAXELS)
    readings[1] = readings[0]
    press = np.repeat(np.arange(150), np.where(np.arange(150) < 75, 3, 1))
    taken, said = settled(replace(scan_of(readings[press]), presses=press))
    assert "again" not in said
    assert np.array_equal(taken.readings, find_idle(readings[press], press).rise(readings[press]))


def test_dead_taxels_have_no_say():
    readings = -pressed()
    readings[:, :20] = np.random.default_rng(0).normal(size=(len(readings), 20)) * 0.01
    assert (find_idle(readings).sign == -1).all()


@pytest.mark.parametrize("step", [0.0, 0.7])
def test_saturated_taxels_are_not_idle(step):
    readings = np.minimum(pressed(presses=600, step=step), 25)
    idle = find_idle(readings + 400)
    assert (idle.sign == 1).all()
    assert idle.level == pytest.approx(np.full(TAXELS, 400), abs=1)
    assert idle.known.all()
    falling = find_idle(400 - readings)  # or a pad that rests at 375 and is mostly loaded
    assert not falling.known[falling.sign > 0].any()


@pytest.mark.parametrize("offset", [0, 200])
@pytest.mark.parametrize("share", [0.3, 1.0])
def test_saturated_taxels_that_rest_less_often_are_not_taken_for_falling(offset, share):
    rng = np.random.default_rng(0)
    rest = 100.0 + offset * rng.random(TAXELS)
    at = rng.random((300, TAXELS))
    full = np.where(rng.permutation(TAXELS) < share * TAXELS, 0.4, 0.0)
    loads = rest + rng.random(at.shape) * (1023 - rest)
    readings = np.where(at < 0.3, rest, np.where(at > 1 - full, 2000, loads)) + rng.normal(0, 2, at.shape)
    idle = find_idle(np.clip(readings, 0, 1023).round())
    assert (idle.sign == 1).all()
    assert idle.level == pytest.approx(rest, abs=20)


@pytest.mark.parametrize("spread", [0.5, 3, 10])
def test_taxels_that_rest_at_one_value_and_are_mostly_loaded_rise(spread):
    rng = np.random.default_rng(0)
    loaded = rng.random((400, TAXELS)) < 0.7
    readings = np.where(loaded, 50 + rng.normal(scale=spread, size=loaded.shape), 0.0)
    idle = find_idle(readings)
    assert (idle.sign == 1).all()
    assert not idle.off_zero


def test_few_readings_are_taken_as_they_are():
    few = find_idle(pressed()[:9] + 400)
    assert np.array_equal(few.rise([500.0] * TAXELS), [500.0] * TAXELS)
    assert not few.known.any()
    assert find_idle(np.zeros((0, 4))).level.tolist() == [0, 0, 0, 0]
    assert not find_idle(np.zeros((3, 4))).off_zero


def test_a_scan_is_settled_once_and_says_so():
    raw = scan_of(4095 - 20 * pressed())
    taken, line = settled(raw)
    assert "falls" in line
    assert np.abs(np.quantile(taken.readings, 0.25, axis=0)).max() < 60
    assert taken.readings.max() > 1000
    again, line = settled(taken)
    assert again is taken
    assert "rest near 0" in line
    assert taken.meta["idle"]["sign"] == [-1.0] * TAXELS
    assert settled(raw, "off")[0] is raw


@pytest.mark.parametrize("zero", ["400", "frames"])
def test_a_level_that_is_known_is_taken_off(zero):
    readings = 400 + 20 * pressed()
    frames = np.full((5, TAXELS), 400.0) if zero == "frames" else None
    for turned in (1.0, -1.0):
        taken, _ = settled(
            scan_of(400 + turned * (readings - 400)), "auto" if zero == "frames" else zero, frames
        )
        assert taken.readings == pytest.approx(readings - 400)


def test_idle_readings_of_the_whole_pad_are_taken_for_the_taxels_that_are_left():
    readings = 400 + pressed()
    readings[:, 3] = np.nan
    frames = np.full((5, TAXELS), 400.0)
    frames[:, 3] = 7
    taken, _ = settled(scan_of(readings), frames=frames)
    assert taken.readings == pytest.approx(np.delete(readings, 3, axis=1) - 400)


@pytest.mark.parametrize(
    ("zero", "frames", "says"),
    [
        ("much", None, "give a number, auto or off"),
        ("3", np.zeros(TAXELS), "leave one out"),
        ("auto", np.full(TAXELS, np.nan), "idle readings"),
    ],
)
def test_a_mistake_is_one_line(zero, frames, says):
    with pytest.raises(InputError, match=says):
        settled(scan_of(pressed()), zero, frames)


@pytest.mark.parametrize("turned", [1, -1])
@pytest.mark.parametrize("mark", [65535.0, 9999.0, -9999.0, -32768.0, 0.0, 4095.0, 6553.5, -9999.25, 1e9])
def test_presses_with_failed_cells_are_left_out_and_counted(turned, mark):
    readings = np.round(3000 + turned * 10 * pressed())
    failed = np.random.default_rng(1).random(readings.shape) < 0.01
    kept = ~failed.any(axis=1)
    taken, said = settled(scan_of(np.where(failed, mark, readings)))
    right, _ = settled(scan_of(readings[kept]))
    assert taken.meta["idle"] == right.meta["idle"]
    assert np.array_equal(taken.readings, right.readings)
    assert set(taken.meta["idle"]["sign"]) == {turned}
    lost = f"{(~kept).sum():,} of {len(kept):,} readings with {failed.sum():,} failed cells, such as {mark!r}"
    assert said.startswith(lost)


@pytest.mark.parametrize("turned", [1, -1])
@pytest.mark.parametrize("mark", [65535.0, 9999.0, -9999.0])
@pytest.mark.parametrize("flicker", [65535.0, 9999.0, -9999.0, "random"])
def test_failed_cells_are_found_beside_a_taxel_that_flickers(turned, mark, flicker):
    """They turned the signs of most taxels: what one taxel reads made all of theirs look near."""
    rng = np.random.default_rng(2)
    whole = np.round(3000 + turned * 20 * pressed(presses=300))
    failed = rng.random(whole.shape) < 0.01
    readings = np.where(failed, mark, whole)
    often = rng.random(len(readings)) < 0.2
    readings[often, 2] = rng.integers(0, 65536, often.sum()) if flicker == "random" else flicker
    taken, said = settled(scan_of(readings))
    others = np.arange(whole.shape[1]) != 2
    lost = failed[:, others].any(axis=1)
    sign = np.array(taken.meta["idle"]["sign"])
    assert ((sign[others] if flicker == "random" else sign) == turned).all()
    if flicker != "random":
        assert flickering(readings).nonzero()[0].tolist() == [2]
        assert said.startswith("taxel 2 is left out: it fails in many presses")
        assert taken.readings.shape == (len(whole) - lost.sum(), others.sum())
        assert set(taken.meta["left_out"]) == {"2"}
        idle = np.full((5, TAXELS), 3000.0)
        assert np.allclose(settled(scan_of(readings), frames=idle)[0].meta["idle"]["level"], 3000)


def test_pads_of_which_many_taxels_fail_often_are_mended_or_refused():
    whole = np.round(3000 + 20 * pressed())
    often = np.random.default_rng(3).random(whole.shape) < 0.2
    taken, _ = settled(scan_of(np.where(often & (np.arange(TAXELS) % 4 == 2), 65535.0, whole)))
    assert set(taken.meta["left_out"]) == {*map(str, range(2, TAXELS, 4))}
    assert (np.array(taken.meta["idle"]["sign"]) == 1).all()
    with pytest.raises(InputError, match=r"of the cells read 8388607\.0, far from all others"):
        settled(scan_of(np.where(often, 2.0**23 - 1, whole)))


def test_a_large_reading_among_others_is_no_failed_cell():
    ramp = np.linspace(0, 9999, 400).reshape(100, 4)
    assert not failed_cells(ramp).any()
    assert not failed_cells(np.where(np.arange(4) == 2, 65535.0, pressed()[:, :4])).any()  # a dead taxel
    rising = np.round(3000 + 40 * pressed())
    for saturated in (
        np.minimum(rising, 4095),
        np.where(rising < 3100, 0, rising),
        np.clip(rising, 2990, 3500),
    ):
        assert not failed_cells(saturated).any()


@pytest.mark.parametrize("turned", [1, -1])
@pytest.mark.parametrize(("bits", "unit"), [(8, 1.0), (10, 1.0), (12, 0.1), (16, 1.0), (24, 1.0), (16, 0.1)])
def test_counts_below_0_without_a_sign_are_mended_and_counted(turned, bits, unit):
    counts = np.round(turned * 20 * pressed() / (10 if bits < 12 else 1))
    taken, said = settled(scan_of(np.mod(counts, 2.0**bits) * unit))
    right, also = settled(scan_of(counts * unit))
    assert np.allclose(taken.readings, right.readings)
    lost = f"{(counts < 0).sum():,} counts below 0 were stored without a sign, {2**bits - 1} for -1"
    assert said == f"{lost}, and are mended; {also}"


def test_large_counts_are_not_taken_for_counts_below_0():
    stuck = np.round(3000 + 20 * pressed())
    stuck[:, 3] = 65533 + np.arange(len(stuck)) % 3  # a taxel that never reads less
    failed = np.where(
        np.random.default_rng(1).random(stuck.shape) < 0.1, 65535.0, np.round(3000 + 20 * pressed())
    )
    ramp = np.round(np.linspace(0, 65535, 400)).reshape(100, 4)
    for counts in (stuck, failed, ramp, np.zeros((0, 4)), pressed()):
        mended, count = unwrapped(counts)
        assert count == 0
        assert np.array_equal(mended, counts)


@pytest.mark.parametrize("turned", [1, -1])
def test_a_level_that_drifts_from_press_to_press_is_said(turned):
    counts = np.round(3000 + turned * 20 * pressed(presses=300))
    drift = np.linspace(0, 300, len(counts)).round()[:, None]
    assert "drifts" not in settled(scan_of(counts))[1]
    assert "it drifts by 2" in settled(scan_of(counts + drift))[1]
    to_and_fro = 100 * np.sin(np.arange(len(counts)) / len(counts) * 6 * np.pi)[:, None]
    apart = drift * np.random.default_rng(0).choice([-1, 1], TAXELS)
    for moved in (to_and_fro, apart):
        assert "drifts" in settled(scan_of(counts + moved.round()))[1]


def whole_presses(seed=0, side=4, presses=20, moments=5):
    """Make counts of a ball, a bar and a ring that cover most of a pad, sorted by object, at rising loads."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side]
    readings, labels = [], []
    for kind in ("ball", "bar", "ring"):
        for _ in range(presses):
            for moment in range(moments):
                dx, dy = x - (side - 1) / 2 - rng.normal(0, 0.4), y - (side - 1) / 2 - rng.normal(0, 0.4)
                off = {"ball": np.hypot(dx, dy), "bar": dy, "ring": np.hypot(dx, dy) - 0.35 * side}[kind]
                image = 500 * np.exp(-((off / side / 0.15) ** 2) / 2) * rng.uniform(0.8, 1.2)
                load = 0.4 + 0.6 * (moment + 1) / moments
                readings.append((load * image + rng.normal(0, 15, image.shape)).clip(0).round().ravel())
                labels.append(kind)
    return np.array(readings), labels, np.repeat(np.arange(3 * presses), moments)


def scan_of_whole_presses(readings, labels, presses, pad):
    return Scan.from_arrays(
        readings, np.zeros((len(readings), 3)), labels, pad=pad, unit="count", presses=presses
    )


@pytest.mark.parametrize("side", [3, 4, 6])
@pytest.mark.parametrize("seed", range(3))
def test_load_of_covered_taxels_is_not_taken_for_rest(seed, side):
    """Taxels that objects cover in most presses were said to rest where they read 210 counts of load."""
    readings, labels, presses = whole_presses(seed, side)
    pad = Pad(rows=side, columns=side, pitch_x=3.4, pitch_y=3.4)
    raw = scan_of_whole_presses(readings, labels, presses, pad)
    taken, said = settled(raw)
    assert taken is raw
    assert "rest near 0" in said
    offsets = np.random.default_rng(seed).uniform(300, 500, side**2)
    for sign in (1, -1):
        taken, said = settled(replace(raw, readings=sign * readings + offsets))
        assert np.abs(taken.readings - readings).max() < 60  # of 500
        assert "drifts" not in said
        assert "taxels it cannot be told" in said


@pytest.mark.parametrize(("objects", "presses"), [(2, 150), (100, 5), (100, 3), (250, 2), (500, 1)])
def test_a_zero_that_drifts_is_said_however_few_presses_an_object_has(objects, presses):
    counts = np.round(3000 + 20 * pressed(presses=objects * presses))
    labels = np.tile([f"object {number}" for number in range(objects)], presses)  # in turn
    drift = np.linspace(0, 300, len(counts)).round()[:, None]
    assert "drifts" not in settled(replace(scan_of(counts), labels=labels))[1]
    assert "drifts" in settled(replace(scan_of(counts + drift), labels=labels))[1]


def test_what_objects_differ_by_is_no_drift_of_a_file_that_is_sorted_by_object():
    """One of the two presses on all taxels harder, so that fewer of them rest in its presses."""
    rng = np.random.default_rng(0)
    counts = np.round(3000 + 20 * pressed(presses=300))
    counts[150:] += np.where(rng.random(counts[150:].shape) < 0.8, 120, 0)
    of_two = replace(scan_of(counts), labels=np.repeat(["A", "B"], 150))
    assert "drifts" not in settled(of_two)[1]
    assert "drifts" in settled(replace(of_two, labels=np.full(300, "A")))[1]  # nobody could tell


def test_of_taxels_that_are_always_covered_nothing_is_taken_off():
    rng = np.random.default_rng(0)
    readings = 300 + 200 * rng.random((120, TAXELS)) + rng.normal(scale=5, size=(120, TAXELS))
    raw = scan_of(readings)
    taken, said = settled(raw)
    assert taken is raw
    assert "cannot be told" in said
    assert "so they were not zeroed" in said
