"""The configuration of a run with objects in space: its fields are options of `bench run --task solids`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from tactsim.bench.config import Flags, Noise, as_paths, merged, nested, whole_number
from tactsim.core.checking import checked
from tactsim.core.errors import InputError

if TYPE_CHECKING:
    from tactsim.solids import SpaceOptions


def _objects(words: Any) -> Any:
    """Read names from a text: "bolt,nut", "none", or "20" for the first twenty; names in a list stay as they are."""
    if not isinstance(words, str):
        return words
    if (count := whole_number(words.strip())) is not None:
        from tactsim.models import solid_names

        return solid_names(count)
    return () if words.strip() == "none" else tuple(words.replace(",", " ").split())


class SpaceWords(BaseModel):
    """What is touched: the options of `bench scan --task solids`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    task: Literal["solids"] = "solids"
    objects: Annotated[tuple[str, ...] | None, BeforeValidator(_objects)] = Field(
        None,
        description="Which objects: bolt,nut,key, or 30 for the first thirty, or none beside shapes. Default: 12.",
    )
    shapes: Annotated[tuple[Path, ...], BeforeValidator(as_paths), Flags(("--shape",))] = ()
    noise: Noise = None
    scan_set: Annotated[dict[str, Any], BeforeValidator(nested)] = {}
    seed: int = Field(0, ge=0, lt=2**63)

    @cached_property
    def scan_options(self) -> SpaceOptions:
        """Resolve the options of the scan. Raises InputError for the first wrong value."""
        from tactsim.press import WORLDS
        from tactsim.solids import SpaceOptions

        values: dict[str, Any] = {"seed": self.seed}
        if self.noise == "off":
            values |= {"sensor": WORLDS["ideal"]["sensor"], "placement_mm": 0.0, "placement_rad": 0.0}
        elif self.noise is not None:
            values |= {"sensor": {"noise": self.noise}}
        if self.objects is not None:
            values["objects"] = self.objects
        if self.shapes:
            values["meshes"] = tuple(map(str, self.shapes))
        return checked(SpaceOptions, merged(values, self.scan_set), "scan")


class SpaceConfig(SpaceWords):
    """One run with objects in space: an estimator, and how it is tried."""

    kind: ClassVar[str] = "solids"
    estimator: str = "space-refined"
    set: dict[str, Any] = {}
    trials: int = Field(200, ge=1, le=1_000_000)
    touches: int = Field(20, ge=1, le=10_000, description="Touches a trial.")
    explore: Literal["random", "information"] = "random"
    hand: Path | None = Field(
        None, description="Several pads that touch at once, a hand file (.toml). Default: one pad."
    )
    scan: Path | None = None

    @model_validator(mode="after")
    def _one_pad_is_chosen(self) -> SpaceConfig:
        if self.hand is not None and self.explore == "information":
            raise ValueError("a hand is not led by information; leave out hand or explore")
        return self

    @cached_property
    def scan_options(self) -> SpaceOptions:
        """Resolve the options of the scan, with the hand's kind of pad. Raises InputError for the first wrong value."""
        if self.hand is None:
            return super().scan_options
        from tactsim.solids.touching import load_hand

        return load_hand(self.hand).options(super().scan_options)

    @property
    def options(self) -> dict[str, Any]:
        """Give the estimator's options."""
        return self.set

    @property
    def readings(self) -> int:
        """Give the number of touches of a trial, under the name that a run in the plane has for it."""
        return self.touches

    @property
    def source(self) -> str:
        """Name the readings: runs with the same source share them."""
        return json.dumps([self.scan_options.model_dump(mode="json"), str(self.scan)], sort_keys=True)

    @property
    def digest(self) -> str:
        """Hash what the run is asked to do."""
        words = self.model_dump(mode="json", exclude={"objects", "shapes", "noise", "scan_set"})
        words["scan_options"] = self.scan_options.model_dump(mode="json")
        return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()


def check_words(given: Mapping[str, Any], model: type[BaseModel], verb: str) -> None:
    """Raise InputError for a word that means nothing for objects in space; it names the one to use in its place."""
    instead = {
        "letters": "--objects", "readings": "--touches", "pad": "--scan-set pad=FILE", "particles": "--set",
        "bins": "--set",
    }  # fmt: skip
    for name in given:
        if name not in model.model_fields:
            use = f"; use {instead[name]}" if name in instead else "; leave it out"
            raise InputError(f"--{name.replace('_', '-')} is not for {verb} --task solids{use}")


def space_config(**words: Any) -> SpaceConfig:
    """Build a run's configuration. Raises InputError with one line, also for a wrong option of the scan."""
    check_words(words, SpaceConfig, "run")
    config = checked(SpaceConfig, words, "run")
    _ = config.scan_options
    return config


def scan_words(**words: Any) -> SpaceWords:
    """Build what says how objects are touched. Raises InputError with one line."""
    check_words(words, SpaceWords, "scan")
    return checked(SpaceWords, words, "scan")
