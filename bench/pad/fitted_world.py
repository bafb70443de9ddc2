"""The world of a fitted pad: the options of a scan that reads as the recorded pad does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from tactsim.bench.config import merged
from tactsim.hardware.sensor_fit import SensorFit
from tactsim.press.scan_options import ScanOptions

_FORCE_ALONE = (0.1, 10.0)  # a gain within is an error of the force; one beyond it is another unit
_CURVED = 0.2  # an exponent so far from 1 tells the pressure that a response reads right
_PRESSURES = (np.log(1e-3), np.log(1e6))  # kPa, its bounds
_DIGITS = 5


def fitted_world(options: ScanOptions, fit: SensorFit, unit: str) -> dict[str, Any]:
    """Say how a scan reads as the recorded pad does: a world file, with letters, shapes and pad of the simulation.

    Gain and force cannot be told apart by readings alone. Where the response is bent, its pressure takes both, and the
    force is as stated; else the force takes both. A pressure that is larger by one
    factor everywhere has a larger slope, too: tilts grow with it, or, where the gain is that of another unit, layer
    and wrist. A recorded press is a mean of frames; what the mean leaves of the sensor's resolution is part of the
    fitted noise. A response whose interval includes none is left out. What is
    beyond the bounds of a scan's options is put on the nearest bound: `clipped` names it.
    """
    return merged(stated_world(options, unit), _rounded(ScanOptions, _changes(options, fit)))


def stated_world(options: ScanOptions, unit: str) -> dict[str, Any]:
    """Say in TOML's types how a simulation was made, in another unit: what `fitted_world` changes.

    TOML has no null. So a pad without a seam says `no_seam = true`, a wrist that does not give way is "rigid", and
    what else is None has that as its default.
    """
    left_out = {"seed", "test_poses", "test_load"}
    stated = options.model_dump(mode="json", exclude_defaults=True, exclude_none=True, exclude=left_out)
    stated |= {"letters": list(options.letters), "unit": unit}
    if "shapes" in stated:
        stated["shapes"] = [str(Path(path).resolve()) for path in stated["shapes"]]
    if options.pad.seam is None:
        stated["pad"]["no_seam"] = True
    if options.press.wrist_stiffness is None:
        stated["press"]["wrist_stiffness"] = "rigid"
    return stated


def clipped(options: ScanOptions, fit: SensorFit) -> dict[str, float]:
    """Name what was found beyond the bounds of a scan's options, with what was found."""
    changes = _changes(options, fit)
    said = _rounded(ScanOptions, changes)
    pairs = [(changes, said), *((changes[group], said[group]) for group in ("press", "sensor"))]
    return {
        name: value
        for found, put in pairs
        for name, value in found.items()
        if isinstance(value, float) and put[name] != _round(value)
    }


def _changes(options: ScanOptions, fit: SensorFit) -> dict[str, Any]:
    bent = not fit.response_range[0] <= 1 <= fit.response_range[1]
    gain, pressure = fit.gain, fit.gain * fit.typical
    if bent and abs(fit.response - 1) > _CURVED:
        # gain typical (p / typical)^g is p0 (p / p0)^g with this p0.
        logarithm = np.log(fit.typical) + np.log(gain) / (1 - fit.response)
        if _PRESSURES[0] < logarithm < _PRESSURES[1]:
            gain, pressure = 1.0, float(np.exp(logarithm))
    layer = 1.0
    if not _FORCE_ALONE[0] <= gain <= _FORCE_ALONE[1]:
        least = max(1 / fit.stiffness, 1 / fit.wrist if np.isfinite(fit.wrist) else 0.0)
        most = min(1e6 / fit.stiffness, 1e7 / fit.wrist if np.isfinite(fit.wrist) else np.inf)
        layer = float(np.clip(gain, least, most))
    tilt = gain / layer
    tilt_x, tilt_y = (tilt * fit.tilt_offset).tolist()
    # What a response that is left out did to what presses and taxels differ by.
    bend = 1.0 if bent else fit.response
    return {
        "placement_mm": fit.placement_mm,
        "placement_rad": fit.placement_rad,
        "placement_tilt": tilt * fit.placement_tilt,
        "load_spread": bend * fit.load_spread,
        "press": {
            "force": options.press.force * gain,
            "stiffness": layer * fit.stiffness,
            "wrist_stiffness": layer * fit.wrist if np.isfinite(fit.wrist) else "rigid",
            "tilt_x": tilt_x,
            "tilt_y": tilt_y,
        },
        "sensor": {
            "psf_sigma": fit.psf_sigma,
            "response": fit.response if bent else 1.0,
            "response_pressure": pressure,
            "noise": fit.noise,
            "gain_spread": bend * fit.gain_spread,
            "texture": bend * fit.texture,
            "random_taxels": fit.stray,
            "resolution": 0.0,
        },
    }


def _rounded(model: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """Round all values, and put them on the nearest bounds of the model's options."""
    rounded = dict(changes)
    for name, value in changes.items():
        if isinstance(value, dict):
            rounded[name] = _rounded(model.model_fields[name].annotation, value)
        elif isinstance(value, float):
            rounded[name] = _within(model, name, value)
    return rounded


def _within(model: type[BaseModel], name: str, value: float) -> float:
    schema = model.model_json_schema()["properties"][name]
    bounds = next(kind for kind in (schema, *schema.get("anyOf", ())) if kind.get("type") == "number")
    return float(np.clip(_round(value), bounds.get("minimum", -np.inf), bounds.get("maximum", np.inf)))


def _round(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
