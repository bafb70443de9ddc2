import pytest
from synthetic import make_scan

from tactsim import Scan


@pytest.fixture(scope="session")
def scan() -> Scan:
    """Four shapes at the paper's 192 poses, on a pad of 6 x 6 taxels."""
    return make_scan()
