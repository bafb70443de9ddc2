"""What every engine is asked and what it answers: `Touches`, where a letter is pressed, and `Pressed`, how it rests."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray, compose
from tactsim.models.letter import Letter

if TYPE_CHECKING:
    from tactsim.press.scan_options import ScanOptions

# rad, 20 degrees: what tilts further has tipped over; `facet_kernels.STEEPEST`, held by a test
MOST_TILT = 0.35
TIPPED = "it tips over; the wrist is too soft for the force, or the contact too far from the pad's middle"


class UnsettledError(InputError):
    """A press does not come to rest; it has no reading."""


class Normals(Protocol):
    """What draws normal numbers: a generator, or numbers that were drawn before."""

    def standard_normal(self, size: int | tuple[int, ...]) -> FloatArray:
        """Give normal numbers of this shape."""


@dataclass(frozen=True, eq=False)
class Touches:
    """A letter and the ways in which it is pressed.

    poses: (n, 3) sensor_in_object [mm, mm, rad]. tilts: (n, 2) rad about the pad's x and y, between letter
    and pad before the wrist gives way; +tilt_x brings the side at +y closer, +tilt_y the side at -x.
    load: (n,) the force of each as a share of the options' `press.force`; None: all press with that force.
    """

    letter: Letter
    poses: FloatArray
    tilts: FloatArray
    load: FloatArray | None = None

    @classmethod
    def of(cls, letter: Letter, poses: FloatArray, tilt: tuple[float, float] = (0.0, 0.0)) -> Touches:
        """Press `letter` at `poses` with the same tilt (rad about x and y) every time."""
        return cls(letter, poses, np.tile(np.array(tilt, dtype=float), (len(poses), 1)))

    def some(self, which: slice) -> Touches:
        """Take some of the presses."""
        load = None if self.load is None else self.load[which]
        return Touches(self.letter, self.poses[which], self.tilts[which], load)

    def forces(self, nominal: float) -> FloatArray:
        """Give the force of each press (n,), N, if that of the options is `nominal` N."""
        return np.full(len(self), nominal) if self.load is None else nominal * self.load

    def __len__(self) -> int:
        return len(self.poses)


def as_pressed(
    letter: Letter, stated: FloatArray, split: str, options: ScanOptions, draw: Callable[[str], Normals]
) -> Touches:
    """Say how a letter is truly pressed at stated poses (n, 3) sensor_in_object: misplaced, tilted, with what load.

    draw(purpose): what draws for one purpose ("placement", "tilt" or "load"), so that no error depends on whether
    another is switched on.
    """
    true, tilts = stated, np.tile((options.press.tilt_x, options.press.tilt_y), (len(stated), 1))
    spread = (options.placement_mm, options.placement_mm, options.placement_rad)
    if any(spread):
        true = compose(stated, draw("placement").standard_normal(stated.shape) * spread)
    if options.placement_tilt:
        tilts = tilts + draw("tilt").standard_normal(tilts.shape) * options.placement_tilt
    # The loads of the test presses are `test_load` times as large as those of the training presses.
    share, load = options.test_load if split == "test" else 1.0, None
    if options.load_spread:
        load = share * draw_loads(len(stated), options.load_spread, draw("load"))
    elif share != 1:
        load = np.full(len(stated), share)
    return Touches(letter, true, tilts, load=load)


class Load(Protocol):
    """Pressure on the pad, of many presses."""

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the pressure over the taxels: (n, taxels) kPa without imperfections."""
        ...


@dataclass(frozen=True, eq=False)
class Pressed:
    """A letter pressed until it rests.

    load: the pressure on the pad; none where nothing touches and in a blank. work: `presses`, those that an
    engine worked out, and what was skipped by reason. blanks: {press: why it does not come to rest}.
    """

    touches: Touches
    load: Load
    work: Counter[str]
    blanks: dict[int, str] = field(default_factory=dict)

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the pressure over the taxels: (n, taxels) kPa without imperfections, 0 in a blank.

        `options` may differ from those of the press in the sensor's alone, and not in whether its point
        spread is 0, which the bed's cells depend on.
        """
        return self.load.readings(options)

    def settled(self) -> Pressed:
        """Return this if every press came to rest.

        Raises UnsettledError that names the letter and the first pose which did not.
        """
        for press, reason in self.blanks.items():
            raise unsettled(self.touches.letter.name, self.touches.poses[press], reason)
        return self


def unsettled(name: str, pose: FloatArray, reason: str) -> UnsettledError:
    """Name the press that did not come to rest."""
    x, y, angle = pose
    return UnsettledError(
        f"letter {name!r} pressed at x = {x:g} mm, y = {y:g} mm, {angle:g} rad does not settle: {reason}"
    )


def draw_loads(count: int, spread: float, rng: Normals) -> FloatArray:
    """Draw the loads (count,) of presses as shares of the set force: log-normal, with mean 1 and deviation `spread`.

    A log-normal load is above 0 whatever the spread.
    """
    return np.exp(log_spread(spread) * rng.standard_normal(count) - math.log1p(spread**2) / 2)


def log_spread(spread: float) -> float:
    """Give the standard deviation of the log of a log-normal load with mean 1 and deviation `spread`."""
    return math.sqrt(math.log1p(spread**2))
