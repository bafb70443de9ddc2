"""A robot that presses an emulated pad by a plan, recorded to a file faster than it would take in truth."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from tactsim.core.checking import checked
from tactsim.core.files import replacing
from tactsim.core.poses import FloatArray
from tactsim.hardware.emulator.emulated import Emulated, Pressures
from tactsim.hardware.emulator.faults import Faults
from tactsim.hardware.scans import Interval, PlacedPress, named_rows


def read_plan(path: str | Path) -> list[PlacedPress]:
    """Read a plan: CSV with the columns label, split, x_mm, y_mm, theta_rad or theta_deg.

    Raises InputError with the wrong line.
    """
    return [checked(PlacedPress, row, place) for place, row in named_rows(path, "presses", PlacedPress)]


# Shares of its load at which it is known what a press feels on its way; in between it is interpolated.
SHARES = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Timing:
    """How long a robot takes, s: it lifts, presses harder for `ramp`, holds, and lets go for `ramp`.

    The load rises and falls evenly.
    """

    hold: float = 2.0
    lift: float = 0.5
    ramp: float = 0.1

    @property
    def period(self) -> float:
        """Give the time from one press to the next."""
        return self.lift + 2 * self.ramp + self.hold

    def intervals(self, plan: Sequence[PlacedPress]) -> list[Interval]:
        """Say when each press of the plan holds its full load."""
        begins = self.period * np.arange(len(plan)) + self.lift + self.ramp
        return [
            Interval(
                **press.model_dump(),
                first_s=round(float(begin), 6),
                last_s=round(float(begin) + self.hold, 6),
            )
            for press, begin in zip(plan, begins, strict=True)
        ]

    def pressing(self, table: FloatArray) -> Pressures:
        """Press in turn, once. table: (n, shares, taxels) kPa, what a press feels at the SHARES of its load."""
        nothing, at = np.zeros(table.shape[2]), (0.0, *SHARES)

        def pressures(now: float) -> FloatArray:
            turn, since = divmod(now, self.period)
            if since <= self.lift or turn >= len(table):
                return nothing
            level = min((since - self.lift) / self.ramp, (self.period - since) / self.ramp, 1.0)
            above = int(np.searchsorted(SHARES, level)) + 1
            felt = [nothing, *table[int(turn)]]
            part = (level - at[above - 1]) / (at[above] - at[above - 1])
            return (1 - part) * felt[above - 1] + part * felt[above]

        return pressures


def write_marks(intervals: Sequence[Interval], path: str | Path) -> None:
    """Write a marks file, which `read_intervals` reads. Whole or not at all."""
    text = StringIO()
    writer = csv.DictWriter(text, list(Interval.model_fields), lineterminator="\n")
    writer.writeheader()
    writer.writerows(interval.model_dump() for interval in intervals)
    with replacing(path) as stream:
        stream.write(text.getvalue().encode())


def record(
    device: Emulated,
    seconds: float,
    received: Callable[[bytes, float], object],
    faults: Faults | None = None,
    rng: np.random.Generator | None = None,
) -> None:
    """Give `received` all bytes that the device sends in `seconds`, with the time of each, without waiting for them.

    A device that waits for its start or for requests says nothing. faults: spoil the bytes, with `rng`.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    for now in np.arange(0.0, seconds, 1 / device.rate).tolist():
        for message in device.say(now):
            received(message if faults is None else faults.spoil(message, rng), now)
