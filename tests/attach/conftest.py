import pytest


@pytest.fixture(autouse=True)
def _own_cache(own_cache):
    """Keep tests from each other's cache."""
