"""Plug-ins, installed as a user's are."""

import sys
from pathlib import Path

import pytest

PLUG_INS = Path(__file__).parent / "plug_ins"
MODULES = ("guess", "random_guess", "failing", "prepared")


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
    assert not [name for name in MODULES if name in sys.modules], "the command has imported a plug-in"
