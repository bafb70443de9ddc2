"""Explain the distance between simulation and recording: how much goes with each part of the fit that is put in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactsim.bench.config import merged
from tactsim.bench.pad.recorded_presses import PressesAsRecorded
from tactsim.bench.pad.trained_elsewhere import drop, recognised
from tactsim.bench.trials import Progress
from tactsim.core.checking import checked
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan
from tactsim.hardware.gain_fit import best_gain
from tactsim.hardware.sensor_fit import SensorFit
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import scan_letters

_AGAIN = 400  # bootstrap samples

# What of a world each part of the fit is.
_OF_WORLD: dict[str, tuple[str, ...]] = {
    "gain": ("unit", "press.force", "sensor.response_pressure"),
    "point spread": ("sensor.psf_sigma",),
    "response": ("sensor.response",),
    "noise": ("sensor.noise", "sensor.resolution"),
    "taxel gains": ("sensor.gain_spread",),
    "texture": ("sensor.texture",),
    "stray contacts": ("sensor.random_taxels",),
    "placement": ("placement_mm", "placement_rad"),
    "load": ("load_spread",),
    "tilt, layer and wrist": (
        "placement_tilt", "press.tilt_x", "press.tilt_y", "press.stiffness", "press.wrist_stiffness",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A part of the fit, put in after those before it.

    rms: of what is left of the readings, in the recording's unit. share, low, high: how much of the squares that
    were there at first goes with it, with a 95 % interval by bootstrap over presses.
    """

    name: str
    rms: float
    share: float
    low: float
    high: float


def explained(
    recorded: FloatArray, presses: PressesAsRecorded, fit: SensorFit, rng: np.random.Generator
) -> list[Part]:
    """Put one part of the fit in after the other, and see how much of the distance to readings (n, taxels) goes.

    The last line is what is left, of which noise is the part that no fit can take. Each stage has its own best gain.
    """
    stated, guess = presses.stated, fit.guess
    spread = replace(stated, psf_sigma=guess.psf_sigma)
    outlined = replace(spread, grown=guess.grown)
    level, offset, placed = presses.level, presses.level, presses.level
    offset = offset.copy()
    offset[:, :3] = fit.offset
    placed = placed.copy()
    placed[:, :3] = fit.placement

    def bent(image: FloatArray) -> FloatArray:
        return fit.typical * (np.maximum(image, 0) / fit.typical) ** fit.response

    loads = fit.loads[:, None] ** fit.response
    at_stated, at_spread, at_outlined, at_offset, at_placed, at_last = (
        presses(stated, level), presses(spread, level), presses(outlined, level), presses(outlined, offset),
        presses(outlined, placed), presses(guess, fit.errors),
    )  # fmt: skip
    stages = {
        "gain": at_stated,
        "point spread": at_spread,
        "response": bent(at_spread),
        "outlines": bent(at_outlined),
        "offset of all presses": bent(at_offset),
        "placement": bent(at_placed),
        "load": loads * bent(at_placed),
        "tilt, layer and wrist": loads * bent(at_last),
        "taxel gains": fit.gain_per_taxel * loads * bent(at_last),
    }
    rows = [_squares(recorded, at_stated, 1.0)]
    rows += [_squares(recorded, image, best_gain(recorded, image)) for image in stages.values()]
    squares = np.array(rows)  # (stages + 1, n)
    total = squares.sum(axis=1)
    again = squares[:, rng.integers(squares.shape[1], size=(_AGAIN, squares.shape[1]))].sum(axis=2)
    shares = -np.diff(again, axis=0) / again[0]
    low, high = np.quantile(shares, [0.025, 0.975], axis=1)
    parts = [
        Part(
            name,
            float(np.sqrt(total[k + 1] / recorded.size)),
            float((total[k] - total[k + 1]) / total[0]),
            *ends,
        )
        for k, (name, ends) in enumerate(
            zip(stages, zip(low.tolist(), high.tolist(), strict=True), strict=True)
        )
    ]
    left = again[-1] / again[0]
    ends = np.quantile(left, [0.025, 0.975]).tolist()
    return [*parts, Part("left", parts[-1].rms, float(total[-1] / total[0]), *ends)]


def _squares(recorded: FloatArray, image: FloatArray, gain: float) -> FloatArray:
    return (np.nan_to_num(recorded - gain * image) ** 2).sum(axis=1)


def ablation(
    options: ScanOptions,
    world: Mapping[str, Any],
    recorded: Scan,
    estimator: str,
    settings: Mapping[str, Any],
    trials: int,
    touch: int,
    seed: int,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Train on scans of worlds with one part of the fitted `world` more at a time, and recognise recorded presses.

    Returns for each part the share right after `touch` touches and how much it changes, with a 95 % interval by
    bootstrap over trials, which have the same touches in all worlds.
    """
    rng = np.random.default_rng(seed)
    values = options.model_dump(mode="json", exclude={"seed"})
    values["unit"] = world["unit"]
    rows, before = [], None
    for name, of_world in {"as simulated": (), **_OF_WORLD}.items():
        for path in of_world:
            values = merged(values, _at(path, world))
        scan, _ = scan_letters(checked(ScanOptions, {**values, "seed": seed}, "world"))
        figures, right = recognised(scan, recorded, estimator, settings, trials, seed, progress)
        gained = (0.0, 0.0, 0.0) if before is None else drop(before, right, touch, rng)
        rows.append(
            {
                "with": name,
                "accuracy": figures["accuracy"][touch - 1],
                "touches_to_95": figures["touches_to_95"],
                "gained": gained,
            }
        )
        before = right
    return rows


def _at(path: str, world: Mapping[str, Any]) -> dict[str, Any]:
    """Take one value of a nested world, nested as it was."""
    group, _, name = path.rpartition(".")
    inner = world.get(group, {}) if group else world
    if name not in inner:
        return {}
    return {group: {name: inner[name]}} if group else {name: inner[name]}
