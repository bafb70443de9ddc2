"""Hands: several pads that touch at once, each along its own normal, and the file that describes them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tactsim import models
from tactsim.core.checking import Settings, checked
from tactsim.core.documents import read_toml
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.core.rigid import checked_poses, compose, matrix
from tactsim.solids.options import SpaceOptions
from tactsim.solids.pad_lattice import pad_lattice
from tactsim.solids.press import SpacePress, Touched, advanced, misplaced

_APART = 0.5  # mm that pads of one hand keep from each other


class HandPad(Settings):
    """One pad of a hand."""

    pose: tuple[float, float, float, float, float, float, float] = Field(
        description="[x, y, z, qw, qx, qy, qz] of the pad in the hand's frame, mm, where its stroke begins"
    )
    stroke: float = Field(60.0, gt=0, le=1000, description="mm that the pad goes along its normal at most")

    @model_validator(mode="after")
    def _turned(self) -> HandPad:
        try:
            checked_poses(self.pose, "pose")
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class Hand(Settings):
    """A hand of two to five pads, all of one kind: an estimator learns how one pad feels an object."""

    name: str = Field("hand", min_length=1, max_length=100)
    body: Literal["flat", "cylinder", "sphere"] = Field("flat", description="what every pad is laid on")
    radius: float | None = Field(None, gt=0, le=1e6, description="mm of the cylinders or spheres")
    pads: tuple[HandPad, ...] = Field(min_length=2, max_length=5)

    @classmethod
    def load(cls, path: str | Path) -> Hand:
        """Read a hand from a TOML file. Raises InputError if it cannot be read or a value is wrong."""
        return checked(cls, read_toml(path, "hand"), f"hand {path}")

    def options(self, options: SpaceOptions) -> SpaceOptions:
        """Give the options with the hand's pads: with them a scan teaches what such a pad feels.

        Raises InputError if a radius is missing or given for flat pads.
        """
        values = options.model_dump() | {"body": self.body, "radius": self.radius}
        return checked(SpaceOptions, values, f"hand {self.name}")


class HandPress:
    """A hand that touches objects: all pads close at once, each along its z axis until it carries the force.

    A pad that carries the force, ends its stroke or would run into another pad of the hand stops; the others go on. The
    hand is stiff: where it is off its stated pose, all its pads are.
    Raises InputError if two pads overlap where their strokes begin, or a pad does not fit its body.
    """

    def __init__(self, solids: Iterable[models.Solid], hand: Hand, options: SpaceOptions) -> None:
        self.hand, self.options = hand, hand.options(options)
        self.press = SpacePress(solids, self.options)
        self._pads = checked_poses([pad.pose for pad in hand.pads], "pads")
        self._strokes = np.array([pad.stroke for pad in hand.pads])
        lattice = pad_lattice(self.options)
        x_low, x_high, y_low, y_high = options.pad.load_bounds
        back = float(np.nanmin(lattice.points.surface)) - options.thickness
        self._box = np.array([[x_low, y_low, back], [x_high, y_high, 0.0]])
        for first, second in combinations(range(len(self._pads)), 2):
            if _overlap(self._pads[[first]], self._pads[[second]], self._box, 0.0)[0]:
                raise InputError(
                    f"hand {hand.name}: pads {first + 1} and {second + 1} overlap where their strokes begin; "
                    "move them apart"
                )

    def touch(self, label: str, start: FloatArray, rng: np.random.Generator | None = None) -> Touched:
        """Touch an object with all pads from a stated start (7,), hand_in_object: one touch for each pad.

        rng: draws how far the true start is off the stated one; without it it is not.
        Raises InputError if there is no such object or the start is no pose.
        """
        start = checked_poses(start, "start")
        if start.shape != (7,):
            raise InputError(f"start has shape {start.shape}; it is one pose, (7,)")
        true = start if rng is None else misplaced(start, self.options, rng)
        stated, true = compose(start, self._pads), compose(true, self._pads)
        touched = self.press.touch_from(label, stated, true, self._strokes)
        stops = self._stops(touched.travel)
        return (
            touched
            if (stops == touched.travel).all()
            else self.press.touch_from(label, stated, true, np.minimum(stops, self._strokes))
        )

    def sensed(self, touched: Touched, rng: np.random.Generator) -> Touched:
        """Give the touches with what the pads report of them; see `SpacePress.sensed`."""
        return self.press.sensed(touched, rng)

    def _stops(self, travel: FloatArray) -> FloatArray:
        """Tell how far pads go (pads,) mm that would go `travel` if no other were in the way: all at one speed."""
        stops = travel.copy()
        times = np.arange(min(0.0, float(travel.min())), float(travel.max()) + _APART, _APART / 2)
        while True:
            met = []
            for first, second in combinations(range(len(stops)), 2):
                one, other = (
                    advanced(np.repeat(self._pads[[pad]], len(times), 0), np.minimum(times, stops[pad]))
                    for pad in (first, second)
                )
                moving = (times < stops[first]) | (times < stops[second])
                at = np.flatnonzero(_overlap(one, other, self._box, _APART) & moving)
                if len(at):
                    met.append((times[at[0]], first, second))
            if not met:
                return stops
            time, first, second = min(met)
            stops[[first, second]] = np.minimum(stops[[first, second]], time)


def _overlap(first: FloatArray, second: FloatArray, box: FloatArray, apart: float) -> NDArray[np.bool_]:
    """Tell of n pairs of equal boxes (2, 3) mm at poses (n, 7) each whether they are less than `apart` mm apart: (n,).

    Two boxes are apart if they are along a normal of a side of one, or across an edge of both (Gottschalk et al. 1996).
    """
    turn_a, turn_b = matrix(first[:, 3:]), matrix(second[:, 3:])
    middle, half = box.mean(axis=0), (box[1] - box[0]) / 2
    between = (second[:, :3] + turn_b @ middle) - (first[:, :3] + turn_a @ middle)
    edges_a, edges_b = np.swapaxes(turn_a, 1, 2), np.swapaxes(turn_b, 1, 2)
    across = np.cross(edges_a[:, :, None], edges_b[:, None]).reshape(-1, 9, 3)
    length = np.linalg.norm(across, axis=2, keepdims=True)
    across = np.divide(across, length, out=np.zeros_like(across), where=length > 1e-9)
    axes = np.concatenate([edges_a, edges_b, across], axis=1)
    reach = np.abs(axes @ turn_a) @ half + np.abs(axes @ turn_b) @ half
    gaps = np.abs(np.einsum("nai,ni->na", axes, between)) - reach
    gaps[:, 6:][length[..., 0] <= 1e-9] = -np.inf  # edges that are parallel
    return np.asarray(gaps.max(axis=1) < apart)
