import pytest
from made_pads import ramp

from tactsim.hardware.device import load_device
from tactsim.hardware.emulator import emulate


@pytest.fixture(scope="session")
def paper_pad():
    return load_device("emulated")


@pytest.fixture
def emulated_pad(paper_pad):
    return emulate(paper_pad, ramp(paper_pad), rate=200.0)
