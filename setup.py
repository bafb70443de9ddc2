"""Make the links that an archive may have lost; all else that setuptools needs is in pyproject.toml.

pip unpacks a zip archive with links as small text files: what is in them is where the link leads. Without this
the folders beside `tactsim/` would be missing from the wheel, and nobody would be told.
"""

import shutil
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).resolve().parent

for room in ("bench", "estimators", "hardware", "models"):
    link = HERE / "tactsim" / room
    if link.is_file() and link.read_text(encoding="utf-8").strip() == f"../{room}":
        link.unlink()
        link.symlink_to(f"../{room}")
    if not link.is_dir():
        raise SystemExit(
            f"tactsim/{room} should be a link to ../{room}: unpack the archive again, with its links"
        )

# A file that was renamed since an earlier build would still be in that build's folder, and so in the wheel.
shutil.rmtree(HERE / "build" / "lib", ignore_errors=True)

# A path to this folder, and no import hook: from the folder above, `import tactsim` would find a clone of that name
# first, without its package.
setup(options={"editable_wheel": {"mode": "compat"}})
