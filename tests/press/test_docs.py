"""The page on the sensor names every option with its default."""

from pathlib import Path

import pytest

import tactsim
from tactsim.press.scan_options import PressOptions, ScanOptions, SensorOptions, Skips

PAGE = (Path(tactsim.__file__).parents[1] / "docs" / "sensor.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| `")]


@pytest.mark.parametrize("options", [PressOptions, SensorOptions])
def test_every_option_stands_there_with_its_default_and_what_is_assumed(options):
    for name, field in options.model_fields.items():
        (row,) = [row for row in ROWS if f"`{name}`" in row.split("|")[1]]
        if name != "skip":
            assert str(field.default) in row.split("|")[2]
            assert ("assumed" in field.description) == ("assumed" in row), name


@pytest.mark.parametrize("name", ["placement_mm", "placement_rad", "placement_tilt", "rounding", "seed"])
def test_a_scan_s_options_stand_there(name):
    (row,) = [row for row in ROWS if f"`{name}`" in row.split("|")[1]]
    assert str(ScanOptions.model_fields[name].default) in row.split("|")[2]


@pytest.mark.parametrize("name", Skips.model_fields)
def test_every_skip_stands_there(name):
    assert any(f"`{name}`" in row.split("|")[1] for row in ROWS)
