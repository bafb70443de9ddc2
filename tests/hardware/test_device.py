"""What `--pad` takes: a file of measures, a device file or a built-in name mean one pad wherever they are named."""

import pytest

from tactsim.bench.config import key_values, run_config, scan_options
from tactsim.core import InputError, Pad
from tactsim.hardware.codecs.codec import CodecError
from tactsim.hardware.device import built_in_devices, load_device

MEASURES = "rows = 4\ncolumns = 8\npitch_x = 3.0\nunread_columns = 0\n"
DEVICE = 'name = "mine"\n[pad]\n' + MEASURES
ONE_ARRAY = Pad(rows=4, columns=8, pitch_x=3.0, unread_columns=0, seam=None)


@pytest.mark.parametrize("content", [MEASURES, DEVICE])
@pytest.mark.parametrize("seam", ["no_seam = true", 'seam = "none"'])
def test_a_file_means_the_same_pad_wherever_it_is_named(tmp_path, content, seam):
    path = tmp_path / "mine.toml"
    path.write_text(content + seam)
    assert Pad.load(path) == load_device(path).pad == ONE_ARRAY
    assert scan_options(pad=path).pad == run_config(pad=str(path)).scan_options.pad == ONE_ARRAY
    assert scan_options(scan_set={"pad": str(path)}).pad == ONE_ARRAY
    assert load_device(path).name == "mine"


@pytest.mark.parametrize("name", built_in_devices())
def test_a_built_in_name_is_pressed_as_it_is_read(name):
    assert scan_options(pad=name).pad == load_device(name).pad


@pytest.mark.parametrize("word", ["pad.seam=none", "pad.seam=None", "pad.no_seam=true"])
def test_no_seam_is_one_thing_in_both_spellings(word):
    changed = scan_options(scan_set=key_values([word], "--scan-set")).pad
    assert changed == scan_options().pad.model_copy(update={"seam": None})


def test_none_is_the_word_where_an_option_has_it_and_no_value_where_it_may_have_none():
    words = ["sensor.ghosting=none", "sensor.saturation=none"]
    sensor = scan_options(scan_set=key_values(words, "--scan-set")).sensor
    assert (sensor.ghosting, sensor.saturation) == ("none", None)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"pad": "flexitac"}, "unknown device 'flexitac': did you mean 'flexitac-"),
        ({"pad": "paper"}, "the paper's pad is called 'emulated'"),
        ({"pad": "dfrobot-4x8", "scan_set": {"pad.rows": 3}}, "the pad dfrobot-4x8 has its measures"),
        ({"scan_set": {"pad.no_seam": "maybe"}}, "unknown option 'pad.no_seam'"),
    ],
)
def test_a_mistake_is_one_line(words, says):
    with pytest.raises(InputError, match=says) as caught:
        run_config(**words)
    assert "\n" not in str(caught.value)


def test_measures_alone_are_read_by_no_codec(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MEASURES + "no_seam = true")
    with pytest.raises(CodecError, match=r"'mine' has no \[codec\]"):
        load_device(path).build_codec()
    path.write_text("rows = 0")
    with pytest.raises(InputError, match=r"^pad .*mine\.toml: rows"):
        load_device(path)
