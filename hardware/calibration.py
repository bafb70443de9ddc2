"""Correct a pad's readings: tare, gains, taxels that are dead, stuck or always loaded; and sum them to a force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, Field, model_validator

from tactsim.core.checking import checked
from tactsim.core.documents import read_toml
from tactsim.core.errors import InputError
from tactsim.core.files import write_bytes
from tactsim.core.pad import Pad, pitch
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.hardware.codecs.codec import STRICT
from tactsim.hardware.device import Device

LEAST_FRAMES = 40
_MOVED = 5.0  # noise standard deviations by which the two halves of a tare may differ
# At most this share of the taxels may be loaded on a pad that nothing touches, and at most so many side by side.
_LOADED, _BESIDE = 0.06, 2
_FAINT = 0.05  # share of the typical taxel's answer below which a taxel is dead


class Calibration(BaseModel):
    """What corrects one device's readings: the content of a calibration file (TOML).

    corrected = (pressure - tare) * gain, kPa, for every taxel that is not dead, stuck or always loaded.
    """

    model_config = STRICT

    device: str = Field(max_length=200, description="name in the device file")
    port: str = Field(max_length=1000, description="where the device was read")
    taken: datetime
    read_by: str = Field(
        "", max_length=64, description="the digest `Device.read_by` of its codec and wiring; none: not known"
    )
    frames: int = Field(ge=0, description="frames that the tare is the median of")
    tare: tuple[float, ...] = Field(min_length=1, max_length=40_000, description="kPa of each taxel unloaded")
    noise: tuple[float, ...] = Field(max_length=40_000, description="kPa, sd of each taxel unloaded")
    gain: tuple[float, ...] = Field(max_length=40_000)
    dead: tuple[int, ...] = Field((), description="taxels that do not answer to a load")
    stuck: tuple[int, ...] = Field((), description="taxels that always say the same")
    loaded: tuple[int, ...] = Field((), description="taxels that feel a load while nothing touches the pad")

    @model_validator(mode="after")
    def _whole(self) -> Calibration:
        for name in ("noise", "gain"):
            if len(getattr(self, name)) != len(self.tare):
                raise ValueError(f"{name} has {len(getattr(self, name))} values, tare has {len(self.tare)}")
        for name in ("dead", "stuck", "loaded"):
            if any(not 0 <= taxel < len(self.tare) for taxel in getattr(self, name)):
                raise ValueError(f"{name} names a taxel that the pad of {len(self.tare)} does not have")
        if not self.kept.any():
            raise ValueError("every taxel is dead or stuck or always loaded")
        return self

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Tell which taxels are read, (taxels,)."""
        kept = np.ones(len(self.tare), dtype=bool)
        kept[list(self.dead + self.stuck + self.loaded)] = False
        return kept

    def save(self, path: str | Path) -> None:
        """Write the calibration as TOML, whole or not at all. Raises InputError if it cannot."""
        import tomli_w

        write_bytes(path, tomli_w.dumps(self.model_dump()).encode())

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a calibration file. Raises InputError with the first value that is wrong."""
        table = read_toml(path, "calibration")
        if "tare" not in table and table.keys() & {"codec", "pad", "part"}:
            raise InputError(
                f"{path} is a device file, and no calibration: give it with --device, or take a tare of it"
            )
        return checked(cls, table, f"calibration {path}")


class Correction:
    """Apply a calibration to readings of the pad that it was taken on.

    taxel_xy: (kept, 2) mm, where the taxels lie that are left. Raises InputError if the pad has another
    number of taxels than the calibration.
    """

    def __init__(self, calibration: Calibration, pad: Pad) -> None:
        if len(calibration.tare) != pad.taxels:
            raise InputError(
                f"the calibration of {calibration.device!r} has {len(calibration.tare)} taxels, the pad has "
                f"{pad.taxels}; take one with `bench tare`"
            )
        kept = calibration.kept
        self._kept = slice(None) if kept.all() else kept
        self._tare, self._gain = np.array(calibration.tare), np.array(calibration.gain)
        self.taxel_xy = pad.taxel_xy[self._kept]

    def whole(self, pressures: FloatArray) -> FloatArray:
        """Correct the pressures (..., taxels) kPa of all taxels, including those left out."""
        return (pressures - self._tare) * self._gain

    def apply(self, reading: Reading) -> Reading:
        """Correct one reading; dead, stuck and always loaded taxels are left out."""
        return replace(reading, pressures=self.whole(reading.pressures)[self._kept])


def take_tare(readings: Sequence[Reading], device: Device, port: str) -> Calibration:
    """Take the median of unloaded readings as each taxel's zero, and mask taxels that are stuck or always loaded.

    A taxel further from zero than the device file's `largest_offset_kpa` is always loaded if it is at rest and such
    taxels are few and stand apart: at most 6 % of the taxels, and no more than two side by side.

    Raises InputError for fewer than 40 readings, and if something touches the pad: a taxel that
    moves beyond its noise while the tare is taken, or more taxels far from zero than those.
    """
    if len(readings) < LEAST_FRAMES:
        raise InputError(f"a tare takes at least {LEAST_FRAMES} frames, not {len(readings)}")
    values = np.array([reading.pressures for reading in readings])
    tare = np.median(values, axis=0)
    noise = values.std(axis=0, ddof=1)
    stuck = find_stuck(values)
    free = np.setdiff1d(np.arange(values.shape[1]), stuck)
    if not len(free):
        raise InputError("every taxel of the pad says the same all the time: is it connected?")
    far = free[tare[free] > device.largest_offset_kpa]  # a zero that has fallen is none that is touched
    if len(far) > _LOADED * values.shape[1] or _most_beside(device.pad.taxel_xy, far) > _BESIDE:
        worst = far[np.argmax(tare[far])]
        raise InputError(
            f"something touches the pad: taxel {device.called(worst)} reads {tare[worst]:.1f} kPa; take everything "
            f"off, or raise largest_offset_kpa ({device.largest_offset_kpa:g}) in the device file if nothing is there"
        )
    # Noise is taken from one frame to the next: a slow movement would otherwise count as noise and hide itself.
    jitter = np.sqrt((np.diff(values, axis=0) ** 2).mean(axis=0) / 2)
    half = len(values) // 2
    moved = np.abs(values[:half].mean(axis=0) - values[-half:].mean(axis=0))
    # A taxel may be quiet by chance, as values come in steps; the typical taxel's noise is the least assumed.
    typical = float(np.median(jitter[free]))
    allowed = np.maximum(_MOVED * np.maximum(jitter, typical) * np.sqrt(2 / half), _smallest_step(values))
    leap = max(device.largest_offset_kpa, 2 * _MOVED * typical)
    moving = free[((moved > allowed) | (np.ptp(values, axis=0) > leap))[free]]
    if len(moving):
        worst = moving[np.argmax(moved[moving])]
        raise InputError(
            f"something moves on the pad: taxel {device.called(worst)} went by {np.ptp(values[:, worst]):.1f} kPa "
            "during the tare; take everything off and wait until it is at rest"
        )
    return Calibration(
        device=device.name, port=port, taken=datetime.now(UTC).replace(microsecond=0),
        read_by=device.read_by(), frames=len(values), tare=tuple(tare.tolist()), noise=tuple(noise.tolist()),
        gain=(1.0,) * values.shape[1], stuck=tuple(stuck.tolist()), loaded=tuple(far.tolist()),
    )  # fmt: skip


def with_gain(
    calibration: Calibration, readings: Sequence[Reading], pressure: float | None = None
) -> Calibration:
    """Fit each taxel's gain from readings under an even load, and mask taxels that are dead.

    readings: uncorrected. pressure: kPa of the load; None makes the taxels agree with their median.
    Raises InputError for fewer than 40 readings or a load that hardly any taxel feels.
    """
    if len(readings) < LEAST_FRAMES:
        raise InputError(f"gains take at least {LEAST_FRAMES} frames, not {len(readings)}")
    values = np.array([reading.pressures for reading in readings])
    answer = np.median(values, axis=0) - np.array(calibration.tare)
    masked = calibration.stuck + calibration.loaded
    dead = find_dead(answer[None], skip=masked)
    alive = np.setdiff1d(np.arange(len(answer)), [*dead, *masked])
    typical = float(np.median(answer[alive])) if len(alive) else 0.0
    if not typical > 5 * float(np.median(calibration.noise)):
        raise InputError(f"the load reads {typical:.1f} kPa, hardly more than the noise; load the pad evenly")
    gain = np.ones(len(answer))
    gain[alive] = (typical if pressure is None else pressure) / answer[alive]
    return calibration.model_copy(update={"gain": tuple(gain.tolist()), "dead": tuple(dead.tolist())})


def find_stuck(values: FloatArray) -> NDArray[np.int64]:
    """Find taxels that never change while the others do: values (frames, taxels), any unit.

    A taxel's noise can be smaller than its steps, so a constant one is stuck only if the typical
    taxel changes by half a step or more, which makes 40 equal values next to impossible.
    """
    restless = float(np.median(values.std(axis=0))) >= _smallest_step(values) / 2 > 0
    return np.flatnonzero(np.ptp(values, axis=0) == 0) if restless else np.zeros(0, dtype=np.int64)


def _most_beside(taxel_xy: FloatArray, chosen: NDArray[np.intp]) -> int:
    """Count the taxels of the largest group of chosen ones in which each has a neighbour, straight or diagonal."""
    from scipy.sparse.csgraph import connected_components  # imported here: only a tare needs it

    apart = np.hypot(*(taxel_xy[chosen][:, None] - taxel_xy[chosen]).T)
    _, group = connected_components(apart <= 1.6 * pitch(taxel_xy), directed=False)
    return int(np.bincount(group).max(initial=0))


def find_dead(values: ArrayLike, skip: Sequence[int] = ()) -> NDArray[np.int64]:
    """Find taxels that no load reaches: values (readings, taxels), tared, where every taxel is pressed.

    A taxel is dead whose largest value stays below 5 % of the typical taxel's largest.
    """
    largest = np.max(np.asarray(values, dtype=float), axis=0)
    others = np.setdiff1d(np.arange(len(largest)), skip)
    typical = float(np.median(largest[others])) if len(others) else 0.0
    return others[largest[others] < _FAINT * typical] if typical > 0 else np.zeros(0, dtype=np.int64)


def force(pressures: ArrayLike, pad: Pad) -> FloatArray:
    """Sum pressures (..., taxels) kPa over the taxels' areas: N. Load between taxels is not felt."""
    area = pad.taxel_width * pad.taxel_height  # mm^2
    return np.asarray(pressures, dtype=float).sum(axis=-1) * area * 1e-3  # kPa mm^2 = 1e-3 N


def _smallest_step(values: FloatArray) -> float:
    """Find the smallest difference between two values of one taxel: the device's resolution."""
    steps = np.diff(np.sort(values, axis=0), axis=0)
    steps = steps[steps > 1e-12]
    return float(steps.min()) if len(steps) else 0.0
