"""What tests of all folders share. What is called and not given is in `tests/support`."""

import pytest
from command_line import Bench


@pytest.fixture(scope="session", autouse=True)
def shared_cache(tmp_path_factory):
    """Keep tests from the user's cache; what one test has pressed another finds."""
    folder = tmp_path_factory.mktemp("shared-cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTSIM_CACHE_DIR", str(folder))
        yield folder


@pytest.fixture
def own_cache(tmp_path_factory, monkeypatch):
    """Give a test a cache of its own, empty."""
    folder = tmp_path_factory.mktemp("own-cache")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(folder))
    return folder


@pytest.fixture
def bench(tmp_path, shared_cache):
    """Give the installed command in an empty folder, with the cache that all tests share."""
    return Bench(tmp_path, shared_cache)


@pytest.fixture(scope="session")
def scan_file(tmp_path_factory, shared_cache):
    """Write the scan of two letters, I and O, with the command line."""
    folder = tmp_path_factory.mktemp("scan")
    assert Bench(folder, shared_cache)("scan", "--out", "two.npz", "--letters", "IO").returncode == 0
    return folder / "two.npz"
