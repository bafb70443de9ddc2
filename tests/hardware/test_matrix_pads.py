"""Device files of resistive matrices without guards: what an emulated one sends is un-mixed by who reads it."""

import numpy as np
import pytest
from made_pads import small_device

from tactsim.core import InputError
from tactsim.hardware.device import Matrix, load_device
from tactsim.hardware.emulator import emulate
from tactsim.hardware.stream import Stream

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
