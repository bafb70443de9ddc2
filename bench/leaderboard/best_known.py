"""The best known result on every task, from `best_known.toml`, which `docs/tools/best_known_results.py` makes.

Bundles take long to read, and they do not come with an installation; the file is read at once, and does.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from tactsim.core.checking import checked
from tactsim.core.documents import read_toml

FILE = Path(__file__).with_name("best_known.toml")


class Best(BaseModel):
    """The best on a task: the figure that ranks there, its value, the method, and the commit of the harness."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    figure: str
    value: float
    method: str
    commit: str = "unknown"


def best_known() -> dict[str, Best]:
    """Give the best known result on each task that has one, by the task's name."""
    return {
        name: checked(Best, entry, f"{FILE.name}: {name}") for name, entry in read_toml(FILE, "file").items()
    }
