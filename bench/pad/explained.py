"""Explain the distance between simulation and recording: how much goes with each part of the fit that is put in."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactsim.bench.pad.recorded_presses import PressesAsRecorded
from tactsim.core.poses import FloatArray
from tactsim.hardware.gain_fit import best_gain
from tactsim.hardware.sensor_fit import SensorFit

_AGAIN = 400  # bootstrap samples


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
