"""The simulated pad as a source of readings: a letter that lies still on it, with the noise of every reading.

The emulated pad of `bench emulate` is pressed by the same functions.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tactsim import models
from tactsim.core.counters import Counters
from tactsim.core.errors import InputError
from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.source import HasPad, Log, Source, SourceError
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_options import ScanOptions
from tactsim.press.sensor import EFFECTS, Frames, GainSpread, Resolution, gains, sense, take
from tactsim.press.touches import as_pressed

_RATE = 100.0  # readings a second


class SimulatedPad(Source):
    """A pad that gives 100 readings a second of what `feel` says; a subclass says who presses it.

    feel(now): the pressures (taxels,) kPa at a time, s since the first reading.
    """

    def __init__(self, device: HasPad, feel: Callable[[float], FloatArray]) -> None:
        self.pad, self.taxel_xy, self.counters = device.pad, device.pad.taxel_xy, Counters()
        self._feel = feel
        self._closed = False
        self._begun: float | None = None  # when the first reading was given

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading when it is due; see `Source.read`."""
        if self._closed:
            raise SourceError("the simulated pad was closed")
        index = self.counters.readings
        self._begun = time.monotonic() if self._begun is None else self._begun
        time.sleep(max(0.0, self._begun + index / _RATE - time.monotonic()))
        self.counters.readings += 1
        return Reading(self._feel(index / _RATE), time.monotonic(), index / _RATE, index)

    def close(self) -> None:
        """Stop giving readings."""
        self._closed = True


class SimulatedSource(SimulatedPad):
    """Readings of a letter that lies still on the simulated pad."""

    def __init__(self, letter: str, pose: str, device: HasPad, seed: int = 0) -> None:
        """Press `letter` at `pose`, written x,y,theta in mm and rad, on the device's pad.

        Raises InputError for an unknown letter or a bad pose.
        """
        rng = np.random.default_rng(seed)
        options = on_pad_of(device, ScanOptions())
        table = press_table(letter, parse_pose(pose)[None], options, rng)
        super().__init__(device, sensing(lambda now: table[0], options, rng))


def open_source(places: Sequence[str], device: HasPad, log: Log | None) -> Source:
    """Press a letter that lies still on the simulated pad: simulated:LETTER@x,y,theta."""
    if len(places) != 1:
        raise SourceError(f"the simulated pad is one source; {len(places)} were given")
    letter, _, pose = places[0].partition("@")
    return SimulatedSource(letter or "A", pose or "0,0,0", device)


def press_table(
    pressed: str | models.Letter, poses: FloatArray, options: ScanOptions, rng: np.random.Generator
) -> FloatArray:
    """Press a letter at `poses` (n, 3) sensor_in_object, each off by the options' placement error, tilt and load.

    Returns (n, taxels) kPa without the sensor's imperfections. Raises InputError for an unknown letter, and
    if a press does not come to rest.
    """
    return rising_table(pressed, poses, options, rng, (1.0,))[:, 0]


def rising_table(
    pressed: str | models.Letter,
    poses: FloatArray,
    options: ScanOptions,
    rng: np.random.Generator,
    shares: Sequence[float],
) -> FloatArray:
    """Press as `press_table` does, each press at shares of its load: (n, shares, taxels) kPa.

    Where a press goes and how it tilts is the same at all of them. So a light press may touch on one side only.
    """
    letter = models.letter(pressed) if isinstance(pressed, str) else pressed
    touches = as_pressed(letter, poses, "train", options, lambda purpose: rng)
    whole = touches.forces(1.0)
    levels = [ideal_readings(replace(touches, load=share * whole), options)[0] for share in shares]
    number = np.tile(np.arange(1, len(shares) + 1), (len(poses), 1))
    at = Frames(np.ones(options.pad.taxels), options.pad.rows, number, one_touch=True)
    of_touch = [effect for effect in EFFECTS if effect.facts.of_touch or effect is GainSpread]
    return take(np.stack(levels, axis=1), options.sensor, at, [rng] * len(poses), of_touch)


def sensing(
    pressures: Callable[[float], FloatArray], options: ScanOptions, rng: np.random.Generator
) -> Callable[[float], FloatArray]:
    """Add the taxels' gains, noise and faults to the pressures (taxels,) kPa at a time, s; drawn anew each call.

    The device's own steps come with its codec, so the sensor's resolution is left out; so are effects that need the
    readings before, and those of a touch, which are the press's (`rising_table`).
    """
    sensor = options.sensor.without(
        effect
        for effect in EFFECTS
        if effect.facts.remembers or effect.facts.of_touch or effect is Resolution
    )
    gain = gains(options)
    return lambda now: sense(pressures(now)[None], sensor, gain, rng, rows=options.pad.rows)[0]


def parse_pose(text: str) -> FloatArray:
    """Read a pose written as `x,y,theta` in mm and rad. Raises InputError."""
    try:
        pose = np.array([float(word) for word in text.split(",")])
    except ValueError:
        pose = np.zeros(0)
    if pose.shape != (3,) or not (np.abs(pose) <= LARGEST).all():
        raise InputError(f"a pose is written x,y,theta in mm and rad, like 3.4,-3.4,0.52, not {text!r}")
    return pose


def on_pad_of(device: HasPad, options: ScanOptions) -> ScanOptions:
    """Press on the device's pad instead of the options' own."""
    return options.model_copy(update={"pad": device.pad})
