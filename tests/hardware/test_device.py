"""What `--pad` takes: a file of measures, a device file or a built-in name mean one pad wherever they are named."""

import numpy as np
import pytest
from made_pads import small_device

from tactsim.bench.config import key_values, run_config, scan_options
from tactsim.core import InputError, Pad
from tactsim.hardware.codecs.codec import CodecError
from tactsim.hardware.device import Matrix, built_in_devices, load_device
from tactsim.hardware.emulator import emulate
from tactsim.hardware.stream import Stream

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


PRESSED = np.array([40.0, 1.0, 25.0, 30.0, 1.0, 2.0])
FINE = {"kpa_per_count": 0.05, "zero": 0}


def read(device, emulated=None):
    """Let `emulated`, or the device itself, send what PRESSED is, and read it as the device does."""
    (message,) = emulate(emulated or device, lambda now: PRESSED, rate=10.0).say(0.0)
    (reading,) = Stream(device).received(0, message, 0.0)
    return reading.pressures


@pytest.mark.parametrize(
    "matrix", [{}, {"full_kpa": 150.0}, {"least_kpa": 1.0}, {"full_kpa": 90.0, "idle": "ground"}]
)
def test_what_a_matrix_sends_is_read_without_cross_talk(matrix):
    device = small_device(codec=FINE, matrix=matrix)
    assert np.abs(read(device) - PRESSED).max() < 0.3  # steps of 0.05 kPa, spread over the cells
    without = small_device(codec=FINE)
    assert np.abs(read(without, device) - PRESSED).max() > 5
    assert read(without) == pytest.approx(PRESSED, abs=0.03)


def test_a_column_over_its_resistor_is_a_divider_with_its_idle_cells_to_ground():
    """Row 0 at 1 V, column 0: 40 above, 30 and the resistor (that conducts 100) below. By hand 40 / 170 V."""
    matrix = Matrix(idle="ground", full_kpa=100.0)
    assert matrix.read(PRESSED.reshape(2, 3))[0, 0] == pytest.approx(100 * 40 / 170)
    assert matrix.cells(matrix.read(PRESSED.reshape(2, 3))).ravel() == pytest.approx(PRESSED)
    alone = Matrix(full_kpa=100.0).read(np.full((1, 1), 40.0))  # one cell and the resistor: 40 / 140 V
    assert alone[0, 0] == pytest.approx(100 * 40 / 140)


def test_a_matrix_without_a_codec_is_refused_in_one_line(tmp_path):
    (tmp_path / "x.toml").write_text('name = "x"\n[matrix]\n')
    with pytest.raises(InputError, match=r"installed source does it by itself, with tactsim.core.matrix"):
        load_device(tmp_path / "x.toml")
    (tmp_path / "x.toml").write_text('name = "x"\n[matrix]\nidle = "ground"\n')
    with pytest.raises(InputError, match="state full_kpa, or leave"):
        load_device(tmp_path / "x.toml")
    (tmp_path / "x.toml").write_text('name = "x"\n[matrix]\nleast_kpa = 0\n')
    with pytest.raises(InputError, match=r"matrix\.least_kpa"):
        load_device(tmp_path / "x.toml")
