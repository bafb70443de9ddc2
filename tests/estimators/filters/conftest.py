import pytest
from synthetic import make_scan, paper_poses

from tactsim.core import Scan


@pytest.fixture(scope="session")
def scan() -> Scan:
    """Three shapes at 24 poses each, which are enough to tell them apart."""
    return make_scan("EIL", poses=paper_poses(positions=4, angles=6))
