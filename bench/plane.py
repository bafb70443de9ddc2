"""Letters in the plane, the kind of run that the harness does unless it is asked for another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from tactsim.bench.config import RunConfig, chosen_letters, run_config
from tactsim.bench.config import scan_options as stated_scan
from tactsim.bench.kinds import PLANE, Gathered, Kind
from tactsim.bench.placement import Properties, properties, stated_properties
from tactsim.bench.results import AnyAbout, AnyConfig, Run
from tactsim.bench.runs.paper import beside
from tactsim.bench.runs.scan_quality import eq3_agreement, notes_on
from tactsim.bench.trials import (
    OneTrial,
    Press,
    Progress,
    TrialPlan,
    TrialRules,
    Trials,
    check_count,
    check_labels,
    check_readings,
    draw_true_pose,
    presses_with,
)
from tactsim.core import InputError, Scan
from tactsim.core.errors import some, unknown
from tactsim.core.origins import object_origins, seen_from
from tactsim.core.pad import offsets
from tactsim.core.poses import POSE, FloatArray
from tactsim.core.provenance import poses_unknown
from tactsim.core.seeds import stream
from tactsim.estimators import Estimator
from tactsim.estimators.likelihoods.occupancy import maps_of
from tactsim.estimators.options import FilterOptions
from tactsim.press import ScanOptions, scan_letters
from tactsim.press.scan_poses import PAPER, stage_for
from tactsim.press.scanning import letters_of

if TYPE_CHECKING:
    from tactsim.bench.report import Pages
    from tactsim.bench.runs.figures import Picture
    from tactsim.core.forward import ForwardModel
    from tactsim.estimators.filters.map_filter import MapFilter

NO_BOUND = "it was not asked for; `bench run --bound` works it out"


class _Config(AnyConfig):
    train_scan: str | None
    given: str | None
    letters: list[str] | None
    hold_out: list[str]
    readings: int


class _About(AnyAbout):
    config: _Config
    objects: dict[str, Any]
    letters: list[str]
    classifier_agreement: float | None
    source: str
    slip: str = ""


def _forward_model(options: ScanOptions | None, scan: Scan) -> ForwardModel:
    from tactsim.press import forward_model  # for the few estimators that press by themselves

    return forward_model(scan, options)


class Plane(Kind):
    """Letters that a pad is pressed on, at x, y, theta."""

    name = PLANE
    thing, touch, touches = "letter", "reading", "readings"
    config, scan_options, about, trials = RunConfig, ScanOptions, _About, Trials
    pose = POSE
    schema = 3
    columns = (
        "truth", "trial", "reading_number", "touch_index", "label", "p_truth", "p_label",
        *(f"{before}{name}" for before in ("", "true_") for name in POSE),
        "credibility", "radius_90", "nees", "evaluations",
    )  # fmt: skip
    asked = ("slip", "hold_out")
    errors: ClassVar = {"error_mm": lambda scored: scored.error}

    def configured(self, **words: Any) -> RunConfig:
        """Build a run's configuration; see `config.run_config`."""
        return run_config(**words)

    def scanned(
        self, words: Mapping[str, Any], *, jobs: int, cache: bool, progress: Progress
    ) -> tuple[Scan, dict[str, Any]]:
        """Press the letters that the words of `bench scan` say."""
        words = {name: value for name, value in words.items() if name != "task"}
        report = partial(progress, "press")
        return scan_letters(stated_scan(**words), jobs=jobs, cache=cache, progress=report)

    def check(self, config: RunConfig) -> None:
        """Raise InputError for letters to hold out that are not pressed, and for too many readings.

        Readings that are not pressed are left to `check_gathered`, once they are loaded.
        """
        if not config.pressed:
            return
        letters = letters_of(config.scan_options)
        _held_out(config, [letter.name for letter in letters])
        for letter in letters if config.readings > PAPER.poses else ():
            stage = PAPER if config.on_demand else stage_for(config.scan_options.pad, letter)
            check_count(letter.name, stage.poses, config.readings)

    def gather(
        self, config: RunConfig, *, scan: Scan | None, jobs: int, cache: bool, progress: Progress
    ) -> Gathered:
        """Get the readings of a run: those given, pressed, or from files.

        Poses are seen from the centre of the training poses, if that is not the origin already; `meta` of the scan says
        so. Raises InputError if a named letter is not among the readings, a letter is called NONE or two files do not
        fit together.
        """
        start = perf_counter()
        work: dict[str, Any] = {"presses": 0, "skipped": {}}
        if config.train_scan is not None or config.scan is not None:
            from tactsim.bench.formats import load_scan
        train = None if config.train_scan is None else load_scan(config.train_scan)  # before the presses
        if scan is not None:
            stated_properties(scan)
        elif config.scan is not None:
            scan = load_scan(config.scan, config.seed)
        elif config.presses is not None:
            from tactsim.bench.pad import measured_scan

            assert train is not None  # as a configuration with presses has it
            letters = chosen_letters(config, train.letters)
            assert config.trials != "all"  # which is of a scan
            scan = measured_scan(config.presses, letters, config.trials, config.readings)
        else:
            self.check(config)
            report = partial(progress, "press")
            scan, work = scan_letters(config.scan_options, jobs=jobs, cache=cache, progress=report)
        if train is not None:
            from tactsim.core.making import train_on

            try:
                scan = train_on(train, scan)
            except InputError as error:
                if not config.pressed:
                    raise
                raise InputError(
                    f"{error}; without --scan the test readings are pressed in simulation"
                ) from error
        letters = chosen_letters(config, scan.letters)
        if not scan.letters:
            raise InputError(f"{config.scan or 'the scan'} holds no readings")
        if not letters:
            raise InputError(f"letters names none to try; the scan has {some(scan.letters)}")
        check_labels(letters)
        known = letters
        if train is not None and config.letters is None:  # what is tested may be fewer than what is known
            letters = tuple(letter for letter in letters if len(scan.where("test", letter))) or letters
        scan = scan.of_letters(known)
        # T_R^O is drawn about 0: with 0 at the object the trials are the same, wherever poses have their origin, and
        # the places of touches do not name an object that has a frame of its own.
        scan = seen_from(scan, object_origins(scan))
        objects = properties(scan)
        scan = scan.untrained(_held_out(config, letters))
        if config.train_presses is not None:
            scan = scan.with_train_presses(config.train_presses, stream(config.seed, "train_presses"))
        return Gathered(scan, letters, work, perf_counter() - start, objects)

    def check_gathered(self, config: RunConfig, gathered: Gathered) -> None:
        """Raise InputError as `trials.check_readings` does."""
        if config.trials == "all" and not poses_unknown(gathered.scan.meta):
            raise InputError(
                "trials all: takes every press once, of scans whose poses nobody noted; of others trials draw their "
                "readings, so give a number, or, if nobody did, say so: `bench import FILE.npz --poses none --out "
                "NEW.npz`"
            )
        check_readings(gathered.scan, gathered.letters, config.readings, config.hold_out)
        if not poses_unknown(gathered.scan.meta):
            return
        if not config.moving.still:
            raise InputError(
                "slip: poses are unknown, so a trial takes the readings of one press, in which nothing slips"
            )
        if config.explore == "information" and gathered.scan.where("test").at_one_pose:
            raise InputError(
                "explore information: poses are unknown, so no touch is at another place; leave it out"
            )

    def tasks(self, config: RunConfig, gathered: Gathered) -> list[OneTrial]:
        """List the trials of a run: as many of each letter, or one for each of its test presses."""
        found = []
        for letter in gathered.letters:
            count = config.trials
            if count == "all":
                count = len(presses_with(gathered.scan.where("test", letter), config.readings))
            found += [OneTrial(letter, trial) for trial in range(count)]
        return found

    def plan(
        self, config: RunConfig, scan: Scan, given: Estimator | None, objects: Mapping[str, Any] | None
    ) -> TrialPlan:
        """Put together what a worker needs to do the trials."""
        press: Press | None = None
        if config.on_demand:
            from tactsim.bench.on_demand import OnDemand  # brings MuJoCo, which most runs need not

            press = OnDemand(config.scan_options)
        rules = TrialRules.of(config, press)
        forward = partial(_forward_model, config.told)
        return TrialPlan(config.estimator, config.options, scan, rules, forward, given, objects)

    def hide(self, scan: Scan, rng: np.random.Generator) -> FloatArray:
        """Draw robot_in_object (3,); see `trials.draw_true_pose`."""
        return draw_true_pose(rng, offsets(scan.taxel_xy), poses_unknown=poses_unknown(scan.meta))

    def said(
        self, config: RunConfig, gathered: Gathered, trials: Trials, estimator: Estimator
    ) -> tuple[dict[str, Any], FloatArray | None]:
        """Give what a run says of itself beside the rest, and the bounds of its trials (n, r) mm."""
        scan, options = gathered.scan, estimator.options
        said: dict[str, Any] = {}
        bounds, no_bound = None, NO_BOUND
        if config.bound:
            from tactsim.bench.cramer_rao import bounds_of_trials

            bounds, no_bound = bounds_of_trials(scan, trials, config.explore, config.moving)
        if isinstance(options, FilterOptions) and hasattr(estimator, "fits_pad") and estimator.fits_pad(scan):
            pad_fit = cast("MapFilter", estimator).pad_fit
            if pad_fit is None:  # a sweep's workers have fitted theirs
                from tactsim.estimators.pad_fit import fit_to_pad

                pad_fit = fit_to_pad(scan, options)
            options = pad_fit.outer(options)
            said = {"options": options.model_dump(mode="json"), "pad_fit": pad_fit.facts()}
        notes = notes_on(scan)
        if poses_unknown(scan.meta) and scan.where("train").at_one_pose and maps_of(estimator):
            notes.append(
                "nobody knows where presses were taken: these maps are of presses laid over each other as they came; "
                "stacked and whole-image name whole presses by their images"
            )
        said |= {
            "protocol": _protocol_name(config, scan),
            "slip": config.moving.describe(),
            "no_bound": no_bound,
            "classifier_agreement": eq3_agreement(scan, options),
            **({"notes": notes} if notes else {}),
        }
        return said, bounds

    def maps(self, estimator: Estimator) -> Mapping[str, Any]:
        """Give the occupancy maps that an estimator has learned."""
        return maps_of(estimator)

    def shape_files(self, config: RunConfig) -> tuple[Path, ...]:
        """Give the files of the user's own shapes."""
        return config.shapes

    def cautions(self, run: Run) -> list[str]:
        """Say of which letters no symmetry is known."""
        # Errors take an object whose symmetry nobody stated for having none: half a turn of it may look the same.
        stated = run.about["scan"].get("objects", {})
        unknown = [label for label, of in run.objects.items() if of.placed and label not in stated]
        if not unknown or not run.trials.places:
            return []
        return [
            f"no symmetry is known of {' '.join(unknown)}: a turn that looks the same counts as an error; "
            "`--shape FILE` of `bench import` and `bench replay` states it"
        ]

    def as_json(self, run: Run) -> dict[str, Any]:
        """Give the letters, the bound, and how often eq. 3 is right."""
        agreement = run.about["classifier_agreement"]
        return {"letters": run.letters, **run.against_bound, "classifier_agreement": agreement}

    def stated(self, run: Run, about: dict[str, Any]) -> dict[str, Any]:
        """Add the letters' properties."""
        return about | {"objects": {label: asdict(of) for label, of in run.objects.items()}}

    def objects_of(self, about: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Take the letters' properties out of what run.json says."""
        return {
            label: Properties.stated(of, f"run.json: objects.{label}")
            for label, of in about.pop("objects").items()
        }

    def plot(self, run: Run, ax: Any = None) -> Any:
        """Draw accuracy and placement error."""
        from tactsim.bench.runs.figures import draw_curves, readings_figure

        return readings_figure(run) if ax is None else draw_curves(run, ax)

    def plot_maps(self, maps: Mapping[str, Any]) -> Picture:
        """Draw occupancy maps."""
        from tactsim.bench.runs.figures import maps_figure

        return maps_figure(maps)

    def page(self, of: Pages) -> tuple[list[Path], list[str]]:
        """Write the page, its pictures and curves."""
        from tactsim.bench.report.write import write_plane_pages

        return write_plane_pages(of)

    def table(self, run: Run, verbose: bool) -> list[str]:
        """Show the bound too, where it is known, and how sure the estimator was."""
        bounded = any(bound is not None for bound in run.against_bound["bound_mm"])
        sure = verbose and any(value is not None for value in run.summary["sharpness_mm"])
        names = ["error_mm", *["efficiency"] * bounded, *["error_all_mm"] * verbose]
        return names + ["sharpness_mm", "coverage_90"] * sure

    def details(self, run: Run) -> list[str]:
        """Say the bound, how often eq. 3 is right, and the times."""
        seconds, readings, lines = run.times["seconds"], run.readings, list[str]()
        if run.against_bound["bound_mm"][-1] is not None:
            lines.append(
                f"bound of the error at reading {readings} (Cramer and Rao): {run.against_bound['bound_mm'][-1]:.3f} mm"
            )
        if run.about["classifier_agreement"] is not None:
            lines.append(
                f"eq. 3 is right for {100 * run.about['classifier_agreement']:.1f} % of decided taxels"
            )
        propose = seconds.get("propose_per_reading", 0)
        stages = [one for one in ("scan", "fit", "trials", "total") if one in seconds]
        lines.append(
            f"time  {', '.join(f'{stage} {seconds[stage]:.2f} s' for stage in stages)}"
            f"; update {1e3 * seconds['update_per_reading']:.3f} ms, the slowest of a hundred "
            f"{1e3 * np.quantile(run.trials.update_s, 0.99):.3f} ms, "
            f"estimate {1e3 * seconds['estimate_per_reading']:.3f} ms a reading"
            + (f", choice of the next {1e3 * propose:.1f} ms" if propose else "")
        )
        return lines

    def nexts(self, run: Run) -> list[str]:
        """Suggest the default estimator, or to choose the touches."""
        config = RunConfig(**run.config)
        plain = config.source == RunConfig(seed=config.seed).source and not config.slip
        again, standard = "bench run" if plain else "the same data with", RunConfig().estimator
        if run.estimator != standard:
            return [
                f"{again} --estimator {standard}  # the default{_error_of_default() if beside(run) else ''}"
            ]
        if not config.pressed or config.explore != "random":
            return []
        return [
            f"{again} --explore information --readings 10  # it chooses the touches; --explore blind does not"
        ]


def _held_out(config: RunConfig, letters: Sequence[str]) -> tuple[str, ...]:
    """Say which of the letters nothing is trained on in any trial. Raises InputError if they are not among them."""
    held_out = () if config.each_held_out else config.hold_out
    for letter in held_out:
        if letter not in letters and len(letter) > 1 and set(letter) <= set(letters):
            raise InputError(
                f"--hold-out (in Python hold_out) {letter}: several letters have commas between them: "
                f"{','.join(letter)}; one is left to train on"
            )
        if letter not in letters:
            raise unknown("letter to hold out", letter, letters)
    if set(letters) <= set(held_out) or (config.each_held_out and len(letters) == 1):
        raise InputError("--hold-out (in Python hold_out) names every letter; leave one to train on")
    return held_out


def _protocol_name(config: RunConfig, scan: Scan) -> str:
    """Name the protocol of a run; only results of one protocol share a table."""
    options = scan.meta.get("options")  # of the press, if the scan says them
    stated = options.get("test_poses") if isinstance(options, Mapping) else None
    where = (
        f"test poses {'from a file' if config.scan else stated if stated in ('same', 'random') else 'given'}"
    )
    if config.on_demand:
        where = "touches in the robot's frame"
    elif poses_unknown(scan.meta):
        where = "one press a trial, poses unknown"
    elif config.presses is not None:
        where = "presses on a pad"
    order = "random order"
    if config.explore == "information":
        # Recorded readings lie around the object: the poses to choose among tell where it is.
        among = "" if config.on_demand else " among recorded poses, which tell the place"
        order = f"chosen by information{among}"
    held_out = f", {' '.join(config.hold_out)} held out" if config.hold_out else ""
    if config.each_held_out:
        held_out = ", each letter held out in turn"
    # What was said above, and what runs of one table may differ in. Every other rule makes another protocol.
    said = {"readings", "seed", "explore", "moving", "press", "measured", "each_held_out"}
    rules = TrialRules.of(config, None)
    more = [
        f", {rule.name.replace('_', ' ')} {getattr(rules, rule.name)}"
        for rule in fields(TrialRules)
        if rule.name not in said and getattr(rules, rule.name) != rule.default
    ]
    return f"{where}, {order}{held_out}{''.join(more)}"


def _error_of_default() -> str:
    """Say how exactly the default estimator places the paper's letters, pressed as by default."""
    from tactsim.bench.leaderboard import best_known

    task = "letters-offgrid-v1"
    best = best_known().get(task)
    return f": {best.default:.2f} mm after 20 readings on task {task}" if best and best.default else ""
