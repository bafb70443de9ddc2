"""Objects in space as a kind of run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from tactsim.bench.kinds import Gathered, Kind, Pages
from tactsim.bench.results import AnyAbout, AnyConfig, Run
from tactsim.bench.runs.figures import Picture
from tactsim.bench.trials import OneTrial, Progress, TrialPlan, TrialRules, Trials
from tactsim.core import rigid
from tactsim.core.errors import InputError, counted
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import had_another_shape
from tactsim.core.scan import Scan
from tactsim.estimators import Estimator
from tactsim.solids.config import SpaceConfig, scan_words, space_config
from tactsim.solids.options import SpaceOptions
from tactsim.solids.score import METRICS, SpaceTrials, angle
from tactsim.solids.solid_scan import SpaceScan
from tactsim.solids.surface_distance import Surface, load_surfaces, save_surfaces, symmetries_of
from tactsim.solids.touching import SolidPress, draw_pose_in_space


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
        "truth", "trial", "touch_number", "label",
        *(f"{before}{name}" for before in ("", "true_", "start_") for name in rigid.POSE),
        "p_truth", "p_label", "credibility", "radius_90", "nees", "met", "evaluations",
    )  # fmt: skip
    asked = ("touches", "hand")
    of_trials = ("seed", "objects", "shapes", "trials", "scan")
    errors: ClassVar = {"surface mm @{}, both right": lambda scored: scored.error, "angle deg @{}": angle}
    own_touches = True

    def configured(self, **words: Any) -> SpaceConfig:
        """Build a run's configuration; see `config.space_config`."""
        return space_config(**words)

    def scanned(
        self, words: Mapping[str, Any], *, jobs: int, cache: bool, progress: Progress
    ) -> tuple[Scan, dict[str, Any]]:
        """Touch the objects that the words say; neither more processes nor a cache would be of use."""
        from tactsim.solids.scanning import scan_solids  # brings compiled loops

        options = scan_words(**words).scan_options
        return scan_solids(options, progress=lambda done, total: progress("press", done, total))

    def gather(
        self, config: SpaceConfig, *, scan: Scan | None, jobs: int, cache: bool, progress: Progress
    ) -> Gathered:
        """Touch the objects or load the readings, and take from the objects what the error needs.

        Raises InputError if an object has no training readings.
        """
        from tactsim.solids.scanning import scan_solids, solids_of

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
                    f"--scan {config.scan} holds no training readings of {name}; it has {', '.join(trained)}"
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
        from tactsim.solids.pictures import touches_figure

        if ax is not None:
            raise InputError("ax is for runs in the plane; a run in space draws three figures of its own")
        return touches_figure(run)

    def plot_maps(self, maps: Mapping[str, Any]) -> Picture:
        """Draw learned surfaces from three sides."""
        from tactsim.solids.pictures import surfaces_figure

        return surfaces_figure(maps)

    def page(self, of: Pages) -> tuple[list[Path], list[str]]:
        """Write the page with its scenes, each run by its folder's name."""
        from tactsim.solids.page import write_space_page

        return write_space_page(of)

    def table(self, run: Run, verbose: bool) -> tuple[Mapping[str, Any], list[tuple[str, str, int]]]:
        """Show the angle too."""
        columns = [("error_mm", "error mm", 2)]
        columns += [("error_median_mm", "median", 2)] * verbose + [("angle_deg", "degrees", 1)]
        columns += [("angle_median_deg", "median", 1), ("coverage_90", "90 % held", 2)] * verbose
        return run.summary, columns

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
