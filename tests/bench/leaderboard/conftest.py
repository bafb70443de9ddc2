"""Plug-ins, installed as a user's are, and a small run for them."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

from tactsim.bench import experiment
from tactsim.bench.config import run_config

PLUG_INS = Path(__file__).parent / "plug_ins"
MODULES = ("guess", "random_guess", "counting", "failing", "peeking", "prepared")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """Write what pip would of an installed package: its entry points are called as their classes, in small letters."""
    folder = tmp_path_factory.mktemp("site")
    metadata = folder / "plugged-1.0.dist-info"
    metadata.mkdir()
    lines = ["[tactsim.estimators]"]
    for module in MODULES:
        for line in (PLUG_INS / f"{module}.py").read_text(encoding="utf-8").splitlines():
            if line.startswith("class ") and not line.startswith("class _") and "Options" not in line:
                name = line.removeprefix("class ").partition("(")[0]
                lines.append(f"{name.lower()} = {module}:{name}")
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def plugged(site, monkeypatch):
    """Install the plug-ins in this process, and in those that it starts."""
    monkeypatch.syspath_prepend(PLUG_INS)
    monkeypatch.syspath_prepend(site)
    yield
    assert not [name for name in MODULES if name in sys.modules], "the harness has imported a plug-in"


@pytest.fixture
def imported(plugged):
    """Import the plug-ins here after all, for a comparison."""
    yield import_module
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.fixture(scope="session")
def small_config():
    return lambda **words: run_config(**({"letters": "IO", "trials": 2, "readings": 4} | words))


@pytest.fixture(scope="session")
def gathered(small_config, shared_cache):
    return experiment.gather(small_config(), jobs=1, cache=True, progress=experiment.silent)
