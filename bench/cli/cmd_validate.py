"""`bench validate`: measure how far the simulation is from a recorded pad, and fit its options to that."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.console import kept_clear, plain_console, plain_table, rounded
from tactsim.bench.pad.validation import ROWS, TOUCHES
from tactsim.core.errors import counted

if TYPE_CHECKING:
    from tactsim.bench.pad.validation import Validation
    from tactsim.hardware.sensor_fit import SensorFit


def command_validate(
    simulated: Path = typer.Option(..., help="A scan of `bench scan`."),
    recorded: Path = typer.Option(
        ..., help="A scan of `bench record`, `bench replay --scan` or `bench import`."
    ),
    estimator: list[str] | None = typer.Option(
        None, help="An estimator that recognises; may be repeated. [default: refined, histogram]"
    ),
    settings: list[str] | None = typer.Option(None, "--set", help="An option of the estimators, key=value."),
    trials: int = typer.Option(10, min=1, help="Trials for each object."),
    out: Path | None = typer.Option(
        None, help="A new folder for validation.json, presses.png and world.toml, for `bench scan --world`."
    ),
    seed: shared.Seed = 0,
    as_json: shared.AsJson = False,
) -> None:
    """Compare a simulated with a recorded scan: readings, sensor parameters, recognition."""
    import json
    from functools import partial

    import tomli_w

    from tactsim.bench.config import key_values
    from tactsim.bench.formats import load_scan
    from tactsim.bench.pad import validation
    from tactsim.bench.places import check_new_folder, save_beside, saved
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.files import new_folder

    if out is not None:
        check_new_folder(out)
    with kept_clear(as_json), progress_bars() as progress:
        result = validation.validate(
            load_scan(simulated), load_scan(recorded), estimators=estimator or ("refined", "histogram"),
            options=key_values(settings or (), "--set"), trials=trials, seed=seed, progress=progress,
        )  # fmt: skip
    answer = validation.as_json(result)

    def save(wanted: Path) -> Path:
        with new_folder(wanted) as folder:
            (folder / "validation.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
            (folder / "presses.png").write_bytes(validation.presses_figure(result).png())
            (folder / "world.toml").write_bytes(tomli_w.dumps(result.parameters).encode())
        return wanted

    with saved(None if out is None else partial(save_beside, save, out)) as place:
        if as_json:
            typer.echo(json.dumps(answer))
        else:
            show(result, place, recorded)


_TRAINED = {"simulated": "simulated", "fitted": "as fitted", "recorded": "recorded"}
_ALL = float("inf")
_MOVED = 5.0  # times what a press's frames leave: so far are untouched taxels off where the zero moves
_NOISE_ALONE = 1.2  # times the noise: more is left of a fit than noise, which intervals take it for


def show(result: Validation, out: Path | None, recorded: Path) -> None:
    """Print the report. out: where the world was written, if it was; recorded: the recording's file."""
    console = plain_console()
    for line in verdict(result):
        console.print(line, style="bold", soft_wrap=True)
    split = "training" if result.trained_apart else "recorded"
    console.print(
        f"{result.readings:,} recorded readings of {' '.join(result.letters)}, {result.taxels} taxels, in "
        f"{result.unit}; fitted to {result.used:,} {split} ones"
        + (f", near copies averaged to {result.apart:,}" if result.apart < result.used else ""),
        soft_wrap=True,
    )
    _show_errors(console, result)
    for line in fit_lines(result.fit, result.unit):
        console.print(line, soft_wrap=True)
    if result.outlined:
        console.print(_outlines(result), soft_wrap=True)
    for name, value in result.clipped.items():
        console.print(f"bound   {name} {value:.4g} is beyond what a scan takes; the world has the bound")
    _show_recognition(console, result)
    if out is not None:
        name = next(iter(result.recognition))
        console.print(f"picture {out / 'presses.png'}", soft_wrap=True)
        console.print(f"all figures in {out / 'validation.json'}. Press as fitted, and train on that:")
        console.print(f"  bench scan --world {out / 'world.toml'} --out fitted.npz", soft_wrap=True)
        readings = len(next(iter(result.recognition[name].values()))["accuracy"])
        run = f"bench run --estimator {name} --scan {recorded} --train-scan fitted.npz --readings {readings}"
        console.print(f"  {run}", soft_wrap=True)


def verdict(result: Validation) -> list[str]:
    """Say in three lines what a fit is good for: how near it comes, what that is worth, and what to doubt."""
    before, after = (result.errors[name] for name in ("as_it_is", "held_out_placed"))
    name, sides = next(iter(result.recognition.items()))
    k = min(5, *(len(figures["accuracy"]) for figures in sides.values()))
    shares = ", ".join(f"{_TRAINED[side]} {of['accuracy'][k - 1]:.2f}" for side, of in sides.items())
    fit = result.fit
    ratio = fit.misfit / fit.noise if fit.noise else _ALL
    noise = f"what no fit explains is {ratio:.1f} times the noise" if ratio < _ALL else "there is no noise"
    narrow = "the intervals below, above all of curve, gain and load, are too narrow"
    doubt = f"{noise}, so the intervals below hold"
    if ratio > _NOISE_ALONE:
        doubt = f"{noise}: {narrow}"
    elif result.steady is not None and fit.noise > _MOVED * result.steady:
        doubt = (
            f"untouched taxels are off by {fit.noise:.2g} {result.unit}, a press's frames by {result.steady:.2g}: the "
            f"zero moved, and {narrow}; take a tare more often"
        )
    return [
        f"near    presses that were held out are off by {100 * after.relative:.0f} % of the contact as fitted, by "
        f"{100 * before.relative:.0f} % as simulated",
        f"worth   {name} is right after {counted(k, 'touch')}, by what it was trained on: {shares}",
        f"doubt   {doubt}",
    ]


def _show_errors(console: Console, result: Validation) -> None:
    unit = result.unit
    table = plain_table("recorded against", f"rms {unit}", f"bias {unit}", "of contact", "correlation")
    for key, name in ROWS.items():
        of = result.errors[key]
        shares = f"{100 * of.relative:.1f} %", f"{of.correlation:.4f}"
        table.add_row(name, f"{of.rms:.3g}", f"{of.bias:+.2g}", *shares)
    console.print(table)


def fit_lines(fit: SensorFit, unit: str) -> list[str]:
    """Say what was fitted, each number with its 95 % interval."""
    saved, error = fit.gains_saved
    apart = f"{100 * saved:+z.0f} % (standard error {100 * error:.0f} %) of the squares of held-out presses"
    gains = "gains   taxels left alike: too few presses to hold some out"
    if (fit.gain_per_taxel != 1).any():
        gains = f"gains   taxels have gains of their own, which save {apart}"
    elif error < _ALL:
        gains = f"gains   taxels left alike: gains of their own would save {apart}"
    x, y, angle = (rounded(value, digits, "+") for value, digits in zip(fit.offset, (2, 2, 4), strict=True))
    return [
        f"spread  point spread {_known(fit.psf_sigma, fit.psf_sigma_range, 'mm')}",
        f"gain    {_known(fit.gain, fit.gain_range, f'{unit} a kPa of the simulation')}",
        f"curve   exponent of the response {_known(fit.response, fit.response_range)}",
        gains,
        f"uneven  taxels {100 * fit.gain_spread:.1f} % apart in all presses, and by another {100 * fit.texture:.1f} % "
        f"from press to press; {100 * fit.stray:.1f} % read a contact where there is none, by held-out presses",
        f"noise   {fit.noise:.3g} {unit}",
        f"placed  off by {x}, {y} mm and {angle} rad in all presses; from press to press "
        f"{_known(fit.placement_mm, fit.placement_mm_range, 'mm')} and "
        f"{_known(fit.placement_rad, fit.placement_rad_range, 'rad')}",
        f"load    from press to press {_known(fit.load_spread, fit.load_spread_range, 'of it')}",
        *_tilt_lines(fit),
    ]


def _outlines(result: Validation) -> str:
    """Say how far outlines lie outside their drawings, as far as readings tell."""
    found = zip(result.outlined, result.fit.grown, result.fit.grown_range, strict=True)
    each = [f"{name} {by:+.2f} ({low:+.2f} to {high:+.2f})" for name, by, (low, high) in found]
    return f"shapes  outlines lie outside their drawings by mm: {', '.join(each)}; the world has the drawings"


def _known(value: float, ends: tuple[float, float], unit: str = "") -> str:
    low, high = ends
    words = f"{value:.3g}{' ' + unit if unit else ''}"
    if not low and high == _ALL:
        return f"not identified (at {words})"
    return f"{words} ({_range(low, high)})"


def _tilt_lines(fit: SensorFit) -> list[str]:
    """Say what the readings tell of tilt, layer and wrist, and what they leave open."""
    layer, wrist = f"{fit.stiffness:,.0f} kPa/mm", f"{fit.wrist:,.0f} N mm/rad"
    tilted = "tilted  no press, as far as readings tell"
    if fit.placement_tilt:
        x, y = (rounded(value, 4, "+") for value in fit.tilt_offset)
        tilted = (
            f"tilted  by {x}, {y} rad in all presses; from press to press "
            f"{_known(fit.placement_tilt, fit.placement_tilt_range, 'rad')}, which on a layer of {layer} is "
            f"{fit.lean:.2f} kPa/mm along the pad"
        )
    if fit.held == "wrist":
        ends = fit.yielding_low * fit.wrist, fit.yielding_high * fit.wrist
        known = f"layer   {layer}, {_range(*ends)}, if the wrist has {wrist} as simulated"
    else:
        ratios = fit.yielding_high, fit.yielding_low
        low, high = (fit.stiffness / ratio if ratio else _ALL for ratio in ratios)
        found = "rigid" if fit.wrist == _ALL else wrist
        known = f"wrist   {found}, {_range(low, high)}, if the layer has {layer}"
    alone = fit.stiffness_low, fit.stiffness_high
    open_end = alone[0] == 0 or alone[1] == _ALL
    which = f"not identified ({_range(*alone)})" if open_end else _range(*alone)
    lines = [tilted, known, f"alone   the layer's stiffness in kPa/mm: {which}; tilts and wrist follow it"]
    if fit.lifted:
        lines.append(
            "rough   tilts lift a side of many faces from the pad; tilt, layer, wrist may be far off"
        )
    if fit.blanks:
        lines.append(f"blank   {fit.blanks:,} presses that tip over in the fitted simulation")
    return lines


def _range(low: float, high: float) -> str:
    """Write an interval; 0 and infinity are no bounds."""
    if not low and high == _ALL:
        return "any"
    if high == _ALL:
        return f"at least {low:,.4g}"
    return f"{low:,.4g} to {high:,.4g}" if low else f"at most {high:,.4g}"


def _show_recognition(console: Console, result: Validation) -> None:
    table = plain_table("", "trained on", *(f"@{touch}" for touch in TOUCHES), "95 % from", "mm")
    for name, sides in result.recognition.items():
        for side, figures in sides.items():
            accuracy, error = figures["accuracy"], figures["error_mm"]
            shares = [f"{accuracy[touch - 1]:.2f}" if touch <= len(accuracy) else "-" for touch in TOUCHES]
            reached = str(figures["touches_to_95"] or "later")
            table.add_row(name, _TRAINED[side], *shares, reached, "-" if error is None else f"{error:.2f}")
    console.print(table)
