import pytest


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    """Keep tests from the user's cache, and from each other's."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(folder))
    return folder
