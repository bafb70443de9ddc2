"""The configuration of a run: one model for the command line, sweep files, run folders and Python.

Its fields are the long options of `bench run`, the keys of a sweep file, the keywords of `tactsim.run`, and the
`config` of a run's folder.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

from tactsim.bench import kinds
from tactsim.bench.kinds import Config
from tactsim.core import InputError, invert
from tactsim.core.checking import checked
from tactsim.core.errors import unknown
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.press import ScanOptions


def key_values(pairs: Iterable[str], option: str) -> dict[str, Any]:
    """Parse `key=value` words; dots nest: `press.force=3` gives {"press": {"force": "3"}}.

    Values stay text, for the configuration's own types to read.
    Raises InputError if a word has no `=`, or one name has two values.
    """
    result: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not (equals and key.strip()):
            raise InputError(f"{option} {pair!r}: write it as key=value")
        word = nested({key.strip(): value.strip()})
        if twice := _in_both(result, word):
            raise InputError(f"{option} {pair!r}: {twice} is given twice")
        result = merged(result, word)
    return result


def nested(words: Any) -> Any:
    """Let dots in names nest, as on the command line: {"press.force": 5} is {"press": {"force": 5}}.

    Raises InputError if one option has two values.
    """
    if not isinstance(words, Mapping):
        return words
    result: dict[str, Any] = {}
    for name, value in words.items():
        for part in reversed(str(name).split(".")):
            value = {part: value}
        twice = _in_both(result, value)
        if twice:
            raise InputError(f"{twice} is given twice")
        result = merged(result, value)
    return result


def _in_both(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Name an option that has a value in both of two nested tables, with dots; empty if there is none."""
    for name in one.keys() & other.keys():
        if not (isinstance(one[name], Mapping) and isinstance(other[name], Mapping)):
            return name
        if inner := _in_both(one[name], other[name]):
            return f"{name}.{inner}"
    return ""


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested values with nested changes applied; neither argument is modified."""
    result = dict(base)
    for key, value in changes.items():
        inner = result.get(key)
        if isinstance(inner, Mapping) and isinstance(value, Mapping):
            value = merged(inner, value)
        result[key] = value
    return result


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Write nested values as one table, their names with dots."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        result |= (
            flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
        )
    return result


def as_paths(words: Any) -> Any:
    """Take one path for a list of one."""
    return (words,) if isinstance(words, str | Path) else words


def whole_number(text: str) -> int | None:
    """Read a count of at most nine digits; None if `text` is not one."""
    return int(text) if re.fullmatch(r"[0-9]{1,9}", text) else None


RECORDING: Final = "recording:"  # begins what stands for a scan's file where a public recording is meant
EACH = "each"  # of hold_out: every trial's own letter is held out, one after another
OF_READINGS = "of the readings"  # marks a field of which runs with the same readings have the same value


@dataclass(frozen=True)
class Flags:
    """The names of a field's option if they are not the field's own; none if the command line does not have it."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class Panel:
    """Of a field: the group of options in which the help of a verb shows it, if that is not the first."""

    title: str


def flags_of(name: str, field: FieldInfo) -> tuple[str, ...]:
    """Name a field's option, such as --test-poses; nothing if the command line does not have it."""
    flags = [mark.names for mark in field.metadata if isinstance(mark, Flags)]
    return flags[0] if flags else (f"--{name.replace('_', '-')}",)


def _letters(words: Any) -> Any:
    """Read letters from a text such as "AEIOU" or "A-Z0-9", or "none"; names in a list or an array stay as they are."""
    if words is None:
        return None
    if not isinstance(words, Iterable):
        raise ValueError("give letters, as 'AEIOU' or a list")
    if not isinstance(words, str):
        return tuple(words)
    if words.strip() == "none":
        return ()
    from tactsim.models import parse_letters

    return parse_letters(words)


def _held_out(words: Any) -> Any:
    """Read the letters to hold out, or `EACH`, from a text such as "A,E" or a list: sorted, without repeats."""
    names = words.replace(",", " ").split() if isinstance(words, str) else words or ()
    if not (isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)):
        raise ValueError("give letters, as 'A,E' or a list of names")
    return tuple(sorted(set(names)))


def _noise(words: Any) -> Any:
    """Refuse a text that is neither a number nor "off"; what number is allowed, the sensor's options say."""
    if words is None or words == "off":
        return words
    try:
        float(words)
    except (TypeError, ValueError):
        raise ValueError("give the standard deviation in kPa, or 'off'") from None
    return words


Noise = Annotated[str | float | None, BeforeValidator(_noise)]
StopAt = Annotated[
    float | None,
    Field(
        gt=0,
        le=1,
        description="End a trial as soon as the most probable label has this probability, e.g. 0.95. Default: all "
        "touches are taken.",
    ),
]


def _text_of_path(words: Any) -> Any:
    return str(words) if isinstance(words, Path) else words


class Slip(BaseModel):
    """How far the object moves between two touches, about its own origin; by default it lies still."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    walk_mm: float = Field(0.0, ge=0, le=100, description="mm, sd of a random step in x and in y")
    walk_rad: float = Field(0.0, ge=0, le=3.2, description="rad, sd of a random turn")
    jump_mm: float = Field(0.0, ge=0, le=1000, description="mm, a jump any way before a random touch")
    jump_rad: float = Field(0.0, ge=0, le=3.2, description="rad, by which the jump turns it either way")
    drift_mm: float = Field(0.0, ge=0, le=100, description="mm at each touch, in one random direction")
    drift_rad: float = Field(0.0, ge=0, le=3.2, description="rad at each touch, either way")

    @property
    def still(self) -> bool:
        """Tell whether the object does not move at all."""
        return not any(self.model_dump().values())

    def describe(self) -> str:
        """Say in a few words how the object moves."""
        parts = []
        for name in ("walk", "jump", "drift"):
            mm, rad = getattr(self, f"{name}_mm"), getattr(self, f"{name}_rad")
            sizes = [f"{size:g} {unit}" for size, unit in ((mm, "mm"), (rad, "rad")) if size]
            if sizes:
                parts.append(f"{name} {' '.join(sizes)}")
        return ", ".join(parts)

    def poses(self, first: FloatArray, readings: int, rng: np.random.Generator) -> FloatArray:
        """Draw robot_in_object at each of `readings` touches (readings, 3), from the first (3,) on.

        The object's place and angle in the robot's frame get independent steps, so a turn is about the object's
        origin. As many random numbers are drawn whatever moves: worlds with one seed differ in size alone.
        """
        steps = rng.standard_normal((readings, 3)) * [self.walk_mm, self.walk_mm, self.walk_rad]
        steps[0] = 0
        drift, jump = rng.uniform(-np.pi, np.pi, 2)
        turns = rng.choice([-1.0, 1.0], 2)
        steps[1:] += [self.drift_mm * np.cos(drift), self.drift_mm * np.sin(drift), self.drift_rad * turns[0]]
        touch = rng.integers(1, max(readings, 2))
        if readings > 1:
            steps[touch, :2] += self.jump_mm * np.cos(jump), self.jump_mm * np.sin(jump)
            steps[touch, 2] += self.jump_rad * turns[1]
        return invert(invert(first) + steps.cumsum(axis=0))


STILL = Slip()
# Worlds in which the object moves. Its readings are those of the default world.
SLIPS: dict[str, dict[str, Any]] = {"slip": {"slip": {"walk_mm": 0.5, "walk_rad": 0.03}}}
_TRIALS, _OTHERS = Panel("How a trial goes, and what is worked out of it"), Panel("Other readings")


class ScanWords(BaseModel):
    """What is pressed: the long options of `bench scan`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    letters: Annotated[tuple[str, ...] | None, BeforeValidator(_letters), OF_READINGS] = Field(
        None,
        description="Which letters: AEIOU, A-Z0-9, A,E,I, or none beside shapes. Of a file its labels: bolt,nut. "
        "Default: AEIOU, or all that the file holds.",
    )
    shapes: Annotated[tuple[Path, ...], BeforeValidator(as_paths), Flags(("--shape",))] = Field(
        (), description="A shape of your own beside the letters: STL, OBJ, GLB or SVG; repeat for several."
    )
    test_poses: Annotated[Literal["same", "random"], _OTHERS] = Field(
        "random",
        description="Test readings at random poses within 12 mm, or at the training poses (same: as in the paper).",
    )
    world: str = Field(
        "default",
        description="How good the data are: default, level, paper-like, rough, handheld, resistive, ideal, slip "
        "(`bench list worlds` says what each is), or a file of `bench validate`.",
    )
    pad: Annotated[str | None, BeforeValidator(_text_of_path), Flags(("--pad", "--device"))] = Field(
        None,
        description="The pad: a file of its measures or of a device (.toml), or a built-in name; `bench devices` names "
        "them. Default: the paper's.",
    )
    noise: Noise = Field(
        None,
        description="Sensor noise, sd in kPa; 'off': no noise, resolution, saturation, placement error or tilt.",
    )
    scan_set: Annotated[dict[str, Any], BeforeValidator(nested), _OTHERS] = Field(
        {}, description="Any option of the scan, e.g. press.force=5; `bench list scan-options` names them."
    )
    seed: int = Field(0, ge=0, lt=2**63, description="Seed of all randomness.")

    @cached_property
    def scan_options(self) -> ScanOptions:
        """Resolve the options of the scan: a world, changed by `pad`, `noise`, the other fields, and last `scan_set`.

        Raises InputError for the first wrong value, and for a file that cannot be read.
        """
        from tactsim.press import WORLDS, ScanOptions

        values = {name: value for name, value in _world(self.world).items() if name != "slip"}
        if self.pad is not None:
            from tactsim.hardware.device import load_device

            if "pad" in self.scan_set:
                raise InputError(
                    f"the pad {self.pad} has its measures; leave out scan_set pad, or change them in a copy of its file"
                )
            values = merged(values, {"pad": load_device(self.pad).pad.model_dump()})
        if self.noise == "off":
            values = merged(values, WORLDS["ideal"])
        elif self.noise is not None:
            values = merged(values, {"sensor": {"noise": self.noise}})
        values = merged(values, {"test_poses": self.test_poses, "seed": self.seed})
        if self.shapes:
            values = merged(values, {"shapes": tuple(map(str, self.shapes))})
        if self.letters is not None:
            values = merged(values, {"letters": self.letters})
        return checked(ScanOptions, merged(values, self.scan_set), "scan")


def _trials(value: Any) -> Any:
    """Read a number of trials, or all. Raises ValueError."""
    count = whole_number(value) if isinstance(value, str) else value
    if value == "all" or (isinstance(count, int) and 1 <= count <= 1_000_000):
        return value if value == "all" else count
    raise ValueError("give a number of at least 1, or all")


_PRESS_WORDS = ("shapes", "world", "pad", "noise", "scan_set")  # how letters are pressed


class RunConfig(ScanWords):
    """One run: an estimator, its readings and how it is tried.

    By default letters are pressed as the fields of `ScanWords` say. With `scan` the readings come from that
    file, and with `given` from Python; `letters` then selects some of their letters. With `train_scan` the
    training readings come from that file (train on simulated, test on recorded).
    """

    kind: ClassVar[str] = kinds.PLANE
    estimator: str = Field("stacked", description="The estimator; `bench list` names them all.")
    bins: int | None = Field(
        None,
        ge=1,
        description="Histogram bins for each object: 100, 1000, 10000 (Table I), or at most so many.",
    )
    particles: int | None = Field(None, ge=1, description="Particles over all letters (n_P).")
    set: dict[str, Any] = Field({}, description="An option of the estimator, key=value; repeat for several.")
    hold_out: Annotated[tuple[str, ...], BeforeValidator(_held_out), OF_READINGS, _TRIALS] = Field(
        (),
        description="Letters to try but not to train on, e.g. A,E: 'none' is then right (see `--set unknown`). each: "
        "in its own trials each letter is held out, the others are known.",
    )
    trials: Annotated[int | Literal["all"], BeforeValidator(_trials)] = Field(
        10, description="Trials for each object; all: each test press once, where nobody noted poses."
    )
    readings: int = Field(
        60,
        ge=1,
        description="Touches of a trial at most, each of which gives a reading, without replacement.",
    )
    explore: Annotated[Literal["random", "information", "blind"], _TRIALS] = Field(
        "random",
        description="The scan's test readings in random order, or touches in the robot's frame, pressed on demand: "
        "proposed by the estimator (information) or in random order (blind).",
    )
    stop_at: Annotated[StopAt, _TRIALS] = None
    slip: Annotated[dict[str, Any], BeforeValidator(nested), _TRIALS] = Field(
        {},
        description="How the object moves between touches, e.g. walk_mm=1; `bench list slip` names all. Default: "
        "as the world says.",
    )
    scan: Annotated[Path | None, OF_READINGS] = Field(
        None,
        description="Readings from a file instead of the press, or recording:NAME of a public one (`bench data`).",
    )
    train_scan: Annotated[Path | None, OF_READINGS, _OTHERS] = Field(
        None, description="Training readings from another file (train on simulated, test on recorded)."
    )
    train_presses: Annotated[int | None, _OTHERS] = Field(
        None,
        ge=1,
        description="Learn from so many training presses of each object, spread over it, and not from all.",
    )
    presses: Annotated[Path | None, OF_READINGS, _OTHERS] = Field(
        None,
        description="Trials measured on a pad (--port), a folder: instead of a scan, each trial with its own presses.",
    )
    bound: Annotated[bool, _TRIALS] = Field(
        False, description="Also work out the Cramer-Rao bound of the error; it takes as long as the presses."
    )
    given: Annotated[str | None, Flags(()), OF_READINGS] = Field(
        None, description="Digest of the readings that were given in Python."
    )
    task: str | None = Field(
        None,
        description="A frozen task, or a FILE.toml: it says all but the estimator and its options; `bench tasks` names "
        "them. solids: objects in space.",
    )

    @model_validator(mode="before")
    @classmethod
    def _letters_may_be_labels_of_a_file(cls, words: Any) -> Any:
        """Leave the words of `letters` as they are where readings are not pressed: a file says what labels it has."""
        if not isinstance(words, Mapping) or not isinstance(words.get("letters"), str):
            return words
        if all(words.get(name) is None for name in ("scan", "presses", "given")):
            return words
        return {**words, "letters": words["letters"].replace(",", " ").split()}

    @model_validator(mode="after")
    def _options_fit_together(self) -> RunConfig:
        if not self.pressed:
            place = self.scan or self.presses
            whence = f"come from {place}" if place else "are given"
            for name in ("test_poses",) if self.told else ("test_poses", *_PRESS_WORDS):
                drawn = name == "shapes" and self.presses is not None  # by the guide of these presses
                if not drawn and getattr(self, name) != RunConfig.model_fields[name].default:
                    raise ValueError(
                        f"{name} says how letters are pressed; the readings {whence}: leave it out"
                    )
            if self.explore == "blind":
                raise ValueError(
                    f"explore=blind presses on demand, but the readings {whence}; give random or information"
                )
        if self.presses is not None and (self.scan is not None or self.given is not None):
            raise ValueError("presses and scan both say what is tested; leave one out")
        if self.presses is not None and self.train_scan is None:
            raise ValueError(
                "presses of a pad are for testing; name what is trained on with --train-scan (in Python train_scan), "
                "a file of `bench record` or `bench scan`"
            )
        if self.trials == "all" and self.explore != "random":
            raise ValueError("trials all takes each test press once, in whatever order: leave out explore")
        if self.trials == "all" and self.scan is None and self.given is None:
            raise ValueError("trials all takes each test press of a scan once; name it with --scan")
        for name in ("bins", "particles"):
            if name in self.set and getattr(self, name) is not None:
                raise ValueError(f"{name} is given by itself and in set; leave one out")
        return self

    @property
    def pressed(self) -> bool:
        """Tell whether the readings are pressed for this run."""
        return self.scan is None and self.given is None and self.presses is None

    @property
    def told(self) -> ScanOptions | None:
        """Resolve how an estimator that presses letters itself presses those of a file; None if nothing says it."""
        from tactsim.estimators.registry import load

        said = any(getattr(self, name) != RunConfig.model_fields[name].default for name in _PRESS_WORDS)
        if self.pressed or self.measured or not said or not load(self.estimator).uses_forward_model:
            return None
        # The labels of the file are its own.
        return scan_options(
            **{name: getattr(self, name) for name in ScanWords.model_fields if name != "letters"}
        )

    @property
    def on_demand(self) -> bool:
        """Tell whether each touch of a trial is pressed when it is chosen."""
        return self.pressed and self.explore != "random"

    @cached_property
    def moving(self) -> Slip:
        """Resolve how the object moves: as the world says, changed by `slip`. Raises InputError for a wrong value."""
        stated = slip_of_world(self.world).model_dump(exclude_unset=True)
        return checked(Slip, merged(stated, self.slip), "slip")

    @property
    def measured(self) -> bool:
        """Tell whether the readings were measured on a pad for these trials."""
        return self.presses is not None

    @property
    def each_held_out(self) -> bool:
        """Tell whether each letter is held out in its own trials."""
        return self.hold_out == (EACH,)

    @property
    def options(self) -> dict[str, Any]:
        """Give the estimator's options: `set`, `bins` and `particles`."""
        counts = {"bins": self.bins, "particles": self.particles}
        return self.set | {name: count for name, count in counts.items() if count is not None}

    @property
    def source(self) -> str:
        """Name the readings: runs with the same source share them."""
        pressed = self.scan_options.model_dump(mode="json") if self.pressed else None
        words = self.model_dump(mode="json", include=OF_SOURCE)
        # Which presses are left out may depend on the seed.
        left_out = [self.seed] if str(self.scan).startswith(RECORDING) else []
        if self.train_presses is not None:
            words |= {"train_presses": self.train_presses}
            left_out = [self.seed]
        return json.dumps([pressed, words, *left_out], sort_keys=True)

    @property
    def digest(self) -> str:
        """Hash what the run is asked to do; equal values have one digest, whatever world's file or task says them.

        Every field counts: by what it resolves to, or as it is.
        """
        rest = self.model_dump(mode="json", exclude=_RESOLVED)
        resolved = [self.source, self.options, self.moving.model_dump(mode="json")]
        resolved += [] if self.told is None else [self.told.model_dump(mode="json")]
        content = json.dumps([*resolved, rest], sort_keys=True, default=str)
        return hashlib.sha256(content.encode()).hexdigest()


OF_SOURCE = {name for name, field in RunConfig.model_fields.items() if OF_READINGS in field.metadata}
# What `RunConfig.digest` takes from `source`, `options` and `moving`; a task says other fields.
_RESOLVED = {
    *OF_SOURCE, *ScanWords.model_fields, "train_presses", "set", "bins", "particles", "slip", "task",
} - {"seed"}  # fmt: skip


def chosen_letters(config: RunConfig, labels: Sequence[str]) -> tuple[str, ...]:
    """Say which of a run's labels are tried: all that were pressed, or those of a file that `letters` names.

    A word that is no label may name several of one character: AEIOU, A-Z. Raises InputError for one that names none.
    """
    if config.pressed or config.letters is None:
        return tuple(labels)
    return tuple(dict.fromkeys(label for word in config.letters for label in _labels(word, labels)))


def _labels(word: str, labels: Sequence[str]) -> tuple[str, ...]:
    from tactsim.models import parse_letters

    if word in labels:
        return (word,)
    try:
        several = parse_letters(word)
    except InputError:
        several = (word,)
    for label in several:
        if label not in labels:
            raise unknown("letter of the scan", label, labels)
    return several


def any_config(**words: Any) -> Config:
    """Build the configuration of a run of the kind that `task` names, or of letters in the plane.

    Raises InputError as `run_config` does.
    """
    return kinds.of_task(words.get("task")).configured(**words)


def run_config(**words: Any) -> RunConfig:
    """Build a run's configuration; a task's is completed by what the task says.

    Raises InputError with one line, also for a wrong option of the scan, for one that contradicts the task, and for one
    of the estimator, which belongs into `set`.
    """
    if words.get("task") is not None:
        from tactsim.bench.tasks import task  # imports this module

        words = task(str(words["task"])).completed(words)
    taken = {field.alias or name for name, field in RunConfig.model_fields.items()}
    if strange := [word for word in words if word not in taken]:
        from tactsim.estimators.registry import names, options_of

        name = words.get("estimator", RunConfig.model_fields["estimator"].default)
        known = options_of(name, words.get("set")).model_fields if name in names() else ()
        for word in strange:
            if word in known:
                raise InputError(
                    f"run: {word!r} is an option of the estimator {name}; give set={{{word!r}: ...}}"
                )
    config = checked(RunConfig, words, "run")
    _ = config.moving
    if config.pressed:
        _ = config.scan_options
    return config


def scan_options(**words: Any) -> ScanOptions:
    """Build a scan's options from `ScanWords`. Raises InputError with one line."""
    return checked(ScanWords, words, "scan").scan_options


def slip_of_world(name: str) -> Slip:
    """Say how the object moves in a world. Raises InputError for an unknown world, and for a wrong file."""
    return Slip(**_world(name).get("slip", {}))


def _world(name: str) -> Mapping[str, Any]:
    """Get the options of a ready-made world, or of a TOML file as `bench validate` writes.

    A file is checked by itself: what else a run says may replace a wrong value, and would be blamed for one that stays.
    """
    from tactsim.press import WORLDS, ScanOptions

    if name.endswith(".toml"):
        from tactsim.core.documents import read_toml  # most worlds are those that come along

        where, values = f"world {name}", read_toml(name, "world")
        for own in ("seed", "test_poses"):
            if own in values:
                raise InputError(
                    f"{where}: {own} is no option of a world; leave it out, and give --{own.replace('_', '-')} "
                    f"(in Python {own})"
                )
        checked(Slip, values.get("slip", {}), f"{where}: slip")
        checked(ScanOptions, {key: value for key, value in values.items() if key != "slip"}, where)
        return values
    worlds = WORLDS | SLIPS
    if name not in worlds:
        raise unknown("world", name, [*worlds, "FILE.toml"])
    return worlds[name]
