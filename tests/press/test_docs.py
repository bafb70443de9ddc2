"""The page on the sensor has every effect with its default; the reference, made from the source, every option."""

from pathlib import Path

import pytest

import tactsim
from tactsim.press.scan_options import PressOptions, ScanOptions, SensorOptions
from tactsim.press.space import SpaceOptions

DOCS = Path(tactsim.__file__).parents[1] / "docs"
PAGE = (DOCS / "sensor.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| `")]


@pytest.mark.parametrize("name", SensorOptions.model_fields)
def test_every_effect_stands_there_with_its_default_and_what_is_assumed(name):
    field = SensorOptions.model_fields[name]
    (row,) = [row for row in ROWS if f"`{name}`" in row.split("|")[1]]
    assert str(field.default) in row.split("|")[2]
    assert ("assumed" in field.description) == ("assumed" in row)


@pytest.mark.parametrize("options", [ScanOptions, PressOptions, SensorOptions, SpaceOptions])
def test_the_reference_has_a_description_of_every_option(options):
    groups = {"pad", "press", "sensor", "skip"}  # whose own options are described one by one
    described = {name for name, field in options.model_fields.items() if field.description}
    assert set(options.model_fields) - described <= groups
