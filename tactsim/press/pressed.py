"""What an engine gives: the pressure that a letter puts on the pad, and what the taxels feel of it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.press.bed import Bed
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scene import UnsettledError
from tactsim.press.spread import contact_map
from tactsim.press.touches import Touches


class Load(Protocol):
    """Pressure on the pad, of many presses."""

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the pressure over the taxels: (n, taxels) kPa without imperfections."""
        ...


@dataclass(frozen=True, eq=False)
class Patches:
    """Pressure on the covered parts of the pad's cells.

    bed: the parts. pressure: (contacts,) N/mm^2 at the centres of their cells. gradient: (contacts, 2)
    N/mm^3 along the pad's x and y, None where the pressure is even within a cell.
    """

    bed: Bed
    pressure: FloatArray
    gradient: FloatArray | None = None

    @property
    def forces(self) -> FloatArray:
        """Integrate over each part: (contacts,) N."""
        forces = self.pressure * self.bed.area
        if self.gradient is not None:
            forces += np.einsum("ci,ic->c", self.gradient, self.bed.moments[1:3])
        return forces

    def readings(self, options: ScanOptions) -> FloatArray:
        """Spread the pressure over the taxels: (n, taxels) kPa without imperfections."""
        press, sigma = options.press, options.sensor.psf_sigma
        return contact_map(self.bed, self.pressure, self.gradient, options.pad, press.cells_per_taxel, sigma)


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
