import pytest
from command_line import Bench


@pytest.fixture
def bench(tmp_path):
    """Give the installed command in an empty folder, with a cache of its own: faults are told apart."""
    return Bench(tmp_path)
