"""`bench fit`: choose what depends on unit, pitch and response from the training readings, and say why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    from tactsim.core import Scan

_WHAT = {
    "threshold": "T of eq. 3, in the scan's unit",
    "ratio": "of the largest taxel, eq. 3",
    "sigma": "point spread of eq. 4, mm",
    "cell": "side of a map cell, mm",
    "quantiles": "bins in which classes are counted",
}


def command(
    scan: Annotated[
        Path, typer.Argument(metavar="SCAN", help="The scan, .npz; its training readings count.")
    ],
    estimator: Annotated[
        str, typer.Option(help="The estimator whose options are chosen; a filter on maps.")
    ] = "stacked",
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="An option that is not to be chosen, name=value.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="A world file (.toml) with the pad and the response, for `bench scan --world`."),
    ] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Choose what depends on a pad's unit, pitch and response from training readings alone, and say why."""
    import tomli_w

    from tactsim.bench.config import key_values
    from tactsim.bench.console import plain_console
    from tactsim.bench.places import check_new_file
    from tactsim.bench.results import to_json
    from tactsim.core import InputError, Scan
    from tactsim.core.files import replacing
    from tactsim.estimators import create
    from tactsim.estimators.likelihoods.folds import can_leave_out
    from tactsim.estimators.options import FilterOptions
    from tactsim.estimators.pad_fit import fit_to_pad, response, units_of

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
    if not can_leave_out(train):
        raise InputError(
            f"{scan}: no object has two training presses, so nothing tells which options foretell a press best; "
            "record more of them"
        )
    train = train if (train.split == "train").all() else _all_to_train(train)
    found = fit_to_pad(train, made.options)
    exponent, straight, bent = response(train, made.options)
    typical = units_of(train).pressure
    unit = train.meta.get("unit", "kPa")
    world = _world(train, exponent, typical)
    if out is not None:
        with replacing(out) as stream:
            stream.write(tomli_w.dumps(world).encode())
    if as_json:
        told = {"response_exponent": exponent, "information_straight": straight, "information_bent": bent}
        typer.echo(
            to_json({"estimator": estimator, "unit": unit, **found.facts(), **told, "world": world}), nl=False
        )
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
        console.print(
            f"response  readings are proportional to pressure: mosaics tell {straight:.3f} nats of them"
        )
    else:
        console.print(
            f"response  reading^{exponent:g} is proportional to pressure: mosaics tell {bent:.3f} nats of left-out "
            f"readings raised so, {straight:.3f} of readings as they are"
        )
    if out is not None:
        console.print(f"world     {out}, for `bench scan --world`")


def _all_to_train(scan: Scan) -> Scan:
    """Take all readings as training readings, as `bench run --train-scan` does of a scan with one split."""
    from dataclasses import replace

    import numpy as np

    return replace(scan, split=np.full(len(scan), "train"))


def _world(scan: Scan, exponent: float, typical: float) -> dict[str, Any]:
    """Say what was learned of the sensor as a world: the pad, if the scan states it, and the response."""
    sensor: dict[str, float] = {}
    if exponent != 1:
        sensor = {"response": 1 / exponent, "response_pressure": typical}
    pad = scan.about["pad"]
    return ({"pad": {k: v for k, v in pad.items() if v is not None}} if pad else {}) | {"sensor": sensor}
