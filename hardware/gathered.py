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
from tactsim.core.scan import Scan
from tactsim.hardware.following import Follower


@dataclass
class Gathered:
    """Collects the presses of recordings, their moments, and the taxels that are wrong in one of them."""

    pad: Pad
    taxel_xy: FloatArray
    moments: int | Literal["auto"] | None
    readings: list[FloatArray] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    split: list[str] = field(default_factory=list)
    press: list[int] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    wrong: dict[int, str] = field(default_factory=dict)

    @property
    def shares(self) -> FloatArray | None:
        """Give the shares of the load at which images are wanted; None if moments are not."""
        return None if self.moments is None else shares_of(self.moments)

    def add(
        self,
        readings: FloatArray,
        presses: Sequence[tuple[str, str, tuple[float, float, float]]],
        follower: Follower,
    ) -> None:
        """Add presses (label, split, pose) with their readings (n, taxels) and what was found on the way."""
        shares = self.shares
        for number, (label, split, pose) in enumerate(presses):
            moments = [(1.0, readings[number])]
            if shares is not None and number in follower.moments:
                found, images = follower.moments[number]
                wanted = found if split == "train" else found & (shares == 1)
                moments = list(zip(shares[wanted].tolist(), images[wanted], strict=True))
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
        if self.moments is not None:
            chosen = self._seldom_left_out(share)
            lower = share[chosen] < 1
            if not lower.any():
                raise InputError(
                    "no press of the recording shows a plateau and images on the way there, so there are no moments to "
                    "take; record whole presses with more images a second, or leave out --moments"
                )
            presses = np.array(self.press)[chosen]
            meta = {
                **meta,
                "moments": {
                    "shares": sorted(set(share[chosen].tolist())), "of": "felt", "split": "train",
                    "presses": len(set(presses[lower].tolist())),
                },
            }  # fmt: skip
        return Scan(
            np.array(self.readings)[chosen][:, kept], np.array(self.poses)[chosen], np.array(self.labels)[chosen],
            np.array(self.split)[chosen], self.taxel_xy[kept], meta,
            presses=None if self.moments is None else np.array(self.press)[chosen],
        )  # fmt: skip

    def _seldom_left_out(self, share: FloatArray) -> NDArray[np.bool_]:
        """Choose the readings (n,) whose share of the load at least half of the presses show, if that is automatic."""
        chosen = np.ones(len(share), dtype=bool)
        if self.moments == "auto":
            most = max(np.count_nonzero(share == one) for one in set(share[share < 1].tolist()) or {1.0})
            for one in set(share[share < 1].tolist()):
                chosen &= (share != one) | (np.count_nonzero(share == one) >= most / 2)
        return chosen
