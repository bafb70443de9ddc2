"""Install a package with entry points, as pip would leave it on disk, for as long as a test runs."""

from pathlib import Path

import pytest


def install_plug_in(
    place: Path,
    patch: pytest.MonkeyPatch,
    origin: str = "plugged",
    group: str = "tactsim.estimators",
    **points: str,
) -> None:
    """Make entry points `name="module:Class"` of the modules in `place` known to this process."""
    metadata = place / f"{origin}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {origin}\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in points.items()]
    (metadata / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines]) + "\n")
    patch.syspath_prepend(str(place))
