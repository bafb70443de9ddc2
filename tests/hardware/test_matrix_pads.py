"""Device files of resistive matrices without guards: what an emulated one sends is un-mixed by who reads it."""

import numpy as np
import pytest
from made_pads import small_device

from tactsim.core import InputError
from tactsim.hardware.device import load_device
from tactsim.hardware.emulator import emulate
from tactsim.hardware.stream import Stream

PRESSED = np.array([40.0, 1.0, 25.0, 30.0, 1.0, 2.0])
FINE = {"kpa_per_count": 0.05, "zero": 0}


def read(device, emulated=None):
    """Let `emulated`, or the device itself, send what PRESSED is, and read it as the device does."""
    (message,) = emulate(emulated or device, lambda now: PRESSED, rate=10.0).say(0.0)
    (reading,) = Stream(device).received(0, message, 0.0)
    return reading.pressures


@pytest.mark.parametrize("matrix", [{}, {"full_kpa": 150.0}, {"least_kpa": 1.0}])
def test_what_a_matrix_sends_is_read_without_cross_talk(matrix):
    device = small_device(codec=FINE, matrix=matrix)
    assert np.abs(read(device) - PRESSED).max() < 0.3  # steps of 0.05 kPa, spread over the cells
    without = small_device(codec=FINE)
    assert np.abs(read(without, device) - PRESSED).max() > 5
    assert read(without) == pytest.approx(PRESSED, abs=0.03)


def test_recordings_of_other_pads_do_not_mention_it():
    assert "matrix" not in small_device().as_json()
    assert small_device(matrix={}).as_json()["matrix"]["least_kpa"] == 0.1


def test_a_matrix_without_a_codec_is_refused_in_one_line(tmp_path):
    (tmp_path / "x.toml").write_text('name = "x"\n[matrix]\n')
    with pytest.raises(InputError, match=r"installed source does it by itself, with tactsim.core.matrix"):
        load_device(tmp_path / "x.toml")
    (tmp_path / "x.toml").write_text('name = "x"\n[matrix]\nleast_kpa = 0\n')
    with pytest.raises(InputError, match=r"matrix\.least_kpa"):
        load_device(tmp_path / "x.toml")
