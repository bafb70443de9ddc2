import pytest
from level_world import at_few_angles


@pytest.fixture(autouse=True)
def _own_cache(own_cache):
    """Keep tests from each other's cache."""


@pytest.fixture
def few_angles():
    with at_few_angles():
        yield
