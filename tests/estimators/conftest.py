import pytest
from synthetic import make_scan

from tactsim.core import Scan
from tactsim.press import ScanOptions, scan_letters


@pytest.fixture(scope="session")
def scan() -> Scan:
    """Four shapes at the paper's 192 poses, on a pad of 6 x 6 taxels; no physics."""
    return make_scan()


@pytest.fixture(scope="session")
def vowels(shared_cache) -> Scan:
    """The paper's experiment: five letters, test readings at the training poses."""
    return scan_letters(ScanOptions(test_poses="same"))[0]
