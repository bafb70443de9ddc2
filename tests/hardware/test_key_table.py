"""The tables of a device file's keys have every key that a device is written with."""

import pytest

from tactsim.core import InputError
from tactsim.hardware.device import Device, load_device
from tactsim.hardware.key_table import key_tables


def keys(content):
    """List all keys that a device, written down whole, has."""
    for key, value in content.items():
        yield key
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, dict):
                yield from keys(inner)


@pytest.mark.parametrize("name", ["emulated", "singletact-5x5"])
def test_every_key_that_a_device_is_written_with_stands_there(name):
    written = set(keys(load_device(name).as_json())) - {"kind", "is", "codec", "pad", "part"}
    assert len(written) > 15
    assert [key for key in written if f"| `{key}` |" not in key_tables()] == []


def test_true_is_no_number_of_a_device_file(tmp_path):
    content = """
        name = "x"
        [codec]
        kind = "singletact"
        full_scale_kpa = 100
        torn_frames = true
        [pad]
        rows = 1
        columns = 1
        no_seam = true
    """
    (tmp_path / "x.toml").write_text(content)
    with pytest.raises(InputError, match=r"codec.torn_frames: a number is wanted, not true"):
        load_device(tmp_path / "x.toml")
    (tmp_path / "x.toml").write_text(content.replace("true\n        [pad]", "1\n        [pad]"))
    assert isinstance(load_device(tmp_path / "x.toml"), Device)
