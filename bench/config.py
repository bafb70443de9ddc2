"""What a run is asked to do: one checked, frozen object that is saved beside its results."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.core.documents import read_toml
from tactsim.core.errors import unknown
from tactsim.models import parse_letters
from tactsim.press import WORLDS, ScanOptions

# Options of estimators that say how much may be computed, before those that they replace; the others say how.
BUDGETS = ("split", "bins", "particles")


class RunConfig(BaseModel):
    """One run of the paper's protocol: an estimator, its readings and how it is tried.

    The readings are pressed as `scan` says, or, with `scan_file`, read from there; with `train_file`
    the training readings come from that file instead (train on simulated, test on recorded).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    estimator: str = "refined"
    options: dict[str, Any] = Field(default_factory=dict, description="the estimator's options")
    letters: tuple[str, ...] | None = Field(None, description="which take part; None: all there are")
    hold_out: tuple[str, ...] = Field((), description="of them, those that are not trained on")
    trials: int = Field(10, ge=1, le=1_000_000, description="trials for each letter")
    readings: int = Field(60, ge=1, description="readings a trial, without replacement")
    explore: Literal["random", "information"] = "random"
    seed: int = Field(0, ge=0, lt=2**63)
    scan: ScanOptions = Field(default_factory=ScanOptions)
    scan_file: Path | None = None
    train_file: Path | None = None
    given: str | None = Field(None, description="digest of the readings that were given in Python")

    @property
    def source(self) -> str:
        """Name the readings: runs with the same source share them."""
        return self.model_dump_json(
            include={"scan", "scan_file", "train_file", "given", "letters", "hold_out"}
        )


class RunWords(BaseModel):
    """The words in which a run is asked for: the long options of `bench run`, and the keys of a sweep file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    estimator: str = "refined"
    bins: int | None = None
    particles: int | None = None
    set: dict[str, Any] = {}
    letters: str | tuple[str, ...] | None = None
    hold_out: str | tuple[str, ...] | None = None
    shapes: tuple[Path, ...] = ()
    trials: int = 10
    readings: int = 60
    test_poses: str = "same"
    explore: str = "random"
    world: str = "default"
    noise: str | float | None = None
    scan_set: dict[str, Any] = {}
    seed: int = 0
    scan: Path | None = None
    train_scan: Path | None = None
    given: str | None = None

    def resolved(self) -> RunConfig:
        """Turn the words into the configuration. Raises InputError for the first wrong value."""
        options = self.set | {
            name: count for name in ("bins", "particles") if (count := getattr(self, name)) is not None
        }
        pressed = scan_options(
            letters=None if self.scan or self.given else self.letters, shapes=self.shapes, world=self.world,
            noise=self.noise, test_poses=self.test_poses, seed=self.seed, scan_set=self.scan_set,
        )  # fmt: skip
        values = {
            "estimator": self.estimator, "options": options, "trials": self.trials,
            "readings": self.readings, "explore": self.explore, "seed": self.seed, "scan": pressed,
            "letters": _letters(self.letters) if self.letters and (self.scan or self.given) else None,
            "hold_out": tuple(sorted(set(_names(self.hold_out or "")))),
            "scan_file": self.scan, "train_file": self.train_scan, "given": self.given,
        }  # fmt: skip
        return checked(RunConfig, values, "run")


def run_config(**words: Any) -> RunConfig:
    """Build a run's configuration from `RunWords`. Raises InputError with one line."""
    return checked(RunWords, words, "run").resolved()


def scan_options(
    *,
    letters: str | Iterable[str] | None = None,
    shapes: Iterable[str | Path] = (),
    world: str = "default",
    noise: str | float | None = None,
    test_poses: str = "same",
    seed: int = 0,
    scan_set: Mapping[str, Any] | None = None,
) -> ScanOptions:
    """Build the scan's options: a world, changed by `noise`, changed by `scan_set`.

    world: the name of a ready-made one, or a TOML file of options, as `bench validate` writes.
    noise: "off" for the ideal world's exact pad, or the standard deviation in kPa. Raises InputError.
    """
    values = _world(world)
    if noise == "off":
        values = merged(values, WORLDS["ideal"])
    elif noise is not None:
        values = merged(values, {"sensor": {"noise": noise}})
    values = merged(values, {"test_poses": test_poses, "seed": seed})
    own = tuple(map(str, shapes))
    if own:
        values = merged(values, {"shapes": own})
    if letters is not None:
        values = merged(values, {"letters": _letters(letters)})
    return checked(ScanOptions, merged(values, scan_set or {}), "scan")


def _letters(letters: str | Iterable[str]) -> tuple[str, ...]:
    return parse_letters(letters) if isinstance(letters, str) else tuple(letters)


def _names(names: str | Iterable[str]) -> list[str]:
    return names.replace(",", " ").split() if isinstance(names, str) else list(names)


def _world(name: str) -> Mapping[str, Any]:
    if not name.endswith(".toml"):
        if name not in WORLDS:
            raise unknown("world", name, [*WORLDS, "FILE.toml"])
        return WORLDS[name]
    return read_toml(name, "world")


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Lay nested changes over nested values; neither argument is touched."""
    result = dict(base)
    for key, value in changes.items():
        inner = result.get(key)
        result[key] = (
            merged(inner, value) if isinstance(inner, Mapping) and isinstance(value, Mapping) else value
        )
    return result


def whole_number(text: str) -> int | None:
    """Read a count of at most nine digits; None if `text` is none."""
    return int(text) if re.fullmatch(r"[0-9]{1,9}", text) else None


def key_values(pairs: Iterable[str], option: str) -> dict[str, Any]:
    """Parse `key=value` words; dots nest: `press.force=3` gives {"press": {"force": "3"}}.

    Values stay text, for the configuration's own types to read; `none` stands for None.
    Raises InputError if a word has no `=`, or one name is both a value and a group.
    """
    result: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not (equals and key.strip()):
            raise InputError(f"{option} {pair!r}: write it as key=value")
        *groups, last = key.strip().split(".")
        inner = result
        for group in groups:
            inner = inner.setdefault(group, {})
            if not isinstance(inner, dict):
                raise InputError(f"{option} {pair!r}: {group!r} has a value already")
        if isinstance(inner.get(last), dict):
            raise InputError(f"{option} {pair!r}: {last!r} is a group of options")
        inner[last] = None if value.strip().lower() == "none" else value.strip()
    return result
