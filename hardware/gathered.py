"""Presses of recordings put together: their readings, their moments, and the taxels that none of them can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.moments import shares_of
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan, check_pose_units
from tactsim.hardware.following import Follower

Moments = int | Literal["auto", "found"]


@dataclass
class Gathered:
    """Collects the presses of recordings, their moments, and the taxels that are wrong in one of them.

    moments: how many of each training press are wanted, "auto", or "found": auto, and none where no press shows a rise.
    at_load: the share of their load at which test presses are taken.
    """

    pad: Pad
    taxel_xy: FloatArray
    moments: Moments | None = None
    at_load: float = 1.0
    readings: list[FloatArray] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    split: list[str] = field(default_factory=list)
    press: list[int] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    wrong: dict[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 < self.at_load <= 1:
            raise InputError(
                f"test presses are asked for at {self.at_load:g} of their load; give a share above 0, at most 1"
            )
        self.automatic = self.moments in ("auto", "found")
        count = "auto" if self.moments == "found" else self.moments
        self.of_training = np.ones(1) if count is None else shares_of(count)

    @property
    def shares(self) -> FloatArray | None:
        """Give the shares of the load at which images are wanted; None if that is the whole load alone."""
        wanted = np.union1d(self.of_training, self.at_load)
        return None if wanted[0] == 1 else wanted

    def add(
        self,
        readings: FloatArray,
        presses: Sequence[tuple[str, str, tuple[float, float, float]]],
        follower: Follower,
    ) -> None:
        """Add presses (label, split, pose) with their readings (n, taxels) and what was found on the way.

        A test press that does not show the share of its load that is asked for is left out.
        """
        shares, whole = self.shares, self.at_load == 1
        taken = {"train": self.of_training, "test": np.array([self.at_load])}
        if self.moments == "found" and not self._shows_a_rise(follower):
            taken = {} if whole else {"test": taken["test"]}
        for number, (label, split, pose) in enumerate(presses):
            moments = []
            if shares is not None and split in taken and number in follower.moments:
                found, images = follower.moments[number]
                chosen = found & np.isin(shares, taken[split])
                moments = list(zip(shares[chosen].tolist(), images[chosen], strict=True))
            elif split == "train" or whole:
                moments = [(1.0, readings[number])]
            first = self.press[-1] + 1 if self.press else 0
            for share, image in moments:
                self.readings.append(image)
                self.poses.append(pose)
                self.labels.append(label)
                self.split.append(split)
                self.press.append(first)
                self.share.append(share)
        if presses:
            self.wrong |= follower.wrong_taxels(readings)[0]

    def scan(self, meta: dict[str, Any]) -> Scan:
        """Make the scan, without the taxels that are wrong."""
        kept = np.setdiff1d(np.arange(len(self.taxel_xy)), list(self.wrong))
        if not len(kept):
            raise InputError(
                "every taxel is stuck or always loaded in one of the recordings; nothing is left to read"
            )
        share, chosen = np.array(self.share), np.ones(len(self.share), dtype=bool)
        if self.wrong:
            of_pad = [int(np.abs(self.pad.taxel_xy - xy).sum(axis=1).argmin()) for xy in self.taxel_xy]
            meta = {**meta, "left_out": {str(of_pad[taxel]): why for taxel, why in self.wrong.items()}}
        training = np.array(self.split) == "train"
        if self.moments is not None:
            chosen = self._seldom_left_out(share, training)
            lower = chosen & training & (share < 1)
            if lower.any():
                meta = {
                    **meta,
                    "moments": {
                        "shares": sorted(set(share[chosen & training].tolist())), "of": "felt", "split": "train",
                        "presses": len(set(np.array(self.press)[lower].tolist())),
                    },
                }  # fmt: skip
            elif self.moments != "found":
                raise InputError(
                    "no press of the recording shows a plateau and images on the way there, so there are no moments to "
                    "take; record whole presses with more images a second, or leave out --moments"
                )
        if self.at_load < 1:
            if not (chosen & ~training).any():
                raise InputError(
                    f"no test press shows {self.at_load:.0%} of its load on the way to a plateau; record whole presses "
                    "with more images a second, or leave out --at-load"
                )
            meta = {**meta, "test_load": self.at_load}
        apart = (share[chosen] < 1).any()
        poses = np.array(self.poses)[chosen]
        check_pose_units(poses, self.taxel_xy)
        return Scan(
            np.array(self.readings)[chosen][:, kept], poses, np.array(self.labels)[chosen],
            np.array(self.split)[chosen], self.taxel_xy[kept], meta,
            presses=np.array(self.press)[chosen] if apart else None, moments=share[chosen] if apart else None,
        )  # fmt: skip

    def _shows_a_rise(self, follower: Follower) -> bool:
        """Tell whether a press has an image below its whole load that training asks for."""
        shares = self.shares
        if shares is None:
            return False
        lower = np.isin(shares, self.of_training) & (shares < 1)
        return any(found[lower].any() for found, _ in follower.moments.values())

    def _seldom_left_out(self, share: FloatArray, training: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Choose the readings (n,) whose share of the load at least half of the presses show, if that is automatic."""
        chosen = np.ones(len(share), dtype=bool)
        if self.automatic:
            number = {
                part: np.count_nonzero(training & (share == part))
                for part in set(share[training & (share < 1)].tolist())
            }
            for part, count in number.items():
                chosen &= ~training | (share != part) | (count >= max(number.values()) / 2)
        return chosen
