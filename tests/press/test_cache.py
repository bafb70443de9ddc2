import numpy as np
import pytest
from level_world import level_press, level_scan

from tactsim.press import cache, scan_letters

pytestmark = pytest.mark.usefixtures("few_angles")

OPTIONS = level_scan(letters=("E", "I"))


def files(folder):
    return sorted(folder.glob("*.readings"))


def test_a_cached_scan_is_the_same_and_presses_nothing(own_cache):
    fresh, work = scan_letters(OPTIONS)
    again, less = scan_letters(OPTIONS)
    uncached, more = scan_letters(OPTIONS, cache=False)
    assert np.array_equal(fresh.readings, again.readings)
    assert np.array_equal(fresh.readings, uncached.readings)
    assert fresh.meta == again.meta == uncached.meta
    assert work["presses"] == more["presses"] > 0
    assert (less["presses"], less["skipped"]["cached"]) == (0, 192)
    assert len(files(own_cache)) == 4


def cut(content):
    return content[: len(content) // 2]


def flip(content):
    return content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]


@pytest.mark.parametrize("damage", [cut, flip, lambda _: b""], ids=["cut", "flipped", "empty"])
def test_a_damaged_file_is_made_again(own_cache, damage):
    fresh, _ = scan_letters(OPTIONS)
    for path in files(own_cache):
        path.write_bytes(damage(path.read_bytes()))
    again, work = scan_letters(OPTIONS)
    assert work["skipped"]["cached"] == 0
    assert np.array_equal(fresh.readings, again.readings)
    assert scan_letters(OPTIONS)[1]["skipped"]["cached"] == 192


@pytest.mark.parametrize(
    "other",
    [level_scan(letters=("E", "I"), seed=1), level_scan(letters=("E", "I"), press=level_press(force=1.0))],
)
def test_what_changes_a_reading_changes_the_key(other):
    scan_letters(OPTIONS)
    assert scan_letters(other)[1]["skipped"]["cached"] == 0


def test_another_shape_at_the_same_poses_has_another_key():
    exact = {"placement_mm": 0, "placement_rad": 0, "test_poses": "same"}
    scan_letters(level_scan(letters=("E",), **exact))
    assert scan_letters(level_scan(letters=("I",), **exact))[1]["skipped"]["cached"] == 0


def test_noise_is_no_reason_to_press_again():
    scan_letters(OPTIONS)
    noisy = OPTIONS.model_copy(update={"sensor": OPTIONS.sensor.model_copy(update={"noise": 5.0})})
    scan, work = scan_letters(noisy)
    assert work["presses"] == 0
    assert np.array_equal(scan.readings, scan_letters(noisy, cache=False)[0].readings)


def test_a_folder_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(blocked))
    scan, work = scan_letters(OPTIONS)
    assert work["presses"] > 0
    assert len(scan) == 192


def test_readings_of_another_source_are_not_taken(monkeypatch):
    scan_letters(OPTIONS)
    monkeypatch.setattr(cache, "source_digest", lambda: "0" * 64)
    assert scan_letters(OPTIONS)[1]["skipped"]["cached"] == 0
