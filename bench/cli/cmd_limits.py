"""`bench bound`, `fit` and `stress`: how good an estimator can be, what it has learned, and where it breaks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import Words, key_values, with_options_of
from tactsim.bench.config import RunConfig, ScanWords, run_config
from tactsim.bench.console import plain_console, plain_table
from tactsim.bench.places import check_new_file, saved
from tactsim.core.errors import counted

if TYPE_CHECKING:
    from tactsim.bench.exact_bayes import Bound
    from tactsim.bench.stress import Outcome
    from tactsim.core import Scan


@with_options_of(ScanWords, only=("letters", "test_poses", "world"))
def command_bound(
    words: Words,
    trials: int = typer.Option(10, min=1, help="Trials for each object."),
    readings: int = typer.Option(20, min=1, help="Readings a trial, without replacement."),
    scan: Path | None = typer.Option(None, help="Readings from a file of `bench scan` instead of the press."),
    slip: list[str] | None = typer.Option(
        None,
        help="How the object moves between touches, a random walk: walk_mm=0.5, walk_rad=0.03.",
        metavar="NAME=VALUE",
    ),
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    out: Path | None = typer.Option(None, help="Also draw a picture: the file to write, .png."),
    as_json: shared.AsJson = False,
) -> None:
    """Say how good an estimator can be: exact Bayes, and the Cramer-Rao bound of the error, by reading."""
    from functools import partial

    from tactsim.bench.exact_bayes import find_bound
    from tactsim.bench.results import to_json
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.files import write_bytes

    if out is not None:
        check_new_file(out, picture=".png")
    given = {} if scan is None else {"scan": scan}
    moving = {} if slip is None else {"slip": key_values(slip, "--slip")}
    config = run_config(**words, **given, **moving, trials=trials, readings=readings)
    with progress_bars() as progress:
        found = find_bound(config, jobs=jobs, cache=cache, progress=progress)

    def save(picture: Path) -> Path:
        write_bytes(picture, found.plot().png())
        return picture

    with saved(None if out is None else partial(save, out)) as place:
        if as_json:
            typer.echo(to_json(found.as_json()), nl=False)
            return
        _print_bound(found)
        if place is not None:
            typer.echo(f"picture  {place}")


def _print_bound(found: Bound) -> None:
    """Print the best possible by reading: exact Bayes, and the Cramer-Rao bound where readings determine the pose."""
    from tactsim.bench.score import BESIDE, CURVES
    from tactsim.bench.terminal import ROWS, number, rows_of

    console, values = plain_console(), found.as_json()
    console.print("the best possible", style="bold", end="; ")
    console.print(
        f"{' '.join(values['letters'])}: {counted(values['trials'], 'trial')} each, {values['protocol']}, "
        f"seed {values['seed']}"
    )
    heads = (CURVES["accuracy"].column, CURVES["error_mm"].column, BESIDE["bound_mm"].column)
    table = plain_table("readings", *heads, "trials", words=0)
    for reading in rows_of(values["readings"], ROWS):
        k = reading - 1
        table.add_row(
            str(reading),
            number(values["bayes_accuracy"][k], 3),
            number(values["bayes_error_mm"][k], 3),
            number(values["bound_mm"][k], 3),
            f"{values['determined'][k]:.3f}",
        )
    console.print(table)
    if values["no_bayes"]:
        console.print(f"no exact Bayes: {values['no_bayes']}")
    console.print(
        "right, error: of exact Bayes, which knows the press; Cramer-Rao bound: over the share `trials` of trials "
        f"whose readings determine the pose to {values['determined_below_mm']:.2g} mm; -: such trials are too few"
    )


_WHAT = {
    "threshold": "T of eq. 3, in the scan's unit",
    "ratio": "of the largest taxel, eq. 3",
    "sigma": "point spread of eq. 4, mm",
    "cell": "side of a map cell, mm",
    "quantiles": "bins in which classes are counted",
}


def command_fit(
    scan: Path = typer.Argument(..., metavar="SCAN", help="The scan, .npz; its training readings count."),
    estimator: str = typer.Option(
        RunConfig.model_fields["estimator"].default, help="Whose options are chosen; a filter on maps."
    ),
    settings: list[str] | None = typer.Option(None, "--set", help="An option not to be chosen, name=value."),
    out: Path | None = typer.Option(
        None, help="A world file (.toml) with the pad and the response, for `bench scan --world`."
    ),
    as_json: shared.AsJson = False,
) -> None:
    """Choose what depends on a pad's unit, pitch and response from training readings alone, and say why."""
    from dataclasses import replace

    import numpy as np
    import tomli_w

    from tactsim.bench.results import to_json
    from tactsim.core import InputError, Scan
    from tactsim.core.files import replacing
    from tactsim.estimators import create
    from tactsim.estimators.likelihoods.folds import can_leave_out
    from tactsim.estimators.options import FilterOptions
    from tactsim.estimators.pad_fit import fit_to_pad, response, units_of
    from tactsim.estimators.stacked_filter import no_poses

    made = create(estimator, **key_values(settings or (), "--set"))
    if not isinstance(made.options, FilterOptions):
        raise InputError(f"--estimator {estimator}: it learns no maps, so there is nothing to choose for it")
    if out is not None:
        check_new_file(out, scan, suffix=".toml")
    readings = Scan.load(scan)
    train = readings.where("train")
    train = train if len(train) else readings
    if not train.readings.any():
        raise InputError(f"{scan}: no training reading touches anything; press harder, or at other places")
    if train.at_one_pose and (unknown := no_poses(train)):
        raise InputError(f"{scan}: options are of maps, which need poses, but {unknown}")
    if not can_leave_out(train):
        raise InputError(
            f"{scan}: no object has two training presses, so nothing tells which options foretell a press best; "
            "record more of them"
        )
    train = replace(train, split=np.full(len(train), "train"))
    found = fit_to_pad(train, made.options)
    exponent, straight, bent = response(train, made.options)
    typical = units_of(train).pressure
    unit = train.meta.get("unit", "kPa")
    world = _world(train, exponent, typical)
    if out is not None:
        with replacing(out) as stream:
            stream.write(tomli_w.dumps(world).encode())
    if as_json:
        told: dict[str, Any] = {
            "response_exponent": exponent,
            "information_straight": straight,
            "information_bent": bent,
        }
        told |= {"estimator": estimator, "unit": unit, "world": world}
        typer.echo(to_json(found.facts() | told), nl=False)
        return
    facts, console = found.facts(), plain_console()
    console.print(
        f"pad       its pitch is {facts['length_ratio']:.3g} times the paper's; lengths in mm are scaled by that\n"
        f"readings  a covered taxel reads {typical:.4g} {unit} (median); thresholds are scaled by that"
    )
    for name, value in facts["chosen"].items():
        console.print(f"{name:<9} {value:.4g}  ({_WHAT[name]})")
    before, after = facts["information_default"], facts["information_chosen"]
    console.print(
        f"why       tested on a position left out, maps tell {after:.3f} nats of whether a taxel is covered as "
        f"chosen, {before:.3f} with the scaled defaults; more is better"
    )
    if exponent == 1:
        console.print(f"response  readings are in proportion to pressure: mosaics tell {straight:.3f} nats")
    else:
        console.print(
            f"response  reading^{exponent:g} is proportional to pressure: mosaics tell {bent:.3f} nats of left-out "
            f"readings raised so, {straight:.3f} of readings as they are"
        )
    if out is not None:
        console.print(f"world     {out}, for `bench scan --world`")


def _world(scan: Scan, exponent: float, typical: float) -> dict[str, Any]:
    """Say what was learned of the sensor as a world: the pad, if the scan states it, and the response."""
    sensor: dict[str, float] = {}
    if exponent != 1:
        sensor = {"response": 1 / exponent, "response_pressure": typical}
    pad = scan.about["pad"]
    return ({"pad": {k: v for k, v in pad.items() if v is not None}} if pad else {}) | {"sensor": sensor}


def command_stress(
    case: list[str] | None = typer.Option(None, help="Only this case; repeat for several."),
    tag: list[str] | None = typer.Option(
        None, help="Only cases with this tag, a topic or 'quick'; repeat for several."
    ),
    as_json: shared.AsJson = False,
) -> None:
    """Vary inputs over many decades and measure the worst deviation; exit status 1 if a case fails."""
    from tactsim.bench.machine import machine, versions
    from tactsim.bench.results import to_json
    from tactsim.bench.stress import chosen_cases, run_cases
    from tactsim.bench.terminal import progress_bars

    cases = chosen_cases(case or (), tag or ())
    with progress_bars() as progress:
        outcomes = run_cases(cases, progress)
    failed = sum(not outcome.passed for outcome in outcomes)
    if as_json:
        said = {"cases": [outcome.as_json() for outcome in outcomes], "failed": failed}
        typer.echo(to_json(said | {"versions": versions(), "machine": machine()}), nl=False)
    else:
        _print(outcomes)
    if failed:
        raise typer.Exit(1)


def _print(outcomes: Sequence[Outcome]) -> None:
    """Print the table, then for every failed case where it failed and why its limit is what it is."""
    from tactsim.core.errors import counted

    console = plain_console()
    table = plain_table("case", "varied", "deviation", "worst", "limit", "verdict", words=3)
    for outcome in outcomes:
        case = outcome.case
        limit = f"<= {case.limit:g}"
        table.add_row(case.name, case.varied, case.deviation, f"{outcome.worst:.2g}", limit, outcome.verdict)
    console.print(table)
    failed = [outcome for outcome in outcomes if not outcome.passed]
    for outcome in failed:
        console.print(f"{outcome.case.name}: {outcome.at}; the limit: {outcome.case.because}")
    seconds = sum(outcome.seconds for outcome in outcomes)
    console.print(f"{counted(len(outcomes), 'case')} in {seconds:.0f} s, {len(failed) or 'none'} failed")
