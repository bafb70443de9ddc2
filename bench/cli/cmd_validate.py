"""`bench validate`: measure how far the simulation is from a recorded pad, and fit its options to that."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    from tactsim.bench.validation import Validation
    from tactsim.hardware.sensor_fit import SensorFit


def command(
    simulated: Annotated[Path, typer.Option(help="A scan of `bench scan`.")],
    recorded: Annotated[Path, typer.Option(help="A scan of `bench record` or `bench replay --scan`.")],
    estimator: Annotated[str, typer.Option(help="The estimator that recognises.")] = "histogram",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="An option of the estimator, key=value.", show_default=False),
    ] = None,
    trials: Annotated[int, typer.Option(min=1, help="Trials for each letter.")] = 10,
    out: Annotated[
        Path | None,
        typer.Option(
            help="A new folder for validation.json and world.toml, for `bench scan --world`.",
            show_default=False,
        ),
    ] = None,
    seed: shared.Seed = 0,
    as_json: pads.AsJson = False,
) -> None:
    """Compare a simulated with a recorded scan: readings, sensor parameters, classes, recognition."""
    import json

    import tomli_w

    from tactsim.bench import validation
    from tactsim.bench.config import key_values
    from tactsim.bench.places import check_new_folder
    from tactsim.bench.terminal import progress_bars
    from tactsim.core import Scan
    from tactsim.core.files import new_folder

    if out is not None:
        check_new_folder(out)
    with progress_bars() as progress:
        result = validation.validate(
            Scan.load(simulated), Scan.load(recorded), estimator=estimator,
            options=key_values(settings or (), "--set"), trials=trials, seed=seed, progress=progress,
        )  # fmt: skip
    answer = validation.as_json(result)
    if out is not None:
        with new_folder(out) as folder:
            (folder / "validation.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
            (folder / "world.toml").write_bytes(tomli_w.dumps(result.parameters).encode())
    if as_json:
        typer.echo(json.dumps(answer))
    else:
        _show(result, out)


def _show(result: Validation, out: Path | None) -> None:
    from rich.table import Table

    from tactsim.bench.console import plain_console
    from tactsim.bench.validation import CLASSES

    console = plain_console()
    fit = result.fit
    console.print(
        f"{result.readings:,} recorded readings of {' '.join(result.letters)}, {result.taxels} taxels"
    )
    table = Table(box=None, pad_edge=False)
    for heading in ("recorded against", "rms kPa", "bias kPa", "of contact pressure", "correlation"):
        table.add_column(heading, justify="left" if heading == "recorded against" else "right")
    for name, error in (("simulation as it is", result.before), ("simulation as fitted", result.after)):
        table.add_row(
            name, f"{error.rms:.2f}", pads.rounded(error.bias, 2, "+"),
            f"{100 * error.relative:.1f} %", f"{error.correlation:.4f}"
        )  # fmt: skip
    console.print(table)
    console.print(
        f"fitted  point spread {fit.psf_sigma:.3f} +- {fit.psf_sigma_error:.3f} mm, noise {fit.noise:.2f} kPa, gain "
        f"{fit.gain:.3f} (taxels {100 * fit.gain_spread:.1f} % apart)"
    )
    x, y, angle = (
        pads.rounded(value, digits, "+") for value, digits in zip(fit.offset, (2, 2, 4), strict=True)
    )
    console.print(
        f"placed  off by {x}, {y} mm and {angle} rad in all presses; {fit.placement_mm:.2f} mm and "
        f"{fit.placement_rad:.4f} rad from press to press"
    )
    for line in _tilt_lines(fit):
        console.print(line)
    console.print(
        f"eq. 3   {100 * result.class_agreement:.1f} % of the taxels in the same class; simulated against "
        f"simulated {100 * result.class_ceiling:.1f} %"
    )
    counts = Table(box=None, pad_edge=False)
    counts.add_column("recorded \\ simulated")
    for name in CLASSES:
        counts.add_column(name, justify="right")
    for name, row in zip(CLASSES, result.class_counts, strict=True):
        counts.add_row(name, *(f"{count:,}" for count in row))
    console.print(counts)
    table = Table(box=None, pad_edge=False)
    for heading in ("trained -> tested", "readings", "right @5", "right @end", "error mm"):
        table.add_column(heading, justify="left" if heading == "trained -> tested" else "right")
    for name, row in result.recognition.items():
        placed = "-" if row["error_mm"] is None else f"{row['error_mm']:.2f}"
        table.add_row(
            name, str(row["readings"]), f"{row['accuracy_at_5']:.3f}", f"{row['accuracy']:.3f}", placed
        )
    console.print(table)
    if out is not None:
        console.print(
            f"all figures in {out / 'validation.json'}; press as fitted by --world {out / 'world.toml'}"
        )


def _tilt_lines(fit: SensorFit) -> list[str]:
    """Say what the readings tell of tilt, layer and wrist, and what they leave open."""
    rigid = float("inf")
    layer, wrist = f"{fit.stiffness:,.0f} kPa/mm", f"{fit.wrist:,.0f} N mm/rad"
    tilted = "tilted  no press, as far as readings tell"
    if fit.placement_tilt:
        x, y = (pads.rounded(value, 4, "+") for value in fit.gain * fit.tilt_offset)
        tilted = (
            f"tilted  by {x}, {y} rad in all presses; {fit.gain * fit.placement_tilt:.4f} rad from press "
            f"to press, which on a layer of {layer} is {fit.gain * fit.lean:.2f} kPa/mm along the pad"
        )
    if fit.held == "wrist":
        ends = fit.yielding_low * fit.wrist, fit.yielding_high * fit.wrist
        known = f"layer   {layer}, {_range(*ends)}, if the wrist has {wrist} as simulated"
    else:
        ratios = fit.yielding_high, fit.yielding_low
        low, high = (fit.stiffness / ratio if ratio else rigid for ratio in ratios)
        found = "rigid" if fit.wrist == rigid else wrist
        known = f"wrist   {found}, {_range(low, high)}, if the layer has {layer}"
    alone = fit.stiffness_low, fit.stiffness_high
    open_end = alone[0] == 0 or alone[1] == rigid
    which = f"not identified ({_range(*alone)})" if open_end else _range(*alone)
    lines = [tilted, known, f"alone   the layer's stiffness in kPa/mm: {which}; tilts and wrist follow it"]
    if fit.lifted:
        lines.append(
            "rough   tilts lift a side of many faces from the pad; tilt, layer and wrist may be far off"
        )
    if fit.blanks:
        lines.append(f"blank   {fit.blanks:,} presses that tip over in the fitted simulation")
    return lines


def _range(low: float, high: float) -> str:
    """Write an interval; 0 and infinity are no bounds."""
    if not low and high == float("inf"):
        return "any"
    if high == float("inf"):
        return f"at least {low:,.4g}"
    return f"{low:,.4g} to {high:,.4g}" if low else f"at most {high:,.4g}"
