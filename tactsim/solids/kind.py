"""Objects in space as a kind of run: its configuration, the touches of a trial, and what the harness asks of a kind."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from tactsim.bench.config import Flags, Noise, StopAt, as_paths, merged, nested, whole_number
from tactsim.bench.kinds import Gathered, Kind
from tactsim.bench.results import AnyAbout, AnyConfig, Run
from tactsim.bench.runs.figures import Picture
from tactsim.bench.trials import OneTrial, Progress, Touch, TrialPlan, TrialRules, Trials, generator
from tactsim.core import rigid
from tactsim.core.checking import checked
from tactsim.core.documents import parse_toml
from tactsim.core.errors import InputError, counted, some
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import had_another_shape
from tactsim.core.scan import Scan
from tactsim.estimators import Estimator
from tactsim.solids.scan import SpaceOptions, SpaceScan
from tactsim.solids.score import (
    METRICS,
    SpaceTrials,
    Surface,
    angle,
    load_surfaces,
    save_surfaces,
    symmetries_of,
)

if TYPE_CHECKING:
    from tactsim.bench.report import Pages
    from tactsim.models import Solid
    from tactsim.solids import Hand, HandPress, SpacePress
    from tactsim.solids.press import Touched


HALF_BOX = 20.0  # mm: the object's origin, and the point that a touch aims at, lie in this box about the robot's origin
OFFERED = 40  # touches among which an estimator may choose the next
HANDS = ("gripper",)  # those that come along


def draw_pose_in_space(rng: np.random.Generator) -> FloatArray:
    """Draw robot_in_object (7,): the object's origin even in the box about the robot's, all rotations alike."""
    place = rng.uniform(-HALF_BOX, HALF_BOX, size=3)
    return rigid.invert(np.concatenate([place, rigid.random_rotations(1, rng)[0]]))


def draw_starts(count: int, outside: float, rng: np.random.Generator) -> FloatArray:
    """Draw where touches begin, sensor_in_robot (count, 7).

    The direction is even over the sphere, the point aimed at even in the box, the turn about the normal even. The pad
    starts `outside` mm before the robot's origin, measured along its normal.
    """
    rotation = rigid.random_rotations(count, rng)
    aim = rng.uniform(-HALF_BOX, HALF_BOX, size=(count, 3))
    normal = rigid.turned(rotation, np.array([0.0, 0.0, 1.0]))
    back = outside + np.einsum("ij,ij->i", aim, normal)
    return np.concatenate([aim - back[:, None] * normal, rotation], axis=1)


def outside_of(radius: float) -> float:
    """Say how far from the robot's origin no point of an object of that radius about its origin can be, mm."""
    return float(np.sqrt(3) * HALF_BOX + radius)


def draw_hands(count: int, rng: np.random.Generator) -> FloatArray:
    """Draw where a hand closes, hand_in_robot (count, 7): its origin even in the box, its rotation even."""
    place = rng.uniform(-HALF_BOX, HALF_BOX, size=(count, 3))
    return np.concatenate([place, rigid.random_rotations(count, rng)], axis=1)


def load_hand(hand: Path) -> Hand:
    """Read a hand that comes along, by its name, or a hand file. Raises InputError if it is none."""
    from tactsim.solids import Hand

    if str(hand) in HANDS:
        text = (files("tactsim.solids") / "hands" / f"{hand}.toml").read_bytes()
        return checked(Hand, parse_toml(text, f"hand {hand}"), f"hand {hand}")
    return Hand.load(hand)


@dataclass(frozen=True)
class SolidPress:
    """Touch the solids of a scan wherever a trial asks, with one pad, or with the pads of a hand at once.

    hand: see `load_hand`; None: one pad, which comes along its normal.
    """

    options: SpaceOptions
    hand: Path | None = None

    def touches(self, truth: str, trial: int, seed: int) -> SolidTouches:
        """Offer the touches of one trial."""
        task = OneTrial(truth, trial)
        return SolidTouches(self, truth, generator(seed, task, 2), generator(seed, task, 3))

    def starts(self, rng: np.random.Generator) -> FloatArray:
        """Draw where a touch may begin: (OFFERED, 7) sensor_in_robot, or hand_in_robot."""
        if self.hand is not None:
            return draw_hands(OFFERED, rng)
        return draw_starts(OFFERED, outside_of(max(one.radius for one in self._solids)), rng)

    def touch(self, label: str, start: FloatArray, rng: np.random.Generator) -> Touched:
        """Touch from one start (7,) in the object frame: m touches, one of each pad."""
        press = self._press
        return press.sensed(press.touch(label, start[None] if self.hand is None else start, rng), rng)

    @cached_property
    def _solids(self) -> list[Solid]:
        from tactsim.solids import solids_of

        return solids_of(self.options)

    @cached_property
    def _press(self) -> SpacePress | HandPress:
        """Make what touches. Raises InputError if pads of the hand overlap."""
        from tactsim.solids import HandPress, SpacePress

        if self.hand is not None:
            return HandPress(self._solids, load_hand(self.hand), self.options)
        return SpacePress(self._solids, self.options)

    def __getstate__(self) -> Mapping[str, object]:
        """Go to another process without what was built."""
        return {"options": self.options, "hand": self.hand}


class SolidTouches:
    """The touches of a trial: for each, `OFFERED` starts are drawn anew; see `trials.Touches`.

    An estimator that chooses is offered what one that does not is, which takes the first.
    """

    def __init__(
        self, press: SolidPress, truth: str, offer: np.random.Generator, disturb: np.random.Generator
    ) -> None:
        self._press, self._truth, self._offer, self._disturb = press, truth, offer, disturb
        self._taken = 0

    def shuffle(self, rng: np.random.Generator) -> None:
        """Leave them as they are: they are drawn at random."""

    def offer(self, robot_in_object: FloatArray) -> FloatArray:
        """Draw where the next touch may begin; see `SolidPress.starts`."""
        self._starts = self._press.starts(self._offer)
        return self._starts

    def take(self, chosen: int, robot_in_object: FloatArray) -> Touch:
        """Touch from one of the starts just offered."""
        start, number = self._starts[chosen], self._taken
        self._taken += 1
        rng = np.random.default_rng(self._disturb.integers(2**63))
        touched = self._press.touch(self._truth, rigid.compose(robot_in_object, start), rng)
        sensors_in_robot = rigid.compose(rigid.invert(robot_in_object), touched.stated)
        return Touch(
            number,
            touched.readings,
            sensors_in_robot,
            {"start": start, "met": int(np.count_nonzero(touched.met))},
        )


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
    stop_at: StopAt = None
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


class _Config(AnyConfig):
    touches: int
    hand: str | None


class _About(AnyAbout):
    config: _Config
    objects: list[str]
    symmetries: dict[str, dict[str, Any]]
    taxel_points: list[list[float]]


class Solids(Kind):
    """Solids that one pad, or those of a hand, touch from any side, at x, y, z and a unit quaternion."""

    name = "solids"
    config, scan_options, about, trials, metrics = SpaceConfig, SpaceOptions, _About, SpaceTrials, METRICS
    pose = rigid.POSE
    poses: ClassVar = {**Kind.poses, "start_": "start"}
    columns = (
        "truth", "trial", "touch_number", "touch_index", "label",
        *(f"{before}{name}" for before in ("", "true_", "start_") for name in rigid.POSE),
        "p_truth", "p_label", "credibility", "radius_90", "nees", "met", "evaluations",
    )  # fmt: skip
    asked = ("touches", "hand")
    of_method = (*Kind.of_method, "touches", "hand", "explore")
    errors: ClassVar = {"error_mm": lambda scored: scored.error, "angle_deg": angle}
    own_touches = True

    def configured(self, **words: Any) -> SpaceConfig:
        """Build a run's configuration; see `config.space_config`."""
        return space_config(**words)

    def scanned(
        self, words: Mapping[str, Any], *, jobs: int, cache: bool, progress: Progress
    ) -> tuple[Scan, dict[str, Any]]:
        """Touch the objects that the words say; neither more processes nor a cache would be of use."""
        from tactsim.solids.press import scan_solids  # brings compiled loops

        options = scan_words(**words).scan_options
        return scan_solids(options, progress=lambda done, total: progress("press", done, total))

    def gather(
        self, config: SpaceConfig, *, scan: Scan | None, jobs: int, cache: bool, progress: Progress
    ) -> Gathered:
        """Touch the objects or load the readings, and take from the objects what the error needs.

        Raises InputError if an object has no training readings.
        """
        from tactsim.solids.press import scan_solids, solids_of

        start = perf_counter()
        solids = solids_of(config.scan_options)
        if config.scan is None:
            scan, work = scan_solids(
                config.scan_options, progress=lambda done, total: progress("press", done, total)
            )
        else:
            scan, work = SpaceScan.load(config.scan), {"presses": 0, "skipped": {}}
        names = tuple(solid.name for solid in solids)
        trained = scan.where("train").letters
        for name in names:
            if name not in trained:
                raise InputError(
                    f"--scan {config.scan} holds no training readings of {name}; it has {some(trained)}"
                )
        for solid in solids[len(config.scan_options.objects) :]:  # those of files
            if had_another_shape(scan.meta, solid.name, solid.digest):
                raise InputError(
                    f"--scan {config.scan} touched another {solid.name} than the --shape of that name; give the file "
                    f"that was scanned"
                )
        objects = {solid.name: Surface.of(solid) for solid in solids}
        return Gathered(scan.of_letters(names), names, work, perf_counter() - start, objects)

    def tasks(self, config: SpaceConfig, gathered: Gathered) -> list[OneTrial]:
        """List the trials, which the objects share, taking turns."""
        letters = gathered.letters
        return [
            OneTrial(letter, trial)
            for place, letter in enumerate(letters)
            for trial in range((config.trials - place + len(letters) - 1) // len(letters))
        ]

    def plan(
        self, config: SpaceConfig, scan: Scan, given: Estimator | None, objects: Mapping[str, Any] | None
    ) -> TrialPlan:
        """Put together what a worker needs to do the trials, all of whose touches are pressed on demand."""
        return TrialPlan(
            config.estimator, config.options, scan,
            TrialRules.of(config, SolidPress(config.scan_options, config.hand)), given=given, objects=objects,
        )  # fmt: skip

    def hide(self, scan: Scan, rng: np.random.Generator) -> FloatArray:
        """Draw robot_in_object (7,)."""
        return draw_pose_in_space(rng)

    def said(
        self, config: SpaceConfig, gathered: Gathered, trials: Trials, estimator: Estimator
    ) -> tuple[dict[str, Any], FloatArray | None]:
        """Give the protocol, and the taxels' centres on the pad, mm; no bound is known."""
        assert isinstance(gathered.scan, SpaceScan)
        order = "touches from random sides" if config.explore == "random" else "touches chosen by information"
        protocol = f"objects in space, {order}" + (f", hand {config.hand.stem}" if config.hand else "")
        protocol += f", stop at {config.stop_at:g}" if config.stop_at else ""
        return {"protocol": protocol, "taxel_points": gathered.scan.taxel_points.tolist()}, None

    def maps(self, estimator: Estimator) -> Mapping[str, Any]:
        """Give the surfaces that an estimator has learned."""
        from tactsim.solids.field import surfaces_of

        return surfaces_of(estimator)

    def stated(self, run: Run, about: dict[str, Any]) -> dict[str, Any]:
        """Add the objects' symmetries."""
        names = about.pop("letters")
        return about | {"objects": names, "symmetries": symmetries_of(run.objects)}

    def objects_of(self, about: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Read the objects' surfaces from the run's folder."""
        assert folder is not None
        about["letters"] = about.pop("objects")
        return dict(load_surfaces(about.pop("symmetries"), folder / "objects.npz"))

    def save_objects(self, objects: Mapping[str, Any], folder: Path) -> None:
        """Write the objects' surfaces."""
        save_surfaces(objects, folder / "objects.npz")

    def plot(self, run: Run, ax: Any = None) -> Picture:
        """Draw accuracy, surface distance and angle. Raises InputError if axes are given."""
        from tactsim.solids.page import touches_figure

        if ax is not None:
            raise InputError("ax is for runs in the plane; a run in space draws three figures of its own")
        return touches_figure(run)

    def plot_maps(self, maps: Mapping[str, Any]) -> Picture:
        """Draw learned surfaces from three sides."""
        from tactsim.solids.page import surfaces_figure

        return surfaces_figure(maps)

    def page(self, of: Pages) -> tuple[list[Path], list[str]]:
        """Write the page with its scenes, each run by its folder's name."""
        from tactsim.solids.page import write_space_page

        return write_space_page(of)

    def table(self, run: Run, verbose: bool) -> list[str]:
        """Show the angle too."""
        if not verbose:
            return ["error_mm", "angle_deg"]
        return ["error_mm", "error_median_mm", "angle_deg", "angle_median_deg", "coverage_90"]

    def details(self, run: Run) -> list[str]:
        """Say which objects were hardest, how many touches met one, and the times."""
        summary, seconds, spent = run.summary, run.times["seconds"], run.trials.seconds.sum(axis=1)
        hard = sorted(summary["by_object"].items(), key=lambda item: item[1]["accuracy"])[:3]
        stages = (
            f"{stage} {seconds[stage]:.2f} s" for stage in ("scan", "fit", "trials") if stage in seconds
        )
        return [
            f"lowest accuracy at touch {run.readings}: "
            + ", ".join(f"{label} {values['accuracy']:.2f}" for label, values in hard),
            f"{100 * sum(summary['met']) / run.readings:.0f} % of the touches met the object",
            f"time  {', '.join(stages)}; a recognition of {counted(run.readings, 'touch')} {spent.mean():.2f} s of one "
            f"core, at most {spent.max():.2f} s",
        ]

    def nexts(self, run: Run) -> list[str]:
        """Suggest the default estimator."""
        standard = SpaceConfig.model_fields["estimator"].default
        if run.estimator == standard:
            return []
        return [f"the same data with --estimator {standard}  # the default"]
