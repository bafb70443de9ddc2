"""Results that travel: one file a method and task, made by `bench submit` and checked by `bench verify`.

Here: the best known result on every task, from `best_known.toml`, which `docs/tools/best_known_results.py` makes:
bundles take long to read, and do not come with an installation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from tactsim.core.checking import checked
from tactsim.core.documents import read_toml

FILE = Path(__file__).with_name("best_known.toml")


class Best(BaseModel):
    """The best on a task: the figure that ranks there, its value, the method, and the commit of the harness.

    method: as tables call it. estimator, options: what it is made of. default: the default estimator's value; None
    where nobody submitted it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    figure: str
    value: float
    method: str
    commit: str = "unknown"
    estimator: str = ""
    options: dict[str, Any] = {}
    default: float | None = None

    @property
    def words(self) -> str:
        """Say what `--estimator` and `--set` take to do it again."""
        options = (f"--set {name}={value}" for name, value in self.options.items())
        return " ".join([self.estimator or self.method, *options])


def best_known() -> dict[str, Best]:
    """Give the best known result on each task that has one, by the task's name."""
    entries = read_toml(FILE, "file")
    return {name: checked(Best, entry, f"{FILE.name}: {name}") for name, entry in entries.items()}
